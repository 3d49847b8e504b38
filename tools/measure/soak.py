"""
Check what the bridge promises under faults and load on one machine, and count.

    make soak                    takes about a quarter of an hour
    make soak SHORT=1            takes about two minutes
    make soak REFUSALS=12000     this many refused starts instead of 200
    make soak SIGNALS=500        this many signals to each executable instead of 100
    make soak ARGS="--only NAME" one scenario

Prints one line per scenario. The exit code is 1 if a promise is broken.
"""

import argparse
import contextlib
import os
import random
import re
import shlex
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import count, islice, repeat
from pathlib import Path

import domain_coordinator
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.recording.reading_files import read_rows
from lupin_greenhouse_bridge.recording.rows import key_of, make_rows
from lupin_greenhouse_bridge.recording.store import open_store
from lupin_greenhouse_bridge.testing._helpers import executable
from lupin_msgs.msg import SensorReading, TagReading
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from shared import PATIENCE_SECONDS, own_domain, parser_of
from traffic import TAG_IDS, Bridge, ClientProcess

GROWTH = {'RSS in kB': 4096, 'open files': 2, 'threads': 0}  # the largest during many calls
RECORD_READINGS = [executable('lupin_greenhouse_bridge', 'record_readings')]
START_NS = 1_795_189_976_000_000_000
LATCHED = latched(50)


def client_killed_in_mid_call(scale: int) -> Iterator[tuple[str, bool]]:
    """Kill clients without warning; the bridge continues and keeps nothing of theirs."""
    bridge = Bridge(debug_time_of_day=12.0)
    ClientProcess('--calls', '100').result()
    files = bridge.open_files()
    for _ in range(2 * scale):
        victims = [ClientProcess() for _ in range(4)]
        for victim in victims:
            victim.wait_for_first_answer()
        for victim in victims:
            victim.process.kill()
            victim.process.wait()
    after = ClientProcess('--calls', '100').result()
    yield f'{8 * scale} clients killed, next one answered {after["answered"]}/100', after['answered'] == 100
    yield f'open files {files} -> {bridge.open_files()}', bridge.open_files() <= files + 8
    yield bridge.ends_cleanly()


def bridge_killed_and_restarted(scale: int) -> Iterator[tuple[str, bool]]:
    """Kill the bridge while clients keep calling; every call ends, and the next bridge starts and answers."""
    bridge = Bridge(debug_time_of_day=12.0)
    seconds = 6 * scale + 8
    clients = [
        ClientProcess('--seconds', str(seconds), '--timeout', '2', '--pause', '0.005') for _ in range(4)
    ]
    for client in clients:
        client.wait_for_first_answer()
    for _ in range(2 * scale):
        bridge.kill()
        bridge = Bridge(debug_time_of_day=12.0)  # returns when it is ready, despite what the killed one left
        time.sleep(2.0)
    results = [client.result() for client in clients]
    answered, timed_out, wrong = (
        sum(result[key] for result in results) for key in ('answered', 'timed_out', 'wrong')
    )
    # After a kill, sending itself may take a second: Fast DDS then checks the queues in shared memory.
    slowest = max(result['slowest_seconds'] for result in results)
    timeouts = f'{timed_out} timed out after 2 s (slowest {slowest} s)'
    yield f'{2 * scale} kills, {answered} calls answered, {wrong} swapped, {timeouts}', wrong == 0
    last = ClientProcess('--calls', '50').result()
    yield f'after the last restart {last["answered"]}/50 answered', last['answered'] == 50
    yield bridge.ends_cleanly()


def sixteen_clients(scale: int) -> Iterator[tuple[str, bool]]:
    """
    Call from 16 processes at once; every reply matches its request, and none is lost.

    All start at the same moment: 16 requests are more than the 10 that ROS's default depth keeps.
    """
    bridge = Bridge(debug_time_of_day=12.0)
    calls = 100 * scale
    clients = [ClientProcess('--wait', '--calls', str(calls), '--first', str(number)) for number in range(16)]
    for client in clients:
        client.wait_for_first_answer()
    for client in clients:
        client.go()
    results = [client.result() for client in clients]
    answered, wrong = (sum(result[key] for result in results) for key in ('answered', 'wrong'))
    lost = 16 * calls - answered
    yield f'{16 * calls} calls, {lost} lost, {wrong} swapped', (lost, wrong) == (0, 0)
    greetings = sum(result['greetings'] for result in results)
    exit_code, handled = bridge.handled()
    text = f'{handled} requests handled of {greetings} greetings and {16 * calls} calls, exit {exit_code}'
    yield text, exit_code == 0 and 16 + 16 * calls <= handled <= greetings + 16 * calls


