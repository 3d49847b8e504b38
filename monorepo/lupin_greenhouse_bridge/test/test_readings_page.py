# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
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
from conftest import START_S, visit, write_report
from lupin_greenhouse_bridge.display import placing, readings_page
from lupin_greenhouse_bridge.display.drawing_command import MOST_SENSORS, Recording
from lupin_greenhouse_bridge.planning.walls import find_walls
from lupin_greenhouse_bridge.recording.rows import Row, utc_of
from lupin_greenhouse_bridge.recording.store import open_store
from lupin_greenhouse_bridge.simulator.layout import find_layout
from lupin_greenhouse_bridge.units import name_of

EVIL = '</script><script>alert(1)</script>'


@pytest.fixture
def report(tmp_path):
    return lambda *visits: write_report(tmp_path / 'report.jsonl', *visits)


@pytest.fixture
def recording(tmp_path):
    """Return a function that keeps these values of one sensor, a second apart, as SQLite or CSV."""

    def write(name, values, sensor='ph', place_m=(1.0, 2.0)):
        path = tmp_path / name
        store = open_store(str(path))
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
    (data,) = data_in(path.with_suffix('.html'))['files']
    return data


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
    assert data['unused_numbers'] == ('There is no tag 8.' if '30' in shipped_tags else '')
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
    path, report_path = recording('day.csv', [7.0]), report(visit('1', co2=1.0))
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert [tag['id'] for tag in shown(path)['tags']] == ['a1']
    assert readings_page.main([str(report_path)]) == 2
    assert 'mdp-greenhouse is not installed here: name' in capsys.readouterr().err


def test_a_recording_shows_its_own_places_and_no_unit_for_an_unknown_sensor(recording):
    data = shown(recording('day.csv', [7.0, 6.5]))
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
    recording = Recording(Path('day'), 'day', rows, [], layout, find_walls(layout), [], {})
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
    assert len(readings_page.fill([recording], limits)) < 5e6


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
    assert capsys.readouterr().err == f"readings_page: '{path}': holds no readings: there is no page\n"
    assert not path.with_suffix('.html').exists()


