"""The layout, read as data."""

import json

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_mission.greenhouse_plot import read_visualization
from lupin_mission.layout import Tag, find_layout, read_layout, shipped_file

TAG = {'x': 1, 'y': 2.5, 'sensors': ['co2']}
TABLE = {'x0': 0, 'y0': 0, 'x1': 2, 'y1': 1}
BARE = {**TAG, 'sensors': []}


@pytest.fixture
def tag_file(tmp_path):
    """Return a function that writes a tag file and returns its path."""

    def write(data):
        path = tmp_path / 'tags.json'
        path.write_text(data if isinstance(data, str) else json.dumps(data), encoding='utf-8')
        return str(path)

    return write


@pytest.mark.parametrize('data', [{'9': TAG, '7': TAG}, {'tags': {'9': TAG, '8': BARE, '7': TAG}}])
def test_both_formats_give_the_tags_with_sensors_in_their_order(tag_file, data):
    layout = read_layout(tag_file(data))
    assert list(layout.tags) == ['9', '7']
    assert layout.tags['7'] == Tag(1.0, 2.5, ['co2'])


def test_the_shipped_layout_is_that_of_the_simulator(shipped_tags):
    assert list(find_layout('').tags) == list(shipped_tags)


def test_without_the_simulator_there_is_no_shipped_layout(monkeypatch):
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert shipped_file('tag_locations.json') == ''
    assert find_layout('') is None


def test_the_walls_are_those_of_the_config_or_go_around_everything(tag_file, monkeypatch):
    layout = read_layout(tag_file({'tags': {'7': TAG}, 'tables': {'t': TABLE}}))
    assert read_visualization(layout, shipped_file('greenhouse_config.yaml')).footprint.width_m > 2.0
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert read_visualization(layout) == ((2.0, 2.5), {})


@pytest.mark.parametrize(
    ('data', 'fragment'),
    [
        ('', 'is not a tag_locations.json (JSONDecodeError'),
        ('[' * 100_000, 'is not a tag_locations.json (RecursionError'),
        ('[]', 'is not a tag_locations.json (AttributeError'),
        ({'7': {'x': 1, 'y': 1}}, "is not a tag_locations.json (KeyError: 'sensors'"),
        ({'7': 7}, 'is not a tag_locations.json (TypeError'),
        ({'7': {**TAG, 'x': '1'}}, "'1' is not a number of metres"),
        ({'7': {**TAG, 'x': float('nan')}}, 'nan is not a number of metres'),
        ({'7': BARE}, 'no tag has a sensor'),
    ],
)
def test_a_file_that_is_no_layout_is_refused_in_one_line(tag_file, data, fragment):
    path = tag_file(data)
    with pytest.raises(StartUpError) as refusal:
        read_layout(path)
    assert f"tag_file '{path}'" in str(refusal.value)
    assert fragment in str(refusal.value)


def test_a_missing_file_is_refused():
    with pytest.raises(StartUpError, match=r"tag_file '/missing\.json' cannot be read: No such file"):
        read_layout('/missing.json')
