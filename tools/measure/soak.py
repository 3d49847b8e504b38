"""
Check what the bridge promises under faults and load on one machine, and count.

make soak SHORT=1 takes about two minutes, and ARGS="--only NAME" runs one scenario. Prints one line per
promise. The exit code is 1 if a promise is broken.
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
from argparse import Namespace
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import domain_coordinator
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.interfaces import SensorReading, TagReading
from lupin_greenhouse_bridge.recording.reading_files import read_rows
from lupin_greenhouse_bridge.recording.rows import key_of, make_rows
from lupin_greenhouse_bridge.recording.store import open_store
from lupin_greenhouse_bridge.runtime.arguments import number_type
from lupin_greenhouse_bridge.runtime.process import private_domains
from lupin_greenhouse_bridge.testing._helpers import executable, spinning_node
from rclpy.duration import Duration
from rclpy.node import Node
from shared import PATIENCE_SECONDS, Promises, Server, check_promises, own_domain, parser_of
from traffic import Bridge, ClientProcess, start_clients

GROWTH = {'RSS in kB': 4096, 'open files': 2, 'threads': 0}  # the largest during many calls
BRIDGE_NODE, READ_TAG, READ_ON_SIGHT, RECORD_READINGS = (
    [executable('lupin_greenhouse_bridge', name)]
    for name in ('bridge_node', 'read_tag', 'read_on_sight', 'record_readings')
)
START_NS = 1_795_189_976_000_000_000
CHANCE = random.SystemRandom()


def bridge_ended_and_restarted(load: Namespace) -> Promises:
    """Kill or terminate the bridge while clients call; every call ends, and the next bridge answers."""
    bridge = Bridge()
    clients = start_clients(4, '--seconds', 14 * load.scale + 8, '--timeout', 2, '--pause', 0.005)
    exit_codes = []
    for number in range(4 * load.scale):
        if number % 2:
            exit_codes.append(bridge.stop())
        else:
            bridge.close()
        bridge = Bridge()  # returns when it is ready, despite what a killed one left
        time.sleep(CHANCE.uniform(2.0, 2.1))
    counts = [client.counts() for client in clients]
    found, slowest = sum(counts, Counter()), max(each['slowest'] for each in counts)
    # After a kill, sending itself may take a second: Fast DDS then checks the queues in shared memory.
    timeouts = f'{found["timed out"]} timed out after 2 s (slowest {slowest / 1000} s)'
    yield f'{found["answered"]} calls answered, {found["swapped"]} swapped, {timeouts}', not found['swapped']
    text = f'{2 * load.scale} times killed, as often terminated, exit codes {set(exit_codes)}'
    yield text, set(exit_codes) == {0}
    answered = ClientProcess('--calls', 50).counts()['answered']
    yield f'after the last restart, answered {answered}/50', answered == 50
    yield bridge.ends_cleanly()


def sixteen_clients(load: Namespace) -> Promises:
    """
    Call from 16 processes at once; every reply matches its request, and none is lost.

    All start at the same moment: 16 requests are more than the 10 that ROS's default depth keeps.
    """
    bridge = Bridge()
    clients = start_clients(16, '--wait', '--calls', 100 * load.scale)
    for client in clients:
        client.go()
    counts, calls = [client.counts() for client in clients], 1600 * load.scale
    lost, swapped = calls - sum(each['answered'] for each in counts), sum(each['swapped'] for each in counts)
    yield f'{calls} calls, {lost} lost, {swapped} swapped', (lost, swapped) == (0, 0)
    yield bridge.has_handled(counts)


def killed_clients_and_many_calls(load: Namespace) -> Promises:
    """Kill clients without warning, then call many times: no reply is lost, and the bridge does not grow."""
    bridge = Bridge()
    ClientProcess('--calls', 1000).counts()
    before = bridge.resources()
    for _ in range(2 * load.scale):
        for victim in start_clients(4):
            victim.process.kill()
            victim.process.wait()
    # Fast DDS remembers a killed client for a while, which takes memory, but no file.
    before = bridge.resources() | {'open files': before['open files']}
    calls = 20_000 * load.scale if load.scale > 1 else 5_000
    started = time.monotonic()
    found = ClientProcess('--calls', calls, '--seconds', 3000).counts()
    rate = calls / (time.monotonic() - started)
    lost, swapped = calls - found['answered'], found['swapped']
    text = f'{8 * load.scale} clients killed, {calls} calls, {lost} lost, {swapped} swapped'
    yield f'{text}, {rate:.0f} calls/s', (lost, swapped) == (0, 0)
    after = bridge.resources()
    for name, growth in GROWTH.items():
        yield f'{name} {before[name]} -> {after[name]}', after[name] <= before[name] + growth
    yield bridge.ends_cleanly()


def two_bridges(load: Namespace) -> Promises:
    """Run two bridges with one name: each call gets one reply, from either."""
    hours = (6.0, 18.0)
    bridges = [Bridge(debug_time_of_day=hour) for hour in hours]
    calls = 200 * load.scale
    found = ClientProcess('--calls', calls).counts()
    shares = ', '.join(f'{found[f"{hour:g} h"]} at {hour:g} h' for hour in hours)
    yield f'{calls} calls, {found["answered"]} answered ({shares})', found['answered'] == calls
    codes = [bridge.stop() for bridge in bridges]
    yield f'exit codes {codes}', codes == [0, 0]


def recorders_ended(load: Namespace) -> Promises:
    """Kill or end recorders under 300 values a second, also of locked databases; none is lost silently."""
    for is_killed, longest_lock_seconds, suffixes, times in (
        (True, 0.0, ['sqlite', 'csv'], 10 * load.scale),
        (True, 6.0 * load.scale, ['sqlite'] * load.scale, 1),
        (False, 6.0 * load.scale, ['sqlite'] * load.scale, 1),
    ):
        with (
            tempfile.TemporaryDirectory() as folder,
            spinning_node('robot') as node,
            ThreadPoolExecutor(len(suffixes)) as pool,
        ):
            files = [Path(folder, f'recorder_{number}.{suffix}') for number, suffix in enumerate(suffixes)]
            one_run = partial(record, node, longest_lock_seconds, is_killed)
            runs = [run for _ in range(times) for run in pool.map(one_run, files)]
            in_database = [key_of(row) for row in read_rows(files[0])]
        total, twice = sum(runs, Counter()), len(in_database) - len(set(in_database))
        counted = [f'{total[what]} rows {what}' for what in ('published', 'in file', 'kept', 'lost')]
        ending = 'killed' if is_killed else 'ended'
        text = f'{len(runs)} recorders {ending}: {", ".join(counted)}, {twice} twice in a database'
        are_kept = [
            each['kept'] <= each['in file'] <= each['published']
            if is_killed
            else each['published'] == each['in file'] + each['lost']
            for each in runs
        ]
        yield text, all(are_kept) and twice == 0 and (longest_lock_seconds > 0 or total['kept'] > 0)


def record(node: Node, longest_lock_seconds: float, is_killed: bool, file: Path) -> 'Counter[str]':
    """
    Publish to a recorder, whose file is first locked for up to this time, and end it at any moment.

    Returns the numbers of its rows: `published`, `kept` and `lost` as the recorder says, and `in file`.
    """
    before = len(read_rows(file)) if file.exists() else 0
    locked_seconds = CHANCE.uniform(0.0, longest_lock_seconds)
    seconds = 1.0 + CHANCE.uniform(0.0, longest_lock_seconds + 1.0)
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
    return in_log + Counter({'published': published, 'in file': len(read_rows(file)) - before})


def status_of(pid: int, key: str) -> str:
    """Return a value of /proc/PID/status, without its unit."""
    text = Path(f'/proc/{pid}/status').read_text()
    return next(line for line in text.splitlines() if line.startswith(f'{key}:')).split()[1]


def recorder_of_many_rows(load: Namespace) -> Promises:
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
            megabytes = int(status_of(recorder.process.pid, 'VmHWM')) / 1000
            recorder.stop()
        yield f'{name} of {size:,} rows: ready after {seconds:.1f} s, {megabytes:.0f} MB', megabytes < 150


def results_of(command: list[str], count: int, *, is_signalled: bool) -> list[tuple[int, str]]:
    """
    Run a command this often, two at a time; return exit code and output of each.

    If they are signalled, one to three signals arrive at random moments of the first second. Each process is
    alone on its domain: Fast DDS 3.2 can crash in a process that closes while another one asks for its types.
    """

    def result(_number: int) -> tuple[int, str]:
        domain = domain_coordinator.domain_id(private_domains())
        with domain as domain_id, tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain_id)}
            output: dict[str, Any] = {'stdout': subprocess.PIPE, 'stderr': subprocess.STDOUT, 'text': True}
            process = subprocess.Popen(command, cwd=folder, env=environment, **output)
            try:
                if is_signalled:
                    send_signals(process)
                printed, _ = process.communicate(timeout=PATIENCE_SECONDS)
                return process.returncode, printed
            finally:
                process.kill()

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(result, range(count)))


def send_signals(process: 'subprocess.Popen[str]') -> None:
    """Send one to three signals to a process as soon as it handles SIGTERM, which would end Python before."""
    handled = 0
    while not handled >> (signal.SIGTERM - 1) & 1 and process.poll() is None:
        time.sleep(0.001)
        handled = int(status_of(process.pid, 'SigCgt'), 16)
    for number in CHANCE.choices([signal.SIGINT, signal.SIGINT, signal.SIGTERM], k=CHANCE.randint(1, 3)):
        time.sleep(CHANCE.choice([0.0, CHANCE.uniform(0.0, 1.0)]))
        process.send_signal(number)


def refused_starts(load: Namespace) -> Promises:
    """Start the bridge with a parameter that it refuses; each start ends cleanly with exit code 1."""
    command = [*BRIDGE_NODE, '--ros-args', '-p', 'debug_seed:=-5']
    codes = Counter(code for code, _ in results_of(command, load.refusals, is_signalled=False))
    yield f'{load.refusals} refused, exit codes {dict(codes)}', set(codes) == {1}


def signalled_at_any_moment(load: Namespace) -> Promises:
    """Send Ctrl-C and SIGTERM at random, up to three of them; each process ends as documented."""
    read_nobody = [*READ_TAG, '1', '--service', '/nobody/get_tag_reading', '--timeout', '60']
    mission = [executable('lupin_mission', 'mission_orchestrator'), '--ros-args']
    mission += ['-p', 'drive:=simulated', '-p', 'wait_for_start:=false', '-p', 'report_file:=new.jsonl']
    for name, command, documented, last_words in (
        ('bridge_node', BRIDGE_NODE, {0}, ''),
        ('read_tag', read_nobody, {130}, ''),
        ('read_tag --watch', [*read_nobody, '--watch', '1'], {130}, ''),
        ('read_on_sight', READ_ON_SIGHT, {0}, ''),
        ('record_readings', [*RECORD_READINGS, '--ros-args', '-p', 'file:=new.sqlite'], {0}, ''),
        ('mission_orchestrator', mission, {0, 1}, 'tags read'),
        ('confirm_tag', [executable('lupin_tag_confirmation', 'confirm_tag')], {0}, ''),
    ):
        results = results_of(command, load.signals, is_signalled=True)
        codes = Counter(code for code, _ in results)
        wrong = [
            output
            for code, output in results
            if code not in documented or 'Traceback' in output or last_words not in output
        ]
        text = f'{load.signals} times, exit codes {dict(codes)}, {pluralized(len(wrong), "wrong end")}'
        yield f'{name}: {text}', not wrong
        print(*wrong[:1], sep='', end='')


SCENARIOS = (
    bridge_ended_and_restarted,
    sixteen_clients,
    killed_clients_and_many_calls,
    two_bridges,
    recorders_ended,
    recorder_of_many_rows,
    refused_starts,
    signalled_at_any_moment,
)


def main() -> int:
    """Run every scenario on a domain of its own; return the exit code."""
    parser = parser_of(__doc__, 'a tenth of everything')
    names = [scenario.__name__ for scenario in SCENARIOS]
    parser.add_argument('--only', nargs='+', choices=names, default=names, help='default: all of them')
    count = number_type('a whole number above 0, such as 20', int, above=0)
    parser.add_argument('--refusals', type=count, help='default: 200, or 20')
    parser.add_argument('--signals', type=count, help='at each executable; default: 100, or 10')
    parser.add_argument('--check', action='store_true', help='check the arguments, and end')
    load = parser.parse_args()
    if load.check:
        return 0
    load.scale = 1 if load.short else 10
    load.refusals = load.refusals or 20 * load.scale
    load.signals = load.signals or 10 * load.scale
    with own_domain():
        return check_promises([each for each in SCENARIOS if each.__name__ in load.only], load)


if __name__ == '__main__':
    sys.exit(main())
