# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Errors for the person who reads the log: one line each."""

import re
from collections.abc import Sequence


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
