# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The page of readings: what it holds, and what it refuses. A browser opens it in the monorepo's ci/tests."""

import importlib.util
import json
import os
import re
import sys

import pytest
from lupin_greenhouse_bridge.display import readings_page
from lupin_greenhouse_bridge.recording.rows import Row, utc_of
from lupin_greenhouse_bridge.recording.store import open_store
from lupin_greenhouse_bridge.simulator.layout import find_layout
from reading_helpers import START_S, visit, write_report

pytest.importorskip('plotly', reason='plotly, which draws the page, is missing: pip install plotly')
EVIL = '</script><script>alert(1)</script>'


@pytest.fixture
def report(tmp_path):
    """Return a function that writes a report of these visits and returns its path."""
    return lambda *visits: write_report(tmp_path / 'report.jsonl', *visits)


@pytest.fixture
def recording(tmp_path):
    """Return a function that keeps these values of one sensor, a second apart, as SQLite or CSV."""

    def write(name, values, sensor='ph', place_m=(1.0, 2.0)):
        path = tmp_path / name
        stamps = [(START_S + number) * 1_000_000_000 for number in range(len(values))]
        rows = [
            Row(ns, utc_of(ns), 'a1', sensor, value, '', *place_m, 60.0, 'test')
            for ns, value in zip(stamps, values, strict=True)
        ]
        store = open_store(str(path))
        store.keep(rows)
        store.close()
        return path

    return write


def shown(path, *options):
    """Make the page of a file, and return the data in it."""
    assert readings_page.main([str(path), *options]) == 0
    page = path.with_suffix('.html').read_text(encoding='utf-8')
    (text,) = re.findall('<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    return json.loads(text)


def test_the_table_has_failures_first_and_the_last_reading_of_each_tag(report, shipped_tags):
    data = shown(
        report(
            visit('1', co2=600.0, temperature=21.5),
            visit('10', 'TIMEOUT', 'no reply'),
            visit('9', 'UNKNOWN_TAG', 'no such tag'),
            visit('1', second=5, co2=700.0),
        )
    )
    assert [tag['id'] for tag in data['tags'][:2]] == ['9', '10']
    assert data['tags'][-1]['id'] == '1'
    assert data['tags'][-1]['values'] == [None, 700.0]  # temperature comes before co2
    assert data['tags'][-1]['stamp_ms'] == (START_S + 5) * 1000
    assert len(data['tags']) == len(shipped_tags)


def test_a_report_shows_its_order_of_visits_and_a_recording_has_none(report, recording):
    tags = find_layout('').tags
    visits = [
        visit('5', co2=1.0),
        visit('2', 'UNREACHABLE'),
        visit('nowhere', 'UNKNOWN_TAG'),
        visit('1', co2=1.0),
    ]
    assert shown(report(*visits))['visits'] == [
        [tags[tag_id].x, tags[tag_id].y] for tag_id in ('5', '2', '1')
    ]
    assert shown(recording('day.csv', [7.0]))['visits'] == []


def test_the_route_that_a_robot_drove_is_shown(report, tmp_path):
    route = tmp_path / 'route.csv'
    route.write_text('x,y\n0.5,0.5\n0.5,3.5\n', encoding='utf-8')
    assert shown(report(visit('1', co2=1.0)), '--route', str(route))['route'] == [[0.5, 0.5], [0.5, 3.5]]


def test_without_the_simulator_a_recording_shows_its_own_places(recording, report, monkeypatch, capsys):
    path, report_path = recording('day.csv', [7.0]), report(visit('1', co2=1.0))
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, 'find_spec', lambda name: name != 'greenhouse_sim' and find_spec(name)
    )
    assert [tag['id'] for tag in shown(path)['tags']] == ['a1']
    assert readings_page.main([str(report_path)]) == 2
    assert 'mdp-greenhouse is not installed here: name the layout' in capsys.readouterr().err


