# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What read_tag prints of a response, without ROS."""

import json
import sys

import pytest
from conftest import Terminal
from lupin_greenhouse_bridge.contract import STATUS_NAMES
from lupin_greenhouse_bridge.interfaces import GetTagReading, SensorReading
from lupin_greenhouse_bridge.reading.table import Screen, json_line, terminal_size
from lupin_greenhouse_bridge.recording.rows import rows_of

OK, UNKNOWN_TAG = 0, 1


def answer(seconds=0.0, **values):
    response = GetTagReading.Response(status=OK)
    response.reading.sim_time_of_day_seconds = float(seconds)
    response.reading.readings = [SensorReading(name=name, value=value) for name, value in values.items()]
    return response


def failure(status, message):
    return GetTagReading.Response(status=status, error_message=message)


def test_the_columns_are_aligned_values_to_the_right_and_the_failures_apart(capsys):
    responses = {'7': answer(3661.9, co2=400.0, light=1.25), 'long': answer(86399.9, co2=12.5)}
    Screen(is_watched=False).show(responses | {'9': failure(9, 'new\n')}, STATUS_NAMES)
    assert capsys.readouterr() == (
        'tag   sim time  sensor    value  unit\n'
        '7     01:01:01  co2     400.000  ppm\n'
        '7     01:01:01  light     1.250  lx\n'
        'long  23:59:59  co2      12.500  ppm\n'
        '2/3 tags read\n',
        'read_tag: 9: new\\n\n',
    )


def test_a_sensor_that_is_not_one_of_the_simulators_has_no_unit(capsys):
    response = answer(ozone=0.5)
    assert [row.unit for row in rows_of(response.reading, 'read_tag')] == ['']
    Screen(is_watched=False).show({'7': response}, STATUS_NAMES)
    assert capsys.readouterr().out.splitlines()[1] == '7    00:00:00  ozone   0.500'


def test_one_tag_is_not_counted(capsys):
    Screen(is_watched=False).show({'7': answer(co2=1.0)}, STATUS_NAMES)
    assert len(capsys.readouterr().out.splitlines()) == 2


def test_long_ids_and_messages_are_cut(capsys):
    responses = {'x' * 41: answer(co2=1.0), '8': failure(UNKNOWN_TAG, 'y' * 1001)}
    Screen(is_watched=False).show(responses, STATUS_NAMES)
    out, err = capsys.readouterr()
    assert out.splitlines()[1].startswith('x' * 40 + '...  00:00:00')
    assert err == f'read_tag: UNKNOWN_TAG: {"y" * 1000}...\n'


@pytest.mark.parametrize(('window', 'size'), [((24, 60), (60, 24)), ((0, 0), (80, 24))])
def test_the_size_is_that_of_the_window_or_the_usual_one(window, size):
    with Terminal(*window) as terminal:
        assert terminal_size(terminal.stream) == size


def test_a_watched_table_in_a_pipe_has_one_header_and_its_columns_never_get_narrower(capsys):
    screen = Screen(is_watched=True)
    for value in (1000.0, 1.0):
        screen.show({'7': answer(co2=value), '8': failure(UNKNOWN_TAG, 'no 8')}, STATUS_NAMES)
    out, err = capsys.readouterr()
    assert out == (
        'tag  sim time  sensor     value  unit\n'
        '7    00:00:00  co2     1000.000  ppm\n'
        '7    00:00:00  co2        1.000  ppm\n'
    )
    assert err == 'read_tag: UNKNOWN_TAG: no 8\n' * 2


def test_the_header_comes_with_the_first_reading(capsys):
    screen = Screen(is_watched=True)
    screen.show({'7': failure(UNKNOWN_TAG, 'no 7')}, STATUS_NAMES)
    assert capsys.readouterr().out == ''
    screen.show({'7': answer(co2=1.0)}, STATUS_NAMES)
    assert capsys.readouterr().out.startswith('tag')


@pytest.fixture
def shown(monkeypatch):
    """Return a function that returns what tables of these many tags look like on a terminal of 24 rows."""

    def shown(*counts, **changed):
        with Terminal() as terminal, monkeypatch.context() as patch:
            patch.setattr(sys, 'stdout', terminal.stream)
            screen = Screen(is_watched=True)
            for count in counts:
                responses = {f'tag {number}': answer(co2=1.0) for number in range(count)}
                screen.show(responses | changed, STATUS_NAMES)
        return terminal.text.replace('\r\n', '\n')

    return shown


def test_on_a_terminal_a_table_replaces_the_last_one_with_its_failures(shown):
    table = 'tag    sim time  sensor  value  unit\ntag 0  00:00:00  co2     1.000  ppm\n'
    table += 'read_tag: UNKNOWN_TAG: no lost\n'
    assert shown(1, 1, lost=failure(UNKNOWN_TAG, 'no lost')) == f'\x1b[J{table}\x1b[3F\x1b[J{table}'


def test_a_table_that_is_taller_than_the_terminal_is_cut(shown):
    """Lines that have scrolled away cannot be replaced."""
    whole, cut = shown(22).splitlines(), shown(23, 23).splitlines()
    assert len(whole) == 23
    assert whole[-1].startswith('tag 21 ')
    assert cut[21].startswith('tag 20 ')
    assert cut[22] == '... 2 more lines in a taller window'
    assert cut[23].startswith('\x1b[23F\x1b[J')


def test_a_line_that_is_wider_than_the_terminal_is_cut(shown):
    """A line that is as wide as the terminal would take two."""
    assert (
        shown(0, lost=failure(UNKNOWN_TAG, 'x' * 60)) == f'\x1b[J{"read_tag: UNKNOWN_TAG: " + "x" * 60:.59}\n'
    )


def test_json_names_the_status_and_keeps_characters_as_they_are():
    response = answer(60.0, co2=1.5)
    response.reading.stamp.sec, response.reading.stamp.nanosec = 7, 8
    line = json_line('番茄', response, STATUS_NAMES)
    assert '番茄' in line
    assert json.loads(line) == {
        'tag_id': '番茄',
        'status': 'OK',
        'error_message': '',
        'stamp': {'sec': 7, 'nanosec': 8},
        'sim_time_of_day_seconds': 60.0,
        'readings': {'co2': 1.5},
    }
    assert json.loads(json_line('7', failure(9, 'new'), STATUS_NAMES))['status'] == 9