def many_calls(scale: int) -> Iterator[tuple[str, bool]]:
    """Call many times; no reply is lost, and memory, files and threads do not grow."""
    bridge = Bridge(debug_time_of_day=12.0)
    ClientProcess('--calls', '1000').result()
    before = resources_of(bridge)
    calls = 20_000 * scale if scale > 1 else 5_000
    started = time.monotonic()
    result = ClientProcess('--calls', str(calls), '--seconds', '3000').result()
    rate = calls / (time.monotonic() - started)
    after = resources_of(bridge)
    lost = calls - result['answered']
    text = f'{calls} calls, {lost} lost, {result["wrong"]} swapped, {rate:.0f} calls/s'
    yield text, (lost, result['wrong']) == (0, 0)
    for name, growth in GROWTH.items():
        yield f'{name} {before[name]} -> {after[name]}', after[name] <= before[name] + growth
    yield bridge.ends_cleanly()


def resources_of(bridge: Bridge) -> dict[str, int]:
    """Return what may grow by GROWTH."""
    memory_kb, threads = bridge.status('VmRSS'), bridge.status('Threads')
    return {'RSS in kB': memory_kb, 'open files': bridge.open_files(), 'threads': threads}


def terminated_during_calls(scale: int) -> Iterator[tuple[str, bool]]:
    """Send SIGTERM during calls, at any moment; the bridge exits with 0 and each call ends."""
    exit_codes, answered, timed_out = [], 0, 0
    for _ in range(3 * scale):
        bridge = Bridge(debug_time_of_day=12.0)
        client = ClientProcess('--seconds', '2', '--timeout', '0.5')
        client.wait_for_first_answer()
        time.sleep(random.uniform(0.0, 0.1))  # noqa: S311 (any moment will do)
        exit_codes.append(bridge.stop()[0])
        result = client.result()
        answered, timed_out = answered + result['answered'], timed_out + result['timed_out']
    calls = f'{answered} calls answered, {timed_out} timed out after 0.5 s'
    yield f'{3 * scale} times, {calls}, exit codes {set(exit_codes)}', set(exit_codes) == {0}


def two_bridges(scale: int) -> Iterator[tuple[str, bool]]:
    """Run two bridges with one name: each call gets one reply, from either."""
    bridges = [Bridge(debug_time_of_day=hour) for hour in (6.0, 18.0)]
    calls = 200 * scale
    result = ClientProcess('--calls', str(calls)).result()
    shares = ', '.join(
        f'{count} at {float(second) / 3600:g} h' for second, count in result['sim_times'].items()
    )
    yield f'{calls} calls, {result["answered"]} answered ({shares})', result['answered'] == calls
    codes = [bridge.stop()[0] for bridge in bridges]
    yield f'exit codes {codes}', codes == [0, 0]


def tags_in_view(_scale: int) -> Iterator[tuple[str, bool]]:
    """Show 32 tags at 30 Hz, three of which do not exist, and restart the bridge; each one is read."""
    from apriltag_msgs.msg import AprilTagDetection, AprilTagDetectionArray
    from lupin_greenhouse_bridge.testing import NodeProcess
    from lupin_greenhouse_bridge.testing._helpers import spinning_node

    tags = [*map(int, TAG_IDS), 400, 401, 402]
    bridge = Bridge()
    command = [executable('lupin_greenhouse_bridge', 'read_on_sight')]
    reader = NodeProcess(command, cooldown_seconds=3600.0, request_timeout_seconds=0.5)
    read = []
    with spinning_node('detector') as node:
        topic = f'{reader.namespace}/read_on_sight/readings'
        node.create_subscription(TagReading, topic, lambda message: read.append(message.tag_id), LATCHED)
        detections = node.create_publisher(AprilTagDetectionArray, '/detections', 10)

        def show(numbers: list[int], seconds: float, enough: int) -> None:
            seen = [AprilTagDetection(family='tag36h11', id=number) for number in numbers]
            end = time.monotonic() + seconds
            while time.monotonic() < end and len(read) < enough:
                detections.publish(AprilTagDetectionArray(detections=seen))
                time.sleep(1 / 30)

        reader.wait_for_log('ready:')
        show(tags[:16], PATIENCE_SECONDS, 16)
        bridge.kill()
        show(tags, 3.0, len(tags))
        bridge = Bridge()
        show(tags, PATIENCE_SECONDS, len(TAG_IDS))
    text = f'{len(tags)} tags in view, the bridge killed after 16 of them: {len(read)} readings'
    yield text, sorted(read) == sorted(TAG_IDS)
    codes = [reader.stop(), bridge.stop()[0]]
    yield f'exit codes {codes}', codes == [0, 0]


