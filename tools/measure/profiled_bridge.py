"""
The bridge with stopwatches, for bench.py; prints when it ends where the time of its replies went.

Prints one line of JSON with the median of each share in microseconds.
"""

import functools
import json
import statistics
import time

from greenhouse_sim.simulator import GreenhouseSimulator
from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.simulator import simulation


def timed(owner, name: str) -> list[float]:
    """Time the calls of a function of a class or module; return the list of the durations in us."""
    function, durations = getattr(owner, name), []

    @functools.wraps(function)
    def run(*arguments):
        started = time.perf_counter_ns()
        try:
            return function(*arguments)
        finally:
            durations.append((time.perf_counter_ns() - started) / 1000)

    setattr(owner, name, run)
    return durations


def main() -> int:
    """Serve like the bridge; return its exit code."""
    handler = timed(bridge_node.GreenhouseBridgeNode, '_handle_get_tag_reading')
    read = timed(simulation, 'read')
    simulator = timed(GreenhouseSimulator, 'get_sensor_data')
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
    process.end(main())
