# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What a command prints, and the file that it writes. Does not import ROS."""

import os
import sys
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import TextIO

from lupin_greenhouse_bridge.errors import UsageError

HEAD_BYTES = 4096


def aligned_table(rows: Sequence[Sequence[str]], numeric_columns: Collection[int]) -> list[str]:
    """Return a line for each row. Each column is as wide as its widest cell; numbers are aligned right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        '  '.join(
            cell.rjust(width) if column in numeric_columns else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def print_line(text: str, stream: TextIO | None = None, end: str = '\n') -> None:
    """Print a text, by default to standard output. A closed pipe (`| head`) ends the program."""
    try:
        print(text, end=end, file=stream, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes it again at the end
        sys.exit(1)


def check_output_file(
    path: Path, option: str, inputs: Iterable[tuple[str, str | Path | None]] = (), mark: bytes = b''
) -> None:
    """
    Raise UsageError if the file of an option cannot be written, before a command works for it.

    The output must not replace a file of `inputs`, which are pairs of an option and its file, nor a file
    without `mark` in its first bytes. The command writes this mark into each of its own files.
    """
    where, parent = f"{option} '{path}'", path.parent
    try:
        if path.is_dir():
            raise UsageError(f'{where} is a folder: name a file in it')
        if not parent.is_dir():
            raise UsageError(f"{where}: there is no folder '{parent}': name a folder that exists")
        if not os.access(path if path.exists() else parent, os.W_OK):
            raise UsageError(f'{where} is read-only: name another file')
        for input_option, input_file in inputs:
            if input_file and path.exists() and Path(input_file).exists() and path.samefile(input_file):
                raise UsageError(f'{where} is the file of {input_option} itself: name another file')
        if path.is_file():
            with path.open('rb') as file:
                head = file.read(HEAD_BYTES)
            if head and mark not in head:
                raise UsageError(f'{where} exists and is not from this program: name another file')
    except OSError as error:
        raise UsageError(f'{where}: {error.strerror}: name another file') from error


class ProgressLine:
    """
    The last line of a terminal, where each text replaces the previous one; nothing in a pipe.

    The cursor stays at its beginning, so that a line of another process on the terminal replaces it too.
    """

    def __init__(self, stream: TextIO | None) -> None:
        """Write to this stream, which is None if it was closed before Python started."""
        self.is_visible = stream is not None and stream.isatty()
        self._stream = stream
        self._text = ''

    def show(self, text: str) -> None:
        """Show a text, cut to the width of the terminal."""
        if self._stream and self.is_visible and text != self._text:
            self._text = text
            columns = os.get_terminal_size(self._stream.fileno()).columns or 80
            print_line(f'\r\x1b[K{text[: columns - 1]}\r', self._stream, end='')

    def clear(self) -> None:
        """Remove the text, so that something else can be printed there."""
        self.show('')


class Progress(ProgressLine):
    """The progress of a command, as the last line of standard error."""

    def __init__(self, command: str) -> None:
        super().__init__(sys.stderr)
        self._command = command

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show how much is done."""
        self.show(f'{self._command}: {what}: {done} of {total}')
