# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Read and validate the simulator's two files, so that the simulator can serve everything in them."""

import datetime
import importlib.util
import json
import math
import os
import reprlib
import stat
from collections import Counter
from pathlib import Path

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.settings import Settings

LARGEST_TAG_FILE_BYTES = 64 * 2**20  # about 500,000 tags
LARGEST_CONFIG_FILE_BYTES = 2**20  # PyYAML takes seconds for a megabyte
LARGEST_CONFIG_VALUES = 100_000  # after its aliases are expanded
# No product of two such numbers overflows, so a finite config cannot give an infinite reading.
LARGEST_NUMBER = 1e12
SMALLEST_DIVISOR = 1e-12


def read_tag_file(path, *, has_tables: bool = True) -> tuple[dict[str, dict], dict[str, tuple]]:
    """
    Return the tags as id -> {x, y, sensors}, and the tables as name -> (x0, y0, x1, y1) in metres.

    The simulator has two formats for tags. Only the nested one has tables; the simulator does not read them,
    nor does this function without `has_tables`.
    Raises StartUpError if the file, a tag or a table is malformed, or if no tag has a sensor. Does not check
    that the sensors exist.
    """
    where = f"tag_file '{path}'"
    data = _parse_json(_read_text(path, where, LARGEST_TAG_FILE_BYTES), where)
    if not isinstance(data, dict):
        raise StartUpError(f'{where}: holds {_kind(data)} at its top level, not an object of tags')
    is_nested = isinstance(data.get('tags'), dict)
    tags = data['tags'] if is_nested else data
    if not tags:
        raise StartUpError(f'{where}: holds no tags: add at least one, {_TAG_EXAMPLE}')
    for tag_id, tag in tags.items():
        _check_tag(tag_id, tag, where)
    tables = _tables_of(data.get('tables', {}), where) if is_nested and has_tables else {}
    if not any(tag['sensors'] for tag in tags.values()):
        raise StartUpError(f'{where}: no tag has a sensor: add a sensor to at least one tag')
    return tags, tables


def _tables_of(tables, where: str) -> dict[str, tuple]:
    if not isinstance(tables, dict):
        raise StartUpError(f'{where}: tables is {_kind(tables)}, not an object, {_TABLE_EXAMPLE}')
    corners = {}
    for name, table in tables.items():
        here = f"{where}: table '{escaped(name, 64)}'"
        if not isinstance(table, dict):
            raise StartUpError(f'{here} is {_kind(table)}, not an object, {_TABLE_EXAMPLE}')
        corners[name] = tuple(float(number(table, key, here, 'metres')) for key in ('x0', 'y0', 'x1', 'y1'))
    return corners


def shipped_file(name: str) -> Path | None:
    """Return the path of a file that mdp-greenhouse ships; None if it is not installed."""
    spec = importlib.util.find_spec('greenhouse_sim')  # not imported
    folders = spec.submodule_search_locations if spec else []
    return next((path for each in folders if (path := Path(each, 'configs', name)).is_file()), None)


def read_config(path, settings: Settings, sensor_types, dynamics_types) -> dict:
    """
    Return the simulator's config, validated for a run with these settings.

    `sensor_types` and `dynamics_types` hold the names that the simulator knows.
    Raises StartUpError if the simulator could not serve the config at every hour of the day.
    """
    where = f"sim_config_file '{path}'"
    config = read_yaml(path, where, 'a mapping with time and sensors')
    _check_time(mapping_of(config, 'time', where, _TIME_EXAMPLE), settings, f'{where}: time')
    sensors = mapping_of(config, 'sensors', where, _SENSORS_EXAMPLE)
    if not sensors:
        raise StartUpError(f'{where}: sensors is empty: name at least one of {_listed(sensor_types)}')
    for name, components in sensors.items():
        if name not in sensor_types:
            shown = _start_of(name)
            raise StartUpError(f'{where}: unknown sensor type {shown}: known are {_listed(sensor_types)}')
        if not isinstance(components, list) or not components:
            raise StartUpError(
                f'{where}: sensor {name!r} is {_kind(components)}: must be a list with at least one component'
            )
        for number, component in enumerate(components, start=1):
            _check_component(component, dynamics_types, f'{where}: sensor {name!r}, component {number}')
    return config


def read_yaml(path, where: str, wanted: str) -> dict:
    """
    Return the mapping in a YAML file, or in a JSON file whose name ends in .json; {} for an empty file.

    Raises a StartUpError that begins with `where` if the file is unreadable, malformed or not `wanted`.
    """
    text = _read_text(path, where, LARGEST_CONFIG_FILE_BYTES)
    # 1e3 is a number in JSON, and text in YAML 1.1.
    data = _parse_json(text, where) if str(path).endswith('.json') else _parse_yaml(text, where)
    if not isinstance(data, (dict, type(None))):
        raise StartUpError(f'{where}: holds {_kind(data)} at its top level, not {wanted}')
    return data or {}


