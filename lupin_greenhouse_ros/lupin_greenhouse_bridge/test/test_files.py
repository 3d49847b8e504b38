# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Files that the bridge refuses in one line with the fix, and unusual files that it serves."""

import copy
import json
import math
import os
import tracemalloc

import pytest
import yaml
from greenhouse_sim.sensors import CO2Sensor
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning import approach_poses
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation
from lupin_greenhouse_bridge.simulator.config import COMPONENT_DEFAULTS, read_config
from lupin_greenhouse_bridge.simulator.layout import (
    Tag,
    find_layout,
    natural_order,
    read_layout,
    shipped_file,
)

PARAMETERS = ('tag_file', 'sim_config_file')
MISSING = object()
TAGS = {'tags': {'7': {'x': 1.0, 'y': 7.3, 'sensors': ['co2']}}}
ANY_METRES = 'must be a number from -1e+12 to 1e+12 (metres)'
NOT_ASKABLE = 'cannot be sent over ROS: use an id of visible Unicode characters'

# Changes to TAGS by path, and the expected message.
BAD_TAGS = [
    ({'': None}, 'holds null at its top level, not an object of tags'),
    ({'': {'units': 'm', '7': TAGS['tags']['7']}}, "tag 'units' is text, not an object"),
    ({'tags': {}}, 'holds no tags: add at least one'),
    ({'': {'units': 'm', 'tables': {}}}, 'holds no tags: add at least one, such as {"1": {"x": 1.5'),
    ({'tabels': {}}, 'tabels is unknown: did you mean tables?'),
    ({'': {'Tags': TAGS['tags'], 'units': 'm', 'tables': {}}}, 'Tags is unknown: did you mean tags?'),
    ({'tags': []}, "tag 'tags' is a list, not an object"),
    ({'tags/': TAGS['tags']['7']}, f"tag '' {NOT_ASKABLE}"),
    ({'tags/7\0': TAGS['tags']['7']}, f"tag '7\\x00' {NOT_ASKABLE}"),
    ({'tags/\ud83c': TAGS['tags']['7']}, f"tag '\\ud83c' {NOT_ASKABLE}"),
    ({'tags/7/x': 10**400}, f"tag '7': x is 100000000000000000...0000000000000000000: {ANY_METRES}"),
    ({'tags/7/y': True}, f"tag '7': y is True: {ANY_METRES}"),
    ({'tags/7/sensors': 'co2'}, "tag '7': sensors is 'co2': must be a list of names"),
    ({'tags/7/sensors': ['co2', None]}, "tag '7': sensors holds null: must hold names"),
    ({'tags/7/sensors': []}, 'no tag has a sensor: add a sensor to at least one tag'),
    ({'tags/7/sensors': ['CO2']}, "tag '7' has the sensor 'CO2', which"),
]
BAD_TAG_BYTES = [
    (b'', 'is not JSON: it is empty: save it again'),
    (b'tags:\n  "7": {}', 'is not JSON: it does not begin with { or [: name a JSON file'),
    (b'{"7": {"x": 1,5}}', 'is not JSON: a number has a decimal comma: write a point (line 1, column 15)'),
    (b'{\n // my tag\n"7": {}}', 'is not JSON: it has a comment: remove it (line 2, column 2)'),
    (b"{'7': {}}", 'is not JSON: a name or a text has single quotes: write double quotes'),
    (b'{"7": {},}', 'is not JSON: a comma is before a closing bracket: remove it'),
    (b'{"7": {}', 'is not JSON: its end is missing: close every quote and bracket'),
    (b'{"7" {}}', "is not JSON: Expecting ':' delimiter (line 1, column 6)"),
    (b'\xef\xbb\xbf{"7": {"x": 1, "y": 1, "sensors": ["co2"]}}', 'starts with a UTF-8 byte order mark'),
    ('{}'.encode('utf-16'), 'is not UTF-8 text'),
    (b'\x89PNG\r\n\x1a\n\0\0\0\rIHDR', 'is not a text file: name another'),
    (b'SQLite format 3\0\xff', 'is an SQLite file, not a text file: name another'),
    (b'{"7": {"x": ' + b'9' * 5000 + b'}}', 'is not JSON:'),
    (b'{"7": {}, "8": {}, "7": {}}', "'7' appears twice in one object: keep one of them"),
    (b'[' * 20_000, 'is too deeply nested: use at most 4 levels'),
]

