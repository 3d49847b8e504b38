# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The layout, read as data with the parser of the bridge."""

import json

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.simulator.files import read_tags, shipped_file
from lupin_greenhouse_bridge.simulator.layout import Tag, find_layout, read_layout, read_tags_with_sensors

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
    assert layout.tables == {}


def test_the_tables_are_their_corners_in_metres(tag_file):
    layout = read_layout(tag_file({'tags': {'7': TAG}, 'tables': {'bench': {**TABLE, 'colour': 'green'}}}))
    assert layout.tables == {'bench': (0.0, 0.0, 2.0, 1.0)}


def test_the_shipped_layout_is_that_of_the_simulator(shipped_tags):
    layout = find_layout('')
    assert list(layout.tags) == list(shipped_tags)
    assert layout.tables


def test_without_the_simulator_there_is_no_shipped_layout(monkeypatch):
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert shipped_file('tag_locations.json') is None
    assert find_layout('') is None


@pytest.mark.parametrize(
    'data', ['', '[' * 100_000, '[]', {'7': {'x': 1, 'y': 1}}, {'7': {**TAG, 'x': '1'}}, '{"7": 1, "7": 2}']
)
def test_the_layout_refuses_what_the_bridge_refuses_in_the_same_words(tag_file, data):
    path = tag_file(data)
    refusals = []
    for read in (read_tags, read_layout, read_tags_with_sensors):
        with pytest.raises(StartUpError) as refusal:
            read(path)
        refusals.append(str(refusal.value))
    assert len(set(refusals)) == 1
    assert f"tag_file '{path}'" in refusals[0]


def test_a_file_without_a_tag_that_has_sensors_is_refused(tag_file):
    with pytest.raises(StartUpError, match='no tag has a sensor: add a sensor to at least one tag'):
        read_layout(tag_file({'7': BARE}))


@pytest.mark.parametrize(
    ('tables', 'fragment'),
    [
        ([], 'tables is a list, not an object, such as {"bench": {"x0": 0'),
        ({'t': 7}, "table 't' is a number, not an object"),
        ({'t': {**TABLE, 'x1': '2'}}, "table 't': x1 is '2': must be a number"),
        ({'t': {'x0': 0}}, "table 't': y0 is missing: must be a number"),
        ({'t': {**TABLE, 'y1': float('nan')}}, "table 't': y1 is nan: must be a number"),
    ],
)
def test_a_malformed_table_is_refused_where_the_tables_matter_and_only_there(tag_file, tables, fragment):
    path = tag_file({'tags': {'7': TAG}, 'tables': tables})
    with pytest.raises(StartUpError) as refusal:
        read_layout(path)
    assert f"tag_file '{path}': {fragment}" in str(refusal.value)
    assert list(read_tags_with_sensors(path)) == ['7']


def test_a_missing_file_is_refused():
    with pytest.raises(StartUpError, match=r"tag_file '/missing\.json': cannot be read \(No such file"):
        read_layout('/missing.json')
