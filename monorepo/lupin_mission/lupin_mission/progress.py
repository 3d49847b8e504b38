"""A progress line at a terminal; nothing in a pipe. Does not import ROS."""

import os
import sys
from typing import TextIO


class ProgressLine:
    """Shows a text in the last line of a terminal, where it replaces the previous text."""

    def __init__(self, stream: TextIO | None = sys.stdout):
        """Write to this stream, which is None if it was closed before Python started."""
        self._stream = stream if stream and stream.isatty() else None
        self._text = ''

    def show(self, text: str) -> None:
        """Show a text, cut to the width of the terminal."""
        if self._stream and text != self._text:
            self._text = text
            columns = os.get_terminal_size(self._stream.fileno()).columns or 80
            print(f'\r\x1b[K{text[: columns - 1]}', end='', file=self._stream, flush=True)

    def clear(self) -> None:
        """Remove the text, so that something else can be printed there."""
        self.show('')
