"""
The bridge against a floor: a bare rclpy node that answers the same question with canned answers.

    make bench              under five minutes; the table, and bench.json in .bench/
    make bench SHORT=1      under a minute, for a look

Every figure is a ratio within one run. The two are asked in turns, in rounds; a ratio is the median of the
rounds' ratios, with the middle half of them in brackets. --subject and --floor take other commands than the
bridge's and the floor's: swapped, the ratios invert.
"""

import argparse
import contextlib
import json
import multiprocessing
import os
import platform
import shlex
import statistics
import subprocess
import sys
import time
from pathlib import Path

import domain_coordinator
from traffic import status_of

HERE = Path(__file__).resolve().parent
PATIENCE_SECONDS = 60.0
BRIDGE = f'{os.environ["LUPIN_EXECUTABLES"]}/bridge_node'
FLOOR = f'{sys.executable} {HERE / "bench_floor.py"} floor'
WRAPPER = f'{sys.executable} {HERE / "bench_floor.py"} wrapper'
PROFILED = f'{sys.executable} {HERE / "profiled_bridge.py"}'
TRIGGER = f'{sys.executable} {HERE / "bench_floor.py"} trigger'
CLI = f'{Path(sys.executable).parent}/mdp-greenhouse --read 1 --count 1'
PARTS = ('latency', 'explanation', 'throughput', 'start', 'idle', 'growth', 'alternatives')
SENSORS = ['temperature', 'humidity', 'co2', 'light', 'soil_moisture']
# Ratio of subject to floor, and on which side of it the target lies.
TARGETS = {
    'round trip p50': (1.05, max),
    'round trip p99': (1.05, max),
    'throughput, 1 client': (0.95, min),
    'throughput, 4 clients': (0.95, min),
    'throughput, 16 clients': (0.95, min),
    'start to first answer': (1.15, max),
    'resident memory': (1.10, max),
    '1,000 tags to 29: p50': (1.05, max),
    '100,000 tags to 29: p50': (1.05, max),
    'call 200,000 to call 1: p50': (1.05, max),
}


WHY = (
    'A floor answers without asking anybody; the row "thinnest wrapper" is what mdp-greenhouse, the stamp and'
    ' the answer cost every node that serves it, and "bridge to that wrapper" is what the bridge adds.'
)


class Server:
    """A server process in a namespace of its own, ready to be asked."""

    def __init__(self, command: str, name: str, **parameters):
        self.service = f'/{name}/greenhouse_bridge/get_tag_reading'
        overrides = [word for item in parameters.items() for word in ('-p', '{}:={}'.format(*item))]
        self.process = subprocess.Popen(
            [*shlex.split(command), '--ros-args', '-r', f'__ns:=/{name}', *overrides],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for line in self.process.stdout:
            if 'ready:' in line:
                return
        raise SystemExit(f'bench: {command} did not start: exit code {self.process.wait()}')

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()

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
        """Return when the service has answered once; an answer is never lost after that."""
        from lupin_greenhouse_bridge.client import SERVICE_QOS
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
        # The server may not have found this client yet; until then DDS drops its answers.
        request = service_type.Request(tag_id='1') if kind == 'GetTagReading' else service_type.Request()
        while not self._answers(client, request):
            if time.monotonic() > end:
                raise SystemExit(f'bench: {service} does not answer')

    def _answers(self, client, request) -> bool:
        future = client.call_async(request)
        end = time.monotonic() + 0.1
        while not future.done() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)
        if not future.done():
            client.remove_pending_request(future)
        return future.done()

    def _call(self, client, request) -> None:
        future = client.call_async(request)
        while not future.done():
            started = time.monotonic()
            self._executor.spin_once(timeout_sec=PATIENCE_SECONDS)
            if not future.done() and time.monotonic() - started > PATIENCE_SECONDS / 2:
                raise SystemExit(f'bench: a call of {client.srv_name} was lost')

    def latencies(self, service: str, calls: int, tag_id: str = '1') -> list[float]:
        """Return the duration of each call in microseconds, in order of size."""
        client, request_type = self._clients[service]
        request = request_type(tag_id=tag_id) if hasattr(request_type, 'tag_id') else request_type()
        durations = []
        for _ in range(calls):
            started = time.perf_counter_ns()
            self._call(client, request)
            durations.append((time.perf_counter_ns() - started) / 1000)
        return sorted(durations)

    def median(self, service: str, calls: int, tag_id: str = '1') -> float:
        """Return the median duration of a call in microseconds."""
        return percentile(self.latencies(service, calls, tag_id), 0.5)

    def calls_within(self, service: str, seconds: float) -> int:
        """Return how many calls, one after the other, ended in that time."""
        client, request_type = self._clients[service]
        request = request_type(tag_id='1')
        end = time.monotonic() + seconds
        calls = 0
        while time.monotonic() < end:
            self._call(client, request)
            calls += 1
        return calls

    def hurry(self, service: str, calls: int, at_once: int = 16) -> None:
        """Have this many calls answered as fast as they can be, a few on their way at any time."""
        client, request_type = self._clients[service]
        request = request_type(tag_id='1')
        on_their_way = []
        for _ in range(calls):
            on_their_way.append(client.call_async(request))
            while len(on_their_way) >= at_once:
                self._executor.spin_once(timeout_sec=PATIENCE_SECONDS)
                on_their_way = [future for future in on_their_way if not future.done()]
        while on_their_way:
            self._executor.spin_once(timeout_sec=PATIENCE_SECONDS)
            on_their_way = [future for future in on_their_way if not future.done()]


