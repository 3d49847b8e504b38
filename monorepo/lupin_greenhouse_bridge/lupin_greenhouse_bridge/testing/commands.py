# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
Run the main() of a node or a command in the test's process, and raise signals at a chosen moment.

A moment is the end of a file's path and a function in it, such as rclpy/node.py:create_service.
"""

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import FrameType

import pytest
from rclpy.utilities import get_default_context

from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.testing.helpers import require

SPINS = 'rclpy/executors.py:spin_once'  # the moment at which a node is ready
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
        for moment in [moment for moment in left if called.endswith(moment)]:
            print(f'signalled in {moment}', flush=True)
            for number in left.pop(moment):
                signal.raise_signal(number)

    sys.setprofile(watch if left else None)
    try:
        yield
    finally:
        sys.setprofile(None)


@dataclass(frozen=True)
class Ended:
    """What is left of a command that ran in the test's process."""

    command: str
    code: int
    out: str
    err: str

    @property
    def messages(self) -> str:
        """Return what the command itself printed to standard error, without the lines of the middleware."""
        prefixes = (f'{self.command}: ', 'usage: ')
        return '\n'.join(line for line in self.err.splitlines() if line.startswith(prefixes))

    @property
    def refusal(self) -> str:
        """Return the one FATAL line of a node that refused to start."""
        require(self.code == 1, self)
        fatal = [line for line in self.err.splitlines() if '[FATAL]' in line]
        require(len(fatal) == 1, self)
        return fatal[0]


@pytest.fixture
def run_here(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., Ended]]:
    """
    Return a function that runs a main() in the test's process, and raises signals at these moments.

    A main() takes the process for its own: it leaves signals ignored, and ROS's default context used up.
    """
    not_taken: list[int] = []
    before = {number: signal.getsignal(number) for number in process.SIGNALS}

    def run(
        main: Callable[[list[str]], int],
        *arguments: str,
        signals_at: dict[str, Sequence[signal.Signals]] | None = None,
    ) -> Ended:
        for number in process.SIGNALS:
            signal.signal(number, lambda number, _frame: not_taken.append(number))
        monkeypatch.setattr(process, '_is_asked_to_end', False)
        monkeypatch.setattr(process, 'LONGEST_WAIT_SECONDS', 0.01)  # of a node that was just signalled
        threads = threading.enumerate()
        capfd.readouterr()
        try:
            with raising(signals_at or {}):
                code = main([main.__module__, *arguments])
        except SystemExit as end:  # of argparse
            code = int(end.code or 0)
        finally:
            get_default_context(shutting_down=True).try_shutdown()
        # A thread that is left would log into the next test, and could overwrite what pytest reads then.
        left = set(threading.enumerate()).difference(threads)
        require(not left, left)
        ended = Ended(main.__module__.rpartition('.')[2], code, *capfd.readouterr())
        require('Traceback' not in ended.err, ended.err)
        require(not not_taken, not_taken)
        return ended

    yield run
    for number, handler in before.items():
        signal.signal(number, handler)
