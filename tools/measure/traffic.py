"""
A bridge and its clients as processes; as a script, one such client.

A client calls a service repeatedly, one call at a time, and prints the counts as JSON. The requests that it
sends until its services have discovered it, its greetings, are counted separately.
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
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import rclpy
from lupin_greenhouse_bridge.contract import DEFAULT_SERVICE
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.reading import client as blocking_client
from lupin_greenhouse_bridge.reading.client import Client, NoAnswer
from lupin_greenhouse_bridge.runtime.run import ros
from shared import PATIENCE_SECONDS, Server

# What a client has counted: its greetings, calls, answered and timed out; its swapped ones, which are replies
# for another tag; its slowest in milliseconds; and the replies at each time of day, such as 12 h.
Counts: TypeAlias = 'Counter[str]'
TAG_IDS = [str(number) for number in range(1, 31) if number != 8]


class Bridge(Server):
    """A bridge process that counts its requests, and prints the count when it ends cleanly."""

    def __init__(self, *prefix: str, debug_time_of_day: float = 12.0):
        command = (*prefix, sys.executable, str(Path(__file__).with_name('counting_bridge.py')))
        super().__init__(*command, debug_time_of_day=debug_time_of_day)

    def has_handled(self, clients: Sequence[Counts]) -> tuple[str, bool]:
        """End it; return as a promise that it handled each call of its clients once."""
        exit_code, found = self.stop(), sum(clients, Counter())
        (handled,) = re.findall(r'^requests handled: (\d+)$', '\n'.join(self.log), re.MULTILINE)
        text = f'{handled} requests handled of {found["greetings"]} greetings and {found["calls"]} calls'
        # Of the greetings of a client, at least the one with the answer arrives.
        are_once = len(clients) <= int(handled) - found['calls'] <= found['greetings']
        return f'{text}, exit code {exit_code}', exit_code == 0 and are_once

    def ends_cleanly(self) -> tuple[str, bool]:
        """End it; return its exit code as a promise."""
        exit_code = self.stop()
        return f'exit code {exit_code}', exit_code == 0


class ClientProcess:
    """A client process; see main() for its options."""

    def __init__(self, *options: object, prefix: tuple[str, ...] = ()):
        command = [*prefix, sys.executable, __file__, *map(str, options)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        atexit.register(self.process.kill)

    def wait_for_first_answer(self) -> None:
        """Wait until the client has received a reply."""
        next(iter(self.process.stdout or ()))

    def go(self, service: str = DEFAULT_SERVICE) -> None:
        """Let a client that was started with --wait call a service."""
        print(service, file=self.process.stdin, flush=True)

    def counts_of_turn(self) -> Counts:
        """Return the counts of what go() began; the client waits for the next one."""
        return Counter(json.loads(next(iter(self.process.stdout or ()))))

    def counts(self) -> Counts:
        """Return the counts that the client prints when it ends; raise TimeoutExpired if it does not end."""
        output, _ = self.process.communicate(timeout=10 * PATIENCE_SECONDS)
        return Counter(json.loads(output.splitlines()[-1]))


def start_clients(count: int, *options: object) -> list[ClientProcess]:
    """Start clients with these options; return them when each of their services has replied."""
    clients = [ClientProcess(*options, '--first', number) for number in range(count)]
    for client in clients:
        client.wait_for_first_answer()
    return clients


def call_repeatedly(options: argparse.Namespace, ask: Callable[[str, float], Any]) -> Counts:
    """Call as often and as long as the options say; return the counts."""
    counts: Counts = Counter()
    end = time.monotonic() + options.seconds
    while counts['calls'] < options.calls and time.monotonic() < end:
        tag_id = TAG_IDS[(options.first + counts['calls']) % len(TAG_IDS)]
        counts['calls'] += 1
        started = time.monotonic()
        reading = ask(tag_id, options.timeout)
        counts['slowest'] = max(counts['slowest'], round(1000 * (time.monotonic() - started)))
        if reading is None:
            counts['timed out'] += 1
            continue
        counts['answered'] += 1
        counts['swapped'] += reading.tag_id != tag_id
        counts[f'{reading.sim_time_of_day_seconds / 3600:g} h'] += 1
        if options.pause:
            time.sleep(options.pause)
    return counts


def main() -> None:
    """Call, count, print."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('services', nargs='*', default=[DEFAULT_SERVICE])
    parser.add_argument('--calls', type=int, default=10**9, help='how many at the most')
    parser.add_argument('--seconds', type=float, default=600.0, help='how long at the most')
    parser.add_argument('--timeout', type=float, default=10.0, help='seconds for one call')
    parser.add_argument('--pause', type=float, default=0.0, help='seconds between two calls')
    parser.add_argument('--first', type=int, default=0, help='which tag comes first')
    parser.add_argument('--wait', action='store_true', help='for lines of input: which service to call')
    options = parser.parse_args()

    blocking_client.REPEAT_AFTER_SECONDS = 3600.0  # a call is one request here, so that they can be counted
    with ros([]) as executor:
        node = rclpy.create_node(f'traffic_{os.getpid()}')
        executor.add_node(node)
        connect = partial(Client(executor, node, PATIENCE_SECONDS).connect, GetTagReading)
        clients = {service: connect(service) for service in options.services}

        def ask(service: str, tag_id: str, timeout_seconds: float) -> Any:
            """Return the reading at a tag, None after a timeout."""
            request = GetTagReading.Request(tag_id=tag_id)
            try:
                return Client(executor, node, timeout_seconds).call(clients[service], request).reading
            except NoAnswer:
                return None

        # The client finds a service before the service finds the client; until then DDS drops its requests.
        greetings = 0
        for service in clients:
            greetings += 1
            while ask(service, TAG_IDS[0], 2.0) is None:
                greetings += 1
        print('first answer', flush=True)
        for service in map(str.strip, sys.stdin) if options.wait else clients:
            counts = call_repeatedly(options, partial(ask, service))
            print(json.dumps(counts | {'greetings': greetings}), flush=True)


if __name__ == '__main__':
    main()
