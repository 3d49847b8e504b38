"""The bridge with a counter of its requests, for soak.py and network.py; prints the count when it ends."""

from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.simulator import simulation


def main() -> int:
    """Serve like the bridge; return its exit code."""
    handled = 0
    load = simulation.load

    def load_and_count(*arguments, **keywords):
        greenhouse = load(*arguments, **keywords)  # its reads at start-up do not count
        get_sensor_data = greenhouse.sim.get_sensor_data

        def count(tag_id):
            nonlocal handled
            handled += 1
            return get_sensor_data(tag_id)

        greenhouse.sim.get_sensor_data = count
        return greenhouse

    simulation.load = load_and_count
    exit_code = bridge_node.main()
    print(f'requests handled: {handled}', flush=True)
    return exit_code


if __name__ == '__main__':
    process.end(main())
