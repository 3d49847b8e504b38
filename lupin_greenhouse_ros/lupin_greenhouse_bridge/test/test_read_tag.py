"""read_tag on the command line: output and exit code."""

import fcntl
import json
import os
import pty
import re
import select
import shlex
import struct
import subprocess
import termios
import threading
import time

import domain_coordinator
import pytest
from lupin_greenhouse_bridge.client import GetTagReading
from lupin_greenhouse_bridge.testing import PATIENCE_SECONDS, executable, spinning_node, wait_until

READ_TAG = executable('lupin_greenhouse_bridge', 'read_tag')
ALL_READ, SOME_FAILED, USAGE, NO_ANSWER = 0, 1, 2, 3
# Fast DDS prints this if another starting process has taken a port of shared memory.
OF_FAST_DDS = re.compile(r'\x1b\[37;1m[^\n]*RTPS_TRANSPORT_SHM[^\n]*\n')


def read_tag(bridge, *arguments):
    service = ['--service', bridge.service_name] if bridge else []
    result = subprocess.run(
        [READ_TAG, *arguments, *service],
        capture_output=True,
        text=True,
        timeout=PATIENCE_SECONDS,
        check=False,
    )
    result.stderr = said_by_read_tag(result.stderr)
    return result


def said_by_read_tag(stderr: str) -> str:
    """Return the lines that do not come from the middleware."""
    assert 'Traceback' not in stderr, stderr
    lines = [line for line in stderr.splitlines() if line.startswith(('read_tag: ', 'usage: '))]
    return '\n'.join(lines)


@pytest.fixture(scope='module')
def bridge(noon_bridge):
    noon_bridge.connect()
    return noon_bridge


def test_a_reading_is_a_table(bridge, warm_tag_id):
    result = read_tag(bridge, warm_tag_id)
    assert (result.returncode, result.stderr) == (ALL_READ, '')
    header, *rows = (line.split() for line in result.stdout.splitlines())
    assert header == ['tag', 'sim', 'time', 'sensor', 'value', 'unit']
    temperature = bridge.values(warm_tag_id)['temperature']
    assert [warm_tag_id, '12:00:00', 'temperature', f'{temperature:.3f}', '°C'] in rows


def test_all_reads_every_tag_and_counts_them(bridge, shipped_tags):
    result = read_tag(bridge, '--all')
    assert result.returncode == ALL_READ
    *rows, last = result.stdout.splitlines()[1:]
    assert {row.split()[0] for row in rows} == set(shipped_tags)
    assert last == f'{len(shipped_tags)}/{len(shipped_tags)} tags read'


def test_an_unknown_tag_is_the_typed_error_and_exit_code_1(bridge, shipped_tags):
    result = read_tag(bridge, '99')
    assert (result.returncode, result.stdout) == (SOME_FAILED, '')
    assert result.stderr == (
        f"read_tag: UNKNOWN_TAG: Tag '99' is not in the loaded greenhouse ({len(shipped_tags)} tags known)."
    )


def test_the_good_ones_of_several_tags_are_read(bridge):
    result = read_tag(bridge, '6', '99')
    assert result.returncode == SOME_FAILED
    assert result.stdout.splitlines()[-1] == '1/2 tags read'


def test_json_is_one_object_per_line(bridge, warm_tag_id):
    result = read_tag(bridge, '--json', warm_tag_id, '99')
    good, bad = map(json.loads, result.stdout.splitlines())
    assert result.returncode == SOME_FAILED
    assert (good['tag_id'], good['status'], good['sim_time_of_day_seconds']) == (warm_tag_id, 'OK', 43200.0)
    assert good['readings']['temperature'] == bridge.values(warm_tag_id)['temperature']
    assert good['readings'].keys() == bridge.values(warm_tag_id).keys()
    assert (bad['tag_id'], bad['status'], bad['readings']) == ('99', 'UNKNOWN_TAG', {})


@pytest.mark.parametrize(
    'arguments',
    [
        [],
        ['1', '--all'],
        ['1', '--timeout', '0'],
        ['1', '--timeout', 'nan'],
        ['1', '--watch', '-1'],
        ['--service', 'a b', '1'],
        ['1', '--ros-args', '-p', 'x:=[1'],
        [b'no UTF-8: \xff'],
    ],
)
def test_a_wrong_command_line_is_exit_code_2_and_says_why(arguments):
    result = read_tag(None, *arguments)
    assert result.returncode == USAGE
    assert result.stderr.splitlines()[-1].startswith('read_tag: ')


