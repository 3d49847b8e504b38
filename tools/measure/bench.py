"""
Compare the bridge with the plain wrapper of the simulator that teams used before it.

    make bench              takes five minutes; prints a table and writes bench.json into .bench/
    make bench SHORT=1      takes a minute, for a look

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
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from lupin_greenhouse_bridge.errors import OneLineError, pluralized
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.reading.client import Client
from rclpy.client import Client as ServiceClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from shared import PATIENCE_SECONDS, Server, in_turns, own_domain, parser_of, percentile
from traffic import ClientProcess, Counts, start_clients, total_of

HERE = Path(__file__).resolve().parent
BRIDGE = f'{os.environ["LUPIN_EXECUTABLES"]}/bridge_node'
PLAIN_WRAPPER = f'{sys.executable} {HERE / "plain_wrapper.py"}'
CANNED_REPLIES = f'{sys.executable} {HERE / "canned_replies.py"}'
LOST_AFTER_SECONDS = 0.1  # short, because a client that waits longer for a lost reply makes fewer calls
# The ratio of the subject to the baseline: of throughput at least this, of the others at most.
TARGETS = {
    'round trip p50': 1.00,
    'round trip p99': 1.00,
    'throughput, 1 client': 1.00,
    'throughput, 16 clients': 1.00,
    'resident memory': 1.10,
    'processor at idle': 1.10,
    '100,000 tags to 29: p50': 1.05,
}


class NamedServer(Server):
    """A server in the namespace of its name."""

    def __init__(self, command: str, name: str, **parameters: object):
        self.service = f'/{name}/greenhouse_bridge/get_tag_reading'
        super().__init__(*shlex.split(command), namespace=f'/{name}', **parameters)

    def cpu_seconds(self) -> float:
        """Return the processor time of all its threads so far, to the nanosecond."""
        tasks = Path(f'/proc/{self.process.pid}/task').glob('*/schedstat')
        return sum(int(task.read_text().split()[0]) for task in tasks) * 1e-9


class Figure(NamedTuple):
    """What was measured: the subject and the baseline in each round."""

    name: str
    unit: str
    pairs: Sequence[tuple[float, ...]]
    note: str = ''


class Setup(NamedTuple):
    """What the parts measure: two servers, and the options of the command line."""

    servers: tuple[NamedServer, NamedServer]
    options: argparse.Namespace
    rounds: int


@contextlib.contextmanager
def asking(*servers: NamedServer) -> Iterator[Callable[[int], list[list[float]]]]:
    """
    Yield a function that calls each server this often for tag 1, in turns, by one participant.

    It returns the durations of the calls to each server in microseconds, sorted.
    """
    context = Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node(f'bench_{os.getpid()}', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    client = Client(executor, node, PATIENCE_SECONDS)

    def microseconds(service: 'ServiceClient[Any, Any]') -> float:
        started = time.perf_counter_ns()
        client.call(service, GetTagReading.Request(tag_id='1'))
        return (time.perf_counter_ns() - started) / 1000

    measures = [partial(microseconds, client.connect(GetTagReading, each.service)) for each in servers]

    def durations(calls: int) -> list[list[float]]:
        return [sorted(of_server) for of_server in zip(*in_turns(measures, calls), strict=True)]

    try:
        durations(200)  # the first calls are slower
        yield durations
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def latency(setup: Setup) -> Iterator[Figure]:
    """
    Time the round trips of one client to each server, and to one that only sends canned replies.

    Restarts the servers for each round, because processes of the same program differ more than calls do.
    """
    commands = [setup.options.subject, setup.options.baseline, CANNED_REPLIES]
    results = []
    for number in range(setup.rounds):
        with ExitStack() as stack:
            order = sorted(range(3), reverse=number % 2 == 0)
            started = {n: stack.enter_context(closing(NamedServer(commands[n], f's{n}'))) for n in order}
            durations = stack.enter_context(asking(*(started[n] for n in range(3))))
            results.append(durations(200 if setup.options.short else 1000))
    for name, share in (('p50', 0.5), ('p99', 0.99)):
        pairs = [(percentile(ours, share), percentile(theirs, share)) for ours, theirs, _ in results]
        yield Figure(f'round trip {name}', 'us', pairs)
    pairs = [(percentile(ours, 0.5), percentile(floor, 0.5)) for ours, _, floor in results]
    yield Figure('bridge to canned replies: p50', 'us', pairs, 'a server that reads no simulator')


def throughput(setup: Setup) -> Iterator[Figure]:
    """Count the calls per second of several client processes at once, and the replies that were lost."""
    seconds = 0.2 if setup.options.short else 0.7
    services = [server.service for server in setup.servers]
    for count in (1, 16):
        limits = ('--seconds', seconds, '--timeout', LOST_AFTER_SECONDS)
        clients = start_clients(count, *services, '--wait', *limits)

        def counts(service: str, clients: Sequence[ClientProcess] = clients) -> Counts:
            for client in clients:
                client.go(service)
            return total_of([client.counts_of_turn() for client in clients])

        counts(services[0])  # the first calls are slower
        results = in_turns([partial(counts, service) for service in services], max(4, setup.rounds // 2))
        for client in clients:
            client.process.communicate()
        name = pluralized(count, 'client')
        rates = [tuple(max(each.answered, 1) / seconds for each in sides) for sides in results]
        yield Figure(f'throughput, {name}', 'calls/s', rates)
        lost = tuple(sum(each.timed_out for each in side) for side in zip(*results, strict=True))
        yield Figure(f'{name}: no reply within {LOST_AFTER_SECONDS:g} s', '', [lost])


def idle(setup: Setup) -> Iterator[Figure]:
    """Compare memory, and processor time while no client asks."""
    yield Figure('resident memory', 'kB', [tuple(server.status('VmRSS') for server in setup.servers)])
    seconds = 1.0 if setup.options.short else 3.0
    pairs = []
    for _ in range(2 if setup.options.short else 5):
        before = [server.cpu_seconds() for server in setup.servers]
        time.sleep(seconds)
        after = [server.cpu_seconds() for server in setup.servers]
        pairs.append(tuple(max(b - a, 1e-9) / seconds * 1e6 for a, b in zip(before, after, strict=True)))
    yield Figure('processor at idle', 'us/s', pairs)


def growth(setup: Setup) -> Iterator[Figure]:
    """Compare a bridge with many tags with one of 29."""
    with ExitStack() as stack:
        servers = []
        for count in (100_000, 29):
            tag_file = setup.options.output / f'{count}.json'
            tag = {'x': 1.0, 'y': 1.0, 'sensors': ['temperature', 'co2']}
            tag_file.write_text(json.dumps({str(number): tag for number in range(1, count + 1)}))
            server = NamedServer(setup.options.subject, f'tags{count}', tag_file=f'"{tag_file}"')
            servers.append(stack.enter_context(closing(server)))
        durations = stack.enter_context(asking(*servers))
        rounds = [durations(200 if setup.options.short else 500) for _ in range(setup.rounds)]
    pairs = [tuple(percentile(of_server, 0.5) for of_server in each) for each in rounds]
    yield Figure('100,000 tags to 29: p50', 'us', pairs)


PARTS = {part.__name__: part for part in (latency, throughput, idle, growth)}


def verdict(ratio: float, low: float, high: float, target: float, *, is_least: bool) -> str:
    """Return 'met', 'within noise' if the middle half of the rounds spans the target, or 'MISSED'."""
    if ratio == target or (ratio > target) == is_least:
        return 'met'
    return 'within noise' if low <= target <= high else 'MISSED'


def row_of(figure: Figure) -> dict[str, Any]:
    """Return the statistics of a figure, with the verdict if it has a target."""
    subject, baseline = map(statistics.median, zip(*figure.pairs, strict=True))
    row = {'figure': figure.name, 'subject': subject, 'baseline': baseline, 'unit': figure.unit}
    if not figure.unit:  # a count, which may be 0
        return row
    ratios = sorted(subject / baseline for subject, baseline in figure.pairs)
    ratio, low, high = statistics.median(ratios), percentile(ratios, 0.25), percentile(ratios, 0.75)
    row |= {'ratio': ratio, 'middle_half': [low, high], 'rounds': len(ratios), 'note': figure.note}
    if target := TARGETS.get(figure.name):
        is_least = figure.name.startswith('throughput')
        row |= {'target': target, 'verdict': verdict(ratio, low, high, target, is_least=is_least)}
        row['note'] = f'{">=" if is_least else "<="} {target:.2f} {row["verdict"]}'
    return row


def line_of(row: dict[str, Any]) -> str:
    """Return a row of the printed table."""
    ratio = f'{row["ratio"]:.3f}' if 'ratio' in row else ''
    if row.get('rounds', 1) > 1:
        ratio += ' [{:.3f}, {:.3f}]'.format(*row['middle_half'])
    sides = (
        f'{value:,.0f}' if value >= 1000 else f'{value:.4g}' for value in (row['subject'], row['baseline'])
    )
    cells = [row['figure'], *(f'{side} {row["unit"]}'.strip() for side in sides), ratio, row.get('note', '')]
    return f'| {" | ".join(cells)} |'


def main() -> int:
    """Measure, print, write."""
    parser = parser_of(__doc__, 'fewer rounds: for a look, not for quoting')
    parser.add_argument('--only', nargs='+', default=PARTS, choices=PARTS, help='default: all of them')
    parser.add_argument('--subject', default=BRIDGE, metavar='COMMAND')
    parser.add_argument('--baseline', default=PLAIN_WRAPPER, metavar='COMMAND')
    parser.add_argument('--output', type=Path, default=HERE.parents[1] / '.bench', metavar='FOLDER')
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    print(
        '| | bridge | plain wrapper, or as named | ratio [middle half] | target |',
        '|---|---|---|---|---|',
        sep='\n',
    )
    rows = []
    try:
        with (
            own_domain(),
            closing(NamedServer(options.subject, 'subject')) as subject,
            closing(NamedServer(options.baseline, 'baseline')) as baseline,
        ):
            setup = Setup((subject, baseline), options, rounds=4 if options.short else 20)
            for figure in (figure for part in options.only for figure in PARTS[part](setup)):
                rows.append(row_of(figure))
                print(line_of(rows[-1]), flush=True)
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
    result.write_text(json.dumps({'conditions': conditions, 'figures': rows}, indent=2) + '\n')
    print(f'\n{conditions["seconds"]} s on {conditions["processors"]} processors; {result}')
    if missed := [row['figure'] for row in rows if row.get('verdict') == 'MISSED']:
        print(f'missed: {", ".join(missed)}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