CO2 = "sensor 'co2', component 1"
TYPO = 'is unknown: did you mean'
ANY = 'must be a number from -1e+12 to 1e+12'
POSITIVE = 'must be a number from 1e-12 to 1e+12'
HOURS = 'must be a number from 0 to 24 (hours, such as 12.5)'
KNOWN = 'known are co2, humidity, light, soil_moisture, temperature'
# Changes to the shipped config by path, and the expected message.
BAD_CONFIGS = [
    ({'time/debug_mode': 'false'}, "time: debug_mode is 'false': must be true or false"),
    ({'time/debug_seed': True}, 'time: debug_seed is True: must be a whole number'),
    ({'time/debug_mode': True, 'time/debug_seed': MISSING}, 'time: debug_seed is missing: must be a whole'),
    ({'time/debug_time_of_day': 24.000001}, f'time: debug_time_of_day is 24.000001: {HOURS}'),
    ({'time/debug_mode': True, 'time/debug_time_of_day': MISSING}, f'debug_time_of_day is missing: {HOURS}'),
    ({'time/speedup_factor': 0}, f'time: speedup_factor is 0: {POSITIVE}'),
    ({'time/speedup_factor': MISSING}, f'time: speedup_factor is missing: {POSITIVE}'),
    ({'sensors': {}}, 'sensors is empty: name at least one of co2, humidity'),
    ({'sensors/co2': [{'Decay-Type': 'linear'}]}, f'{CO2}: Decay-Type {TYPO} decay_type?'),
    ({'Time': {}, 'time': MISSING}, f'Time {TYPO} time?'),
    ({'time/speed_factor': 5, 'time/speedup_factor': MISSING}, f'time: speed_factor {TYPO} speedup_factor?'),
    ({'visualization': 5}, 'visualization is 5: must be a mapping, such as {greenhouse_width_m: '),
    ({'visualization/greenhouse_width_m': MISSING}, 'visualization: greenhouse_width_m is missing'),
    ({'visualization/greenhouse_height_m': 0}, 'visualization: greenhouse_height_m is 0'),
    ({'visualization/colorbar_ranges': []}, 'colorbar_ranges is a list: must be a mapping, such as {co2'),
    ({'visualization/colorbar_ranges/co2': 5}, 'co2 is 5: must be a mapping, such as {min: '),
    ({'visualization/colorbar_ranges/co2/max': -1}, "'co2': max is -1: must be a number from 300"),
    ({'visualization/colorbar_ranges/co2/min': math.inf}, 'min is inf'),
    ({'sensors/pressure': []}, f"unknown sensor type 'pressure': {KNOWN}"),
    ({'sensors/co2': MISSING}, "has the sensor 'co2', which"),
    ({'sensors/co2': []}, "sensor 'co2' is a list: must be a list with at least one component"),
    ({'sensors/co2': 5}, "sensor 'co2' is a number: must be a list with at least one component"),
    ({'sensors/co2/1': 'x'}, "sensor 'co2', component 2 is text, not a mapping with value_at_midnight"),
    ({'sensors/co2/0/dynamics': 'spiral'}, f"{CO2}: unknown dynamics 'spiral': known are linear, radial"),
    ({'sensors/co2/0/value_at_midnight': 1e308}, f'{CO2}: value_at_midnight is 1e+308: {ANY}'),
    ({'sensors/co2/0/value_at_noon': math.nan}, f'{CO2}: value_at_noon is nan: {ANY}'),
    ({'sensors/co2/0/noise_sigma': -1}, f'{CO2}: noise_sigma is -1: must be a number from 0 to 1e+12'),
    ({'sensors/co2/0/decay_distance': 9e-13}, f'{CO2}: decay_distance is 9e-13: {POSITIVE} (metres)'),
    ({'sensors/co2/0/angle': 'north'}, f"{CO2}: angle is 'north': {ANY} (degrees)"),
    ({'sensors/co2/0/position': 5}, f'{CO2}: position is 5: must be [x, y] in metres'),
    ({'sensors/co2/0/position': ['2', 4]}, f"{CO2}: position: x is '2': {ANY} (metres)"),
]
# Each line has the line before it nine times, or merges it twice.
LISTS = b''.join(b'%c: &%c [%s]\n' % (c, c, b', '.join([b'*%c' % (c - 1)] * 9)) for c in range(98, 107))
MERGES = b''.join(b'%c: &%c {<<: [*%c, *%c]}\n' % (c, c, c - 1, c - 1) for c in range(98, 120))
TOO_MANY = 'holds more than 100000 values after its aliases are expanded: use fewer aliases'
BAD_CONFIG_BYTES = [
    (b'a: &a [x]\n' + LISTS, TOO_MANY),
    (b'a: &a {k: v}\n' + MERGES, TOO_MANY),
    (b'a: &a [*a]', TOO_MANY),
    (b'time:\n  debug_mode: no\n  debug_mode: yes', "'debug_mode' appears twice in the mapping of line 2"),
    (b'', 'time is missing: must be a mapping, such as {debug_mode: false'),
    (b'time:\n\tdebug_mode: true\n', 'is not YAML: ScannerError: line 2 has a tab: write spaces'),
    (b'time: !!int ""\n', 'is not YAML:'),
    (b'time: 2026-11-21\n', 'time is a date: must be a mapping, such as {'),
    (b'2026-11-21 06:00:00\n', 'holds a date at its top level, not a mapping with time and sensors'),
    (b'!!python/object/apply:os.system ["touch was_run"]\n', 'is not YAML: ConstructorError'),
    (b'[' * 500, 'is too deeply nested: use at most 4 levels'),
]
BAD_FILES = [
    *(('tag_file', row, message) for row, message in [*BAD_TAGS, *BAD_TAG_BYTES]),
    *(('sim_config_file', row, message) for row, message in [*BAD_CONFIGS, *BAD_CONFIG_BYTES]),
]

