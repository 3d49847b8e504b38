"""
Compare the bridge with the plain wrapper of the simulator that teams used before it.

    make bench              takes five minutes; prints a table and writes bench.json into .bench/
    make bench SHORT=1      takes a minute, for a look

Every ratio is measured within one run, in which the servers take turns. A ratio is the median of its rounds,
with the middle half of them in brackets. --subject and --baseline replace the commands of the bridge and of
the plain wrapper. If you swap them, the ratios invert.
"""

import contextlib
import json
import multiprocessing
import os
import platform
import shlex
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from lupin_greenhouse_bridge.errors import pluralized
from shared import (
    PATIENCE_SECONDS,
    Server,
    in_turns,
    own_domain,
    parser_of,
    percentile,
    print_head,
    print_row,
)

HERE = Path(__file__).resolve().parent
BRIDGE = f'{os.environ["LUPIN_EXECUTABLES"]}/bridge_node'
PLAIN_WRAPPER = f'{sys.executable} {HERE / "plain_wrapper.py"}'
CANNED = f'{sys.executable} {HERE / "canned_replies.py"} tag_reading'
TRIGGER = f'{sys.executable} {HERE / "canned_replies.py"} trigger'
PROFILED = f'{sys.executable} {HERE / "instrumented_bridge.py"} profile'
CLI = f'{Path(sys.executable).parent}/mdp-greenhouse --read 1 --count 1'
PARTS = (
    'latency',
    'throughput',
    'burst',
    'interrupt',
    'start',
    'idle',
    'growth',
    'alternatives',
    'shares',
)
BURST = 200
LOST_AFTER_SECONDS = 0.1  # short, because a client that waits longer for a lost reply makes fewer calls
SENSORS = ['temperature', 'humidity', 'co2', 'light', 'soil_moisture']
# Ratio of the subject to the baseline, and on which side of it the target lies.
TARGETS = {
    'round trip p50': (1.00, max),
    'round trip p99': (1.00, max),
    'throughput, 1 client': (1.00, min),
    'throughput, 4 clients': (1.00, min),
    'throughput, 16 clients': (1.00, min),
    'start to first answer': (1.10, max),
    'resident memory': (1.10, max),
    'processor at idle': (1.10, max),
    '1,000 tags to 29: p50': (1.05, max),
    '100,000 tags to 29: p50': (1.05, max),
    'call 200,000 to call 1: p50': (1.05, max),
}


class NodeServer(Server):
    """A server in its own namespace."""

    def __init__(self, command: str, name: str, **parameters):
        self.service = f'/{name}/greenhouse_bridge/get_tag_reading'
        overrides = [word for item in parameters.items() for word in ('-p', '{}:={}'.format(*item))]
        super().__init__([*shlex.split(command), '--ros-args', '-r', f'__ns:=/{name}', *overrides])

    def cpu_seconds(self) -> float:
        """Return the processor time of all its threads so far, to the nanosecond."""
        tasks = Path(f'/proc/{self.process.pid}/task').glob('*/schedstat')
        return sum(int(task.read_text().split()[0]) for task in tasks) * 1e-9


