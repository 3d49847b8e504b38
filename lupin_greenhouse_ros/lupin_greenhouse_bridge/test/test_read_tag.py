# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""read_tag on the command line: output and exit code."""

import contextlib
import csv
import itertools
import json
import math
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from contextlib import redirect_stderr, redirect_stdout
from types import SimpleNamespace

import domain_coordinator
import pytest
import rclpy
from conftest import Terminal, ended_process, reading_of
from lupin_greenhouse_bridge.contract import answer_of
from lupin_greenhouse_bridge.interfaces import GetTagReading, SensorReading, TagReading
from lupin_greenhouse_bridge.reading import client, read_tag
from lupin_greenhouse_bridge.reading.table import Csv, Table
from lupin_greenhouse_bridge.recording.rows import HEADER
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.graph import duplicate_server_warning, servers_of
from lupin_greenhouse_bridge.runtime.output import terminal_size
from lupin_greenhouse_bridge.runtime.rclpy_internals import RCLError
from lupin_greenhouse_bridge.testing._helpers import (
    PATIENCE_SECONDS,
    ManualClock,
    executable,
    has_found_a_client,
    spinning_node,
    wait_until,
)
from rcl_interfaces.srv import GetParameters

READ_TAG = executable('lupin_greenhouse_bridge', 'read_tag')
ALL_READ, SOME_FAILED, USAGE, NO_ANSWER = 0, 1, 2, 3


@pytest.fixture
def read(read_tag_here, noon_bridge):
    return lambda *arguments: read_tag_here(*arguments, '--service', noon_bridge.service_name)


@pytest.fixture
def times_out_when(monkeypatch):
    """Return a function that lets each timeout of read_tag end when is_so(its node) is true, not before."""
    nodes, create_node = [], rclpy.create_node

    def create(*arguments, **keywords):
        nodes.append(create_node(*arguments, **keywords))
        return nodes[-1]

    def install(is_so):
        clock, end = ManualClock(), time.monotonic() + PATIENCE_SECONDS

        def monotonic():
            if time.monotonic() > end or (nodes and is_so(nodes[-1])):
                clock.pass_seconds(1000.0)
            return clock()

        monkeypatch.setattr(client, 'time', SimpleNamespace(monotonic=monotonic))

    monkeypatch.setattr(rclpy, 'create_node', create)
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
    assert (ended.code, ended.said) == (ALL_READ, '')
    header, *rows, last = (line.split() for line in ended.out.splitlines())
    assert header == ['tag', 'sim', 'time', 'sensor', 'value', 'unit']
    temperature = noon_bridge.values(warm_tag_id)['temperature']
    assert [warm_tag_id, '12:00:00', 'temperature', f'{temperature:.1f}', '°C'] in rows
    assert {row[0] for row in rows} == set(shipped_tags)
    assert last == [f'{len(shipped_tags)}/{len(shipped_tags)}', 'tags', 'read']
    ended = read('6', '99', '--ros-args', '-p', 'time_out:=3', '--')
    assert ended.code == SOME_FAILED
    assert 'parameter time_out is unknown and ignored: its parameters are none' in ended.err
    assert ended.out.splitlines()[-1] == '1/2 tags read'
    assert ended.said.startswith("read_tag: UNKNOWN_TAG: Tag '99' is not in the loaded greenhouse (")
    assert ended.said.endswith(' tags known): see read_tag --all')
    several, meant = (
        ('1,6', '1 6', '1;6', '1-6', 'all', 'tag_id:=1'),
        ('01', 'tag1', 'Tag_01', '-1', ' 1', '#1'),
    )
    hints = ['write tag ids with spaces between them, such as 1 2, or --all'] * len(several)
    hints += ['did you mean 1?'] * len(meant)
    said = read(*several, *meant).said.splitlines()
    assert [line.partition(' tags known): ')[2] for line in said] == hints


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