@pytest.mark.parametrize('name', ['day.sqlite', 'day.csv'])
def test_a_recording_shows_its_own_places_and_no_unit_for_an_unknown_sensor(recording, name):
    data = shown(recording(name, [7.0, 6.5]))
    (tag,) = [tag for tag in data['tags'] if tag['id'] == 'a1']
    assert (tag['x'], tag['y'], tag['values'], tag['outcome']) == (1.0, 2.0, [6.5], '')
    (sensor,) = data['sensors']
    assert (sensor['name'], sensor['unit'], sensor['range']) == ('ph', '', None)
    assert [point[2] for point in sensor['points']] == [7.0, 6.5]


def test_a_long_recording_is_thinned_to_its_extremes_and_says_so(recording):
    values = [7.0 + number % 10 / 10 for number in range(20_000)]
    values[12_345], values[6_789] = 99.0, -99.0
    data = shown(recording('day.sqlite', values))
    points = [point[2] for point in data['sensors'][0]['points']]
    assert len(points) <= readings_page.MOST_POINTS
    assert (min(points), max(points)) == (-99.0, 99.0)
    assert data['notes'] == [
        'The charts show 2,000 of 20,000 values of ph: the lowest and the highest of each few in a row.'
    ]


def test_no_text_of_a_file_ends_the_data_of_the_page(report):
    data = shown(report(visit(EVIL, 'UNKNOWN_TAG', EVIL), visit('1', **{EVIL: 1.0})))
    assert (data['tags'][0]['id'], data['tags'][0]['detail']) == (EVIL, EVIL)
    assert data['sensors'][0]['name'] == EVIL


def test_a_detail_that_cannot_be_encoded_is_escaped(report):
    assert shown(report(visit('1', 'TIMEOUT', '\ud800')))['tags'][0]['detail'] == '\\ud800'


def test_a_tag_id_of_any_length_and_a_file_of_any_name_are_shown(report, tmp_path):
    number = '9' * 5000  # more digits than Python converts to a number
    path = report(visit(number, co2=1.0)).rename(tmp_path / os.fsdecode(b'\xff.jsonl'))
    data = shown(path)
    assert data['title'] == '\\udcff.jsonl'
    assert f'{number[:64]}...' in [tag['id'] for tag in data['tags']]


def test_a_tag_without_a_position_is_named(report):
    data = shown(report(visit('stranger', co2=1.0)))
    assert data['notes'] == ['Tags without a position: 1, such as stranger. Name the layout with --tag-file.']


@pytest.mark.parametrize(
    ('arguments', 'fragment'),
    [
        (['/missing.csv'], "'/missing.csv': No such file"),
        (['REPORT', '--tag-file', '/missing.json'], '/missing.json'),
        (['REPORT', '--sim-config-file', 'REPORT'], 'visualization is missing'),
        (['REPORT', '-o', '/missing/page.html'], "--output '/missing/page.html': No such file"),
        (['REPORT', '--route', 'REPORT'], 'is not a CSV file of x,y in metres'),
        (['NAN'], 'nan'),
        (['REPORT', '-o', 'REPORT'], 'is the file of readings itself: name another'),
        (['.'], 'not a regular file'),
        (['/'], 'not a regular file'),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_line(report, tmp_path, capsys, arguments, fragment):
    known = {'REPORT': str(report(visit('1', co2=1.0))), 'NAN': str(tmp_path / 'nan.jsonl')}
    (tmp_path / 'nan.jsonl').write_text(json.dumps(visit('1', co2=float('nan'))), encoding='utf-8')
    assert readings_page.main([known.get(each, each) for each in arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('readings_page: ')
    assert fragment in line


def test_without_plotly_the_command_that_installs_it_is_named(report, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'plotly.offline', None)
    assert readings_page.main([str(report(visit('1', co2=1.0)))]) == 2
    assert capsys.readouterr().err.endswith(': pip install plotly\n')
