"""
A bridge and its clients as processes, for soak.py and network.py; as a script, one such client.

A client calls the bridge repeatedly, one call at a time, and prints the counts as JSON. The requests that it
sends until the bridge has discovered it, its greetings, are counted separately.
"""

import argparse
import atexit
import json
import os
import re
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import rclpy
from lupin_greenhouse_bridge.contract import DEFAULT_SERVICE
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.reading import client as blocking_client
from lupin_greenhouse_bridge.reading.client import Client, NoAnswer
from lupin_greenhouse_bridge.runtime.run import ros
from shared import PATIENCE_SECONDS, Server

HERE = Path(__file__).resolve().parent
TAG_IDS = [str(number) for number in range(1, 31) if number != 8]
blocking_client.REPEAT_AFTER_SECONDS = 3600.0  # a call is one request here, so that they can be counted


class Bridge(Server):
    """A bridge process that counts its requests, and prints the count when it ends cleanly."""

    def __init__(self, *prefix: str, **parameters):
        overrides = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
        script = [sys.executable, str(HERE / 'instrumented_bridge.py'), 'count']
        super().__init__([*prefix, *script, '--ros-args', *overrides])

    def handled(self) -> tuple[int, int]:
        """End it; return the exit code and the number of requests it has handled."""
        exit_code, output = self.stop()
        found = re.search(r'^requests handled: (\d+)$', output, re.MULTILINE)
        return exit_code, int(found[1]) if found else -1

    def ends_cleanly(self) -> tuple[str, bool]:
        """End it; return its exit code as a promise."""
        exit_code, _ = self.stop()
        return f'exit code {exit_code}', exit_code == 0


class ClientProcess:
    """A client process; see main() for its options."""

    def __init__(self, *options: str, prefix: tuple[str, ...] = ()):
        command = [*prefix, sys.executable, str(HERE / 'traffic.py'), *options]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        atexit.register(self.process.kill)

    def wait_for_first_answer(self) -> None:
        """Wait until the client has received a reply."""
        self.process.stdout.readline()

    def go(self) -> None:
        """Release a client that was started with --wait."""
        self.process.stdin.write('go\n')
        self.process.stdin.flush()

    def result(self) -> dict:
        """Return the counts that the client prints when it ends; raise TimeoutExpired if it does not end."""
        output, _ = self.process.communicate(timeout=10 * PATIENCE_SECONDS)
        return json.loads(output.splitlines()[-1])


def main() -> int:
    """Call, count, print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--calls', type=int, default=10**9, help='how many at the most')
    parser.add_argument('--seconds', type=float, default=600.0, help='how long at the most')
    parser.add_argument('--timeout', type=float, default=10.0, help='seconds for one call')
    parser.add_argument('--pause', type=float, default=0.0, help='seconds between two calls')
    parser.add_argument('--first', type=int, default=0, help='which tag comes first')
    parser.add_argument(
        '--wait', action='store_true', help='after the first answer, for a line on standard input'
    )
    options = parser.parse_args()

    with ros([]) as executor:
        node = rclpy.create_node(f'traffic_{os.getpid()}')
        executor.add_node(node)
        get_tag_reading = Client(executor, node, PATIENCE_SECONDS).connect(GetTagReading, DEFAULT_SERVICE)

        def ask(tag_id: str, timeout_seconds: float):
            """Return the reading at a tag, None after a timeout."""
            request = GetTagReading.Request(tag_id=tag_id)
            try:
                return Client(executor, node, timeout_seconds).call(get_tag_reading, request).reading
            except NoAnswer:
                return None

        # The client finds the bridge before the bridge finds the client; until then DDS drops its requests.
        greetings = 1
        while ask(TAG_IDS[0], 2.0) is None:
            greetings += 1
        print('first answer', flush=True)
        if options.wait:
            sys.stdin.readline()
        print(json.dumps({'greetings': greetings, **ask_on(ask, options)}), flush=True)
    return 0


def ask_on(ask, options) -> dict:
    """Call as often and as long as the options say; return the counts."""
    counts = {'calls': 0, 'answered': 0, 'timed_out': 0, 'wrong': 0, 'sim_times': Counter()}
    slowest_seconds = 0.0
    end = time.monotonic() + options.seconds
    while counts['calls'] < options.calls and time.monotonic() < end:
        tag_id = TAG_IDS[(options.first + counts['calls']) % len(TAG_IDS)]
        counts['calls'] += 1
        started = time.monotonic()
        reading = ask(tag_id, options.timeout)
        slowest_seconds = max(slowest_seconds, time.monotonic() - started)
        if reading is None:
            counts['timed_out'] += 1
            continue
        counts['answered'] += 1
        counts['wrong'] += reading.tag_id != tag_id
        counts['sim_times'][reading.sim_time_of_day_seconds] += 1
        if options.pause:
            time.sleep(options.pause)
    return {**counts, 'slowest_seconds': round(slowest_seconds, 3)}


if __name__ == '__main__':
    sys.exit(main())
