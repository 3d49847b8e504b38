"""
Check what the bridge promises under faults and load on one machine, and count.

    make soak                    takes about a quarter of an hour
    make soak SHORT=1            takes about two minutes
    make soak REFUSALS=12000     this many refused starts instead of 200
    make soak SIGNALS=500        this many signals to each executable instead of 100
    make soak ARGS="--only NAME" one scenario

Prints one line per promise. The exit code is 1 if a promise is broken.
"""

import contextlib
import os
import random
import re
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

import domain_coordinator
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.interfaces import SensorReading, TagReading
from lupin_greenhouse_bridge.recording.reading_files import read_rows
from lupin_greenhouse_bridge.recording.rows import key_of, make_rows
from lupin_greenhouse_bridge.recording.store import open_store
from lupin_greenhouse_bridge.runtime.arguments import number_type
from lupin_greenhouse_bridge.testing._helpers import executable, spinning_node
from rclpy.duration import Duration
from rclpy.node import Node
from shared import PATIENCE_SECONDS, Promises, Server, check_promises, own_domain, parser_of, status_of
from traffic import Bridge, ClientProcess, start_clients, total_of

GROWTH = {'RSS in kB': 4096, 'open files': 2, 'threads': 0}  # the largest during many calls
BRIDGE_NODE, READ_TAG, READ_ON_SIGHT, RECORD_READINGS = (
    [executable('lupin_greenhouse_bridge', name)]
    for name in ('bridge_node', 'read_tag', 'read_on_sight', 'record_readings')
)
START_NS = 1_795_189_976_000_000_000


class Load(NamedTuple):
    """How much of everything; `scale` is 1 or 10."""

    scale: int
    refusals: int
    signals: int


def a_moment(longest_seconds: float) -> float:
    """Return a random number of seconds."""
    return random.uniform(0.0, longest_seconds)  # noqa: S311 - no secret


def answered_by(text: str, calls: int) -> tuple[str, bool]:
    """Return as a promise that a new client gets an answer to each of its calls."""
    answered = ClientProcess('--calls', calls).counts().answered
    return f'{text} {answered}/{calls}', answered == calls


def client_killed_in_mid_call(load: Load) -> Promises:
    """Kill clients without warning; the bridge continues and keeps nothing of theirs."""
    bridge = Bridge(debug_time_of_day=12.0)
    ClientProcess('--calls', 100).counts()
    files = bridge.open_files()
    for _ in range(2 * load.scale):
        for victim in start_clients(4):
            victim.process.kill()
            victim.process.wait()
    yield answered_by(f'{8 * load.scale} clients killed, next one answered', 100)
    yield f'open files {files} -> {bridge.open_files()}', bridge.open_files() <= files + 8
    yield bridge.ends_cleanly()


def bridge_killed_and_restarted(load: Load) -> Promises:
    """Kill the bridge while clients keep calling; every call ends, and the next bridge starts and answers."""
    bridge = Bridge(debug_time_of_day=12.0)
    clients = start_clients(4, '--seconds', 6 * load.scale + 8, '--timeout', 2, '--pause', 0.005)
    for _ in range(2 * load.scale):
        bridge.close()
        bridge = Bridge(debug_time_of_day=12.0)  # returns when it is ready, despite what the killed one left
        time.sleep(2.0)
    found = total_of([client.counts() for client in clients])
    # After a kill, sending itself may take a second: Fast DDS then checks the queues in shared memory.
    timeouts = f'{found.timed_out} timed out after 2 s (slowest {found.slowest_seconds} s)'
    text = f'{2 * load.scale} kills, {found.answered} calls answered, {found.swapped} swapped, {timeouts}'
    yield text, found.swapped == 0
    yield answered_by('after the last restart, answered', 50)
    yield bridge.ends_cleanly()


def sixteen_clients(load: Load) -> Promises:
    """
    Call from 16 processes at once; every reply matches its request, and none is lost.

    All start at the same moment: 16 requests are more than the 10 that ROS's default depth keeps.
    """
    bridge = Bridge(debug_time_of_day=12.0)
    clients = start_clients(16, '--wait', '--calls', 100 * load.scale)
    for client in clients:
        client.go()
    counts, calls = [client.counts() for client in clients], 1600 * load.scale
    found = total_of(counts)
    lost = calls - found.answered
    yield f'{calls} calls, {lost} lost, {found.swapped} swapped', (lost, found.swapped) == (0, 0)
    yield bridge.has_handled(counts)