def test_csv_has_the_columns_of_the_recorder_and_one_header(read, shipped_tags, tmp_path, monkeypatch):
    monkeypatch.setattr(process, 'sleep', lambda _seconds: None)
    file = tmp_path / 'day.csv'
    for _ in range(2):
        with file.open('a', encoding='utf-8') as output, redirect_stdout(output):
            ended = read('99', *shipped_tags, '--csv', '--watch', '10', '--count', '2')
        assert ended.code == SOME_FAILED
        assert ended.said.count("read_tag: UNKNOWN_TAG: Tag '99'") == 2
    text = file.read_text(encoding='utf-8')
    assert text.startswith(f'{HEADER}\n')
    assert text.count(HEADER) == 1
    rows = list(csv.DictReader(text.splitlines()))
    values = [(tag_id, name) for tag_id, tag in shipped_tags.items() for name in tag['sensors']]
    assert [(row['tag_id'], row['sensor']) for row in rows] == 4 * values
    for row in rows:
        place_m = float(row['x_m']), float(row['y_m'])
        assert place_m == (shipped_tags[row['tag_id']]['x'], shipped_tags[row['tag_id']]['y'])
        assert (row['sim_time_of_day_seconds'], row['source']) == ('43200.0', 'read_tag')
        assert row['unit']


