"""record_readings: what it receives, what it keeps, and what it says when it cannot."""

import contextlib
from itertools import count
from types import SimpleNamespace

import pytest
import rclpy
from lupin_greenhouse_bridge.interfaces import TagReading
from lupin_greenhouse_bridge.runtime.rclpy_internals import RcutilsLogger
from lupin_greenhouse_bridge.testing.commands import SIGNALS, SPINS
from lupin_greenhouse_bridge.testing.helpers import (
    PATIENCE_SECONDS,
    ManualClock,
    executable,
    spinning_node,
    wait_until,
)
from lupin_greenhouse_bridge.testing.slow_bridge import reading_of
from lupin_readings import record_readings, subscription
from lupin_readings.record_readings import Buffer
from lupin_readings.rows import rows_of
from lupin_readings.store import Store, StoreError, read_rows
from lupin_readings.subscription import subscribe_to_readings, topics_of
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from test_store import row, rows

LATCHED, VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
TOPIC = '/tested/readings'


class Disk:
    """A store in memory, whose disk is full while the test says so."""

    def __init__(self):
        self.rows, self.is_full = [], False

    def keep(self, rows, _wait_seconds):
        if self.is_full:
            raise StoreError("file 'x.sqlite': database or disk is full")
        self.rows += rows
        return len(rows)

    def close(self):
        pass


@pytest.fixture
def kept():
    """Return a buffer with its disk, its log and its clock."""
    disk, log, clock = Disk(), SimpleNamespace(infos=[], errors=[]), ManualClock()
    logger = SimpleNamespace(info=log.infos.append, error=log.errors.append)
    return SimpleNamespace(buffer=Buffer(disk, logger, clock), disk=disk, log=log, clock=clock)


def test_a_full_disk_is_one_error_every_ten_seconds_and_its_rows_are_written_later_or_lost_at_the_end(kept):
    kept.disk.is_full = True
    said = []
    for seconds in (0.0, 0.5, 9.4, 0.1, 9.9, 0.1):
        kept.clock.pass_seconds(seconds)
        kept.buffer.add([row(len(said))])
        kept.buffer.write()
        said.append(len(kept.log.errors))
    assert said == [1, 1, 1, 2, 2, 3]
    assert kept.log.errors[0].endswith('disk is full: 1 row waiting in memory, 0 dropped')
    assert kept.log.errors[-1].endswith('disk is full: 6 rows waiting in memory, 0 dropped')
    kept.disk.is_full = False
    kept.buffer.write()
    assert (kept.disk.rows, kept.log.infos) == (rows(6), ['6 rows kept'])
    kept.disk.is_full = True
    kept.buffer.add([row()])
    assert kept.buffer.end() == 1
    assert len(kept.log.errors) > 3  # also within the ten seconds


def test_so_much_waits_and_what_does_not_fit_is_counted_and_said(kept, monkeypatch):
    monkeypatch.setattr(record_readings, 'MOST_ROWS', 50)
    kept.disk.is_full = True
    for number in range(53):
        kept.buffer.add([row(number)])
    kept.buffer.write()
    assert kept.log.errors[-1].endswith(': 50 rows waiting in memory, 3 dropped')
    kept.disk.is_full = False
    kept.buffer.write()
    kept.buffer.add(rows(53, 60))
    assert kept.buffer.end() == 3
    assert kept.disk.rows == [*rows(50), *rows(53, 60)]
    assert kept.log.infos == ['50 rows kept', '57 rows kept']


def test_topics_are_a_text_or_an_array():
    assert topics_of('/a, /b /a') == topics_of(['/a', '/b']) == ['/a', '/b']


def reading(number, tag_id='7') -> TagReading:
    """Return a reading of two values with this number of nanoseconds."""
    return reading_of(tag_id, 1_795_189_976, number, 14400.0, co2=float(number), light=0.5)


@pytest.fixture
def readings(robot):
    return publisher_on(robot)


def publisher_on(node, durability=LATCHED, topic=TOPIC):
    return node.create_publisher(TagReading, topic, QoSProfile(depth=2000, durability=durability))


