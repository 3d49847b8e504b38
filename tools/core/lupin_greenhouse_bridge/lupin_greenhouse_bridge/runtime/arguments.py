"""The values of a command's options. Does not import ROS."""

import argparse
import contextlib
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from lupin_greenhouse_bridge.errors import escaped

ValueT = TypeVar('ValueT', int, float)


class Parser(argparse.ArgumentParser):
    """A parser that takes options only by their full names, and no empty words; an error is one line."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, **options)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the words; an empty one ends the program, because it stands for an unset variable."""
        words = sys.argv[1:] if args is None else list(args)
        for before, word in zip(['', *words], words, strict=False):
            if word == '' or (word.startswith('--') and word.endswith('=')):
                option = word[:-1] or before
                what = option if option.startswith('-') else 'an argument'
                self.error(f'{what} is empty: write a value, or leave it out')
        return super().parse_known_args(words, namespace)

    def error(self, message: str) -> NoReturn:
        """End the program with one line, without the list of all options that argparse prints before it."""
        message = re.sub(r'expected \d+ arguments', r'\g<0>, without quotes around them', message)
        has_advice = message.count(': ') > 1 or 'is empty' in message
        advice = '' if has_advice else ': see --help'
        self.exit(2, f'{self.prog}: error: {message}{advice}\n')


def number_type(
    accepted: str, kind: Callable[[str], ValueT], above: float = -math.inf, below: float = math.inf
) -> Callable[[str], ValueT]:
    """
    Return the type of an option of argparse: a finite number of a kind between two limits.

    `accepted` says in the error what the option "must be", such as `a number in metres, such as 0.5`.
    """

    def parse(text: str) -> ValueT:
        with contextlib.suppress(ValueError):
            if above < (value := kind(text)) < below:
                return value
        raise argparse.ArgumentTypeError(f'{escaped(repr(text), 100)}: must be {accepted}')

    return parse


def folder_type(text: str) -> Path:
    """Return the path of a folder, which may be new; the type of an option, for which x.pdf is no folder."""
    path = Path(text)
    if re.fullmatch(r'\.[A-Za-z]+', path.suffix) and not path.is_dir():
        raise argparse.ArgumentTypeError(f'{escaped(repr(text), 100)} is the name of a file: name a folder')
    return path


SECONDS = number_type('a number of seconds above 0, such as 5', float, above=0.0)
DEGREES = number_type('a number of degrees, such as 30', float)
METRES = number_type('a number in metres, such as 0.5', float)
