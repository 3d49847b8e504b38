"""The page of readings: what it holds, and what it refuses. A browser opens it in the monorepo's ci/tests."""

import base64
import hashlib
import json
import os
import random
import re
from collections import defaultdict
from pathlib import Path
from statistics import median

import pytest
import yaml
from lupin_greenhouse_bridge.simulator.layout import find_layout, shipped_file
from lupin_greenhouse_bridge.units import name_of
from lupin_planning.walls import find_walls
from lupin_readings import readings_page
from lupin_readings.colours import colour_limits
from lupin_readings.reading_file import Recording
from lupin_readings.rows import Row, utc_of
from lupin_readings.store import Store, read_rows
from lupin_readings.summary import greenhouse_times

START_S = 1795190000
EVIL = '</script><script>alert(1)</script>'


def visit(tag_id, outcome='OK', detail='', second=0, **values):
    """Return one visit of a tag, as a line of a mission's report has it."""
    is_read = outcome == 'OK'
    return {
        'tag_id': tag_id,
        'outcome': outcome,
        'detail': detail,
        'attempts': 1 if is_read else 3,
        'stamp': {'sec': START_S + second, 'nanosec': 0} if is_read else None,
        'sim_time_of_day_seconds': 43200.0 if is_read else None,
        'readings': values if is_read else None,
    }


def write_report(path: Path, *visits: dict) -> Path:
    path.write_text(''.join(f'{json.dumps(each)}\n' for each in visits), encoding='utf-8')
    return path


@pytest.fixture
def report(tmp_path):
    return lambda *visits: write_report(tmp_path / 'report.jsonl', *visits)


@pytest.fixture
def recording(tmp_path):
    """Return a function that keeps these values of one sensor, a second apart, as SQLite."""

    def write(name, values, sensor='ph', place_m=(1.0, 2.0)):
        path = tmp_path / name
        store = Store(str(path))
        for number, value in enumerate(values):
            ns = (START_S + number) * 10**9
            store.keep([Row(ns, utc_of(ns), 'a1', sensor, value, '', *place_m, 60.0, 'test')])
        return path

    return write


def data_in(page):
    text = page.read_text(encoding='utf-8')
    assert len(text) < 5e6
    (data,) = re.findall('<script id="data" type="application/json">(.*?)</script>', text, re.DOTALL)
    return json.loads(data)


def shown(path, *options):
    assert readings_page.main([str(path), *options]) == 0
    return data_in(path.with_suffix('.html'))


def test_the_table_has_failures_first_and_the_last_reading_of_each_tag(report, shipped_tags):
    data = shown(
        report(
            visit('7', 'TIMEOUT', 'no reply'),
            visit('10', 'UNREACHABLE', 'cut off'),
            visit('9', 'UNREACHABLE', 'cut off'),
            visit('5', 'UNREACHABLE', 'no pose'),
            visit('2', 'TIMEOUT', 'no reply'),
            visit('1', co2=600.0, temperature=21.5),
            visit('2', co2=1.0),
            visit('1', second=5, co2=700.0),
        )
    )
    assert [tuple(each.values()) for each in data['failures']] == [  # by reason, the largest group first
        ('unreachable', 'cut off', ['9', '10'], ''),
        ('timeout', 'no reply', ['7'], ''),
        ('unreachable', 'no pose', ['5'], ''),
    ]
    assert data['counts'] == [
        [f'2 of {len(shipped_tags)} tags read', False],
        ['3 unreachable', True],
        ['1 timeout', True],
        [f'{len(shipped_tags) - 6} not visited', False],
    ]
    assert [tag['id'] for tag in data['tags'][:4]] == ['5', '7', '9', '10']
    assert [sensor['name'] for sensor in data['sensors']] == ['temperature', 'CO₂']
    (tag,) = (each for each in data['tags'] if each['id'] == '1')
    assert (tag['values'], tag['stamp_ms']) == ([None, 700.0], (START_S + 5) * 1000)
    assert len(data['tags']) == len(shipped_tags)
    assert not data['is_complete']  # tag 1 also has a temperature


