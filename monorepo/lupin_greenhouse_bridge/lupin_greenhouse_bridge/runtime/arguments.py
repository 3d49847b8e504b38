# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The values of a command's options. Does not import ROS."""

import argparse
import contextlib
import math
from collections.abc import Callable
from typing import Any, NoReturn, TypeVar

from lupin_greenhouse_bridge.errors import escaped

ValueT = TypeVar('ValueT', int, float)


class Parser(argparse.ArgumentParser):
    """A parser that takes options only by their full names; an error is one line."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, **options)

    def error(self, message: str) -> NoReturn:
        """End the program with one line, without the list of all options that argparse prints before it."""
        self.exit(2, f'{self.prog}: error: {message}\n')


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


SECONDS = number_type('a number of seconds above 0, such as 5', float, above=0.0)
DEGREES = number_type('a number of degrees, such as 30', float)
METRES = number_type('a number in metres, such as 0.5', float)
