"""Files that the bridge refuses in one line with the fix, and unusual files that it serves."""

import copy
import json
import math

import pytest
import yaml
from greenhouse_sim.sensors import CO2Sensor
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation
from lupin_greenhouse_bridge.simulator.config import SCHEMA
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

# Changes to TAGS by path, and what the message must name: the place, or the reason where there is no place.
BAD_TAGS = [
    ({'': None}, 'None is not of type'),
    ({'': {'units': 'm', '7': TAGS['tags']['7']}}, ': units: '),
    ({'tags': {}}, ': tags: {} '),
    ({'': {'tables': {}}}, ': tables: '),
    ({'tags': []}, ': tags: [] is not of type'),
    ({'tags/': TAGS['tags']['7']}, ": tags: '' does not match"),
    ({'tags/7\0': TAGS['tags']['7']}, ": tags: '7\\x00' does not match"),
    ({'tags/\ud83c': TAGS['tags']['7']}, ": tags: '\\ud83c' does not match"),
    ({'tags/7/x': 10**400}, ': tags.7.x: '),
    ({'tags/7/x': '1'}, ": tags.7.x: '1' is not of type 'number'"),
    ({'tags/7/y': True}, ': tags.7.y: True'),
    ({'tags/7/y': math.nan}, ': tags.7.y: nan'),
    ({'tags/7/x': MISSING}, ": tags.7: 'x' is a required property"),
    ({'tags/7/sensors': 'co2'}, ': tags.7.sensors: '),
    ({'tags/7/sensors': ['co2', None]}, ': tags.7.sensors.1: None'),
    ({'tags/7/sensors': []}, 'no tag has a sensor'),
    ({'tags/7/sensors': ['CO2']}, "tag '7' has the sensor 'CO2', which"),
    ({'tables': []}, ': tables: []'),
    ({'tables': {'bench': 7}}, ': tables.bench: 7'),
    ({'tables': {'bench': {'x0': 0}}}, ": tables.bench: 'y0' is a required property"),
]
BAD_TAG_BYTES = [
    (b'', 'is not JSON'),
    (b'tags:\n  "7": {}', 'is not JSON'),
    (b'{"7": {"x": 1,5}}', 'line 1 column 15'),
    (b'{"7": {}', 'is not JSON'),
    (b'\xef\xbb\xbf{"7": {"x": 1, "y": 1, "sensors": ["co2"]}}', 'is not JSON: Unexpected UTF-8 BOM'),
    ('{}'.encode('utf-16'), "cannot be read ('utf-8' codec"),
    (b'{"7": {"x": ' + b'9' * 5000 + b'}}', 'is not JSON'),
    (b'{"7": {}, "8": {}, "7": {}}', "'7' appears twice in one object"),
    (b'[' * 20_000, 'is not JSON'),
]

