"""
Check what the bridge and the recorder promise under faults and load on one machine, and count.

    make soak              five minutes
    make soak SHORT=1      half a minute

Prints one line per promise. The exit code is 1 if a promise is broken.
"""

import random
import re
import sqlite3
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TypeAlias

import rclpy
from client import Server, call_together, is_short, own_domain, start_clients
from lupin_greenhouse_bridge.interfaces import SensorReading, TagReading
from rclpy.qos import DurabilityPolicy, QoSProfile

Promises: TypeAlias = Iterator[tuple[str, bool]]  # the counts, and whether the promise is kept
NAMESPACE = '/soak'
CHANCE = random.SystemRandom()


def bridge() -> Server:
    """Start a bridge; return it when it is ready."""
    return Server(['bridge_node'], NAMESPACE)


def restarts_under_load(scale: int) -> Promises:
    """Kill and terminate the bridge while clients call; every call ends, and the next bridge answers."""
    server = bridge()
    clients = start_clients(4, server.service)
    seconds = 15.0 * scale
    end = time.monotonic() + seconds
    for client in clients:
        client.go(server.service, seconds, 2.0)
    killed, exit_codes = 0, list[int]()
    while time.monotonic() < end - 5.0:
        time.sleep(CHANCE.uniform(0.0, 2.0))
        if killed > len(exit_codes):
            exit_codes.append(server.stop())
        else:
            server.close()
            killed += 1
        server = bridge()  # becomes ready even after a kill
    counts = sum((client.counts() for client in clients), Counter())
    text = f'{killed} times killed, {len(exit_codes)} times terminated, exit codes {set(exit_codes)}'
    yield text, set(exit_codes) == {0}
    text = (
        f'{counts["answered"]} calls answered, {counts["swapped"]} swapped, {counts["timed out"]} timed out'
    )
    yield text, counts['answered'] > 0 and not counts['swapped']
    after = call_together(clients, server.service, 1.0, 2.0)
    yield (
        f'after the last restart, {after["timed out"]} of {after["called"]} calls timed out',
        not after['timed out'],
    )
    yield 'the last bridge ends with exit code 0', server.stop() == 0


def sixteen_clients(scale: int) -> Promises:
    """Call from 16 processes at once; every reply is for its request, and none is lost."""
    server = bridge()
    counts = call_together(start_clients(16, server.service), server.service, 3.0 * scale, 10.0)
    text = f'{counts["called"]} calls, {counts["timed out"]} lost, {counts["swapped"]} swapped'
    yield text, counts['called'] == counts['answered'] > 0 and not counts['swapped']
    yield 'the bridge ends with exit code 0', server.stop() == 0


def recorders_killed(scale: int) -> Promises:
    """Kill recorders of one file under 300 values a second; the file has each row that they kept, once."""
    node = rclpy.create_node('robot', namespace=NAMESPACE)
    publisher = node.create_publisher(
        TagReading, 'readings', QoSProfile(depth=2000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )
    values = [SensorReading(name=f'sensor {number}', value=1.0) for number in range(60)]
    published = kept = 0
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, 'readings.sqlite')
        for _ in range(5 * scale):
            recorder = Server(['record_readings'], NAMESPACE, readings_topics=publisher.topic_name, file=file)
            end = time.monotonic() + CHANCE.uniform(1.0, 3.0)
            while time.monotonic() < end:
                stamp = node.get_clock().now().to_msg()
                publisher.publish(TagReading(tag_id='7', stamp=stamp, readings=values))
                published += len(values)
                time.sleep(0.2)
            recorder.close()
            counts = re.findall(r'(\d+) rows kept', '\n'.join(recorder.rest_of_log()))
            kept += int(counts[-1]) if counts else 0  # the last count is the total since its start
        with closing(sqlite3.connect(file)) as database:
            rows = database.execute('SELECT stamp_ns, tag_id, sensor FROM readings').fetchall()
    node.destroy_node()
    twice = len(rows) - len(set(rows))
    text = f'{published} rows published, {kept} logged as kept, {len(rows)} in the file, {twice} twice'
    yield f'{5 * scale} killed: {text}', 0 < kept <= len(rows) <= published and not twice


SCENARIOS = (restarts_under_load, sixteen_clients, recorders_killed)


def main() -> int:
    """Run every scenario; return the exit code."""
    scale = 1 if is_short(__doc__) else 10
    broken = 0
    with own_domain():
        rclpy.init(args=[])
        for scenario in SCENARIOS:
            for text, is_kept in scenario(scale):
                broken += not is_kept
                print(f'{"kept  " if is_kept else "BROKEN"}  {scenario.__name__}: {text}', flush=True)
        rclpy.try_shutdown()
    print(f'{broken} promises broken')
    return int(broken > 0)


if __name__ == '__main__':
    sys.exit(main())