def recorder_killed(scale: int) -> Iterator[tuple[str, bool]]:
    """Kill recorders at any moment under 200 values a second; no row that they have acknowledged is lost."""
    from lupin_greenhouse_bridge.testing import NodeProcess
    from lupin_greenhouse_bridge.testing._helpers import spinning_node

    topic = '/soak/readings'
    acknowledged = lost = 0
    with tempfile.TemporaryDirectory() as folder, spinning_node('robot') as node:
        files = [Path(folder, name) for name in ('readings.sqlite', 'readings.csv')]
        rows = {file: [] for file in files}
        readings = node.create_publisher(TagReading, topic, LATCHED)

        def publish() -> None:
            values = [SensorReading(name=name, value=1.0) for name in ('co2', 'light')]
            readings.publish(TagReading(tag_id='7', stamp=node.get_clock().now().to_msg(), readings=values))

        node.create_timer(0.01, publish)
        for _ in range(10 * scale):
            recorders = [NodeProcess(RECORD_READINGS, readings_topics=topic, file=file) for file in files]
            for recorder in recorders:
                recorder.wait_for_log('rows kept')
            time.sleep(random.uniform(0.0, 1.0))  # noqa: S311 (any moment will do)
            for recorder, file in zip(recorders, files, strict=True):
                recorder.close()
                kept = [line for line in recorder.rest_of_log() if line.endswith('rows kept')]
                count, before = int(kept[-1].split()[-3]), len(rows[file])
                rows[file] = read_rows(file)
                acknowledged += count
                lost += max(before + count - len(rows[file]), 0)
        in_database = [key_of(row) for row in rows[files[0]]]
    twice = len(in_database) - len(set(in_database))
    text = f'{20 * scale} kills, {acknowledged} rows acknowledged, {lost} of them lost'
    text += f', {twice} twice in the database'
    yield text, lost == twice == 0 < acknowledged


def recorder_locked(scale: int) -> Iterator[tuple[str, bool]]:
    """Lock the databases of recorders under 300 values a second, and end them; no value is lost silently."""
    from lupin_greenhouse_bridge.testing._helpers import spinning_node

    longest_seconds, runs = 6.0 * scale, 2 * scale
    with (
        tempfile.TemporaryDirectory() as folder,
        spinning_node('robot') as node,
        ThreadPoolExecutor(runs) as pool,
    ):
        files = [Path(folder, f'recorder_{number}.sqlite') for number in range(runs)]
        ends = list(
            pool.map(lambda file: locked(node, file, longest_seconds, is_killed=file in files[::2]), files)
        )
    killed, ended = ends[::2], ends[1::2]
    published, _, lost, kept = map(sum, zip(*ended, strict=True))
    yield (
        f'{len(ended)} recorders ended: {published} rows published, {kept} kept, {lost} counted as lost',
        all(published == kept + lost for published, _, lost, kept in ended),
    )
    published, acknowledged, _, kept = map(sum, zip(*killed, strict=True))
    yield (
        f'{len(killed)} recorders killed: {published} rows published, {acknowledged} acknowledged,'
        f' {kept} kept',
        all(acknowledged <= kept <= published for published, acknowledged, _, kept in killed),
    )