ODD_IDS = ('Tomate №7', '番茄', '🍅', "o'brien", '"7"', ' 7')
GOOD_TAGS = [  # changes to TAGS by path, and the served tags
    ({'': {'tags': {'tags': TAGS['tags']['7']}}}, ['tags']),
    ({'tags/7/colour': 'red', 'tables': {}, 'units': 'm', 'tags/7/sensors': ['co2', 'co2']}, ['7']),
    ({'tags/7/x': 1e12, 'tags/7/y': -1e12}, ['7']),
    ({f'tags/{tag_id}': TAGS['tags']['7'] for tag_id in ODD_IDS}, ['7', *ODD_IDS]),
    (b'{"7":\r\n{"x": 1, "y": 1,\r\n"sensors": ["co2"]}}', ['7']),
]
TABLE = {'x0': 0, 'y0': 0, 'x1': 2, 'y1': 1}
SENSORS = ['temperature', 'humidity', 'co2', 'light', 'soil_moisture']
SMALL_CONFIG = 'time: {debug_mode: false, speedup_factor: 1}\nsensors:\n'
SMALL_CONFIG += ''.join(f'  {name}: [{{}}]\n' for name in SENSORS)
ANCHORS = SMALL_CONFIG.replace('[{}]', '[&lamp {value_at_noon: 1, dynamics: uniform}]', 1)
ANCHORS = ANCHORS.replace('[{}]', '[{<<: *lamp, value_at_noon: 3}, *lamp]')
GOOD_CONFIGS = [
    f'\ufeff{SMALL_CONFIG}'.replace('\n', '\r\n').encode(),
    ANCHORS.encode(),
    {'time/debug_mode': True, 'time/debug_time_of_day': 24, 'time/speedup_factor': MISSING},
    {'time/debug_time_of_day': MISSING, 'time/debug_seed': MISSING},
    {'time/colour': 'red', 'visualization': MISSING, 'notes': ['any']},
    {f'sensors/{each}/0/decay_distance': 1e-12 for each in SENSORS},
    {f'sensors/{each}/0/value_at_noon': 1e12 for each in SENSORS},
    {'sensors/co2': [{}, {'decay_type': 'cubic'}, {'decay_type': 7}] + 9 * [{'noise_sigma': 0}]},
]


def changed(document, row):
    """Return the document with the changes of a row, or the row itself if it is bytes."""
    if isinstance(row, bytes):
        return row
    document = copy.deepcopy(document)
    for place, value in row.items():
        if not place:
            return value
        *way, last = place.split('/')
        at = document
        for key in way:
            at = at[int(key) if isinstance(at, list) else key]
        last = int(last) if isinstance(at, list) else last
        if value is MISSING:
            del at[last]
        else:
            at[last] = value
    return document


@pytest.fixture
def write(tmp_path, shipped_config):
    def written(parameter, row):
        path = tmp_path / 'the  file'
        content = changed(TAGS if parameter == 'tag_file' else shipped_config, row)
        if not isinstance(content, bytes):
            dump = json.dumps if parameter == 'tag_file' else yaml.safe_dump
            content = dump(content).encode()
        path.write_bytes(content)
        return path

    return written


def load(parameter, path):
    """Load with a pathlib.Path, as the simulator needs it, in both trees."""
    return simulation.load(Settings(), **{**dict.fromkeys(PARAMETERS), parameter: path})