_TIME_EXAMPLE = '{debug_mode: false, speedup_factor: 1800}'
_SENSORS_EXAMPLE = '{co2: [{value_at_midnight: 600, value_at_noon: 400, ...}]}'
_TABLE_EXAMPLE = 'such as {"bench": {"x0": 0, "y0": 0, "x1": 2, "y1": 1}}'
_TAG_EXAMPLE = 'such as {"1": {"x": 1.5, "y": 7.3, "sensors": ["co2"]}}'


def _check_tag(tag_id: str, tag, where: str) -> None:
    where = f"{where}: tag '{escaped(tag_id, 64)}'"
    if not tag_id.strip() or '\0' in tag_id or any('\ud800' <= c <= '\udfff' for c in tag_id):
        raise StartUpError(f'{where} cannot be sent over ROS: use an id of visible Unicode characters')
    if not isinstance(tag, dict):
        raise StartUpError(f'{where} is {_kind(tag)}, not an object, {_TAG_EXAMPLE}')
    for key in ('x', 'y'):
        number(tag, key, where, unit='metres')
    sensors = tag.get('sensors')
    if not isinstance(sensors, list):
        shown = _shown(tag, 'sensors')
        raise StartUpError(f'{where}: sensors is {shown}: must be a list of names, such as ["co2"]')
    if no_names := [name for name in sensors if not isinstance(name, str)]:
        raise StartUpError(f'{where}: sensors holds {_kind(no_names[0])}: must hold names, such as ["co2"]')


def _check_time(time: dict, settings: Settings, where: str) -> None:
    if not isinstance(time.get('debug_mode'), bool):
        raise StartUpError(f'{where}: debug_mode is {_shown(time, "debug_mode")}: must be true or false')
    is_frozen = time['debug_mode'] or settings.debug_time_of_day >= 0.0 or settings.debug_seed >= 0
    if 'debug_time_of_day' in time or (is_frozen and settings.debug_time_of_day < 0.0):
        number(time, 'debug_time_of_day', where, unit='hours', smallest=0.0, largest=24.0)
    if 'speedup_factor' in time or not (is_frozen or settings.speedup_factor > 0.0):
        number(time, 'speedup_factor', where, unit='simulated seconds per second', smallest=SMALLEST_DIVISOR)
    if time['debug_mode'] or 'debug_seed' in time:
        seed = time.get('debug_seed')
        if isinstance(seed, bool) or not isinstance(seed, int):
            raise StartUpError(f'{where}: debug_seed is {_shown(time, "debug_seed")}: must be a whole number')


def _check_component(component, dynamics_types, where: str) -> None:
    if not isinstance(component, dict):
        raise StartUpError(
            f'{where} is {_kind(component)}, not a mapping with value_at_midnight, value_at_noon, ...'
        )
    # The simulator has a default for every key, so only the keys in the file are checked.
    dynamics = component.get('dynamics', 'uniform')
    if not isinstance(dynamics, str) or dynamics not in dynamics_types:
        shown = _start_of(dynamics)
        raise StartUpError(f'{where}: unknown dynamics {shown}: known are {_listed(dynamics_types)}')
    for key, limits in _COMPONENT_NUMBERS.items():
        if key in component:
            number(component, key, where, **limits)
    position = component.get('position', [0.0, 0.0])
    if not isinstance(position, list) or len(position) != 2:
        raise StartUpError(f'{where}: position is {_start_of(position)}: must be [x, y] in metres')
    for axis, value in zip('xy', position, strict=True):
        number({axis: value}, axis, f'{where}: position', unit='metres')


_COMPONENT_NUMBERS = {
    'value_at_midnight': {'unit': 'the unit of the sensor'},
    'value_at_noon': {'unit': 'the unit of the sensor'},
    'noise_sigma': {'unit': 'the unit of the sensor', 'smallest': 0.0},
    'decay_distance': {'unit': 'metres', 'smallest': SMALLEST_DIVISOR},
    'angle': {'unit': 'degrees'},
}


def number(
    mapping: dict, key: str, where: str, unit: str, smallest=-LARGEST_NUMBER, largest=LARGEST_NUMBER
) -> float:
    """Return the value of a key, which must be a number; raises a StartUpError that begins with `where`."""
    value = mapping.get(key)
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not is_number or not smallest <= value <= largest:  # also rejects NaN
        raise StartUpError(
            f'{where}: {key} is {_shown(mapping, key)}:'
            f' must be a number from {smallest:g} to {largest:g} ({unit})'
        )
    return value