def test_each_reading_is_received_once_from_latched_and_volatile_publishers(robot, readings, capfd):
    received, delivered, more = [], [], '/tested/more'

    def create_subscription(kind, topic, callback, *rest, **keywords):
        def receive(each):
            callback(each)
            delivered.append(each.stamp.nanosec)

        return create(kind, topic, receive, *rest, **keywords)

    readings.publish(reading(1))
    volatile = publisher_on(robot, VOLATILE, more)
    with spinning_node('subscriber') as node:
        create, node.create_subscription = node.create_subscription, create_subscription
        names = subscribe_to_readings(node, [TOPIC, more], lambda *both: received.append(both))
        assert names == [TOPIC, more]
        wait_until(lambda: 1 in delivered)  # published before it was subscribed to
        wait_until(lambda: readings.get_subscription_count() == 2)
        # Another sensor or value makes another reading, also with the same stamp and tag.
        same_stamp = [reading(2), reading(2), reading(2)]
        same_stamp[1].readings[0].value = 7.5
        same_stamp[2].readings[0].name = 'temperature'
        for each in same_stamp:
            readings.publish(each)
        wait_until(lambda: delivered.count(2) == 6)
        wait_until(lambda: volatile.publish(reading(3)) or 3 in delivered)
    assert received == [(each, TOPIC) for each in (reading(1), *same_stamp)] + [(reading(3), more)]
    assert '[subscriber]' not in capfd.readouterr().err  # no warning of rclpy


@pytest.fixture
def file(tmp_path):
    return tmp_path / 'readings.sqlite'


@pytest.fixture
def start_recorder(run_nodes, file):
    def start(**parameters):
        parameters = {'readings_topics': TOPIC, 'file': file, **parameters}
        return run_nodes(record_readings.RecordReadingsNode, **parameters)[0]

    return start


def test_a_row_with_a_wrong_number_is_refused_and_counted(start_recorder, readings, file, capfd):
    recorder, bad = start_recorder(), reading(1, 'new\nline')
    bad.readings[0].value = float('nan')
    readings.publish(bad)
    readings.publish(reading(2))
    wait_until(lambda: len(read_rows(file)) == 3)
    assert recorder.end() == 0
    said = capfd.readouterr().err
    assert r"tag 'new\nline': value of co2 is nan: must be a finite number: 1 row refused so far" in said
    assert '1 row refused, because a value is invalid' in said


def test_a_thousand_readings_that_have_arrived_at_the_end_are_all_kept(readings, shipped_tags, file):
    """The node is never spun, as one that a signal ends while it is busy."""
    arguments = ['--ros-args', '-p', f'readings_topics:={TOPIC}', '-p', f'file:={file}']
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    node = record_readings.RecordReadingsNode()
    try:
        wait_until(lambda: readings.get_subscription_count() == 2)
        for number in range(1000):
            readings.publish(reading(number))
        assert readings.wait_for_all_acked(Duration(seconds=PATIENCE_SECONDS))
        assert node.end() == 0
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    place_m = shipped_tags['7']['x'], shipped_tags['7']['y']
    assert read_rows(file) == [each for n in range(1000) for each in rows_of(reading(n), TOPIC, place_m)]


@contextlib.contextmanager
def bridge_with(**parameters):
    with spinning_node('greenhouse_bridge') as bridge:
        for name, value in parameters.items():
            bridge.declare_parameter(name, value)
        yield


NOT_REPORTED = 'the bridge did not report its tag_file: using the positions of mdp-greenhouse'


def test_positions_are_those_of_the_bridges_own_tag_file(start_recorder, readings, file, write_layout, capfd):
    start_recorder()
    readings.publish(reading(0))
    wait_until(lambda: read_rows(file))
    assert NOT_REPORTED in capfd.readouterr().err
    numbers = count(1)
    with bridge_with(tag_file=write_layout({'7': (9.0, 9.5)}), loaded_tag_ids=['7']):
        wait_until(lambda: readings.publish(reading(next(numbers))) or read_rows(file)[-1].x_m == 9.0)
    assert NOT_REPORTED not in capfd.readouterr().err  # once


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({'tag_file': '/elsewhere/tags.json', 'loaded_tag_ids': ['7']}, "tag_file '/elsewhere/tags.json'"),
        ({}, NOT_REPORTED),
    ],
)
def test_a_tag_file_of_the_bridge_that_cannot_be_used_is_said(start_recorder, monkeypatch, parameters, said):
    lines = []
    monkeypatch.setattr(RcutilsLogger, 'warning', lambda _logger, text: lines.append(text))
    with bridge_with(**parameters):
        start_recorder()
        wait_until(lambda: any(said in line and 'of mdp-greenhouse' in line for line in lines))


