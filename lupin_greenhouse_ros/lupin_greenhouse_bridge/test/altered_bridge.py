# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
Run the real bridge_node and the real simulator with one alteration below the node.

    python altered_bridge.py ALTERATION [--ros-args ...]

An alteration is a function of this module.
"""

import datetime
import itertools
import sys
from types import SimpleNamespace

import numpy
from greenhouse_sim import simulator
from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.simulator import simulation


def ticking_clock():
    """Let a second of wall time pass between any two reads of the simulator's clock."""
    start = datetime.datetime(2026, 1, 1, 6, 0, 0)
    ticks = (start + datetime.timedelta(seconds=tick) for tick in itertools.count())
    simulator.datetime = SimpleNamespace(now=lambda: next(ticks))


def faulty_simulator():
    """Serve three tags, named after what they return."""

    def fail():
        raise RuntimeError('the sensor is on fire\ntwo\x1b[2J')

    answers = {
        'good': lambda: {'timestamp': 43200, 'co2': 21.5},
        'numpy': lambda: {'timestamp': numpy.int64(43200), 'co2': numpy.float32(3)},
        'fault': fail,
    }
    load = simulation.load

    def load_and_spoil(*arguments, **keywords):
        greenhouse = load(*arguments, **keywords)
        greenhouse.sim.get_sensor_data = lambda tag_id: answers[tag_id]()
        return greenhouse._replace(tag_ids=list(answers))

    simulation.load = load_and_spoil


if __name__ == '__main__':
    globals()[sys.argv.pop(1)]()
    process.end(bridge_node.main())