def refused(function, *arguments, **keywords) -> str:
    with pytest.raises(StartUpError) as refusal:
        function(*arguments, **keywords)
    return str(refusal.value)


@pytest.mark.parametrize(('parameter', 'row', 'message'), BAD_FILES)
def test_a_bad_file_is_refused_with_its_name_and_the_reason(write, parameter, row, message):
    path = write(parameter, row)
    said = refused(load, parameter, path)
    assert f"{parameter} '{path}'" in said
    assert message in said
    assert said.isprintable()


@pytest.mark.parametrize(('row', 'tag_ids'), GOOD_TAGS)
def test_an_odd_but_good_tag_file_is_served(write, row, tag_ids):
    greenhouse = load('tag_file', write('tag_file', row))
    assert greenhouse.tag_ids == tag_ids
    assert all(simulation.read(greenhouse.sim, tag_id) for tag_id in tag_ids)


@pytest.mark.parametrize('row', GOOD_CONFIGS)
def test_an_odd_but_good_config_is_served_at_every_hour(write, row, shipped_tags):
    greenhouse = load('sim_config_file', write('sim_config_file', row))
    assert greenhouse.tag_ids == list(shipped_tags)
    for hour in (0.0, 5.99, 6.0, 12.0, 18.0, 23.999):
        greenhouse.sim.sim_config['time'].update(debug_mode=True, debug_time_of_day=hour)
        for tag_id in shipped_tags:
            # It raises for a value that is not finite.
            sim_time, values = simulation.read(greenhouse.sim, tag_id)
            assert (sim_time, list(values)) == (pytest.approx(hour * 3600), shipped_tags[tag_id]['sensors'])


def test_keys_that_change_no_value_and_defaults_that_do_are_warned_of(write):
    row = {
        'notes': 'any',
        'sensors/co2': [{'value_at_noon': 600, 'colour': 1}, {'dynamics': 'radial', 'position': [1, 1]}],
        'sensors/light': [{'dynamics': 'linear', 'colour': 2}] * 5,
    }
    path = write('sim_config_file', row)
    ignored, defaults = load('sim_config_file', path).warnings
    assert ignored == f"sim_config_file '{path}': the simulator ignores the keys notes, colour"
    values = 'value_at_midnight 20.0, value_at_noon 25.0, noise_sigma 0.0'
    light = f'{values}, position [0, 0], decay_distance 100.0, decay_type linear, angle 0.0'
    assert defaults == (
        f"sim_config_file '{path}': the simulator takes defaults for missing keys, which may be fine:"
        ' co2 component 1: dynamics uniform, value_at_midnight 20.0, noise_sigma 0.0;'
        f' co2 component 2: {values}, decay_distance 100.0, decay_type linear;'
        f' light component 1: {light}; light component 2: {light}; light component 3: {light} and 2 more'
    )


@pytest.mark.parametrize('dynamics', ['uniform', 'radial', 'linear'])
def test_the_defaults_are_those_of_the_simulator(dynamics):
    given = {'dynamics': dynamics}
    explicit, silent = CO2Sensor(COMPONENT_DEFAULTS | given), CO2Sensor(given)
    for hour in range(24):
        at = (3.0, 4.0), hour * 3600.0
        assert explicit.retrieve_data(*at) == silent.retrieve_data(*at)


def test_a_sensor_that_the_config_lacks_is_refused_by_the_commands_too(write, capsys):
    path = write('tag_file', {'tags/7/sensors': ['CO2']})
    assert approach_poses.main(['approach_poses', '--tag-file', str(path)]) == 2
    fault = f"tag_file '{path}': tag '7' has the sensor 'CO2', which sim_config_file '"
    assert fault in capsys.readouterr().err


@pytest.mark.parametrize('is_nested', [True, False])
def test_tags_with_sensors_come_in_the_order_of_the_file(write, is_nested):
    names = ['soil_moisture', 'light', 'co2', 'humidity', 'temperature']
    bare = {'x': 1, 'y': 1, 'sensors': []}
    tags = {'9': {'x': 1, 'y': 2.5, 'sensors': names}, '8': bare, '7': TAGS['tags']['7'], '6': bare}
    nested = {'tags': tags, 'tables': {'bench': {**TABLE, 'colour': 'green'}}}
    path = write('tag_file', {'': nested if is_nested else tags})
    greenhouse, layout = load('tag_file', path), read_layout(path)
    assert greenhouse.tag_ids == list(layout.tags) == ['9', '7']
    assert list(simulation.read(greenhouse.sim, '9')[1]) == names
    assert greenhouse.warnings == ["2 tags without sensors, treated as unknown: '8', '6'"]
    assert layout.tags['9'] == Tag(1.0, 2.5, names)
    assert layout.tables == ({'bench': (0.0, 0.0, 2.0, 1.0)} if is_nested else {})