def locked(node, file: Path, longest_seconds: float, is_killed: bool) -> tuple[int, int, int, int]:
    """
    Publish to a recorder until a random moment, during or after a random lock of its file, and end it.

    Returns how many values were published, acknowledged, counted as lost, and kept.
    """
    from lupin_greenhouse_bridge.testing import NodeProcess

    topic, published = f'/soak/{file.stem}', 0
    recorder = NodeProcess(RECORD_READINGS, readings_topics=topic, file=file)
    recorder.wait_for_log('ready: ')
    readings = node.create_publisher(TagReading, topic, QoSProfile(depth=2000, durability=LATCHED.durability))
    values = [SensorReading(name=f'sensor {number}', value=1.0) for number in range(60)]
    start = time.monotonic()
    unlock = start + random.uniform(0.0, longest_seconds)  # noqa: S311 (any moment will do)
    end = start + random.uniform(1.0, longest_seconds + 2.0)  # noqa: S311
    with contextlib.closing(sqlite3.connect(file, isolation_level=None)) as other:
        other.execute('BEGIN IMMEDIATE')
        while time.monotonic() < end:
            if other.in_transaction and time.monotonic() > unlock:
                other.execute('ROLLBACK')
            stamp = node.get_clock().now().to_msg()
            readings.publish(TagReading(tag_id='7', stamp=stamp, readings=values))
            published += len(values)
            time.sleep(0.2)
        if is_killed:
            recorder.close()
        else:
            readings.wait_for_all_acked(Duration(seconds=PATIENCE_SECONDS))
            recorder.stop()
    counts = {'kept': 0, 'lost': 0}
    for line in recorder.rest_of_log():
        if match := re.search(r'(\d+) rows (kept|lost)$', line):
            counts[match[2]] = int(match[1])
    return published, counts['kept'], counts['lost'], len(read_rows(file))


def recorder_of_many_rows(scale: int) -> Iterator[tuple[str, bool]]:
    """Start recorders with files of a million rows; their memory does not grow with the file."""
    from lupin_greenhouse_bridge.testing import NodeProcess

    count = 100_000 * scale
    (first,) = make_rows(START_NS, '7', [('co2', 468.63)], 14400.0, '/soak/none', (1.5, 7.25))
    for name in ('readings.sqlite', 'readings.csv'):
        with tempfile.TemporaryDirectory() as folder:
            store = open_store(str(Path(folder, name)))
            for number in range(0, count, 1000):
                store.keep([first._replace(stamp_ns=START_NS + n) for n in range(number, number + 1000)])
            start = time.monotonic()
            recorder = NodeProcess(RECORD_READINGS, readings_topics='/soak/none', file=Path(folder, name))
            recorder.wait_for_log('ready: ')
            seconds = time.monotonic() - start
            status = Path(f'/proc/{recorder.process.pid}/status').read_text()
            megabytes = int(re.search(r'VmHWM:\s*(\d+) kB', status)[1]) / 1000
            recorder.stop()
        yield f'{name} of {count:,} rows: ready after {seconds:.1f} s, {megabytes:.0f} MB', megabytes < 150