def many_calls(load: Load) -> Promises:
    """Call many times; no reply is lost, and memory, files and threads do not grow."""
    bridge = Bridge(debug_time_of_day=12.0)
    ClientProcess('--calls', 1000).counts()
    before = resources_of(bridge)
    calls = 20_000 * load.scale if load.scale > 1 else 5_000
    started = time.monotonic()
    found = ClientProcess('--calls', calls, '--seconds', 3000).counts()
    rate = calls / (time.monotonic() - started)
    after = resources_of(bridge)
    lost = calls - found.answered
    text = f'{calls} calls, {lost} lost, {found.swapped} swapped, {rate:.0f} calls/s'
    yield text, (lost, found.swapped) == (0, 0)
    for name, growth in GROWTH.items():
        yield f'{name} {before[name]} -> {after[name]}', after[name] <= before[name] + growth
    yield bridge.ends_cleanly()


def resources_of(bridge: Bridge) -> dict[str, int]:
    """Return what may grow by GROWTH."""
    memory_kb, threads = bridge.status('VmRSS'), bridge.status('Threads')
    return {'RSS in kB': memory_kb, 'open files': bridge.open_files(), 'threads': threads}


def terminated_during_calls(load: Load) -> Promises:
    """Send SIGTERM during calls, at any moment; the bridge exits with 0 and each call ends."""
    exit_codes = []
    clients: list[ClientProcess] = []
    for _ in range(3 * load.scale):
        bridge = Bridge(debug_time_of_day=12.0)
        clients += start_clients(1, '--seconds', 2, '--timeout', 0.5)
        time.sleep(a_moment(0.1))
        exit_codes.append(bridge.stop())
        clients[-1].process.wait(PATIENCE_SECONDS)
    found = total_of([client.counts() for client in clients])
    calls = f'{found.answered} calls answered, {found.timed_out} timed out after 0.5 s'
    yield f'{3 * load.scale} times, {calls}, exit codes {set(exit_codes)}', set(exit_codes) == {0}


def two_bridges(load: Load) -> Promises:
    """Run two bridges with one name: each call gets one reply, from either."""
    bridges = [Bridge(debug_time_of_day=hour) for hour in (6.0, 18.0)]
    calls = 200 * load.scale
    found = ClientProcess('--calls', calls).counts()
    shares = ', '.join(f'{n} at {float(second) / 3600:g} h' for second, n in found.sim_times.items())
    yield f'{calls} calls, {found.answered} answered ({shares})', found.answered == calls
    codes = [bridge.stop() for bridge in bridges]
    yield f'exit codes {codes}', codes == [0, 0]


def recorder_killed(load: Load) -> Promises:
    """Kill recorders at any moment under 300 values a second; no row that they have acknowledged is lost."""
    acknowledged = lost = 0
    with (
        tempfile.TemporaryDirectory() as folder,
        spinning_node('robot') as node,
        ThreadPoolExecutor(2) as pool,
    ):
        in_file = {Path(folder, f'readings.{suffix}'): 0 for suffix in ('sqlite', 'csv')}
        for _ in range(10 * load.scale):
            seconds = [1.0 + a_moment(1.0) for _ in in_file]
            runs = pool.map(partial(record, node, is_killed=True), in_file, seconds)
            for file, run in zip(list(in_file), runs, strict=True):
                acknowledged += run['kept']
                lost += max(in_file[file] + run['kept'] - run['in file'], 0)
                in_file[file] = run['in file']
        in_database = [key_of(row) for row in read_rows(Path(folder, 'readings.sqlite'))]
    twice = len(in_database) - len(set(in_database))
    text = f'{20 * load.scale} kills, {acknowledged} rows acknowledged, {lost} of them lost'
    yield f'{text}, {twice} twice in the database', lost == twice == 0 < acknowledged