@pytest.mark.parametrize('seconds', ['soon', '0', 'nan', '-1', 'inf'])
def test_a_time_that_is_none_is_named(seconds):
    result = read_tag(None, '1', '--timeout', seconds)
    assert f"argument --timeout: '{seconds}' is not a number of seconds above 0" in result.stderr


def test_a_service_that_does_not_answer_is_exit_code_3():
    answer = threading.Event()

    def withhold(_request, response):
        answer.wait(PATIENCE_SECONDS)
        return response

    with spinning_node('slow') as node:
        node.create_service(GetTagReading, '~/get_tag_reading', withhold)
        result = read_tag(None, '1', '--service', '/slow/get_tag_reading', '--timeout', '5')
        answer.set()
    assert result.returncode == NO_ANSWER
    assert result.stderr == 'read_tag: /slow/get_tag_reading did not answer within 5 s'


def test_a_reader_of_the_pipe_who_has_enough_ends_it_well(bridge):
    ask = [READ_TAG, '6', '--watch', '0.01', '--service', bridge.service_name]
    with subprocess.Popen(ask, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.wait(PATIENCE_SECONDS) == ALL_READ
        assert said_by_read_tag(process.stderr.read()) == ''


def test_all_of_a_bridge_with_another_tag_file_are_its_own(start_bridge, takes_tag_files, tmp_path):
    """Even if this machine has another release of the simulator than the bridge."""
    if not takes_tag_files:
        return  # serves no custom tag file
    tag_file = tmp_path / 'tags.json'
    tag_file.write_text(
        '{"10": {"x": 1, "y": 1, "sensors": ["co2"]}, "9": {"x": 1, "y": 1, "sensors": ["co2"]}}'
    )
    bridge = start_bridge(tag_file=tag_file)
    bridge.connect()
    tag_file.unlink()
    result = read_tag(bridge, '--all', '--json')
    assert result.returncode == ALL_READ
    assert [json.loads(line)['tag_id'] for line in result.stdout.splitlines()] == ['9', '10']


def test_all_needs_a_bridge_that_names_its_tags():
    with spinning_node('stranger') as node:
        node.create_service(GetTagReading, '~/get_tag_reading', lambda _request, response: response)
        result = read_tag(None, '--all', '--service', '/stranger/get_tag_reading')
    assert result.returncode == USAGE
    assert result.stderr == (
        'read_tag: the node of /stranger/get_tag_reading has no parameter loaded_tag_ids,'
        ' so it is a bridge older than 1.1: name the tag ids instead of --all'
    )


def test_no_service_is_exit_code_3_and_a_hint():
    result = read_tag(None, '1', '--service', '/nobody/get_tag_reading', '--timeout', '0.5')
    assert result.returncode == NO_ANSWER
    (line,) = result.stderr.splitlines()
    assert line.startswith('read_tag: no service /nobody/get_tag_reading within 0.5 s; ')


def hint(environment=None) -> str:
    """Return the hint of a read_tag that finds no service."""
    result = subprocess.run(
        [READ_TAG, '1', '--service', '/nobody/get_tag_reading', '--timeout', '1'],
        capture_output=True,
        text=True,
        env={**os.environ, **(environment or {})},
        timeout=PATIENCE_SECONDS,
        check=False,
    )
    assert result.returncode == NO_ANSWER
    return result.stderr


def test_the_hint_names_the_domain_the_discovery_and_what_is_there():
    with domain_coordinator.domain_id() as empty_domain:
        text = hint({'ROS_DOMAIN_ID': str(empty_domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})
    assert f'ROS_DOMAIN_ID {empty_domain}, limited to this machine by ' in text
    assert 'has no other node: start the bridge' in text


def test_the_hint_names_a_bridge_of_another_name(bridge):
    wait_until(lambda: f'there is {bridge.service_name}: name it with --service' in hint())


def test_the_hint_says_when_there_are_nodes_but_no_bridge():
    with domain_coordinator.domain_id() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        with spinning_node('somebody'):
            wait_until(lambda: 'has other nodes but no bridge' in hint())


class Terminal:
    """A terminal that a command runs in."""

    def __init__(self, *command):
        self._screen, terminal = pty.openpty()
        fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack('HHHH', 24, 60, 0, 0))
        self.process = subprocess.Popen(command, stdout=terminal, stderr=terminal, stdin=terminal)
        os.close(terminal)
        self.text = ''

    def read_until(self, fragment: str, count: int) -> None:
        """Read until a fragment was printed this often."""
        deadline = time.monotonic() + PATIENCE_SECONDS
        while self.text.count(fragment) < count:
            wait = max(0.0, deadline - time.monotonic())
            assert select.select([self._screen], [], [], wait)[0], f'no {fragment!r} in {self.text[-500:]!r}'
            self.text += os.read(self._screen, 4096).decode()

    def close(self) -> None:
        """End the command."""
        self.process.terminate()
        self.process.wait(PATIENCE_SECONDS)
        os.close(self._screen)
        self.text = OF_FAST_DDS.sub('', self.text)


def test_watch_updates_the_table_in_place_on_a_terminal(bridge, shipped_tags):
    service = ['--service', bridge.service_name]
    terminal = Terminal(READ_TAG, '6', '99', '--watch', '0.01', *service)
    sensors = shipped_tags['6']['sensors']
    terminal.read_until(sensors[-1], 3)
    terminal.close()
    # A header, the readings and a failure: the number of lines to replace.
    assert terminal.text.count(f'\x1b[{1 + len(sensors) + 1}F\x1b[J') >= 2
    assert 'UNKNOWN_TAG' in terminal.text
    printed = re.sub(r'\x1b\[\d*[A-Z]', '', terminal.text)
    assert max(map(len, re.split(r'[\r\n]+', printed))) < 60


def test_a_watched_table_that_is_taller_than_the_terminal_is_cut(bridge):
    """Lines that have scrolled away cannot be replaced."""
    service = ['--service', bridge.service_name]
    terminal = Terminal(READ_TAG, '--all', '--watch', '0.01', *service)
    terminal.read_until('more lines in a taller window', 2)
    terminal.close()
    assert '\x1b[23F\x1b[J' in terminal.text


def test_waiting_for_the_service_is_shown_on_a_terminal_and_wiped_out():
    terminal = Terminal(READ_TAG, '1', '--service', '/nobody/get_tag_reading', '--timeout', '2')
    terminal.read_until('no service', 1)
    terminal.close()
    assert 'waiting for /nobody/get_tag_reading, 1 s more' in terminal.text
    assert '\r\x1b[Kread_tag: no service' in terminal.text


def test_watch_prints_plain_lines_under_one_header_into_a_pipe(bridge):
    arguments = [READ_TAG, '6', '--watch', '0.01', '--service', bridge.service_name]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
        lines = [process.stdout.readline().split() for _ in range(4)]
        process.terminate()
    assert lines[0][0] == 'tag'
    assert [line[0] for line in lines[1:]] == ['6', '6', '6']


def test_watch_reads_again_and_again_as_json(bridge):
    arguments = [READ_TAG, '6', '--json', '--watch', '0.01', '--service', bridge.service_name]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
        lines = [process.stdout.readline() for _ in range(3)]
        process.terminate()
    assert [json.loads(line)['tag_id'] for line in lines] == ['6', '6', '6']


@pytest.mark.parametrize(
    ('typed', 'offered'), [('read_tag --wa', '--watch'), ('read_tag 2', '21'), ('read_tag --js', '--json')]
)
def test_the_shell_completes_options_and_tag_ids(tmp_path, typed, offered):
    answer = tmp_path / 'answer'
    command = f'exec 8>{shlex.quote(str(answer))} 9>/dev/null; exec {shlex.quote(READ_TAG)}'
    environment = {
        '_ARGCOMPLETE': '1',
        'COMP_LINE': typed,
        'COMP_POINT': str(len(typed)),
        '_ARGCOMPLETE_IFS': '\n',
        '_ARGCOMPLETE_SUPPRESS_SPACE': '1',
    }
    subprocess.run(
        ['bash', '-c', command], env={**os.environ, **environment}, timeout=PATIENCE_SECONDS, check=True
    )
    assert offered in answer.read_text().split('\n')