class Asker:
    """A client of one participant: asks services, one call at a time."""

    def __init__(self):
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        self._context = Context()
        rclpy.init(args=[], context=self._context)
        self._node = rclpy.create_node(f'bench_{os.getpid()}', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._clients = {}

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def connect(self, service: str, kind: str = 'GetTagReading') -> None:
        """Return when the service has replied once; discovery is complete then."""
        from lupin_greenhouse_bridge.contract import SERVICE_QOS
        from lupin_msgs.srv import GetTagReading
        from std_srvs.srv import Trigger

        service_type = GetTagReading if kind == 'GetTagReading' else Trigger
        client = self._node.create_client(service_type, service, qos_profile=SERVICE_QOS)
        self._clients[service] = (client, service_type.Request)
        end = time.monotonic() + PATIENCE_SECONDS
        while not client.service_is_ready():
            self._executor.spin_once(timeout_sec=0.001)
            if time.monotonic() > end:
                raise SystemExit(f'bench: no service {service}')
        # The server may not have found this client yet; until then DDS drops its replies.
        while not self._answers(*self._call_to(service)):
            if time.monotonic() > end:
                raise SystemExit(f'bench: {service} does not answer')

    def _call_to(self, service: str, tag_id: str = '1') -> tuple:
        """Return the client of a service, and a request."""
        client, request_type = self._clients[service]
        return client, request_type(tag_id=tag_id) if hasattr(request_type, 'tag_id') else request_type()

    def _is_done(self, future, seconds: float) -> bool:
        """Spin until a call is answered, or for this long."""
        end = time.monotonic() + seconds
        while not future.done() and (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)
        return future.done()

    def _answers(self, client, request) -> bool:
        future = client.call_async(request)
        if not self._is_done(future, LOST_AFTER_SECONDS):
            client.remove_pending_request(future)
        return future.done()

    def _microseconds(self, client, request) -> float:
        """Return how long a call takes."""
        started = time.perf_counter_ns()
        if not self._is_done(client.call_async(request), PATIENCE_SECONDS):
            raise SystemExit(f'bench: a call of {client.srv_name} was lost')
        return (time.perf_counter_ns() - started) / 1000

    def latencies(self, sides: list[tuple[str, str]], calls: int) -> list[list[float]]:
        """Return the durations of this many calls to each (service, tag id) in microseconds, sorted."""
        measures = [partial(self._microseconds, *self._call_to(*side)) for side in sides]
        return [sorted(of_side) for of_side in zip(*in_turns(measures, calls), strict=True)]

    def medians(self, sides: list[tuple[str, str]], calls: int) -> tuple[float, ...]:
        """Return the median duration of a call to each side in microseconds."""
        return tuple(percentile(of_side, 0.5) for of_side in self.latencies(sides, calls))

    def calls_within(self, service: str, seconds: float) -> tuple[int, int]:
        """Return how many calls, one after the other, were answered, and how many were lost."""
        client, request = self._call_to(service)
        end = time.monotonic() + seconds
        calls = lost = 0
        while time.monotonic() < end:
            if self._answers(client, request):
                calls += 1
            else:
                lost += 1
        return calls, lost

    def burst(self, service: str) -> int:
        """Send many requests at once, and return how many are answered."""
        client, request = self._call_to(service)
        futures = [client.call_async(request) for _ in range(BURST)]
        answered, end = 0, time.monotonic() + 2.0  # seconds without a reply
        while answered < BURST and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.1)
            if (now := sum(future.done() for future in futures)) > answered:
                answered, end = now, time.monotonic() + 2.0
        for future in futures:
            if not future.done():
                client.remove_pending_request(future)
        return answered

    def hurry(self, service: str, calls: int) -> None:
        """Make this many calls as fast as possible, 16 at the same time."""
        client, request = self._call_to(service)
        for _ in range(calls // 16):
            for future in [client.call_async(request) for _ in range(16)]:
                self._is_done(future, PATIENCE_SECONDS)


def verdict(ratio: float, low: float, high: float, target: float, side) -> str:
    """Return 'met', 'within noise' if the middle half of the rounds spans the target, or 'MISSED'."""
    if side(ratio, target) == target:
        return 'met'
    return 'within noise' if low <= target <= high else 'MISSED'


def digits(value: float) -> str:
    """Return a number in four digits, or whole."""
    return f'{value:,.0f}' if value >= 1000 else f'{value:.4g}'


def work(pipe, services: list[str]) -> None:
    """Be one of many clients: connect, then call for as long as the pipe says."""
    asker = Asker()
    for service in services:
        asker.connect(service)
    pipe.send('connected')
    while (order := pipe.recv()) is not None:
        pipe.send(asker.calls_within(*order))
    asker.close()


class Bench:
    """Measures, and prints the table row by row."""

    def __init__(self, options):
        self.options = options
        self.rows = []
        self.lines = []  # printed below the table

    def ratio(self, figure: str, unit: str, pairs: list[tuple[float, float]], note: str = '') -> None:
        """Keep a figure: (subject, baseline) of each round."""
        ratios = sorted(subject / baseline for subject, baseline in pairs)
        row = {
            'figure': figure,
            'subject': statistics.median(subject for subject, _ in pairs),
            'baseline': statistics.median(baseline for _, baseline in pairs),
            'unit': unit,
            'ratio': statistics.median(ratios),
            'middle_half': [percentile(ratios, 0.25), percentile(ratios, 0.75)],
            'rounds': len(pairs),
            'note': note,
        }
        low, high = row['middle_half']
        if figure in TARGETS:
            row['target'], side = TARGETS[figure]
            row['verdict'] = verdict(row['ratio'], low, high, *TARGETS[figure])
            note = f'{"<=" if side is max else ">="} {row["target"]:.2f} {row["verdict"]}'
        self.rows.append(row)
        spread = f' [{low:.3f}, {high:.3f}]' if len(pairs) > 1 else ''
        sides = [f'{digits(row[side])} {unit}' for side in ('subject', 'baseline')]
        print_row(figure, *sides, f'{row["ratio"]:.3f}{spread}', note)

    def texts(self, figure: str, subject: str, baseline: str) -> None:
        """Keep a figure that has no ratio."""
        self.rows.append({'figure': figure, 'subject': subject, 'baseline': baseline})
        print_row(figure, subject, baseline, '', '')

    def latency(self) -> None:
        """
        Time the round trips of one client to each server, and to one that only sends canned replies.

        Restarts the servers for each round, because processes of the same program differ more than calls do.
        """
        calls = 200 if self.options.short else 1000
        commands = (self.options.subject, self.options.baseline, CANNED)

        def durations(order: list[int]) -> list[list[float]]:
            with contextlib.ExitStack() as stack:
                services = {
                    side: stack.enter_context(NodeServer(commands[side], f'side{side}')).service
                    for side in order
                }
                asker = stack.enter_context(contextlib.closing(Asker()))
                sides = [(services[side], '1') for side in range(len(commands))]
                for service, _ in sides:
                    asker.connect(service)
                asker.latencies(sides, 200)  # the first calls are slower
                return asker.latencies(sides, calls)

        results = [durations([0, 1, 2] if number % 2 else [2, 1, 0]) for number in range(self.options.rounds)]
        for name, share in (('p50', 0.5), ('p90', 0.9), ('p99', 0.99)):
            pairs = [(percentile(ours, share), percentile(theirs, share)) for ours, theirs, _ in results]
            self.ratio(f'round trip {name}', 'us', pairs)
        pairs = [(percentile(ours, 0.5), percentile(floor, 0.5)) for ours, _, floor in results]
        self.ratio('bridge to canned replies: p50', 'us', pairs, 'a server that reads no simulator')

    def burst(self) -> None:
        """Count the replies to many requests that one client sends at once."""
        services = [self.subject.service, self.baseline.service]
        with contextlib.closing(Asker()) as asker:
            for service in services:
                asker.connect(service)
            bursts = [partial(asker.burst, service) for service in services]
            pairs = in_turns(bursts, 2 if self.options.short else 6)
        self.ratio(f'burst of {BURST} requests: answered', '', pairs)

    def interrupt(self) -> None:
        """Press Ctrl-C on each."""
        ends = []
        for command in (self.options.subject, self.options.baseline):
            with NodeServer(command, 'interrupted') as server:
                exit_code, output = server.stop(signal.SIGINT)
                ends.append(f'exit code {exit_code}{", traceback" * ("Traceback" in output)}')
        self.texts('Ctrl-C', *ends)

    def throughput(self) -> None:
        """Count the calls per second of several client processes at once."""
        services = [self.subject.service, self.baseline.service]
        context = multiprocessing.get_context('spawn')
        for count in (1, 4, 16):
            pipes = []
            workers = []
            for _ in range(count):
                ours, theirs = context.Pipe()
                workers.append(context.Process(target=work, args=(theirs, services), daemon=True))
                workers[-1].start()
                pipes.append(ours)
            for pipe in pipes:
                pipe.recv()
            seconds = 0.2 if self.options.short else 0.7

            def measure(service, pipes=pipes, seconds=seconds):
                for pipe in pipes:
                    pipe.send((service, seconds))
                calls, lost = map(sum, zip(*(pipe.recv() for pipe in pipes), strict=True))
                return calls / seconds, lost

            measure(self.subject.service)
            sides = [partial(measure, service) for service in services]
            results = in_turns(sides, max(4, self.options.rounds // 2))
            name = pluralized(count, 'client')
            self.ratio(f'throughput, {name}', 'calls/s', [(ours[0], theirs[0]) for ours, theirs in results])
            lost = [str(sum(count for _, count in side)) for side in zip(*results, strict=True)]
            self.texts(f'{name}: no reply within {LOST_AFTER_SECONDS:g} s', *lost)
            for pipe, worker in zip(pipes, workers, strict=True):
                pipe.send(None)
                worker.join(PATIENCE_SECONDS)

    def start(self) -> None:
        """Time a server from the start of its process to its first reply."""

        def measure(command: str) -> float:
            started = time.perf_counter()
            with NodeServer(command, 'started') as server, contextlib.closing(Asker()) as asker:
                asker.connect(server.service)
                return 1000 * (time.perf_counter() - started)

        sides = [partial(measure, command) for command in (self.options.subject, self.options.baseline)]
        pairs = in_turns(sides, 4 if self.options.short else 12)
        self.ratio('start to first answer', 'ms', pairs)

    def idle(self) -> None:
        """Compare memory, and processor time while no client asks."""
        servers = (self.subject, self.baseline)
        self.ratio('resident memory', 'kB', [tuple(server.status('VmRSS') for server in servers)])
        seconds = 1.0 if self.options.short else 3.0

        def spent() -> tuple[float, ...]:
            before = [server.cpu_seconds() for server in servers]
            time.sleep(seconds)
            after = [server.cpu_seconds() for server in servers]
            return tuple(max(b - a, 1e-9) / seconds * 1e6 for a, b in zip(before, after, strict=True))

        self.ratio('processor at idle', 'us/s', [spent() for _ in range(2 if self.options.short else 5)])

    def growth(self) -> None:
        """Compare large with small bridges: tags, sensors at a tag, components of a sensor, calls."""
        calls = 200 if self.options.short else 500
        with contextlib.ExitStack() as stack:
            small, large, huge = (
                stack.enter_context(NodeServer(self.options.subject, f'tags{count}', **files)).service
                for count, files in grown_greenhouses(self.options.output, (29, 1000, 100_000))
            )
            asker = stack.enter_context(contextlib.closing(Asker()))
            for service in (small, large, huge):
                asker.connect(service)

            def medians(*sides: tuple[str, str]) -> list[tuple[float, ...]]:
                asker.latencies(sides, 100)  # the first calls are slower
                return [asker.medians(sides, calls) for _ in range(self.options.rounds)]

            self.ratio('1,000 tags to 29: p50', 'us', medians((large, 'one'), (small, 'one')))
            self.ratio('100,000 tags to 29: p50', 'us', medians((huge, 'one'), (small, 'one')))
            sides = [(small, tag_id) for tag_id in ('one', 'sensors', 'components')]
            rounds = [(one, sensors - one, components - one) for one, sensors, components in medians(*sides)]
            one, sensors, components = map(statistics.median, zip(*rounds, strict=True))
            self.lines.append(
                f'a call for one sensor of one component {one:.1f} us, for 4 sensors {sensors:+.1f} us,'
                f' for 8 components {components:+.1f} us'
            )
        with NodeServer(self.options.subject, 'many') as server, contextlib.closing(Asker()) as asker:
            asker.connect(server.service)
            calls = 7000 if self.options.short else 200_000
            sides = [(server.service, '1')]
            first = [asker.medians(sides, 500) for _ in range(6)]
            asker.hurry(server.service, calls - 6000)
            last = [asker.medians(sides, 500) for _ in range(6)]
            pairs = [(late, early) for (late,), (early,) in zip(last, first, strict=True)]
            self.ratio(f'call {calls:,} to call 1: p50', 'us', pairs)

    def alternatives(self) -> None:
        """Compare other designs: Trigger with JSON, and the simulator's own command for each reading."""
        with (
            NodeServer(CANNED, 'canned') as canned,
            NodeServer(TRIGGER, 'trigger') as trigger,
            contextlib.closing(Asker()) as asker,
        ):
            asker.connect(trigger.service, 'Trigger')
            for server in (canned, self.subject):
                asker.connect(server.service)
            sides = [(trigger.service, ''), (canned.service, '1')]
            pairs = [asker.medians(sides, 300) for _ in range(self.options.rounds)]
            self.ratio(
                'std_srvs/Trigger with JSON to canned replies: p50', 'us', pairs, 'the client parses it'
            )
            pairs = []
            for _ in range(2 if self.options.short else 5):
                started = time.perf_counter()
                run = subprocess.run(shlex.split(CLI), capture_output=True, text=True, check=False)
                if run.returncode:
                    raise SystemExit(f'bench: {CLI}: {run.stderr.strip().splitlines()[-1]}')
                duration = 1e6 * (time.perf_counter() - started)
                pairs.append((duration, *asker.medians([(self.subject.service, '1')], 300)))
            self.ratio('mdp-greenhouse --read as a process to bridge: p50', 'us', pairs, 'no ROS in it')

    def shares(self) -> None:
        """Measure where the bridge spends the time of a reply."""
        with NodeServer(PROFILED, 'profiled') as profiled, contextlib.closing(Asker()) as asker:
            asker.connect(profiled.service)
            asker.latencies([(profiled.service, '1')], 300 if self.options.short else 3000)
            _, output = profiled.stop()
        shares = json.loads(output.splitlines()[-1])
        calls = shares.pop('calls')
        parts = ', '.join(f'{share} {us:.1f} us' for share, us in shares.items())
        self.lines.append(f'in the bridge (medians of {calls} calls): {parts}')


def grown_greenhouses(folder: Path, tag_counts: tuple[int, ...]) -> Iterator[tuple[int, dict[str, str]]]:
    """Write a greenhouse of each number of tags; yield the number and the bridge's parameters."""
    component = {'value_at_midnight': 18.0, 'value_at_noon': 26.0, 'noise_sigma': 1.0, 'dynamics': 'radial'}
    component |= {'decay_distance': 10.0, 'position': [2.0, 0.0]}
    *simple, composed = SENSORS
    config = {
        'time': {'speedup_factor': 1800, 'debug_mode': False, 'debug_time_of_day': 12.0, 'debug_seed': 42},
        'sensors': {name: [component] * (8 if name == composed else 1) for name in SENSORS},
    }
    config_file = folder / 'greenhouse.yaml'
    config_file.write_text(json.dumps(config))  # JSON is YAML
    for count in tag_counts:
        tags = {'one': simple[:1], 'sensors': simple, 'components': [composed]}
        tags |= {f't{number}': simple[:2] for number in range(count - len(tags))}
        tag_file = folder / f'{count}.json'
        places = {tag_id: {'x': 1.0, 'y': 1.0, 'sensors': sensors} for tag_id, sensors in tags.items()}
        tag_file.write_text(json.dumps(places))
        yield count, {'tag_file': f'"{tag_file}"', 'sim_config_file': f'"{config_file}"'}


def main() -> int:
    """Measure, print, write."""
    parser = parser_of(__doc__, 'fewer rounds: for a look, not for quoting')
    parts = ' '.join(PARTS)
    parser.add_argument('--only', nargs='+', default=PARTS, choices=PARTS, metavar='PART', help=parts)
    parser.add_argument('--subject', default=BRIDGE, metavar='COMMAND')
    parser.add_argument('--baseline', default=PLAIN_WRAPPER, metavar='COMMAND')
    parser.add_argument('--output', type=Path, default=HERE.parents[1] / '.bench', metavar='FOLDER')
    options = parser.parse_args()
    options.rounds = 4 if options.short else 20
    options.output.mkdir(parents=True, exist_ok=True)
    bench = Bench(options)
    started = time.monotonic()
    print_head('', 'bridge', 'plain wrapper, or as named', 'ratio [middle half]', 'target')
    with own_domain(), contextlib.ExitStack() as stack:
        bench.subject = stack.enter_context(NodeServer(options.subject, 'subject'))
        bench.baseline = stack.enter_context(NodeServer(options.baseline, 'baseline'))
        for part in options.only:
            getattr(bench, part)()
    conditions = {
        'python': platform.python_version(),
        'ros_distro': os.environ.get('ROS_DISTRO'),
        'processors': os.cpu_count(),
        'seconds': round(time.monotonic() - started),
        'short': options.short,
    }
    figures = {'conditions': conditions, 'figures': bench.rows, 'lines': bench.lines}
    result = options.output / 'bench.json'
    result.write_text(json.dumps(figures, indent=2) + '\n')
    took = f'{conditions["seconds"]} s on {conditions["processors"]} processors; {result}'
    print('', took, *bench.lines, sep='\n')
    if missed := [row['figure'] for row in bench.rows if row.get('verdict') == 'MISSED']:
        print(f'missed: {", ".join(missed)}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
