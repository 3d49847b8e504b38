"""What a command prints. Does not import ROS."""

import sys
import time
from collections.abc import Collection, Sequence
from typing import TextIO

from lupin_greenhouse_bridge.runtime.process import lose_output


def column_widths(rows: Sequence[Sequence[str]], at_least: Sequence[int] | None = None) -> list[int]:
    """Return the width of each column in characters, none of them narrower than `at_least`."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return list(map(max, widths, at_least)) if at_least else widths


def aligned_table(
    rows: Sequence[Sequence[str]], numeric_columns: Collection[int], widths: Sequence[int] | None = None
) -> list[str]:
    """Return a line for each row. Each column is as wide as its widest cell; numbers are aligned right."""
    widths = widths or column_widths(rows)
    return [
        '  '.join(
            cell.rjust(width) if column in numeric_columns else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def print_line(text: str, stream: TextIO | None = None, end: str = '\n') -> None:
    """Print a text, by default to standard output. If the output is full or closed, the command continues."""
    try:
        print(text, end=end, file=stream, flush=True)
    except OSError as error:
        if stream is None:
            lose_output(error)


class Progress:
    """A line on standard error about work that takes long. A terminal's is rewritten, others follow."""

    FIRST_SECONDS, REWRITTEN_SECONDS, NEXT_SECONDS = 3.0, 0.2, 15.0

    def __init__(self, command: str) -> None:
        """Take the name of the command."""
        self._command, self._width, self._due = command, 0, time.monotonic() + self.FIRST_SECONDS

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show how much of what is done, if it is time to."""
        now = time.monotonic()
        if now < self._due:
            return
        is_terminal = sys.stderr.isatty()
        self._due = now + (self.REWRITTEN_SECONDS if is_terminal else self.NEXT_SECONDS)
        text = f'{self._command}: {what}: {done} of {total}'
        if is_terminal:
            text, self._width = '\r' + text.ljust(self._width), len(text)
        print_line(text, sys.stderr, end='' if is_terminal else '\n')

    def end(self) -> None:
        """Wipe the line off a terminal."""
        if self._width:
            print_line('\r' + ' ' * self._width + '\r', sys.stderr, end='')
            self._width = 0