def recorder_locked(load: Load) -> Promises:
    """Lock the databases of recorders under 300 values a second, and end them; no value is lost silently."""
    longest_seconds = 6.0 * load.scale

    def run(number: int) -> 'Counter[str]':
        seconds, locked_seconds = 1.0 + a_moment(longest_seconds + 1.0), a_moment(longest_seconds)
        file = Path(folder, f'recorder_{number}.sqlite')
        return record(node, file, seconds, locked_seconds, is_killed=number % 2 == 1)

    with (
        tempfile.TemporaryDirectory() as folder,
        spinning_node('robot') as node,
        ThreadPoolExecutor(2 * load.scale) as pool,
    ):
        runs = list(pool.map(run, range(2 * load.scale)))
    total = sum(runs[::2], Counter())
    text = f'{load.scale} recorders ended: {total["published"]} rows published, {total["in file"]} kept'
    is_kept = all(each['published'] == each['in file'] + each['lost'] for each in runs[::2])
    yield f'{text}, {total["lost"]} counted as lost', is_kept
    total = sum(runs[1::2], Counter())
    text = f'{load.scale} recorders killed: {total["published"]} rows published'
    is_kept = all(each['kept'] <= each['in file'] <= each['published'] for each in runs[1::2])
    yield f'{text}, {total["kept"]} acknowledged, {total["in file"]} kept', is_kept


def record(
    node: Node, file: Path, seconds: float, locked_seconds: float = 0.0, *, is_killed: bool
) -> 'Counter[str]':
    """
    Publish to a recorder, whose file is first locked for some seconds, and end the recorder.

    Returns the numbers of rows: `published`, `kept` and `lost` as the recorder says, and `in file`.
    """
    topic, published = f'/soak/{file.name.replace(".", "_")}', 0
    recorder = Server(*RECORD_READINGS, namespace=topic, readings_topics=topic, file=file)
    readings = node.create_publisher(TagReading, topic, latched(2000))
    values = [SensorReading(name=f'sensor {number}', value=1.0) for number in range(60)]
    start = time.monotonic()
    with contextlib.closing(sqlite3.connect(file, isolation_level=None)) as other:
        if locked_seconds:
            other.execute('BEGIN IMMEDIATE')
        while time.monotonic() < start + seconds:
            if other.in_transaction and time.monotonic() > start + locked_seconds:
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
    node.destroy_publisher(readings)  # it is latched: the next recorder would receive its readings
    counted = re.findall(r'(\d+) rows (kept|lost)$', '\n'.join(recorder.rest_of_log()), re.MULTILINE)
    in_log = Counter({what: int(number) for number, what in counted})
    return in_log + Counter({'published': published, 'in file': len(read_rows(file))})


def recorder_of_many_rows(load: Load) -> Promises:
    """Start recorders with files of a million rows; their memory does not grow with the file."""
    size = 100_000 * load.scale
    (first,) = make_rows(START_NS, '7', [('co2', 468.63)], 14400.0, '/soak/none', (1.5, 7.25))
    for name in ('readings.sqlite', 'readings.csv'):
        with tempfile.TemporaryDirectory() as folder:
            store = open_store(str(Path(folder, name)))
            for number in range(0, size, 1000):
                store.keep([first._replace(stamp_ns=START_NS + n) for n in range(number, number + 1000)])
            start = time.monotonic()
            recorder = Server(*RECORD_READINGS, readings_topics='/soak/none', file=Path(folder, name))
            seconds = time.monotonic() - start
            megabytes = recorder.status('VmHWM') / 1000
            recorder.stop()
        yield f'{name} of {size:,} rows: ready after {seconds:.1f} s, {megabytes:.0f} MB', megabytes < 150


def results_of(commands: Iterable[list[str]], *, is_signalled: bool) -> list[tuple[int, str]]:
    """
    Run commands, two at a time; return exit code and output of each.

    If they are signalled, one to three signals arrive at random moments of the first second. Each process is
    alone on its domain: Fast DDS 3.2 can crash in a process that closes while another one asks for its types.
    """

    def result_of(command: list[str]) -> tuple[int, str]:
        with domain_coordinator.domain_id() as domain_id:
            environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain_id)}
            process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
            )
            try:
                if is_signalled:
                    send_signals(process)
                output, _ = process.communicate(timeout=PATIENCE_SECONDS)
            finally:
                process.kill()
            return process.returncode, output

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(result_of, commands))


