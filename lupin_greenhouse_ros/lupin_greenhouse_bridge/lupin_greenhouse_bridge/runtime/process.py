# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The signals that end a process, and the ROS domains for trials on one machine. Does not import ROS."""

import itertools
import os
import signal
import time
from collections.abc import Callable
from types import FrameType

LONGEST_WAIT_SECONDS = 0.5  # rclpy waits in C, and Python handles a signal only after the wait
SIGNALS = (signal.SIGINT, signal.SIGTERM)

_is_asked_to_end = False


def install_signal_handlers() -> None:
    """
    Record Ctrl-C and SIGTERM from now on, instead of letting them interrupt the code.

    rclpy's own handlers shut the context down while other code uses it. Python's raise KeyboardInterrupt
    anywhere. Either can turn a signal into a traceback.
    """

    def record(_number: int, _frame: FrameType | None) -> None:
        global _is_asked_to_end  # noqa: PLW0603 - a signal belongs to the process
        _is_asked_to_end = True

    for number in SIGNALS:
        signal.signal(number, record)


def is_asked_to_end() -> bool:
    """Return True once Ctrl-C or SIGTERM has arrived."""
    return _is_asked_to_end


def sleep(seconds: float) -> None:
    """Sleep for this time, or until Ctrl-C or SIGTERM."""
    end = time.monotonic() + seconds
    while not _is_asked_to_end and (left_seconds := end - time.monotonic()) > 0.0:
        time.sleep(min(left_seconds, LONGEST_WAIT_SECONDS))


def private_domains() -> Callable[[], int]:
    """Return the argument of domain_coordinator.domain_id(): the domains of no team (doc/README.md)."""
    return itertools.cycle(range(71, 102)).__next__


def variables_of_private_domain(domain_id: int) -> dict[str, str]:
    """Return the environment variables of a domain whose nodes communicate on this machine only."""
    is_humble = os.environ.get('ROS_DISTRO') == 'humble'
    visible = {'ROS_LOCALHOST_ONLY': '1'} if is_humble else {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    # A discovery server may be off, and is not needed on one machine.
    return {'ROS_DOMAIN_ID': str(domain_id), 'ROS_DISCOVERY_SERVER': '', **visible}
