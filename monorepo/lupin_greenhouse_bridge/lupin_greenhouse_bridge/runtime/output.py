# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What a command prints. Does not import ROS."""

import os
import sys


def print_line(text: str, stream=None, end: str = '\n') -> None:
    """Print a text, to standard output by default, unless the reader has closed the pipe."""
    stream = stream or sys.stdout
    try:
        print(text, end=end, file=stream, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
