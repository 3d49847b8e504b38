"""
Run the real bridge_node over the real simulator with one thing altered below it.

    python altered_bridge.py ALTERATION [--ros-args ...]

An alteration is a function of this module.
"""

import datetime
import itertools
import os
import sys
import threading
from pathlib import Path

import rclpy
from greenhouse_sim import simulator
from lupin_greenhouse_bridge import bridge_node, simulation


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


def signalled_in_start_up():
    """Send this process the signal LUPIN_TEST_SIGNAL while it loads, and go on once ROS has noticed."""
    load = simulation.load

    def load_and_signal(*arguments, **keywords):
        greenhouse = load(*arguments, **keywords)
        os.kill(os.getpid(), int(os.environ['LUPIN_TEST_SIGNAL']))
        noticed = threading.Event()
        while rclpy.ok():
            noticed.wait(0.01)
        return greenhouse

    simulation.load = load_and_signal


if __name__ == '__main__':
    globals()[sys.argv.pop(1)]()
    sys.exit(bridge_node.main())
