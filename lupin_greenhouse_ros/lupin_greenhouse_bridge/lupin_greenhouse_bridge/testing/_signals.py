# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
Signals at a chosen moment, for tests.

A moment is the end of a file's path and a function in it, such as rclpy/node.py:create_service.
"""

import contextlib
import signal
import sys
from collections.abc import Iterator, Sequence
from types import FrameType

SIGNALS = {
    'Ctrl-C': (signal.SIGINT,),
    'Ctrl-C twice': (signal.SIGINT, signal.SIGINT),
    'SIGTERM': (signal.SIGTERM,),
    'SIGTERM and Ctrl-C': (signal.SIGTERM, signal.SIGINT),
}


@contextlib.contextmanager
def raising(signals_at: dict[str, Sequence[signal.Signals]]) -> Iterator[None]:
    """Raise signals in this thread at the first call of each of these functions, by moment."""
    left = dict(signals_at)
    functions = {moment.rpartition(':')[2] for moment in left}

    def watch(frame: FrameType, event: str, _argument: object) -> None:
        code = frame.f_code
        if event != 'call' or code.co_name not in functions:
            return
        called = f'{code.co_filename}:{code.co_name}'
        for moment in [each for each in left if called.endswith(each)]:
            print(f'signalled in {moment}', flush=True)
            for number in left.pop(moment):
                signal.raise_signal(number)

    sys.setprofile(watch if left else None)
    try:
        yield
    finally:
        sys.setprofile(None)