def test_the_lowest_and_the_highest_values_are_those_of_read_tags_and_all_tags_with_them(report):
    data = shown(
        report(
            visit('1', co2=700.2),
            visit('3', co2=699.8),
            visit('5', co2=600.0),
            visit('12', co2=900.0),
            visit('12', 'TIMEOUT', 'no reply'),
        )
    )
    assert data['is_complete']
    (sensor,) = data['sensors']
    assert sensor['extremes'] == [
        ['lowest 600 ppm at tag 5', ['5']],
        ['highest 700 ppm at tags 1 and 3', ['1', '3']],
    ]
    assert (sensor['limits'], data['route']) == ([600.0, 800.0], [])


def test_more_tags_than_are_shown_are_counted(report):
    count = readings_page.MOST_TAGS + 2
    failed = [visit(f'f{number}', 'TIMEOUT') for number in range(readings_page.MOST_NAMED + 7)]
    data = shown(report(*(visit(f't{number}', co2=1.0) for number in range(count)), *failed))
    total = count + len(failed) + len(find_layout('').tags)
    assert data['counts'][0] == [f'{count:,} of {total:,} tags read', False]
    assert len(data['tags']) == readings_page.MOST_TAGS
    assert data['notes'][0] == f'The map, the table and the charts show 1,000 of {total:,} tags.'
    assert data['failures'][0]['more'] == ' and 7 more'


def test_without_the_simulator_a_recording_shows_its_own_places(recording, report, monkeypatch, capsys):
    path, report_path = recording('day.sqlite', [7.0]), report(visit('1', co2=1.0))
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert [tag['id'] for tag in shown(path)['tags']] == ['a1']
    assert readings_page.main([str(report_path)]) == 2
    assert 'mdp-greenhouse is not installed here: name' in capsys.readouterr().err


def test_a_recording_shows_its_own_places_and_no_unit_for_an_unknown_sensor(recording):
    data = shown(recording('day.sqlite', [7.0, 6.5]))
    tag = data['tags'][0]  # before those of the layout, which are not in the file
    assert (tag['id'], tag['x'], tag['y'], tag['values'], tag['outcome']) == ('a1', 1.0, 2.0, [6.5], 'read')
    (sensor,) = data['sensors']
    assert (sensor['name'], sensor['unit'], sensor['limits']) == ('ph', '', [6.44, 6.56])
    assert [line['wall'] for line in sensor['lines']] == [[[0, 7.0], [1000, 6.5]]]
    assert [line['day'] for line in sensor['lines']] == [[[60, 6.75, 6.5, 7.0]]]


def test_a_day_of_readings_shows_each_tag_in_each_half_hour():
    """24 h of the wall clock, in which the greenhouse has 1,800 days: 83,000 values."""
    layout, chance = find_layout(''), random.Random(1)
    series = [(tag_id, sensor) for tag_id, tag in layout.tags.items() for sensor in tag.sensors]
    rounds = 83_000 // len(series)
    rows, values = [], defaultdict(list)
    for number in range(rounds):
        seconds = 86_400 * number / rounds
        ns, sim_time = START_S * 10**9 + round(seconds * 1e9), float(int(seconds) * 1800 % 86_400)
        for tag_id, sensor in series:
            value = round(chance.uniform(300.0, 900.0), 2)
            rows.append(Row(ns, '', tag_id, sensor, value, '', *layout.tags[tag_id][:2], sim_time, 'test'))
            values[sensor, tag_id, sim_time].append(value)
    recording = Recording(Path('day'), rows, [], layout, find_walls(layout), [], '')
    limits = dict.fromkeys(sorted({sensor for _, sensor in series}), (0.0, 1000.0))
    data = readings_page.data_of(recording, limits)
    shown = {}
    for sensor in data['sensors']:
        for line in sensor['lines']:
            assert len(line['wall']) == readings_page.WALL_BINS
            wall, day = ([value for _, *three in line[clock] for value in three] for clock in ('wall', 'day'))
            assert (min(wall), max(wall)) == (min(day), max(day))
            for at, *three in line['day']:
                shown[sensor['name'], data['tags'][line['tag']]['id'], float(at)] = three
    assert data['is_binned']
    assert len(shown) == 48 * len(series)
    assert shown == {
        (name_of(sensor), *key): pytest.approx([median(found), min(found), max(found)], rel=1e-3)
        for (sensor, *key), found in values.items()
    }
    assert len(readings_page.fill(recording, limits)) < 5e6


