"""
Run an executable that sends itself signals at a chosen moment, for tests.

    python _signals.py PACKAGE EXECUTABLE MOMENT SIGNAL[,SIGNAL] [ARGUMENT...]

MOMENT is the end of a file's path and a function in it, such as rclpy/node.py:create_service. The signals
arrive at the first call of the function. The function <module> is the import of the file. This module runs as
a file: -m would import rclpy first.
"""

import contextlib
import importlib
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


def command(package: str, executable: str, moment: str, signals: Sequence[signal.Signals]) -> list[str]:
    """Return the command line."""
    numbers = ','.join(str(int(number)) for number in signals)
    return [sys.executable, __file__, package, executable, moment, numbers]


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


def main() -> None:
    """Run the executable, which ends the process."""
    package, executable, moment, numbers = sys.argv[1:5]
    del sys.argv[1:5]
    run = getattr(importlib.import_module(f'{package}.executables'), executable)
    with raising({moment: [signal.Signals(int(number)) for number in numbers.split(',')]}):
        run()


if __name__ == '__main__':
    main()
