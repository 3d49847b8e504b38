"""read_tag on the command line: output and exit code."""

import contextlib
import csv
import itertools
import json
import math
import signal
import threading
import time
from types import SimpleNamespace

import domain_coordinator
import pytest
import rclpy
from conftest import ended_process
from lupin_greenhouse_bridge.contract import answer_of
from lupin_greenhouse_bridge.interfaces import GetTagReading, SensorReading, TagReading
from lupin_greenhouse_bridge.reading import client, read_tag
from lupin_greenhouse_bridge.reading.table import CSV_COLUMNS, print_table
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.testing.helpers import (
    PATIENCE_SECONDS,
    ManualClock,
    executable,
    spinning_node,
)
from lupin_greenhouse_bridge.testing.slow_bridge import reading_of

READ_TAG = executable('lupin_greenhouse_bridge', 'read_tag')
ALL_READ, SOME_FAILED, USAGE, NO_ANSWER = 0, 1, 2, 3


@pytest.fixture
def read(read_tag_here, noon_bridge):
    return lambda *arguments: read_tag_here(*arguments, '--service', noon_bridge.service_name)


@pytest.fixture
def times_out_when(monkeypatch):
    """Return a function that lets each timeout of read_tag end when condition(its node) holds."""
    nodes, create_node = [], rclpy.create_node

    def create(*arguments, **keywords):
        nodes.append(create_node(*arguments, **keywords))
        return nodes[-1]

    def install(condition):
        clock, end = ManualClock(), time.monotonic() + PATIENCE_SECONDS

        def monotonic():
            if time.monotonic() > end or (nodes and condition(nodes[-1])):
                clock.pass_seconds(1000.0)
            return clock()

        monkeypatch.setattr(client, 'time', SimpleNamespace(monotonic=monotonic))

    monkeypatch.setattr(rclpy, 'create_node', create)
    return install


@pytest.fixture
def watch(monkeypatch):
    """Return a function that ends --watch after this many rounds without sleeping; it returns the sleeps."""

    def install(rounds, after_round=lambda _number: None):
        def sleep(seconds):
            slept.append(seconds)
            after_round(len(slept))
            if len(slept) == rounds:
                signal.raise_signal(signal.SIGTERM)

        slept = []
        monkeypatch.setattr(process, 'sleep', sleep)
        return slept

    return install


def reply(request, response):
    response.reading = reading_of(request.tag_id, co2=1.5)
    return response