BAD_READINGS = {
    '1': (reading_of('1', time_of_day=math.inf, co2=1.5), 'it has a number that is not finite'),
    '2': (reading_of('2', co2=math.nan), 'it has a number that is not finite'),
    '3': (TagReading(tag_id='3', readings=[SensorReading()] * 2), 'it has two values of one sensor'),
    '4': (TagReading(tag_id='4'), 'it names no tag, or has no value'),
    '5': (reading_of('6', co2=1.5), "it is of tag '6'"),
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
    assert ended.said.splitlines() == [
        f"read_tag: BAD_READING: the reading of tag '{tag_id}': {fault}"
        for tag_id, (_, fault) in BAD_READINGS.items()
    ]
    (row,) = csv.DictReader(ended.out.splitlines())
    assert [row[name] for name in ('tag_id', 'value', 'unit', 'x_m', 'y_m')] == ['7', '1.5', 'ppm', '', '']


@pytest.mark.parametrize(
    ('arguments', 'redirection', 'first_word', 'code', 'reason'),
    [
        (['6', '--csv'], '>/dev/full', '', 4, 'No space left on device'),
        (['6', '--watch', '0.01'], '| head -n 1; exit ${PIPESTATUS[0]}', 'tag', 4, 'Broken pipe'),
        (['99', '--csv'], '2>&-', HEADER, SOME_FAILED, ''),  # as with an open standard error
    ],
)
def test_an_output_that_cannot_be_written_is_one_line_and_exit_code_4(
    noon_bridge, arguments, redirection, first_word, code, reason
):
    command = [READ_TAG, *arguments, '--timeout', '20', '--service', noon_bridge.service_name]
    ended, out, err = ended_process(['bash', '-c', f'"$@" {redirection}', 'bash', *command])
    assert (ended, out.split()[:1]) == (code, first_word.split())
    said = re.sub(r'read_tag: waiting for .* s more\n', '', err)  # on a machine that is slow
    assert said == (f'read_tag: standard output cannot be written: {reason}\n' if reason else '')


@pytest.mark.parametrize(
    ('arguments', 'last_line'),
    [
        ([], 'read_tag: name one or more tag ids, or --all'),
        (['1', '--all'], 'read_tag: name one or more tag ids, or --all, but not both'),
        (['--watch', '1'], 'read_tag: name one or more tag ids, or --all, but not both (1 is the SECONDS of'),
        (['1', '--watch', 'one'], "argument --watch: 'one': must be a number of seconds above 0, such as 5"),
        (['1', '--json', '--csv'], 'argument --csv: not allowed with argument --json'),
        (['1', '--count', '2'], 'read_tag: --count needs --watch SECONDS'),
        (['1', '--watch', '1', '--count', '0'], "'0': must be a whole number above 0"),
        (['1', '--ros-args', '--timeout', '1'], "read_tag: '--timeout' is no ROS argument: write"),
        (['--service', 'a b', '1'], "read_tag: 'a b' is not a service name: "),
        (['no UTF-8: \udcff'], 'read_tag: the ROS arguments cannot be parsed (put other arguments before'),
        (['1', '--timeout', 'nan'], "argument --timeout: 'nan': must be a number of seconds above 0"),
        (['1', '--timeout', '-1'], "argument --timeout: '-1': must be a number of seconds above 0"),
    ],
)
def test_a_wrong_command_line_is_exit_code_2_and_says_why(read_tag_here, arguments, last_line):
    ended = read_tag_here(*arguments)
    assert (ended.code, ended.out) == (USAGE, '')
    assert last_line in ended.said.splitlines()[-1]


def test_a_client_that_ros_refuses_is_exit_code_2_and_names_the_security(read, monkeypatch):
    """A node without the right to call a service cannot create its client."""

    def refuse(*_arguments, **_keywords):
        raise RCLError('error creating client')

    monkeypatch.setattr(rclpy.node.Node, 'create_client', refuse)
    ended, problem = read('1'), 'ROS cannot create the client'
    assert (ended.code, ended.said) == (USAGE, f'read_tag: {problem}: error creating client')
    monkeypatch.setattr(client, 'security_problem', lambda: 'security is enabled')
    assert read('1').said == 'read_tag: security is enabled: error creating client'


def test_all_are_the_tags_that_the_bridge_names_in_natural_order(run_here, read_tag_here, times_out_when):
    """Even if this machine has another release of the simulator than the bridge."""
    with spinning_node('stranger') as node:
        node.create_service(GetTagReading, '~/get_tag_reading', reply)
        arguments = '--all', '--json', '--service', '/stranger/get_tag_reading'
        ended = read_tag_here(*arguments)
        assert (ended.code, ended.said) == (
            USAGE,
            'read_tag: the node of /stranger/get_tag_reading has no parameter loaded_tag_ids,'
            ' so it is a bridge older than 1.1: name the tag ids instead of --all',
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
    assert (ended.code, ended.said) == (
        NO_ANSWER,
        'read_tag: no service /elsewhere/get_parameters within 5 s:'
        ' --all asks the node that /elsewhere/readings is named after: name the tag ids instead',
    )


@pytest.fixture
def hint(run_here, times_out_when):
    """Return a function that returns the hint of a read_tag that finds no service before is_so(its node)."""

    def hint(is_so=lambda _node: True, service='/greenhouse_bridge/get_tag_reading'):
        times_out_when(is_so)
        ended = run_here(read_tag.main, '1', '--service', service)
        assert (ended.code, ended.out) == (NO_ANSWER, '')
        assert ended.said.startswith(f'read_tag: no service {service} within 5 s; ')
        return ended.said.partition('; ')[2]

    return hint


def test_the_hint_names_what_can_keep_a_client_from_its_bridge(hint, monkeypatch, tmp_path):
    monkeypatch.setenv('PATH', str(tmp_path))
    with empty_domain() as domain:
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        text = hint()
        found = f'no other node is found with ROS_DOMAIN_ID={domain}, ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST'
        assert text.startswith(found)
        assert ': start the bridge (make run), or set these variables as for the bridge' in text
        (tmp_path / 'ros2').touch(0o755)
        assert 'start the bridge (ros2 launch lupin_greenhouse_bridge greenhouse_bridge.launch.py)' in hint()
        with spinning_node('somebody'):
            text = hint(lambda node: 'somebody' in node.get_node_names())
        assert text.startswith('other nodes but no bridge is found with ')
        # Without enforcement, a node without keys starts but finds no other node.
        monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
        monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Permissive')
        monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path))
        assert 'the bridge needs the same keystore, and keys for this domain' in hint()
        # The variable comes after the node, which would keep it for the whole process.
        text = hint(lambda _node: monkeypatch.setenv('ROS_DISCOVERY_SERVER', '127.0.0.1:11811') or True)
        assert 'ROS_DISCOVERY_SERVER=127.0.0.1:11811' in text
        assert 'start the discovery server or unset its variable' in text


def test_the_hint_names_a_service_of_another_name_or_type(hint, noon_bridge):
    name = noon_bridge.service_name
    text = hint(lambda node: name in dict(node.get_service_names_and_types()))
    namespace = name.removesuffix('/greenhouse_bridge/get_tag_reading')
    assert text == f'there is {name}: name it with --service (make read: NAMESPACE={namespace})'
    name, its_type = '/stranger/get_tag_reading', 'rcl_interfaces/srv/GetParameters'
    with empty_domain(), spinning_node('stranger') as stranger:
        stranger.create_service(GetParameters, name, lambda _request, response: response)
        text = hint(
            lambda node: its_type in dict(node.get_service_names_and_types()).get(name, []), service=name
        )
    wanted = f'{GetTagReading.__module__.split(".")[0]}/srv/GetTagReading'
    assert text.startswith(f'{name} has the type {its_type}, but this client calls {wanted}')