def test_the_greenhouse_beside_a_report_is_its_own(report, tmp_path, shipped_config, write_layout):
    Path(write_layout({'7': (0.5, 1.5)})).rename(tmp_path / 'report-tag_locations.json')
    room = shipped_config['visualization'] | {'greenhouse_width_m': 3.0, 'greenhouse_height_m': 2.0}
    config = json.dumps(shipped_config | {'visualization': room})
    (tmp_path / 'report-greenhouse_config.yaml').write_text(config, encoding='utf-8')
    (tmp_path / 'report-route.csv').write_text('x,y\n0.5,0\n0.5,3\n0.5,3\n0.5,0\n', encoding='utf-8')
    data = shown(report(visit('7', co2=600.0)))
    assert data['stops'] == [[0.5, 3]]
    # Out and back on one line: each way is on its right, and the two arrows do not cover each other.
    assert {(0.5, 1.5, 0.5, 0), (0.5, 1.5, -0.5, 0)} <= set(map(tuple, data['route']))
    (_, y_out, *out), (_, y_back, *back) = data['arrows']
    assert (out, back) == ([1.571, 0.5, 0], [-1.571, -0.5, 0])
    assert abs(y_out - y_back) > placing.ARROW_M
    assert [(tag['id'], tag['x'], tag['y']) for tag in data['tags']] == [('7', 0.5, 1.5)]
    hours = [(n % 4000 / 1000, n // 4000) for n in range(40_000)]  # recorded ten times a second
    assert len(placing.lanes_of(hours)) <= 2 * placing.MOST_STEPS + 2
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
    path = recording('readings.csv', [400.0])
    (row,) = path.read_text(encoding='utf-8').splitlines()[1:]
    with path.open('a', encoding='utf-8') as file:
        file.write(f'{row}\n{row.replace("400", "500")}\n')  # the same row is no other value
    (tag,) = (each for each in shown(path)['tags'] if each['id'] == 'a1')
    assert tag['values'] == [500.0]
    hidden = '1 value with the stamp, tag and sensor of another value: the last one is shown'
    assert f'readings_page: {path}: {hidden}' in capsys.readouterr().err.splitlines()


def test_positions_of_another_greenhouse_are_refused(write_layout, recording, capsys):
    path, tag_file = recording('readings.sqlite', [7.0]), write_layout({'a1': (1.0, 2.5)})
    assert readings_page.main([str(path), '--tag-file', tag_file]) == 2
    assert capsys.readouterr().err == (
        f"readings_page: '{path}': tag 'a1' is at (1, 2) in it, and at (1, 2.5) in {tag_file}: name the"
        ' tag_file of its bridge with --tag-file, and compare only files of one greenhouse\n'
    )
    assert readings_page.main([str(path), str(path)]) == 2
    assert capsys.readouterr().err == f"readings_page: '{path}' is named twice: name each file once\n"
    assert readings_page.main([str(path), '--tag-file', write_layout({'a1': (1.0, 2.001)})]) == 0


def test_several_files_are_compared_by_tag_and_sensor(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    one = {'1': {'co2': 600.0}, '5': {'co2': 500.0, 'temperature': 20.0}, '9': {'co2': 700.0}}
    two = {'1': {'co2': 610.0}, '5': {'co2': 800.0, 'temperature': 20.5}}
    three = {'1': {'co2': 602.0}, '5': {'co2': 510.0}}
    paths = [tmp_path / f'team{number}/mission.jsonl' for number in (1, 2, 3)]  # of the same name
    for path, values in zip(paths, (one, two, three), strict=True):
        path.parent.mkdir()
        write_report(path, *(visit(tag_id, **by_sensor) for tag_id, by_sensor in values.items()))
    assert readings_page.main([str(each) for each in paths]) == 0
    data = data_in(tmp_path / 'comparison.html')
    assert [each['title'] for each in data['files']] == [f'team{n}/mission.jsonl' for n in (1, 2, 3)]
    keys = ('tag', 'sensor', 'farthest', 'difference')
    found = [(*map(each.get, keys), [text for text, _ in each['cells']]) for each in data['differences']]
    assert found == [
        ('5', 'temperature (°C)', None, '0.5', ['20.0', '20.5', 'none']),
        ('5', 'CO₂ (ppm)', 1, '300', ['500', '800', '510']),  # 290 from the median, 510; 500 is 10 from it
        ('1', 'CO₂ (ppm)', 1, '10', ['600', '610', '602']),
    ]
    assert {time for each in data['differences'] for _, time in each['cells']} == {'12:00', ''}
    limits = [each['limits'] for file in data['files'] for each in file['sensors'] if each['name'] == 'CO₂']
    assert limits == [limits[0]] * 3
    low, high = limits[0]
    assert low <= 500.0
    assert high >= 800.0


def test_more_sensors_than_a_person_can_look_at_are_refused_with_the_choice(report, capsys):
    values = {f's{number}': float(number) for number in range(MOST_SENSORS + 1)}
    path = report(visit('1', **values), visit('5', co2=1.0))
    assert readings_page.main([str(path)]) == 2
    error = f'{MOST_SENSORS + 2} sensors are too many to look at: choose up to {MOST_SENSORS} with --sensor'
    assert capsys.readouterr().err.startswith(f'readings_page: {error}, from co2, s0, s1, ')
    data = shown(path, '--sensor', 's3', '--sensor', 's1')
    assert [each['name'] for each in data['sensors']] == ['s1', 's3']
    assert data['counts'][0][0].startswith('2 of ')  # a tag without the chosen sensors was read, too
    assert readings_page.main([str(path), '--sensor', 'x']) == 2
    error = capsys.readouterr().err
    assert "--sensor 'x': no FILE has it: choose from co2, s0" in error
    assert 'repeat' not in error
    assert readings_page.main([str(path), '--sensor', 'co2,s1']) == 2
    assert capsys.readouterr().err.endswith(', and repeat --sensor for each\n')


@pytest.mark.parametrize(
    ('value', 'place_m', 'fault'),
    [
        (1e300, (1.0, 2.0), 'has value 1e+300, x_m 1.0 and y_m 2.0'),
        (7.0, (1e300, 2.0), 'has value 7, x_m 1e+300 and y_m 2.0'),
        (7.0, (1.0, -2e12), 'has value 7, x_m 1.0 and y_m -2000000000000.0'),
    ],
)
def test_a_number_that_is_too_large_to_draw_is_refused_with_its_row(recording, capsys, value, place_m, fault):
    path = recording('day.csv', [7.0, value], place_m=place_m)
    assert readings_page.main([str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"'{path}': the row of ph of tag 'a1' at 2026-11-20T15:53:2" in line
    assert line.endswith(f'{fault}: values must be within 1e+20, and positions within 1e+12 m, of 0')


@pytest.mark.parametrize(
    ('words', 'fault'),
    [
        ('FILE --walls 0 0 1e300 8', 'the walls are x 0 to 1e+300 m'),
        ('FILE --route ROUTE', "--route 'ROUTE': is not a CSV file of x,y in metres: name another"),
        ('FILE --route tags.json', "--route 'tags.json': is not a CSV file of x,y in metres: name another"),
        ('FILE --route none.csv', "--route 'none.csv': cannot be read (No such"),
        ('FILE FILE --route ROUTE', "--route 'ROUTE' is for one FILE: name one FILE only"),
        ('FILE -o .', "--output '.' is a folder: name a file in it"),
        ('FILE -o page.png', "--output 'page.png' is a page: its name must end in .html"),
        ('none.jsonl -o /missing/a.html', "there is no folder '/missing': name a folder"),
        ('FILE tag_file:=my.json', "'tag_file:=my.json' is no file of readings: write options such as"),
        ('FILE -o other.html', "'other.html' exists and is not from this program: name another"),
        ('FILE -o FILE', "--output 'FILE' is the file of FILE itself: name another file"),
        ('FILE -o tags.json --tag-file tags.json', 'is the file of --tag-file itself: name'),
        ('FILE --tag-file FILE', 'is not JSON'),
        ('FILE --sim-config-file tags.json', 'time is missing'),
        ('FILE tags.json', ': name a tag file with --tag-file'),
        ('REPORT --tag-file tags.json', "2 of the file's 2 tags are not in it, such as '1': name the"),
        ('config.yml', "'config.yml': No such file or directory: name a file of record_readings"),
        ('/', "'/': not a regular file"),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_line(
    recording, report, write_layout, tmp_path, capsys, monkeypatch, words, fault
):
    monkeypatch.chdir(tmp_path)
    recording('day.csv', [7.0]).rename('FILE')
    report(visit('1', co2=1.0), visit('9', 'TIMEOUT')).rename('REPORT')
    write_layout({'x': (1.0, 2.0)})
    (tmp_path / 'other.html').write_text('<!doctype html>', encoding='utf-8')
    (tmp_path / 'ROUTE').write_text('x,y\n0,1\n1e300,-1e300\n', encoding='utf-8')
    assert readings_page.main(words.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('readings_page: ')
    assert fault in line
