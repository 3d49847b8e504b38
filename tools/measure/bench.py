"""
Compare the bridge with the plain wrapper of the simulator that teams used before it.

It prints a table, and writes bench.json into .bench/. SHORT=1 takes a minute, for a look.

Every ratio is measured within one run, in which the servers take turns. A ratio is the median of its rounds,
with the middle half of them in brackets. --subject and --baseline replace the commands of the bridge and of
the plain wrapper. If you swap them, the ratios invert.
"""

import argparse
import contextlib
import json
import os
import platform
import shlex
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import rclpy
from lupin_greenhouse_bridge.errors import OneLineError, pluralized
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.reading.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from shared import PATIENCE_SECONDS, Server, in_turns, own_domain, parser_of
from traffic import ClientProcess, Counts, start_clients

HERE = Path(__file__).resolve().parent
BRIDGE = f'{os.environ["LUPIN_EXECUTABLES"]}/bridge_node'
PLAIN_WRAPPER = f'{sys.executable} {HERE / "plain_wrapper.py"}'
PARTS = ('latency', 'throughput', 'start', 'idle')
LOST_AFTER_SECONDS = 0.1  # short, because a client that waits longer for a lost reply makes fewer calls
Array: TypeAlias = 'npt.NDArray[np.float64]'


class NamedServer(Server):
    """A server in the namespace of its name."""

    def __init__(self, command: str, name: str):
        self.service = f'/{name}/greenhouse_bridge/get_tag_reading'
        super().__init__(*shlex.split(command), namespace=f'/{name}')

    def cpu_seconds(self) -> float:
        """Return the processor time of all its threads so far, to the nanosecond."""
        tasks = Path(f'/proc/{self.process.pid}/task').glob('*/schedstat')
        return sum(int(task.read_text().split()[0]) for task in tasks) * 1e-9