@contextlib.contextmanager
def empty_domain():
    """Move to a domain without nodes, and yield its id."""
    with (
        domain_coordinator.domain_id(process.private_domains()) as domain,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        yield domain


def test_readings_are_a_table_and_each_failure_is_a_line(read, noon_bridge, warm_tag_id, shipped_tags):
    ended = read('--all')
    assert (ended.code, ended.messages) == (ALL_READ, '')
    header, *rows, last = (line.split() for line in ended.out.splitlines())
    assert header == ['tag', 'sim', 'time', 'sensor', 'value', 'unit']
    temperature = noon_bridge.values(warm_tag_id)['temperature']
    assert [warm_tag_id, '12:00:00', 'temperature', f'{temperature:.1f}', '°C'] in rows
    assert {row[0] for row in rows} == set(shipped_tags)
    assert last == [f'{len(shipped_tags)}/{len(shipped_tags)}', 'tags', 'read']
    ended = read('6', '99')
    assert ended.code == SOME_FAILED
    assert ended.out.splitlines()[-1] == '1/2 tags read'
    assert ended.messages.startswith("read_tag: UNKNOWN_TAG: Tag '99' is not in the loaded greenhouse (")


def test_json_is_one_object_per_line_and_keeps_characters_as_they_are(read, noon_bridge, warm_tag_id):
    ended = read('--json', warm_tag_id, '番茄')
    good, bad = map(json.loads, ended.out.splitlines())
    assert ended.code == SOME_FAILED
    assert '番茄' in ended.out
    readings, stamp, values = good.pop('readings'), good.pop('stamp'), noon_bridge.values(warm_tag_id)
    assert (readings['temperature'], readings.keys()) == (values['temperature'], values.keys())
    assert stamp['sec'] > 10**9 > stamp['nanosec']
    ok = {'tag_id': warm_tag_id, 'status': 'OK', 'error_message': '', 'sim_time_of_day_seconds': 43200.0}
    assert good == ok
    assert "Tag '番茄' is not in the loaded greenhouse" in bad.pop('error_message')
    nothing = dict.fromkeys(('stamp', 'sim_time_of_day_seconds', 'readings'))
    assert bad == {'tag_id': '番茄', 'status': 'UNKNOWN_TAG', **nothing}


def test_csv_has_the_columns_of_a_recorded_reading_and_one_header(read, shipped_tags, watch):
    watch(rounds=2)
    ended = read('99', *shipped_tags, '--csv', '--watch', '10')
    assert ended.code == SOME_FAILED
    assert ended.messages.count("read_tag: UNKNOWN_TAG: Tag '99'") == 2
    assert ended.out.count(','.join(CSV_COLUMNS)) == 1
    rows = list(csv.DictReader(ended.out.splitlines()))
    values = [(tag_id, name) for tag_id, tag in shipped_tags.items() for name in tag['sensors']]
    assert [(row['tag_id'], row['sensor']) for row in rows] == 2 * values
    for row in rows:
        tag = shipped_tags[row['tag_id']]
        assert (float(row['x_m']), float(row['y_m'])) == (tag['x'], tag['y'])
        assert (row['sim_time_of_day_seconds'], row['source']) == ('43200.0', 'read_tag')
        seconds, nanoseconds = divmod(int(row['stamp_ns']), 10**9)
        moment = time.strftime('%Y-%m-%dT%H:%M:%S', time.gmtime(seconds))
        assert row['stamp_utc'] == f'{moment}.{nanoseconds:09}Z'
        assert row['unit']


def test_a_reading_of_the_first_second_of_1970_is_read():
    """A machine whose clock is not set sends such a stamp."""
    assert answer_of('7', GetTagReading.Response(reading=reading_of('7', seconds=0, co2=1.0))).is_ok
    assert not answer_of('7', GetTagReading.Response(reading=reading_of('7', seconds=-1, co2=1.0))).is_ok


TIME_OF_DAY = 'its time of day is outside [0, 86400) s'
TWO_VALUES = [SensorReading(name='co2', value=value) for value in (1.5, 2.5)]
LATE_NANOSECONDS = reading_of('9', co2=1.5)
LATE_NANOSECONDS.stamp.nanosec = 1_000_000_000
BAD_READINGS = {
    '1': (reading_of('1', time_of_day=math.inf, co2=1.5), TIME_OF_DAY),
    '2': (reading_of('2', co2=math.nan), 'a value is not finite'),
    '3': (TagReading(tag_id='3', readings=TWO_VALUES), 'two values have the same sensor name'),
    '4': (TagReading(tag_id='4'), 'it has no tag id or no values'),
    '5': (reading_of('6', co2=1.5), "it is of tag '6'"),
    '6': (reading_of('6', time_of_day=86400.0, co2=1.5), TIME_OF_DAY),
    '8': (reading_of('8', time_of_day=-1.0, co2=1.5), TIME_OF_DAY),
    '9': (LATE_NANOSECONDS, 'its stamp is not a time since 1970'),
    '10': (reading_of('10', **{'': 1.5}), 'a value has no sensor name'),
}


def test_a_reading_that_no_bridge_sends_fails_its_tag_in_one_line(read_tag_here):
    """The positions in CSV are empty, because this node does not tell its tag_file."""

    def reply_badly(request, response):
        bad = BAD_READINGS.get(request.tag_id)
        response.reading = bad[0] if bad else reading_of(request.tag_id, co2=1.5)
        return response

    with spinning_node('climate') as node:
        node.create_service(GetTagReading, '/climate/get_tag_reading', reply_badly)
        ended = read_tag_here(*BAD_READINGS, '7', '--csv', '--service', '/climate/get_tag_reading')
    assert ended.code == SOME_FAILED
    assert ended.messages.splitlines() == [
        f"read_tag: BAD_READING: the reading of tag '{tag_id}': {fault}"
        for tag_id, (_, fault) in BAD_READINGS.items()
    ]
    (row,) = csv.DictReader(ended.out.splitlines())
    assert [row[name] for name in ('tag_id', 'value', 'unit', 'x_m', 'y_m')] == ['7', '1.5', 'ppm', '', '']


def test_a_closed_pipe_ends_it_without_a_traceback(noon_bridge):
    watch = [READ_TAG, '6', '--watch', '0.01', '--timeout', '20', '--service', noon_bridge.service_name]
    code, out, err = ended_process(['bash', '-c', '"$@" | head -n 1; exit ${PIPESTATUS[0]}', 'bash', *watch])
    assert (code, out.split()[:1], err) == (1, ['tag'], '')


@pytest.mark.parametrize(
    ('arguments', 'last_line'),
    [
        ([], 'read_tag: name one or more tag ids, or --all'),
        (['1', '--all'], 'read_tag: name one or more tag ids, or --all, but not both'),
        (['--watch', '1'], 'read_tag: name one or more tag ids, or --all, but not both'),
        (['1', '--watch', 'one'], "argument --watch: 'one': must be a number of seconds above 0, such as 5"),
        (['1', '--json', '--csv'], 'argument --csv: not allowed with argument --json'),
        (['1', '--ros-args', '--timeout', '1'], "read_tag: ROS cannot start: ['--timeout', '1']"),
        (['--service', 'a b', '1'], "read_tag: 'a b' is not a service name: "),
        (['1', '--timeout', 'nan'], "argument --timeout: 'nan': must be a number of seconds above 0"),
        (['1', '--timeout', '-1'], "argument --timeout: '-1': must be a number of seconds above 0"),
    ],
)
def test_a_wrong_command_line_is_exit_code_2_and_says_why(read_tag_here, arguments, last_line):
    ended = read_tag_here(*arguments)
    assert (ended.code, ended.out) == (USAGE, '')
    assert last_line in ended.messages.splitlines()[-1]


def test_all_are_the_tags_that_the_bridge_names_in_natural_order(run_here, read_tag_here, times_out_when):
    """Even if this machine has another release of the simulator than the bridge."""
    with spinning_node('stranger') as node:
        node.create_service(GetTagReading, '~/get_tag_reading', reply)
        arguments = '--all', '--json', '--service', '/stranger/get_tag_reading'
        ended = read_tag_here(*arguments)
        assert (ended.code, ended.messages) == (
            USAGE,
            'read_tag: the node of /stranger/get_tag_reading has no parameter loaded_tag_ids:'
            ' name the tag ids instead of --all',
        )
        node.declare_parameter('loaded_tag_ids', ['10', '9'])
        node.declare_parameter('tag_file', '')
        ended = read_tag_here(*arguments)
    assert ended.code == ALL_READ
    assert [json.loads(line)['tag_id'] for line in ended.out.splitlines()] == ['9', '10']
    times_out_when(lambda node: len(list(node.clients)) == 2)  # the second is that of the parameters
    with empty_domain(), spinning_node('climate') as node:
        node.create_service(GetTagReading, '/elsewhere/readings', reply)
        ended = run_here(read_tag.main, '--all', '--service', '/elsewhere/readings')
    assert ended.code == NO_ANSWER
    assert ' offers /elsewhere/get_parameters: ' in ended.messages


def test_no_bridge_is_one_line_with_the_domain_and_the_service(run_here):
    with empty_domain() as domain:
        ended = run_here(read_tag.main, '1', '--service', '/nobody/readings', '--timeout', '0.01')
    assert (ended.code, ended.out) == (NO_ANSWER, '')
    (line,) = ended.messages.splitlines()
    assert line.startswith(f'read_tag: no bridge on domain {domain} offers /nobody/readings: start one')


def test_watch_reads_from_start_to_start_until_a_signal(read, shipped_tags, watch, monkeypatch):
    ticks = itertools.count(0.0, 30.0)  # a round takes 30 s
    slept = watch(rounds=3)
    monkeypatch.setattr(read_tag, 'time', SimpleNamespace(monotonic=lambda: next(ticks)))
    ended = read('6', '99', '--watch', '100')
    assert (ended.code, slept) == (SOME_FAILED, [70.0] * 3)
    tag_ids = [row.split()[0] for row in ended.out.splitlines()]
    one_round = ['tag', *['6'] * len(shipped_tags['6']['sensors']), '1/2']
    assert tag_ids == one_round * 3
    assert ended.messages.count('UNKNOWN_TAG') == 3


@pytest.mark.parametrize(('rounds', 'code'), [(3, NO_ANSWER), (5, ALL_READ)])
def test_a_watch_goes_on_while_the_bridge_is_away(run_here, times_out_when, watch, rounds, code):
    """Away in the second and third round: one message, and the exit code is that of the last round."""
    is_there = threading.Event()
    is_there.set()

    def reply_while_there(request, response):
        is_there.wait(PATIENCE_SECONDS)
        return reply(request, response)

    def leave_and_return(number):
        if number == 1:
            is_there.clear()
        if number == 3:
            is_there.set()

    watch(rounds, leave_and_return)
    times_out_when(lambda _node: not is_there.is_set())
    service = '/away/get_tag_reading'
    with empty_domain(), spinning_node('away') as node:
        node.create_service(GetTagReading, service, reply_while_there)
        ended = run_here(read_tag.main, '1', '--service', service, '--watch', '1')
        is_there.set()
    assert ended.code == code
    assert ended.messages == f'read_tag: {service} did not answer within 5 s; still watching'


def answer(tag_id, seconds=0.0, **values):
    response = GetTagReading.Response(reading=reading_of(tag_id, time_of_day=seconds, **values))
    return answer_of(tag_id, response)


def failure(message, status=GetTagReading.Response.STATUS_UNKNOWN_TAG):
    return answer_of('9', GetTagReading.Response(status=status, error_message=message))


def test_the_columns_are_aligned_values_to_the_right_and_the_failures_apart(capsys):
    good = [answer('7', 3661.9, humidity=1.25, co2=123456.7), answer('long', 86399.9, co2=12.6)]
    print_table([*good, failure('new\n', status=9), failure('y' * 1001)])
    assert capsys.readouterr() == (
        'tag   sim time  sensor     value  unit\n'
        '7     01:01:01  humidity     1.2  %\n'
        '7     01:01:01  co2       123457  ppm\n'
        'long  23:59:59  co2           13  ppm\n'
        '2/4 tags read\n',
        f'read_tag: 9: new\\n\nread_tag: UNKNOWN_TAG: {"y" * 1000}...\n',
    )
    print_table([answer('x' * 41, ozone=0.5)])  # one tag is not counted
    assert capsys.readouterr().out.splitlines()[1:] == [f'{"x" * 40}...  00:00:00  ozone    0.50']