def test_positions_come_from_the_tag_file(start_recorder, readings, file, write_layout):
    start_recorder(tag_file=write_layout({'7': (9.0, 9.5)}), readings_topics=[TOPIC])
    for tag_id in ('7', 'nowhere'):
        readings.publish(reading(1, tag_id))
    wait_until(lambda: len(read_rows(file)) == 4)
    kept = {(row.tag_id, row.x_m, row.y_m, row.source) for row in read_rows(file)}
    assert kept == {('7', 9.0, 9.5, TOPIC), ('nowhere', None, None, TOPIC)}


def test_a_killed_recorder_goes_on_and_keeps_nothing_twice(start_node, start_recorder, readings, file):
    """The latched readings are delivered again to the second recorder."""
    for number in range(10):
        readings.publish(reading(number))
    recorder = [executable('lupin_readings', 'record_readings')]
    first = start_node(recorder, readings_topics=TOPIC, file=file)
    first.wait_for_log(f'ready: readings from {TOPIC} into {file}')
    first.wait_for_log(': 20 rows kept')
    first.close()
    assert len(read_rows(file)) == 20
    second = start_recorder()
    readings.publish(reading(10))
    wait_until(lambda: len(read_rows(file)) > 20)
    assert second.end() == 0
    assert [row.value for row in read_rows(file) if row.sensor == 'co2'] == list(range(11))


@pytest.mark.parametrize(('signals', 'lost'), [('Ctrl-C', 0), ('SIGTERM and Ctrl-C', 0), ('SIGTERM', 1)])
def test_a_signal_writes_the_last_rows_or_is_exit_code_1(run_here, tmp_path, monkeypatch, signals, lost):
    create, end = record_readings.subscribe_to_readings, Buffer.end

    def receive_at_once(node, topics, on_reading):
        on_reading(reading(1), topics[0])
        return create(node, topics, on_reading)

    monkeypatch.setattr(record_readings, 'subscribe_to_readings', receive_at_once)
    monkeypatch.setattr(Buffer, 'end', lambda buffer: end(buffer) + lost)
    file = tmp_path / 'readings.sqlite'
    Store(str(file)).close()
    arguments = ['--ros-args', '-p', f'file:={file}']
    ended = run_here(record_readings.main, *arguments, signals_at={SPINS: SIGNALS[signals]})
    assert (ended.code, '2 rows kept' in ended.err, '1 row lost' in ended.err) == (lost, True, bool(lost))
    assert len(read_rows(file)) == 2


def test_a_short_parameter_with_a_wrong_letter_is_recognized(run_here):
    ended = run_here(record_readings.main, '--ros-args', '-p', 'fike:=r.db', '-p', 'tag_file:=/no/tags.json')
    assert 'parameter fike is unknown and ignored' in ended.err


def test_a_topic_without_a_publisher_is_named_and_its_first_too(start_recorder, robot, monkeypatch):
    monkeypatch.setattr(subscription, 'NO_PUBLISHER_SECONDS', 0.0)
    monkeypatch.setattr(subscription, 'LOOK_EVERY_SECONDS', 0.01)
    monkeypatch.setattr(RcutilsLogger, 'info', lambda _logger, text: said.append(text))
    said = []
    start_recorder()
    wait_until(lambda: len(said) == 2)
    publisher_on(robot)
    wait_until(lambda: len(said) >= 3)
    assert said[1].startswith(f'no publisher of {TOPIC} is found yet on domain ')
    assert 'wait for a mission or read_on_sight that starts' in said[1]
    assert said[2:] == [f'{TOPIC} has a publisher now']


@pytest.mark.parametrize(
    ('name', 'value', 'fragment'),
    [
        ('file', 'r.csv', "file 'r.csv' does not end in .sqlite or .db: name it"),
        ('file', 'no/a.db', "no/a.db': unable to open database file: make the folder"),
        ('file', 'folder.db', "folder.db': not a regular file: name another file"),
        ('readings_topics', '/a no-name', 'readings_topics: Invalid topic name: '),
        *(('readings_topics', value, 'topics is ') for value in ("' '", '7', '[1, 2]')),
    ],
)
def test_a_bad_parameter_is_refused(run_here, tmp_path, monkeypatch, name, value, fragment):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'folder.db').mkdir()
    assert fragment in run_here(record_readings.main, '--ros-args', '-p', f'{name}:={value}').refusal
