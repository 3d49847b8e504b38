"""read_tag, as a person uses it: output and exit code."""

import json
import subprocess

import pytest
from conftest import EXECUTABLES, PATIENCE_SECONDS

ALL_READ, SOME_FAILED, USAGE, NO_ANSWER = 0, 1, 2, 3


def read_tag(bridge, *arguments):
    service = ['--service', bridge.service_name] if bridge else []
    return subprocess.run(
        [EXECUTABLES / 'read_tag', *arguments, *service],
        capture_output=True,
        text=True,
        timeout=PATIENCE_SECONDS,
        check=False,
    )


@pytest.fixture(scope='module')
def bridge(noon_bridge):
    noon_bridge.connect()
    return noon_bridge


def test_a_reading_is_a_table(bridge, warm_tag_id):
    result = read_tag(bridge, warm_tag_id)
    assert (result.returncode, result.stderr) == (ALL_READ, '')
    header, *rows = (line.split() for line in result.stdout.splitlines())
    assert header == ['tag', 'sim', 'time', 'sensor', 'value']
    temperature = bridge.values(warm_tag_id)['temperature']
    assert [warm_tag_id, '12:00:00', 'temperature', f'{temperature:.3f}'] in rows


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
        f"read_tag: UNKNOWN_TAG: Tag '99' is not in the loaded greenhouse ({len(shipped_tags)} tags known).\n"
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
    ],
)
def test_a_wrong_command_line_is_exit_code_2_without_a_traceback(arguments):
    result = read_tag(None, *arguments)
    assert result.returncode == USAGE
    assert 'Traceback' not in result.stderr


def test_no_service_is_exit_code_3_and_a_hint():
    result = read_tag(None, '1', '--service', '/nobody/get_tag_reading', '--timeout', '0.5')
    assert result.returncode == NO_ANSWER
    assert 'no service /nobody/get_tag_reading' in result.stderr
    assert 'ROS_DOMAIN_ID' in result.stderr


def test_watch_reads_again_and_again(bridge):
    arguments = [EXECUTABLES / 'read_tag', '6', '--json', '--watch', '0.01', '--service', bridge.service_name]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
        lines = [process.stdout.readline() for _ in range(3)]
        process.terminate()
    assert [json.loads(line)['tag_id'] for line in lines] == ['6', '6', '6']
