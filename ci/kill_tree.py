"""
Run a command, and end every process that it has started when it ends or is interrupted.

    python ci/kill_tree.py COMMAND [ARGUMENT...]

Ctrl-C in a shell script does not reach background jobs, nor what `timeout` runs, nor processes in a session
of their own. This process therefore adopts orphaned descendants (PR_SET_CHILD_SUBREAPER), so that it can find
each of them. On SIGINT, SIGTERM or SIGHUP it sends them SIGTERM, and SIGKILL to those that remain.

The exit code is that of the command, or 128 plus the number of the signal.
"""

import contextlib
import ctypes
import signal
import subprocess
import sys
from types import FrameType
from typing import NoReturn

import psutil

PR_SET_CHILD_SUBREAPER = 36  # linux/prctl.h
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SECONDS_TO_END = 2.0  # from SIGTERM to SIGKILL


def interrupt(number: int, _frame: FrameType | None) -> NoReturn:
    """Raise SystemExit, once."""
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    sys.exit(128 + number)


def end_descendants() -> None:
    """End every descendant: SIGTERM first, then SIGKILL to those that remain."""
    this = psutil.Process()
    # Twice: what loses its parent while /proc is read is in no tree at that moment.
    while processes := this.children(recursive=True) or this.children(recursive=True):
        for process in processes:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.terminate()
        _, remaining = psutil.wait_procs(processes, timeout=SECONDS_TO_END)
        for process in remaining:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()


def main() -> int:
    """Run the command; return its exit code."""
    if not sys.argv[1:]:
        sys.exit('usage: python ci/kill_tree.py COMMAND [ARGUMENT...]')
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    try:
        for number in SIGNALS:
            signal.signal(number, interrupt)
        # In a session of its own, so that Ctrl-C arrives here first.
        code = subprocess.Popen(sys.argv[1:], start_new_session=True).wait()
        return code if code >= 0 else 128 - code
    finally:
        end_descendants()


if __name__ == '__main__':
    sys.exit(main())
