"""
Run the real bridge_node over the real simulator with one thing altered below it.

    python altered_bridge.py ALTERATION [--ros-args ...]

An alteration is a function of this module.
"""

import datetime
import itertools
import os
import sys
from pathlib import Path

from greenhouse_sim import simulator
from lupin_greenhouse_bridge import bridge_node


class Clock:
    """Stands for `datetime` in the simulator."""

    def __init__(self, now):
        self.now = now


def ticking_clock():
    """Let a second of wall time pass between any two looks of the simulator at its clock."""
    start = datetime.datetime(2026, 1, 1, 6, 0, 0)
    ticks = (start + datetime.timedelta(seconds=tick) for tick in itertools.count())
    simulator.datetime = Clock(lambda: next(ticks))


def driven_clock():
    """Give the simulator the wall time that stands in the file LUPIN_TEST_CLOCK, as HH:MM:SS."""
    clock = Path(os.environ['LUPIN_TEST_CLOCK'])
    simulator.datetime = Clock(lambda: datetime.datetime.strptime(clock.read_text(), '%H:%M:%S'))


if __name__ == '__main__':
    globals()[sys.argv.pop(1)]()
    sys.exit(bridge_node.main())
