"""Errors for the person who reads the log: one line each."""

import difflib
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path


class OneLineError(Exception):
    """An error whose text is one escaped line: what is wrong, where, and how to fix it."""

    def __init__(self, message: str) -> None:
        super().__init__(escaped(re.sub(r'\s*[\r\n]\s*', ' ', message), 1000))


class StartUpError(OneLineError):
    """A node cannot do what its parameters ask for."""


class UsageError(OneLineError):
    """An argument of the command line is invalid."""


class Interrupted(Exception):
    """Ctrl-C or SIGTERM ended a command before it was done."""


def refuse_typo(name: str, missing: Iterable[str], what: str) -> None:
    """Raise a StartUpError that begins with `what` if an unknown name resembles one that is missing."""
    if meant := meant_name(name, missing):
        raise StartUpError(f'{what} {escaped(name, 60)} is unknown: did you mean {meant}?')


def meant_name(name: str, missing: Iterable[str], alike: float = 0.8) -> str:
    """Return which of the missing names an unknown one resembles, by a ratio of difflib, or ''."""
    written = name.lower().replace('-', '_')
    return next(iter(difflib.get_close_matches(written, missing, n=1, cutoff=alike)), '')


def escaped(text: str, longest: int) -> str:
    """Return text cut to `longest` characters, with control characters (new lines too) escaped."""
    shown = ''.join(c if c.isprintable() else c.encode('unicode_escape').decode() for c in text[:longest])
    return shown if len(text) <= longest else f'{shown}...'


def reason_of(error: Exception) -> str:
    """Return why a file cannot be read or written, without the number and the path of an OSError."""
    return getattr(error, 'strerror', None) or str(error)


def pluralized(count: int, thing: str) -> str:
    """Return a count with its noun, such as 1 tag or 29 tags."""
    return f'{count} {thing}' if count == 1 else f'{count} {thing}s'


def names_text(thing: str, names: Sequence[str], most: int) -> str:
    """Return `tag 7`, `tags 7 and 8` or, with more names than `most`, `tags 7, 8 and 3 more`."""
    more = [f'{len(names) - most:,} more'] if len(names) > most else []
    *first, last = [*(escaped(name, 64) for name in names[:most]), *more]
    return f'{thing}s {", ".join(first)} and {last}' if first else f'{thing} {last}'


def is_environment_of_make() -> bool:
    """Return whether this process runs in the environment that make has made."""
    return sys.prefix != sys.base_prefix and Path(sys.prefix, 'local_setup.bash').exists()


def source_of_messages(package: str) -> str:
    """Return how to get a ROS package of messages, of which the environment of make has a stand-in."""
    if is_environment_of_make():
        return 'write `python3 ci/within.py --stand-ins` before the command'
    return f'sudo apt install ros-$ROS_DISTRO-{package.replace("_", "-")}'