CO2 = ': sensors.co2.0.'
# Changes to the shipped config by path, and what the message must name.
BAD_CONFIGS = [
    ({'time/debug_mode': 'false'}, ": time.debug_mode: 'false'"),
    ({'time/debug_seed': True}, ': time.debug_seed: True'),
    ({'time/debug_mode': True, 'time/debug_seed': MISSING}, "time: 'debug_seed' is a required property"),
    ({'time/debug_mode': True, 'time/debug_time_of_day': MISSING}, "time: 'debug_time_of_day' is a required"),
    ({'time/debug_time_of_day': 24.000001}, ': time.debug_time_of_day: 24.000001'),
    ({'time/speedup_factor': 0}, ': time.speedup_factor: 0'),
    ({'time/speedup_factor': MISSING}, "time: 'speedup_factor' is a required property"),
    ({'time': MISSING}, "'time' is a required property"),
    ({'sensors': {}}, ': sensors: {}'),
    ({'visualization': 5}, ': visualization: 5'),
    ({'visualization/greenhouse_width_m': MISSING}, ": visualization: 'greenhouse_width_m' is a dependency"),
    ({'visualization/greenhouse_height_m': 0}, ': visualization.greenhouse_height_m: 0'),
    ({'visualization/colorbar_ranges': []}, ': visualization.colorbar_ranges: []'),
    ({'visualization/colorbar_ranges/co2': 5}, ': visualization.colorbar_ranges.co2: 5'),
    ({'visualization/colorbar_ranges/co2/max': -1}, 'visualization.colorbar_ranges.co2: max is below min'),
    ({'visualization/colorbar_ranges/co2/min': math.inf}, ': visualization.colorbar_ranges.co2.min: inf'),
    ({'sensors/pressure': []}, ": sensors: 'pressure' is not one of"),
    ({'sensors/co2': MISSING}, "has the sensor 'co2', which"),
    ({'sensors/co2': []}, ': sensors.co2: []'),
    ({'sensors/co2': 5}, ': sensors.co2: 5'),
    ({'sensors/co2/1': 'x'}, ": sensors.co2.1: 'x'"),
    ({'sensors/co2/0/dynamics': 'spiral'}, f"{CO2}dynamics: 'spiral'"),
    ({'sensors/co2/0/value_at_midnight': 1e308}, f'{CO2}value_at_midnight: 1e+308'),
    ({'sensors/co2/0/value_at_noon': math.nan}, f'{CO2}value_at_noon: nan'),
    ({'sensors/co2/0/noise_sigma': -1}, f'{CO2}noise_sigma: -1'),
    ({'sensors/co2/0/decay_distance': 0}, f'{CO2}decay_distance: 0'),
    ({'sensors/co2/0/angle': 'north'}, f"{CO2}angle: 'north'"),
    ({'sensors/co2/0/position': 5}, f'{CO2}position: 5'),
    ({'sensors/co2/0/position': [2]}, f'{CO2}position: [2]'),
    ({'sensors/co2/0/position': ['2', 4]}, f"{CO2}position.0: '2'"),
]
BAD_CONFIG_BYTES = [
    (b'a: &a [*a]', "'time' is a required property"),
    (b'', "'time' is a required property"),
    (b'time:\n\tdebug_mode: true\n', 'line 2'),
    (b'time: !!int ""\n', 'is not YAML'),
    (b'time: 2026-11-21\nsensors: {co2: [{}]}', ': time: '),
    (b'2026-11-21 06:00:00\n', 'must be a mapping with time and sensors'),
    (b'!!python/object/apply:os.system ["touch was_run"]\n', 'is not YAML: ConstructorError'),
    (b'[' * 500, 'is not YAML'),
    (b'time: {debug_mode: 0x' + b'f' * 5000 + b'}\nsensors: {}', ''),  # Python refuses to print it
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
    {f'sensors/{name}/0/decay_distance': 1e-12 for name in SENSORS},
    {f'sensors/{name}/0/value_at_noon': 1e12 for name in SENSORS},
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


def test_keys_that_nothing_reads_are_named_in_one_warning_for_each_file(write):
    config = write('sim_config_file', {'notes': 'any', 'sensors/co2': [{'colour': 1}], 'time/speed': 2})
    (warning,) = load('sim_config_file', config).warnings
    assert f"sim_config_file '{config}'" in warning
    for place in ('notes', 'sensors.co2.0.colour', 'time.speed'):
        assert place in warning
    tags = write('tag_file', {'benches': {}, 'tags/7/colour': 'red', 'units': 'm'})
    (warning,) = load('tag_file', tags).warnings
    assert warning == f"tag_file '{tags}': unknown and ignored: keys tags.7.colour and benches"


DEFAULTS = {key: value['default'] for key, value in SCHEMA['definitions']['component']['properties'].items()}


@pytest.mark.parametrize('dynamics', ['uniform', 'radial', 'linear'])
def test_the_defaults_are_those_of_the_simulator(dynamics):
    """At the point where it is not 0, so that the default position counts, and far from it."""
    given = {'dynamics': dynamics}
    explicit, silent = CO2Sensor(DEFAULTS | given), CO2Sensor(given)
    for hour in range(24):
        for place in ((0.0, 0.0), (3.0, 4.0), (60.0, 80.0)):
            at = place, hour * 3600.0
            assert explicit.retrieve_data(*at) == silent.retrieve_data(*at)


@pytest.mark.parametrize('given', [{'debug_seed': 0, 'debug_time_of_day': 0.0}, {'speedup_factor': 1e-9}])
def test_a_parameter_makes_its_key_in_the_config_unnecessary(write, given):
    """A seed and an hour of 0 are given, too."""
    time = {'time': {'debug_mode': False}}
    path = write('sim_config_file', time)
    assert simulation.load(Settings(**given), None, path).tag_ids
    assert 'speedup_factor' in refused(load, 'sim_config_file', path)


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
    (*_, warning) = greenhouse.warnings
    assert 'tags 8 and 6' in warning
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
        (lambda path: path.mkdir(), 'Is a directory'),
        (lambda path: path.symlink_to(path), 'symbolic links'),
        (lambda path: path / 'a\0b', 'embedded null byte'),
    ],
    ids=['folder', 'symlink to itself', 'name with NUL'],
)
def test_what_is_no_plain_file_is_refused(tmp_path, make, fragment):
    path = tmp_path / 'thing'
    path = make(path) or path
    for parameter in PARAMETERS:
        with pytest.raises(StartUpError, match=f"^{parameter} '{tmp_path}.*cannot be read .*{fragment}"):
            load(parameter, path)


def test_the_shipped_layout_is_that_of_the_simulator_if_there_is_one(shipped_tags, monkeypatch):
    layout = find_layout('')
    assert list(layout.tags) == list(shipped_tags)
    assert layout.tables
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert shipped_file('tag_locations.json') is None
    assert find_layout('') is None


def test_ids_come_in_natural_order():
    ids = ['007', '7', '9', '10', '9' * 5000, 'a', 'b', 'tag_2', 'tag_2b', 'tag_10']
    assert sorted(set(ids), key=natural_order) == ids