def test_only_the_script_of_the_page_itself_may_run(report):
    """No text of a file ends the data of the page."""
    path = report(visit(EVIL, 'UNKNOWN_TAG', EVIL), visit('1', **{EVIL: 1.0}))
    data = shown(path)
    assert (data['tags'][0]['id'], data['tags'][0]['reason']) == (EVIL, EVIL)
    assert data['sensors'][0]['name'] == EVIL
    page = path.with_suffix('.html').read_text(encoding='utf-8')
    (digest,) = re.findall("script-src 'sha256-([^']+)'", page)
    (script,) = re.findall('<script>(.*?)</script>', page, re.DOTALL)
    assert base64.b64decode(digest) == hashlib.sha256(script.encode()).digest()


def test_names_of_any_kind_are_shown(report, tmp_path):
    number = '9' * 5000  # more digits than Python converts to a number
    visits = visit('1', 'TIMEOUT', '\ud800'), visit(number, co2=1.0)
    data = shown(report(*visits).rename(tmp_path / os.fsdecode(b'<\xff.jsonl')))
    assert data['title'] == '<\\udcff.jsonl'
    assert data['tags'][0]['reason'] == '\\ud800'
    name = f'{number[:64]}...'
    assert name in [tag['id'] for tag in data['tags']]
    lost = f'Tags without a position: 1, such as {name}. Name the layout with --tag-file.'
    assert data['notes'] == [lost]


def test_of_a_file_without_rows_there_is_no_page(recording, capsys):
    path = recording('day.sqlite', [])
    assert readings_page.main([str(path)]) == 1
    assert capsys.readouterr().err == f"readings_page: '{path}' holds no readings: no page is made\n"
    assert not path.with_suffix('.html').exists()


def test_the_greenhouse_beside_a_report_is_its_own(report, tmp_path, write_layout):
    Path(write_layout({'7': (0.5, 1.5)})).rename(tmp_path / 'report-tag_locations.json')
    shipped_config = yaml.safe_load(Path(shipped_file('greenhouse_config.yaml')).read_text(encoding='utf-8'))
    room = shipped_config['visualization'] | {'greenhouse_width_m': 3.0, 'greenhouse_height_m': 2.0}
    config = json.dumps(shipped_config | {'visualization': room})
    (tmp_path / 'report-greenhouse_config.yaml').write_text(config, encoding='utf-8')
    (tmp_path / 'report-route.csv').write_text('x,y\n0.5,0\n0.5,3\n0.5,3\n0.5,0\n', encoding='utf-8')
    data = shown(report(visit('7', co2=600.0)))
    assert data['stops'] == [[0.5, 3]]
    assert data['arrows'] == [[0.5, 1.5, 1.571], [0.5, 1.5, -1.571]]
    assert [(tag['id'], tag['x'], tag['y']) for tag in data['tags']] == [('7', 0.5, 1.5)]
    assert data['walls'] == [0.0, 0.0, 3.0, 2.0]


def test_tags_outside_the_walls_are_named(recording, capsys):
    path = recording('readings.sqlite', [7.0], place_m=(5.5, 2.0))
    output = path.with_name('page.htm')
    assert readings_page.main([str(path), '-o', str(output), '--walls', '0', '0', '6', '10']) == 0
    assert capsys.readouterr() == (f'page: {output}\n', '')
    shown(path, '--walls', '0', '0', '5', '10')
    problem = 'outside the walls (x 0 to 5 m, y 0 to 10 m): tag a1: set --walls or --sim-config-file, all in'
    assert problem in capsys.readouterr().err


def test_a_value_that_another_one_hides_is_said(recording, capsys):
    path = recording('readings.sqlite', [400.0])
    (row,) = read_rows(path)
    Store(str(path)).keep([row, row._replace(value=500.0)])
    (tag,) = (each for each in shown(path)['tags'] if each['id'] == 'a1')
    assert tag['values'] == [500.0]
    hidden = 'not shown: 1 value with the stamp, tag and sensor of a later value'
    assert f"readings_page: '{path}': {hidden}" in capsys.readouterr().err.splitlines()


def test_positions_of_another_greenhouse_are_refused(write_layout, recording, capsys):
    path, tag_file = recording('readings.sqlite', [7.0]), write_layout({'a1': (1.0, 2.5)})
    assert readings_page.main([str(path), '--tag-file', tag_file]) == 2
    assert capsys.readouterr().err == (
        f"readings_page: tag 'a1' is at (1, 2) in '{path}', but at (1, 2.5) in {tag_file}: name the"
        ' tag_file of its bridge with --tag-file\n'
    )
    assert readings_page.main([str(path), '--tag-file', write_layout({'a1': (1.0, 2.001)})]) == 0


