"""
The bridge with instruments, which prints their results when it ends.

`count` prints the number of requests. `profile` prints one line of JSON: the median of each share of the
time of a reply in microseconds.
"""

import functools
import json
import statistics
import sys
import time
from collections.abc import Callable

from greenhouse_sim.simulator import GreenhouseSimulator
from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.simulator import simulation

HANDLER = (bridge_node.GreenhouseBridgeNode, '_handle_get_tag_reading')


def timed(owner, name: str, note: Callable[[float], None]) -> None:
    """Note the duration in us of each call of a function of a class or module."""
    function = getattr(owner, name)

    @functools.wraps(function)
    def run(*arguments):
        started = time.perf_counter_ns()
        try:
            return function(*arguments)
        finally:
            note((time.perf_counter_ns() - started) / 1000)

    setattr(owner, name, run)


def count() -> int:
    """Serve like the bridge, and print how many requests it handled; return its exit code."""
    handled = 0

    def note(_us: float) -> None:
        nonlocal handled
        handled += 1  # a list of durations would look like a leak

    timed(*HANDLER, note)
    exit_code = bridge_node.main()
    print(f'requests handled: {handled}', flush=True)
    return exit_code


def profile() -> int:
    """Serve like the bridge, and print where the time went; return its exit code."""
    simulator, read, handler = [], [], []
    timed(GreenhouseSimulator, 'get_sensor_data', simulator.append)
    timed(simulation, 'read', read.append)
    timed(*HANDLER, handler.append)
    exit_code = bridge_node.main()
    calls = len(handler)  # start-up also reads, before the first call
    in_simulator, in_read, in_handler = (
        statistics.median(durations[-calls:]) for durations in (simulator, read, handler)
    )
    shares = {
        'mdp-greenhouse': in_simulator,
        'checks of its values': in_read - in_simulator,
        'stamp and answer': in_handler - in_read,
        'calls': calls,
    }
    print(json.dumps(shares), flush=True)
    return exit_code


if __name__ == '__main__':
    process.end({'count': count, 'profile': profile}[sys.argv.pop(1)]())