def percentile(ordered: list[float], share: float) -> float:
    """Return the value that this share of an ordered list does not exceed."""
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)]


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
    """The measurements, and their table."""

    def __init__(self, options):
        self.options = options
        self.rows = []
        self.shares = {}  # of the time that the bridge takes for an answer, in microseconds

    def ratio(self, figure: str, unit: str, pairs: list[tuple[float, float]], note: str = '') -> None:
        """Keep a figure: (subject, floor) of each round."""
        ratios = sorted(subject / floor for subject, floor in pairs)
        row = {
            'figure': figure,
            'subject': statistics.median(subject for subject, _ in pairs),
            'floor': statistics.median(floor for _, floor in pairs),
            'unit': unit,
            'ratio': statistics.median(ratios),
            'middle_half': [percentile(ratios, 0.25), percentile(ratios, 0.75)],
            'rounds': len(pairs),
            'note': note,
        }
        if figure in TARGETS:
            row['target'], side = TARGETS[figure]
            row['is_met'] = side(row['ratio'], row['target']) == row['target']
        self.rows.append(row)
        low, high = row['middle_half']
        spread = f' [{low:.3f}, {high:.3f}]' if len(pairs) > 1 else ''
        target = (
            f'{"<=" if side is max else ">="} {row["target"]:.2f} {"met" if row["is_met"] else "MISSED"}'
            if figure in TARGETS
            else note
        )
        print(
            f'| {figure} | {digits(row["subject"])} {unit} | {digits(row["floor"])} {unit}'
            f' | {row["ratio"]:.3f}{spread} | {target} |',
            flush=True,
        )

    def rounds(self, measure, *sides, rounds: int | None = None) -> list[tuple]:
        """Measure the sides in turns, and return what each round measured; each comes first as often."""
        results = []
        for number in range(rounds or self.options.rounds):
            measured = [None] * len(sides)
            for position in range(len(sides)):
                side = (number + position) % len(sides)
                measured[side] = measure(sides[side])
            results.append(tuple(measured))
        return results

    def latency(self, subject: Server, floor: Server) -> None:
        """Round trips of one client, to each in turns."""
        calls = 200 if self.options.short else 1000
        services = [subject.service, floor.service]
        with contextlib.closing(Asker()) as asker:
            for service in services:
                asker.connect(service)
                asker.median(service, 500)
            pairs = self.rounds(lambda service: asker.latencies(service, calls), *services)
        for name, share in (('p50', 0.5), ('p90', 0.9), ('p99', 0.99)):
            self.ratio(
                f'round trip {name}', 'us', [(percentile(a, share), percentile(b, share)) for a, b in pairs]
            )

    def throughput(self, subject: Server, floor: Server) -> None:
        """Count the calls per second of several client processes at once."""
        services = [subject.service, floor.service]
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
                return sum(pipe.recv() for pipe in pipes) / seconds

            measure(subject.service)
            pairs = self.rounds(measure, *services, rounds=max(4, self.options.rounds // 2))
            self.ratio(f'throughput, {count} client{"s" * (count > 1)}', 'calls/s', pairs)
            for pipe, worker in zip(pipes, workers, strict=True):
                pipe.send(None)
                worker.join(PATIENCE_SECONDS)

    def start(self) -> None:
        """From the start of the process to the first answer to a client that begins when it is ready."""

        def measure(command: str) -> float:
            started = time.perf_counter()
            with Server(command, 'started') as server, contextlib.closing(Asker()) as asker:
                asker.connect(server.service)
                return 1000 * (time.perf_counter() - started)

        pairs = self.rounds(
            measure, self.options.subject, self.options.floor, rounds=4 if self.options.short else 12
        )
        self.ratio('start to first answer', 'ms', pairs)

    def idle(self, subject: Server, floor: Server) -> None:
        """Memory, and processor time while nobody asks."""
        self.ratio(
            'resident memory',
            'kB',
            [tuple(status_of(each.process.pid, 'VmRSS') for each in (subject, floor))],
        )
        seconds = 1.0 if self.options.short else 3.0

        def shares() -> tuple[float, ...]:
            before = subject.cpu_seconds(), floor.cpu_seconds()
            time.sleep(seconds)
            after = subject.cpu_seconds(), floor.cpu_seconds()
            return tuple(max(b - a, 1e-9) / seconds * 1e6 for a, b in zip(before, after, strict=True))

        note = 'the bridge looks for a signal twice a second'
        self.ratio(
            'processor at idle', 'us/s', [shares() for _ in range(2 if self.options.short else 5)], note
        )


def grown_greenhouse(folder: Path, tag_count: int) -> dict[str, str]:
    """Write a greenhouse of that many tags; n1 to n5 have so many sensors."""
    tags = {f't{number}': SENSORS[:2] for number in range(tag_count - 5)}
    tags |= {f'n{count}': SENSORS[:count] for count in range(1, 6)}
    return _written(folder, f'{tag_count}', tags, dict.fromkeys(SENSORS, 2))


def composed_greenhouse(folder: Path) -> dict[str, str]:
    """Write a greenhouse where each sensor has another number of components; tag cN has the one of N."""
    counts = dict(zip(SENSORS, (1, 2, 4, 8), strict=False))
    return _written(folder, 'composed', {f'c{count}': [name] for name, count in counts.items()}, counts)


def _written(folder: Path, name: str, tags: dict[str, list], components: dict[str, int]) -> dict[str, str]:
    component = {'value_at_midnight': 18.0, 'value_at_noon': 26.0, 'noise_sigma': 1.0, 'dynamics': 'radial'}
    component |= {'decay_distance': 10.0, 'position': [2.0, 0.0]}
    config = {
        'time': {'speedup_factor': 1800, 'debug_mode': False, 'debug_time_of_day': 12.0, 'debug_seed': 42},
        'sensors': {sensor: [component] * count for sensor, count in components.items()},
    }
    tag_file, config_file = folder / f'{name}.json', folder / f'{name}.yaml'
    tag_file.write_text(json.dumps({tag: {'x': 1.0, 'y': 1.0, 'sensors': has} for tag, has in tags.items()}))
    config_file.write_text(json.dumps(config))  # JSON is YAML
    return {'tag_file': f'"{tag_file}"', 'sim_config_file': f'"{config_file}"'}


def growth(bench: Bench, folder: Path) -> None:
    """Compare large with small, both of them bridges: tags, sensors at a tag, parts of a sensor, calls."""
    calls = 200 if bench.options.short else 500
    with contextlib.ExitStack() as stack:

        def serve(name: str, files: dict[str, str]) -> Server:
            return stack.enter_context(Server(bench.options.subject, name, **files))

        small, large, huge = (serve(f'tags{n}', grown_greenhouse(folder, n)) for n in (29, 1000, 100_000))
        composed = serve('composed', composed_greenhouse(folder))
        comparisons = [
            ('1,000 tags to 29: p50', (large, 'n2'), (small, 'n2')),
            ('100,000 tags to 29: p50', (huge, 'n2'), (small, 'n2')),
            *((f'{n} sensors at the tag to 1: p50', (small, f'n{n}'), (small, 'n1')) for n in range(2, 6)),
            *((f'{n} components to 1: p50', (composed, f'c{n}'), (composed, 'c1')) for n in (2, 4, 8)),
        ]
        asker = stack.enter_context(contextlib.closing(Asker()))
        for server in (small, large, huge, composed):
            asker.connect(server.service)
        for figure, *sides in comparisons:
            for server, tag_id in sides:
                asker.median(server.service, 100, tag_id)  # the first calls are slower
            pairs = bench.rounds(lambda side: asker.median(side[0].service, calls, side[1]), *sides)
            bench.ratio(figure, 'us', pairs)
    with Server(bench.options.subject, 'many') as server, contextlib.closing(Asker()) as asker:
        asker.connect(server.service)
        calls = 7000 if bench.options.short else 200_000
        first = [asker.median(server.service, 500) for _ in range(6)]
        asker.hurry(server.service, calls - 6000)
        last = [asker.median(server.service, 500) for _ in range(6)]
        bench.ratio(f'call {calls:,} to call 1: p50', 'us', list(zip(last, first, strict=True)))


def explanation(bench: Bench, subject: Server, floor: Server) -> None:
    """Show what any wrapper pays, with one that checks nothing, and where the bridge's own time goes."""
    with Server(WRAPPER, 'wrapper') as wrapper, contextlib.closing(Asker()) as asker:
        services = [each.service for each in (subject, floor, wrapper)]
        for service in services:
            asker.connect(service)
            asker.median(service, 300)
        results = bench.rounds(lambda service: asker.median(service, 300), *services)
    bench.ratio('thinnest wrapper of the simulator: p50', 'us', [(w, f) for _, f, w in results])
    bench.ratio('bridge to that wrapper: p50', 'us', [(s, w) for s, _, w in results])
    with Server(PROFILED, 'profiled') as profiled, contextlib.closing(Asker()) as asker:
        asker.connect(profiled.service)
        asker.median(profiled.service, 300 if bench.options.short else 3000)
        profiled.process.terminate()
        bench.shares = json.loads(profiled.process.stdout.read().splitlines()[-1])


def alternatives(bench: Bench, floor: Server) -> None:
    """Compare what else one might do: Trigger with JSON, and the simulator's own command per reading."""
    with Server(TRIGGER, 'trigger') as trigger, contextlib.closing(Asker()) as asker:
        asker.connect(trigger.service, 'Trigger')
        asker.connect(floor.service)
        pairs = bench.rounds(lambda service: asker.median(service, 300), trigger.service, floor.service)
        bench.ratio('std_srvs/Trigger with JSON: p50', 'us', pairs, 'the client parses it')
        pairs = []
        for _ in range(2 if bench.options.short else 5):
            started = time.perf_counter()
            run = subprocess.run(shlex.split(CLI), capture_output=True, text=True, check=False)
            if run.returncode:
                print(f'bench: {CLI}: {run.stderr.strip().splitlines()[-1]}', file=sys.stderr)
                return
            pairs.append((1e6 * (time.perf_counter() - started), asker.median(floor.service, 300)))
        bench.ratio('mdp-greenhouse --read as a process: p50', 'us', pairs, 'no ROS in it')


def main() -> int:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--short', action='store_true', help='fewer rounds: for a look, not for quoting')
    parser.add_argument(
        '--only', nargs='+', default=PARTS, choices=PARTS, metavar='PART', help=' '.join(PARTS)
    )
    parser.add_argument('--subject', default=BRIDGE, metavar='COMMAND')
    parser.add_argument('--floor', default=FLOOR, metavar='COMMAND')
    parser.add_argument('--output', type=Path, default=HERE.parents[1] / '.bench', metavar='FOLDER')
    options = parser.parse_args()
    options.rounds = 6 if options.short else 20
    options.output.mkdir(parents=True, exist_ok=True)
    bench = Bench(options)
    started = time.monotonic()
    print('| | bridge | compared with | ratio [middle half of the rounds] | target |\n|---|---|---|---|---|')
    with domain_coordinator.domain_id() as domain_id, contextlib.ExitStack() as stack:
        os.environ.update(ROS_DOMAIN_ID=str(domain_id), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
        subject = stack.enter_context(Server(options.subject, 'subject'))
        floor = stack.enter_context(Server(options.floor, 'floor'))
        for part in options.only:
            match part:
                case 'latency' | 'throughput' | 'idle':
                    getattr(bench, part)(subject, floor)
                case 'explanation':
                    explanation(bench, subject, floor)
                case 'start':
                    bench.start()
                case 'growth':
                    growth(bench, options.output)
                case 'alternatives':
                    alternatives(bench, floor)
    conditions = {
        'python': platform.python_version(),
        'ros_distro': os.environ.get('ROS_DISTRO'),
        'processors': os.cpu_count(),
        'seconds': round(time.monotonic() - started),
        'short': options.short,
    }
    result = options.output / 'bench.json'
    figures = {'conditions': conditions, 'figures': bench.rows, 'shares': bench.shares}
    result.write_text(json.dumps(figures, indent=2) + '\n')
    print(f'\n{conditions["seconds"]} s on {conditions["processors"]} processors; {result}')
    if bench.shares:
        calls = bench.shares['calls']
        shares = (f'{share} {us:.1f} us' for share, us in bench.shares.items() if share != 'calls')
        print(f'in the bridge (medians of {calls} calls): {", ".join(shares)}')
    if missed := [row['figure'] for row in bench.rows if not row.get('is_met', True)]:
        print(f'missed: {", ".join(missed)}. {WHY}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