@contextlib.contextmanager
def asking(*services: str) -> Iterator[Callable[[int], Array]]:
    """
    Yield a function that asks the services for tag 1, this often each, by a participant of its own.

    It returns the microseconds of each call, a column for each service. Discovery is complete: each service
    has replied once. Raises NoAnswer.
    """
    context = Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node(f'bench_{os.getpid()}', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    client = Client(executor, node, PATIENCE_SECONDS)
    clients = [client.connect(GetTagReading, service) for service in services]

    def microseconds(number: int) -> float:
        started = time.perf_counter_ns()
        client.call(clients[number], GetTagReading.Request(tag_id='1'))
        return (time.perf_counter_ns() - started) / 1000

    def latencies(calls: int) -> Array:
        return np.array(in_turns([partial(microseconds, number) for number in range(len(clients))], calls))

    latencies(1)
    yield latencies
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


class Bench:
    """Measures, and prints the table row by row."""

    def __init__(self, options: argparse.Namespace, subject: NamedServer, baseline: NamedServer):
        self.options = options
        self.rounds = 4 if options.short else 20
        self.servers = (subject, baseline)
        self.services = [subject.service, baseline.service]
        self.commands: tuple[str, str] = (options.subject, options.baseline)
        self.rows: list[dict[str, Any]] = []

    def ratio(self, figure: str, unit: str, pairs: npt.ArrayLike) -> None:
        """Keep a figure: a row (subject, baseline) of each round."""
        rounds = np.asarray(pairs)
        low, ratio, high = np.quantile(rounds[:, 0] / rounds[:, 1], (0.25, 0.5, 0.75))
        subject, baseline = np.median(rounds, axis=0)
        row = {'figure': figure, 'subject': subject, 'baseline': baseline, 'unit': unit, 'ratio': ratio}
        row |= {'middle_half': [low, high], 'rounds': len(rounds)}
        self.rows.append(row)
        spread = f' [{low:.3f}, {high:.3f}]' if len(rounds) > 1 else ''
        sides = [f'{value:,.0f}' if value >= 1000 else f'{value:.4g}' for value in (subject, baseline)]
        print(f'| {figure} | {sides[0]} {unit} | {sides[1]} {unit} | {ratio:.3f}{spread} |', flush=True)

    def latency(self) -> None:
        """
        Time the round trips of one client to each server.

        Restarts the servers for each round, because processes of the same program differ more than calls do.
        """
        calls = 200 if self.options.short else 1000
        results = []
        for number in range(self.rounds):
            commands = list(enumerate(self.commands))
            with contextlib.ExitStack() as stack:
                services = [
                    stack.enter_context(closing(NamedServer(command, f's{place}'))).service
                    for place, command in (commands if number % 2 else reversed(commands))
                ]
                latencies = stack.enter_context(asking(*sorted(services)))
                latencies(200)  # the first calls are slower
                results.append(latencies(calls))
        for percent in (50, 90, 99):
            self.ratio(f'round trip p{percent}', 'us', np.percentile(results, percent, axis=1))

    def throughput(self) -> None:
        """Count the calls per second of several client processes at once."""
        seconds = 0.2 if self.options.short else 0.7
        limits = ('--seconds', seconds, '--timeout', LOST_AFTER_SECONDS)
        for count in (1, 4, 16):
            clients = start_clients(count, *self.services, '--wait', *limits)

            def counts(service: str, clients: Sequence[ClientProcess] = clients) -> Counts:
                for client in clients:
                    client.go(service)
                return sum((client.counts_of_turn() for client in clients), Counter())

            counts(self.services[0])  # the first calls are slower
            sides = [partial(counts, service) for service in self.services]
            results = in_turns(sides, max(4, self.rounds // 2))
            for client in clients:
                client.process.communicate()
            name = pluralized(count, 'client')
            # On an overloaded machine, a turn may end before the first answer.
            rates = [[max(side['answered'], 1) / seconds for side in sides] for sides in results]
            self.ratio(f'throughput, {name}', 'calls/s', rates)
            lost = [sum(each['timed out'] for each in side) for side in zip(*results, strict=True)]
            figure = f'{name}: no reply within {LOST_AFTER_SECONDS:g} s'
            self.rows.append({'figure': figure, 'subject': lost[0], 'baseline': lost[1]})
            print(f'| {figure} | {lost[0]} | {lost[1]} |  |', flush=True)

    def start(self) -> None:
        """Time a server from the start of its process to its first reply."""

        def milliseconds(command: str) -> float:
            started = time.perf_counter()
            with closing(NamedServer(command, 'started')) as server, asking(server.service):
                return 1000 * (time.perf_counter() - started)

        sides = [partial(milliseconds, command) for command in self.commands]
        self.ratio('start to first answer', 'ms', in_turns(sides, 4 if self.options.short else 12))

    def idle(self) -> None:
        """Compare memory, and processor time while no client asks."""
        self.ratio('resident memory', 'kB', [[server.resources()['RSS in kB'] for server in self.servers]])
        seconds = 1.0 if self.options.short else 3.0
        used = [[server.cpu_seconds() for server in self.servers]]
        for _ in range(2 if self.options.short else 5):
            time.sleep(seconds)
            used.append([server.cpu_seconds() for server in self.servers])
        self.ratio('processor at idle', 'us/s', np.maximum(np.diff(used, axis=0), 1e-9) / seconds * 1e6)


def main() -> int:
    """Measure, print, write."""
    parser = parser_of(__doc__, 'fewer rounds: for a look, not for quoting')
    parts = ' '.join(PARTS)
    parser.add_argument('--only', nargs='+', default=PARTS, choices=PARTS, metavar='PART', help=parts)
    parser.add_argument('--subject', default=BRIDGE, metavar='COMMAND')
    parser.add_argument('--baseline', default=PLAIN_WRAPPER, metavar='COMMAND')
    parser.add_argument('--output', type=Path, default=HERE.parents[1] / '.bench', metavar='FOLDER')
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    print('|  | bridge | plain wrapper, or as named | ratio [middle half] |\n|---|---|---|---|', flush=True)
    try:
        with (
            own_domain(),
            closing(NamedServer(options.subject, 'subject')) as subject,
            closing(NamedServer(options.baseline, 'baseline')) as baseline,
        ):
            bench = Bench(options, subject, baseline)
            for part in options.only:
                getattr(bench, part)()
    except OneLineError as error:
        sys.exit(f'bench: {error}')
    conditions = {
        'python': platform.python_version(),
        'ros_distro': os.environ.get('ROS_DISTRO'),
        'processors': os.cpu_count(),
        'seconds': round(time.monotonic() - started),
        'short': options.short,
    }
    result = options.output / 'bench.json'
    result.write_text(json.dumps({'conditions': conditions, 'figures': bench.rows}, indent=2) + '\n')
    print(f'\n{conditions["seconds"]} s on {conditions["processors"]} processors; {result}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