def send_signals(process: 'subprocess.Popen[str]') -> None:
    """Send one to three signals to a process as soon as it handles SIGTERM, which would end Python before."""
    handled = 0
    while not handled >> (signal.SIGTERM - 1) & 1 and process.poll() is None:
        time.sleep(0.001)
        handled = int(status_of(process.pid, 'SigCgt'), 16)
    for number in random.choices([signal.SIGINT, signal.SIGINT, signal.SIGTERM], k=random.randint(1, 3)):  # noqa: S311
        time.sleep(random.choice([0.0, a_moment(1.0)]))  # noqa: S311
        process.send_signal(number)


def refused_starts(load: Load) -> Promises:
    """Start the bridge with a parameter that it refuses; each start ends cleanly with exit code 1."""
    command = [*BRIDGE_NODE, '--ros-args', '-p', 'debug_seed:=-5']
    results = results_of(repeat(command, load.refusals), is_signalled=False)
    codes = Counter(code for code, _ in results)
    yield f'{load.refusals} refused, exit codes {dict(codes)}', set(codes) == {1}


def signalled_at_any_moment(load: Load) -> Promises:
    """Send Ctrl-C and SIGTERM at random, up to three of them; each process ends as documented."""
    read_nobody = [*READ_TAG, '1', '--service', '/nobody/get_tag_reading', '--timeout', '60']
    mission = [executable('lupin_mission', 'mission_orchestrator'), '--ros-args']
    mission += ['-p', 'drive:=simulated', '-p', 'wait_for_start:=false', '-p', 'report_file:=NEW_FILE.jsonl']
    for name, command, documented in (
        ('bridge_node', BRIDGE_NODE, {0}),
        ('read_tag', read_nobody, {130}),
        ('read_tag --watch', [*read_nobody, '--watch', '1'], {130}),
        ('read_on_sight', READ_ON_SIGHT, {0}),
        ('record_readings', [*RECORD_READINGS, '--ros-args', '-p', 'file:=NEW_FILE.sqlite'], {0}),
        ('mission_orchestrator', mission, {0, 1}),
        ('confirm_tag', [executable('lupin_tag_confirmation', 'confirm_tag')], {0}),
    ):
        with tempfile.TemporaryDirectory() as folder:
            commands = [
                [word.replace('NEW_FILE', f'{folder}/{number}') for word in command]
                for number in range(load.signals)
            ]
            results = results_of(commands, is_signalled=True)
        codes = Counter(code for code, _ in results)
        tracebacks = sum('Traceback' in output for _, output in results)
        text = f'{load.signals} times, exit codes {dict(codes)}, {pluralized(tracebacks, "traceback")}'
        is_kept = set(codes) <= documented and not tracebacks
        if name == 'mission_orchestrator':
            tables = sum('tags read' in output for _, output in results)
            text += f', {pluralized(tables, "table")}'
            is_kept = is_kept and tables == load.signals
        yield f'{name}: {text}', is_kept
        odd = [output for code, output in results if code not in documented or 'Traceback' in output]
        print(*odd[:1], sep='', end='')


SCENARIOS = (
    client_killed_in_mid_call,
    bridge_killed_and_restarted,
    sixteen_clients,
    many_calls,
    terminated_during_calls,
    two_bridges,
    recorder_killed,
    recorder_locked,
    recorder_of_many_rows,
    refused_starts,
    signalled_at_any_moment,
)


def main() -> int:
    """Run every scenario on a domain of its own; return the exit code."""
    parser = parser_of(__doc__, 'a tenth of everything')
    names = [scenario.__name__ for scenario in SCENARIOS]
    parser.add_argument(
        '--only', nargs='+', choices=names, default=names, metavar='NAME', help=', '.join(names)
    )
    count = number_type('a whole number above 0, such as 20', int, above=0)
    parser.add_argument('--refusals', type=count, help='default: 200, or 20')
    parser.add_argument('--signals', type=count, help='at each executable; default: 100, or 10')
    options = parser.parse_args()
    scale = 1 if options.short else 10
    load = Load(scale, options.refusals or 20 * scale, options.signals or 10 * scale)
    with own_domain():
        scenarios = [scenario for scenario in SCENARIOS if scenario.__name__ in options.only]
        return 1 if check_promises(scenarios, load) else 0


if __name__ == '__main__':
    sys.exit(main())