@pytest.mark.parametrize(
    ('words', 'fault'),
    [
        ('FILE --route ROUTE', "--route 'ROUTE' is not a CSV file of x,y in metres: name another"),
        ('FILE --route tags.json', "--route 'tags.json' is not a CSV file of x,y in metres: name another"),
        ('FILE --route none.csv', "--route 'none.csv': No such file or directory"),
        ('FILE -o .', "--output '.' is a folder: name a file in it"),
        ('FILE -o page.png', "--output 'page.png' is a page: its name must end in .html"),
        ('none.jsonl -o /missing/a.html', "there is no folder '/missing': name a folder"),
        ('FILE -o other.html', "'other.html' exists and is not from this program: name another"),
        ('FILE -o FILE', "--output 'FILE' is the file of FILE itself: name another file"),
        ('FILE -o tags.json --tag-file tags.json', 'is the file of --tag-file itself: name'),
        ('FILE --tag-file FILE', "tag_file 'FILE'"),
        ('FILE --sim-config-file tags.json', "'time' is a required property"),
        ('tags.json', 'is not an observation'),
        ('FILE.csv', "'FILE.csv': line 1 is not an observation (it is not JSON): name a file of record"),
        (
            'REPORT --tag-file tags.json',
            "--tag-file 'tags.json' lacks 2 of the 2 tags in 'REPORT', such as '1': name the",
        ),
        ('config.yml', "'config.yml': No such file or directory: name a file of record_readings"),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_line(
    recording, report, write_layout, tmp_path, capsys, monkeypatch, words, fault
):
    monkeypatch.chdir(tmp_path)
    recording('day.sqlite', [7.0]).rename('FILE')
    report(visit('1', co2=1.0), visit('9', 'TIMEOUT')).rename('REPORT')
    write_layout({'x': (1.0, 2.0)})
    (tmp_path / 'other.html').write_text('<!doctype html>', encoding='utf-8')
    (tmp_path / 'FILE.csv').write_text('stamp_ns,stamp_utc\n1,2\n', encoding='utf-8')
    (tmp_path / 'ROUTE').write_text('x,y\n0,1\nnan,1\n', encoding='utf-8')
    assert readings_page.main(words.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('readings_page: ')
    assert fault in line


def rows_at(times_of_day):
    """Return a row for each second of the wall clock and time of day in the greenhouse."""
    return [Row(s * 10**9, '', '1', 'co2', 1.0, '', None, None, time, '') for s, time in times_of_day]


def test_times_of_several_days_say_so():
    times = [(1, 64_800.0), (2, 3600.0), (3, 50_000.0), (4, 1800.0), (5, 79_200.0)]
    assert greenhouse_times(rows_at(times[:2])) == 'greenhouse 18:00 to 01:00'
    assert greenhouse_times(rows_at(times)) == 'greenhouse 18:00 to 22:00 over at least 3 days'


@pytest.mark.parametrize(
    ('values', 'limits', 'expected'),
    [
        ([5.7, 19.1], (0.0, 30.0), (5.0, 20.0)),
        ([24.0], (0.0, 30.0), (23.6, 24.4)),
        ([0.44, 0.56], (0.2, 0.8), (0.4, 0.6)),
        ([-5.0, 12.0], (0.0, 30.0), (0.0, 15.0)),
        ([31.0, 45.0], (0.0, 30.0), (29.6, 30.0)),
        ([], (0.0, 30.0), (0.0, 30.0)),
        ([3.0, 3.001], None, (2.94, 3.06)),
        ([1e16], None, (1e16 - 6e9, 1e16 + 6e9)),
    ],
)
def test_the_colours_end_at_round_numbers_around_the_values_and_within_the_config(values, limits, expected):
    assert colour_limits(values, limits) == expected


def test_one_sensor_is_shown_if_it_is_wanted(report, capsys):
    path = report(visit('1', co2=600.0, temperature=20.0), visit('5', humidity=50.0))
    data = shown(path, '--sensor', 'humidity', '--sensor', 'co2')
    assert [each['name'] for each in data['sensors']] == ['humidity', 'CO₂']
    assert data['counts'][0][0].startswith('2 of ')
    assert readings_page.main([str(path), '--sensor', 'x']) == 2
    assert "--sensor 'x' is not in FILE, which has temperature, humidity, co2" in capsys.readouterr().err