def test_a_relative_path_to_a_symlink_of_any_name_is_followed(bridge_here, write, tmp_path, monkeypatch):
    config = write('sim_config_file', {'time/debug_mode': True, 'time/debug_time_of_day': 3.25})
    (tmp_path / 'spaces and ünïcödé.yaml').symlink_to(config)
    monkeypatch.chdir(tmp_path)
    ended = bridge_here(sim_config_file='spaces and ünïcödé.yaml')
    assert ended.code == 0
    assert 'clock frozen at 3.25 h' in ended.err


@pytest.mark.parametrize(
    ('make', 'fragment'),
    [
        (lambda path: path.mkdir(), 'is a folder'),
        (os.mkfifo, 'is not a regular file'),
        (lambda path: path.symlink_to(path), 'cannot be read'),
        (lambda path: path / 'a\0b', r"thing/a\\x00b': cannot be read \(embedded null byte\)"),
    ],
    ids=['folder', 'named pipe', 'symlink to itself', 'name with NUL'],
)
def test_what_is_no_plain_file_is_refused(tmp_path, make, fragment):
    path = tmp_path / 'thing'
    path = make(path) or path
    for parameter in PARAMETERS:
        with pytest.raises(StartUpError, match=f"^{parameter} '{tmp_path}.*{fragment}"):
            load(parameter, path)


@pytest.mark.parametrize(('parameter', 'mebibytes'), [('tag_file', 64), ('sim_config_file', 1)])
def test_a_file_up_to_its_limit_is_read_and_one_byte_more_is_not(write, parameter, mebibytes):
    path = write(parameter, {})
    content = path.read_bytes() + b'\n'
    path.write_bytes(content.ljust(mebibytes * 2**20))
    read = read_layout if parameter == 'tag_file' else read_config
    assert read(path)
    with path.open('ab') as file:
        file.write(b'\n')
    assert refused(read, path).endswith(f'is larger than {mebibytes} MiB: use a smaller file')


LONG = f's: &s "{"x" * 20_000}"\n'


@pytest.mark.parametrize(
    ('key', 'value', 'shown'),
    [
        ('position', f'[{", ".join(["*s"] * 1000)}]', "position is ['xxx"),
        ('dynamics', f'[{", ".join(["*s"] * 1000)}]', "unknown dynamics ['xxx"),
        ('position', f'[0x{"f" * 5000}]', 'position is a list: must be'),
        ('dynamics', f'0x{"f" * 5000}', 'unknown dynamics a number: known'),
    ],
)
def test_a_refused_value_of_any_size_is_shown_in_little_memory(write, key, value, shown):
    """The first ones would be twenty megabytes of text, and Python refuses to print the other two."""
    text = f'{LONG}time: {{debug_mode: false, speedup_factor: 1}}\nsensors: {{co2: [{{{key}: {value}}}]}}'
    path = write('sim_config_file', text.encode())
    tracemalloc.start()
    try:
        assert shown in refused(read_config, path)
        assert tracemalloc.get_traced_memory()[1] < 8e6
    finally:
        tracemalloc.stop()


def test_the_shipped_layout_is_that_of_the_simulator_if_there_is_one(shipped_tags, monkeypatch):
    layout = find_layout('')
    assert list(layout.tags) == list(shipped_tags)
    assert layout.tables
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert shipped_file('tag_locations.json') is None
    assert find_layout('') is None


@pytest.mark.parametrize(
    ('tables', 'fragment'),
    [
        ([], 'tables is a list, not an object, such as {"bench": {"x0": 0'),
        ({'t': 7}, "table 't' is a number, not an object"),
        ({'t': {'x0': 0}}, "table 't': y0 is missing: must be a number"),
    ],
)
def test_a_malformed_table_is_refused_where_the_tables_matter_and_only_there(write, tables, fragment):
    path = write('tag_file', {'tables': tables})
    assert f"tag_file '{path}': {fragment}" in refused(read_layout, path)
    assert list(read_layout(path, has_tables=False).tags) == ['7']


def test_ids_come_in_natural_order():
    ids = ['007', '7', '9', '10', '9' * 5000, 'a', 'b', 'tag_2', 'tag_2b', 'tag_10']
    assert sorted(set(ids), key=natural_order) == ids