def test_waiting_for_the_service_is_said_and_on_a_terminal_wiped_out(run_here, times_out_when, monkeypatch):
    monkeypatch.setattr(read_tag, 'SILENT_SECONDS', 0.0)
    ends = iter([False, False, True])
    times_out_when(lambda _node: next(ends))
    with Terminal(columns=80) as shown, redirect_stderr(shown.stream):
        run_here(read_tag.main, '1', '--service', '/nobody/get_tag_reading', '--timeout', '7')
    waiting = 'read_tag: waiting for /nobody/get_tag_reading, 7 s more'
    assert shown.text.startswith(f'\r\x1b[K{waiting}\r\r\x1b[K\rread_tag: no service ')


def test_watch_reads_from_start_to_start_until_a_signal(read, shipped_tags, monkeypatch):
    ticks = itertools.count(0.0, 30.0)  # a round takes 30 s
    slept = []

    def sleep(seconds):
        slept.append(seconds)
        if len(slept) == 3:
            signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(process, 'sleep', sleep)
    monkeypatch.setattr(read_tag, 'time', SimpleNamespace(monotonic=lambda: next(ticks)))
    ended = read('6', '99', '--watch', '100')
    assert (ended.code, slept) == (SOME_FAILED, [70.0] * 3)
    tag_ids = [row.split()[0] for row in ended.out.splitlines()]
    assert tag_ids == ['tag', *['6'] * len(shipped_tags['6']['sensors']) * 3]
    assert ended.said.count('UNKNOWN_TAG') == 3


@pytest.mark.parametrize(('count', 'code'), [('3', NO_ANSWER), ('5', ALL_READ)])
def test_a_watch_goes_on_while_the_bridge_is_away(run_here, times_out_when, monkeypatch, count, code):
    """Away in the second and the third round; said once, and the exit code is that of the last round."""
    is_there, rounds = threading.Event(), itertools.count(1)
    is_there.set()

    def reply_while_there(request, response):
        is_there.wait(PATIENCE_SECONDS)
        # The time in which it would ask again stands still.
        wait_until(lambda: has_found_a_client(node, service))
        return reply(request, response)

    def sleep(_seconds):
        number = next(rounds)
        if number == 1:
            is_there.clear()
        if number == 3:
            is_there.set()

    monkeypatch.setattr(process, 'sleep', sleep)
    times_out_when(lambda _node: not is_there.is_set())
    service = '/away/get_tag_reading'
    with empty_domain(), spinning_node('away') as node:
        node.create_service(GetTagReading, service, reply_while_there)
        ended = run_here(read_tag.main, '1', '--service', service, '--watch', '1', '--count', count)
        is_there.set()
    assert ended.code == code
    assert ended.said == f'read_tag: {service} did not answer within 5 s: still watching'


def test_two_servers_of_the_service_are_named_though_their_names_are_the_same(run_here, monkeypatch):
    def warning_once_found(node, name, **options):
        wait_until(lambda: len(servers_of(node, name)) == 2)
        return duplicate_server_warning(node, name, **options)

    monkeypatch.setattr(read_tag, 'duplicate_server_warning', warning_once_found)
    with empty_domain(), spinning_node('first') as first, spinning_node('first') as second:
        for node in (first, second):
            node.create_service(GetTagReading, '/a/get_tag_reading', reply)
        said = run_here(read_tag.main, '1', '--service', '/a/get_tag_reading').said
    faults = '/a/get_tag_reading is offered by /first and /first: clients use the first reply; stop one'
    assert said == f'read_tag: {faults} of them, or rename it'