def results_of(commands: Iterator[list[str]], signals: tuple = ()) -> Iterator[tuple[int, str]]:
    """
    Run commands, two at a time; yield exit code and output of each.

    With signals, one to three arrive at random moments of the first second. Each process is alone on
    its domain: Fast DDS 3.2 can crash in a process that closes while another one asks for its types.
    """

    def result_of(command: list[str]) -> tuple[int, str]:
        with domain_coordinator.domain_id() as domain_id:
            environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain_id)}
            process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
            )
            while signals and not takes_signals(process.pid) and process.poll() is None:
                time.sleep(0.001)
            for number in random.choices(signals, k=random.randint(1, 3)) if signals else ():  # noqa: S311
                time.sleep(random.choice([0.0, random.uniform(0.0, 1.0)]))  # noqa: S311
                process.send_signal(number)
            try:
                output, _ = process.communicate(timeout=PATIENCE_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
                return -signal.SIGKILL, f'hung for {PATIENCE_SECONDS:g} s: {shlex.join(command)}'
            return process.returncode, output

    with ThreadPoolExecutor(2) as pool:
        yield from pool.map(result_of, commands)


def takes_signals(pid: int) -> bool:
    """Return whether a process has a handler for SIGTERM; without one, the signal ends Python."""
    try:
        status = Path(f'/proc/{pid}/status').read_text()
    except OSError:
        return False
    caught = next(line for line in status.splitlines() if line.startswith('SigCgt:')).split()[1]
    return bool(int(caught, 16) >> (signal.SIGTERM - 1) & 1)


def refused_starts(_scale: int) -> Iterator[tuple[str, bool]]:
    """Start the bridge with a parameter that it refuses; each start ends cleanly with exit code 1."""
    command = [executable('lupin_greenhouse_bridge', 'bridge_node'), '--ros-args', '-p', 'debug_seed:=-5']
    codes = Counter(code for code, _ in results_of(repeat(command, options.refusals)))
    yield f'{options.refusals} refused, exit codes {dict(codes)}', set(codes) == {1}


def signalled_at_any_moment(_scale: int) -> Iterator[tuple[str, bool]]:
    """Send Ctrl-C and SIGTERM at random, up to three of them; each process ends as documented."""
    bridge_node, read_tag, read_on_sight, record_readings = (
        [executable('lupin_greenhouse_bridge', name)]
        for name in ('bridge_node', 'read_tag', 'read_on_sight', 'record_readings')
    )
    read_nobody = [*read_tag, '1', '--service', '/nobody/get_tag_reading', '--timeout', '60']
    with tempfile.TemporaryDirectory() as folder:
        files = (f'file:={folder}/{number}.sqlite' for number in count())
        cases = [
            ('bridge_node', repeat(bridge_node), {0}),
            ('read_tag', repeat(read_nobody), {130}),
            ('read_tag --watch', repeat([*read_nobody, '--watch', '1']), {130}),
            ('read_on_sight', repeat(read_on_sight), {0}),
            ('record_readings', ([*record_readings, '--ros-args', '-p', file] for file in files), {0}),
        ]
        if os.environ.get('TREE', 'monorepo') == 'monorepo':
            mission = [executable('lupin_mission', 'mission_orchestrator'), '--ros-args']
            mission += ['-p', 'drive:=simulated', '-p', 'wait_for_start:=false', '-p']
            reports = (f'report_file:={folder}/{number}.jsonl' for number in count())
            cases += [
                ('mission_orchestrator', ([*mission, report] for report in reports), {0, 1}),
                ('confirm_tag', repeat([executable('lupin_tag_confirmation', 'confirm_tag')]), {0}),
            ]
        for name, commands, documented in cases:
            signals = (signal.SIGINT, signal.SIGINT, signal.SIGTERM)
            results = list(results_of(islice(commands, options.signals), signals))
            codes = dict(Counter(code for code, _ in results))
            tracebacks = sum('Traceback' in output for _, output in results)
            text = (
                f'{name}: {options.signals} times, exit codes {codes}, {pluralized(tracebacks, "traceback")}'
            )
            is_kept = set(codes) <= documented and not tracebacks
            if name == 'mission_orchestrator':
                tables = sum('tags read' in output for _, output in results)
                text, is_kept = (
                    f'{text}, {pluralized(tables, "table")}',
                    is_kept and tables == options.signals,
                )
            yield text, is_kept
            odd = [output for code, output in results if code not in documented or 'Traceback' in output]
            print(*odd[:1], sep='', end='')


SCENARIOS: list[Callable[[int], Iterator[tuple[str, bool]]]] = [
    client_killed_in_mid_call,
    bridge_killed_and_restarted,
    sixteen_clients,
    many_calls,
    terminated_during_calls,
    two_bridges,
    tags_in_view,
    recorder_killed,
    recorder_locked,
    recorder_of_many_rows,
    refused_starts,
    signalled_at_any_moment,
]
options = argparse.Namespace(refusals=None, signals=None)


def run(scenarios: list, scale: int) -> int:
    """Run scenarios and print a line per promise; return how many are broken. A hang breaks one."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # ends all that was started
    broken = 0
    for scenario in scenarios:
        for text, is_kept in ended(scenario(scale)):
            broken += not is_kept
            print(f'{"kept  " if is_kept else "BROKEN"}  {scenario.__name__}: {text}', flush=True)
    print(f'{pluralized(broken, "promise")} broken')
    return broken


def ended(promises: Iterator[tuple[str, bool]]) -> Iterator[tuple[str, bool]]:
    """Yield the promises of a scenario, and a broken one if one of its processes did not end."""
    try:
        yield from promises
    except subprocess.TimeoutExpired as error:
        yield f'hung for {error.timeout:g} s: {shlex.join(error.cmd[1:])}', False


def main() -> int:
    """Run every scenario on a domain of its own; return the exit code."""
    parser = parser_of(__doc__, 'a tenth of everything')
    names = [scenario.__name__ for scenario in SCENARIOS]
    text = ', '.join(names)
    parser.add_argument('--only', nargs='+', choices=names, default=names, metavar='NAME', help=text)
    parser.add_argument('--refusals', type=int, help='default: 200, or 20')
    parser.add_argument('--signals', type=int, help='at each executable; default: 100, or 10')
    parser.parse_args(namespace=options)
    share = 10 if options.short else 1
    options.refusals = options.refusals or 200 // share
    options.signals = options.signals or 100 // share
    scenarios = [scenario for scenario in SCENARIOS if scenario.__name__ in options.only]
    with own_domain():
        return 1 if run(scenarios, 1 if options.short else 10) else 0


if __name__ == '__main__':
    sys.exit(main())