def mapping_of(config: dict, key: str, where: str, example: str) -> dict:
    """
    Return the value of a key, which must be a mapping.

    Raises a StartUpError that begins with `where` and shows the example of a good value.
    """
    if not isinstance(config.get(key), dict):
        raise StartUpError(f'{where}: {key} is {_shown(config, key)}: must be a mapping, such as {example}')
    return config[key]


def _shown(mapping: dict, key: str) -> str:
    if key not in mapping:
        return 'missing'
    value = mapping[key]
    if isinstance(value, int) and abs(value) > LARGEST_NUMBER:
        return 'a number of more than 12 digits'  # Python refuses to print thousands of them
    return repr(value)[:60] if isinstance(value, (str, int, float, type(None))) else _kind(value)


def _start_of(value) -> str:
    """Return the start of a value. The whole of it could be gigabytes, after aliases are expanded."""
    try:
        return escaped(reprlib.repr(value), 60)
    except ValueError:  # Python refuses to print thousands of digits
        return _kind(value)


def _kind(value) -> str:
    names = {
        dict: 'an object',
        list: 'a list',
        str: 'text',
        bool: 'true or false',
        type(None): 'null',
        int: 'a number',
        float: 'a number',
        datetime.date: 'a date',
        datetime.datetime: 'a date',
    }
    return names.get(type(value), f'a {type(value).__name__}')


def _listed(names) -> str:
    return ', '.join(sorted(names))


def _read_text(path, where: str, largest_bytes: int) -> str:
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISDIR(mode):
            raise StartUpError(f'{where}: is a folder: set the path of a file')
        if not stat.S_ISREG(mode):
            raise StartUpError(f'{where}: is not a regular file: set the path of a file')
        with open(path, 'rb') as file:
            content = file.read(largest_bytes + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise StartUpError(
            f'{where}: cannot be read ({reason}) in the folder {os.getcwd()}: set an absolute path'
            ' (~ is not expanded)'
        ) from error
    if len(content) > largest_bytes:
        raise StartUpError(f'{where}: is larger than {largest_bytes // 2**20} MiB: use a smaller file')
    try:
        return content.decode('utf-8')
    except UnicodeDecodeError as error:
        raise StartUpError(f'{where}: is not UTF-8 text ({error}): save it as UTF-8') from error


def _parse_json(text: str, where: str):
    if text.startswith('\ufeff'):
        raise StartUpError(f'{where}: starts with a UTF-8 byte order mark: save it as UTF-8 without BOM')

    def without_duplicates(pairs):
        unique = dict(pairs)
        if len(unique) < len(pairs):
            twice = Counter(key for key, _ in pairs).most_common(1)[0][0]
            raise StartUpError(f'{where}: {twice!r} appears twice in one object: keep one of them')
        return unique

    try:
        return json.loads(text, object_pairs_hook=without_duplicates)
    except RecursionError as error:
        raise StartUpError(f'{where}: is too deeply nested: use at most 4 levels') from error
    except ValueError as error:
        raise StartUpError(f'{where}: is not JSON: {error}') from error


def _parse_yaml(text: str, where: str):
    import yaml  # mdp-greenhouse brings it; start-up reports a missing mdp-greenhouse first

    try:
        loader = yaml.SafeLoader(text)
        document = loader.get_single_node()
        if document is None:
            return None
        sizes: dict[int, float] = {}
        if _written_out(document, sizes, where) > LARGEST_CONFIG_VALUES:
            raise StartUpError(
                f'{where}: holds more than {LARGEST_CONFIG_VALUES} values after its aliases are expanded:'
                ' use fewer aliases, and none inside its own anchor'
            )
        return loader.construct_document(document)
    except StartUpError:
        raise
    except RecursionError as error:
        raise StartUpError(f'{where}: is too deeply nested: use at most 4 levels') from error
    except Exception as error:  # PyYAML's constructors leak KeyError, IndexError and others on bad scalars
        raise StartUpError(f'{where}: is not YAML: {type(error).__name__}: {error}') from error


def _written_out(node, sizes: dict[int, float], where: str) -> float:
    """Return how many values a node has with its aliases expanded: infinite if it holds itself."""
    if id(node) not in sizes:
        sizes[id(node)] = math.inf
        children = node.value if isinstance(node.value, list) else []  # a scalar holds a string
        if node.id == 'mapping':
            keys = Counter(key.value for key, _ in children if key.id == 'scalar' and key.value != '<<')
            for key, count in keys.items():
                if count > 1:
                    line = node.start_mark.line + 1
                    raise StartUpError(
                        f'{where}: {escaped(repr(key), 60)} appears twice in the mapping of line {line}:'
                        ' keep one of them'
                    )
            children = [part for pair in children for part in pair]
        sizes[id(node)] = 1 + sum(_written_out(child, sizes, where) for child in children)
    return sizes[id(node)]
