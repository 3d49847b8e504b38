"""The JSON schemas of the tag file and of the config accept what the bridge reads, and nothing else."""

import importlib.util
import json
import math
import sys
from pathlib import Path

import jsonschema
import pytest
import yaml
from ament_index_python.packages import get_package_share_directory
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.simulator.layout import read_layout, shipped_file

ROOT = Path(__file__).resolve().parents[2]
SCHEMAS = Path(get_package_share_directory('lupin_greenhouse_bridge'), 'schema')


def of_the_bridge_tests():
    """Return the module of the package's tests that has its tables of good and bad tag files."""
    path = ROOT / 'monorepo/lupin_greenhouse_bridge/test/test_files.py'
    spec = importlib.util.spec_from_file_location('tests_of_files', path)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FILES = of_the_bridge_tests()
# What a schema cannot say, such as that max is above min; JSON itself has no NaN.
BEYOND_A_SCHEMA = ('\\ud83c', ' is nan', "', which", 'no tag has a sensor', 'did you mean', 'from 300')
TAG_FILE, CONFIG = (
    jsonschema.Draft7Validator(json.loads((SCHEMAS / name).read_text(encoding='utf-8')))
    for name in ('tag_locations.schema.json', 'greenhouse_config.schema.json')
)
SHIPPED_CONFIG = yaml.safe_load(shipped_file('greenhouse_config.yaml').read_text(encoding='utf-8'))


def sayable(rows):
    """Return the rows of a table of bad files that a schema can refuse."""
    return [row for row, message in rows if not any(each in message for each in BEYOND_A_SCHEMA)]


def test_the_schemas_are_schemas_and_take_the_shipped_files():
    for schema in (TAG_FILE, CONFIG):
        schema.check_schema(schema.schema)
    TAG_FILE.validate(json.loads(shipped_file('tag_locations.json').read_text(encoding='utf-8')))
    CONFIG.validate(SHIPPED_CONFIG)


CASES = [
    *((TAG_FILE, FILES.TAGS, row, False) for row in sayable(FILES.BAD_TAGS)),
    *((TAG_FILE, FILES.TAGS, row, True) for row, _ids in FILES.GOOD_TAGS),
    *((CONFIG, SHIPPED_CONFIG, row, False) for row in sayable(FILES.BAD_CONFIGS)),
    *((CONFIG, SHIPPED_CONFIG, row, True) for row in FILES.GOOD_CONFIGS),
]


@pytest.mark.parametrize(('schema', 'document', 'row', 'is_good'), CASES)
def test_a_schema_accepts_the_good_files_and_refuses_the_bad_ones(schema, document, row, is_good):
    changed = FILES.changed(document, row)
    parse = json.loads if schema is TAG_FILE else yaml.safe_load
    assert schema.is_valid(parse(changed) if isinstance(changed, bytes) else changed) == is_good


WHOLE = {
    'units': 'm',
    'tags': {'7': {'x': 1.0, 'y': 7.3, 'sensors': ['co2']}},
    'tables': {'bench': {'x0': 0, 'y0': 0, 'x1': 2, 'y1': 1}},
}
PLACES = [
    *('tags', 'tables', 'units', 'tags/7', 'tags/7/x', 'tags/7/sensors', 'tags/7/sensors/0', 'tags/7/note'),
    *('tags/ ', 'tags/b', 'tables/bench', 'tables/bench/x0', 'tables/bench/note', 'tables/b'),
]
VALUES = [FILES.MISSING, None, True, 0, -1.5, 1e12, 1.1e12, math.inf, '', 'co2', [], [0], {}]
VALUES += [WHOLE['tags']['7'], WHOLE['tables']['bench'], WHOLE['tags']]


@pytest.mark.parametrize('place', PLACES)
def test_the_schema_accepts_what_is_read_and_nothing_else(tmp_path, place):
    path = tmp_path / 'tag_locations.json'
    for value in VALUES:
        try:
            document = FILES.changed(WHOLE, {place: value})
        except KeyError:  # it is missing already
            continue
        path.write_text(json.dumps(document), encoding='utf-8')
        try:
            read_layout(path)
            is_read = True
        except StartUpError as error:
            is_read = 'no tag has a sensor' in str(error)  # which a schema cannot say
        assert TAG_FILE.is_valid(document) == is_read, value