def test_the_shell_completes_tag_ids(tmp_path):
    command = f'exec 8>answer 9>/dev/null; exec {shlex.quote(READ_TAG)}'
    asked = {'_ARGCOMPLETE': '1', '_ARGCOMPLETE_IFS': '\n', '_ARGCOMPLETE_SUPPRESS_SPACE': '1'}
    asked |= {'COMP_LINE': 'read_tag 2', 'COMP_POINT': '10'}
    subprocess.run(['bash', '-c', command], cwd=tmp_path, env={**os.environ, **asked}, timeout=60, check=True)
    assert '21' in (tmp_path / 'answer').read_text().split('\n')


def answer(tag_id, seconds=0.0, **values):
    response = GetTagReading.Response(reading=reading_of(tag_id, time_of_day=seconds, **values))
    return answer_of(tag_id, response)


def failure(message, status=GetTagReading.Response.STATUS_UNKNOWN_TAG):
    return answer_of('9', GetTagReading.Response(status=status, error_message=message))


def test_the_columns_are_aligned_values_to_the_right_and_the_failures_apart(capsys):
    good = [answer('7', 3661.9, humidity=1.25, co2=123456.7), answer('long', 86399.9, co2=12.6)]
    Table(is_watched=False).show([*good, failure('new\n', status=9), failure('y' * 1001)])
    assert capsys.readouterr() == (
        'tag   sim time  sensor     value  unit\n'
        '7     01:01:01  humidity     1.2  %\n'
        '7     01:01:01  co2       123457  ppm\n'
        'long  23:59:59  co2           13  ppm\n'
        '2/4 tags read\n',
        f'read_tag: 9: new\\n\nread_tag: UNKNOWN_TAG: {"y" * 1000}...\n',
    )
    Table(is_watched=False).show([answer('x' * 41, ozone=0.5)])  # one tag is not counted
    assert capsys.readouterr().out.splitlines()[1:] == [f'{"x" * 40}...  00:00:00  ozone    0.50']


def test_a_watched_table_in_a_pipe_has_one_header_and_its_columns_never_get_narrower(capsys):
    table, failed = Table(is_watched=True), failure('no 9')
    table.show([failed])
    assert capsys.readouterr().out == ''  # the header comes with the first reading
    for value in (100000.0, 1.0):
        table.show([answer('7', co2=value), failed])
    assert capsys.readouterr() == (
        'tag  sim time  sensor   value  unit\n'
        '7    00:00:00  co2     100000  ppm\n'
        '7    00:00:00  co2          1  ppm\n',
        'read_tag: UNKNOWN_TAG: no 9\n' * 2,
    )


def shown(*counts, failures=()):
    """Return what tables of these many tags look like on a terminal of 24 rows."""
    with Terminal() as terminal, redirect_stdout(terminal.stream):
        table = Table(is_watched=True)
        for count in counts:
            table.show([*(answer(f'tag {number}', co2=1.0) for number in range(count)), *failures])
    return terminal.text.replace('\r\n', '\n')


def test_on_a_terminal_a_table_replaces_the_last_one_and_is_cut_to_the_window():
    table = 'tag    sim time  sensor  value  unit\ntag 0  00:00:00  co2         1  ppm\n'
    table += 'read_tag: UNKNOWN_TAG: no lost\n'
    assert shown(1, 1, failures=[failure('no lost')]) == f'\x1b[J{table}\x1b[3F\x1b[J{table}'
    whole, cut = shown(22).splitlines(), shown(23, 23).splitlines()
    assert (len(whole), whole[-1].split()[:2]) == (23, ['tag', '21'])
    assert cut[21].startswith('tag 20 ')
    assert cut[22] == '... 2 more lines in a taller window'  # a line that scrolls away cannot be replaced
    assert cut[23].startswith('\x1b[23F\x1b[J')
    # A line that is as wide as the terminal would take two.
    line = f'read_tag: UNKNOWN_TAG: {"x" * 60}'
    assert shown(0, failures=[failure('x' * 60)]) == f'\x1b[J{line:.59}\n'


def test_an_output_without_a_size_has_the_usual_one(capsys):
    with Terminal(0, 0) as terminal:
        assert terminal_size(terminal.stream) == (80, 24)
    assert terminal_size(terminal.stream) == terminal_size(sys.stdout) == (80, 24)  # closed, and no file
    Csv({}).show([answer('7', co2=1.0)])
    assert capsys.readouterr().out.startswith(f'{HEADER}\n')
