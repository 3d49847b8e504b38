# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Read and validate the simulator's two files, so that the simulator can serve everything in them."""

import importlib.util
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator.json_yaml import (
    kind_of,
    mapping_of,
    number,
    read_json,
    read_yaml,
    shown,
    start_of,
)

Corners = tuple[float, float, float, float]  # x0, y0, x1 and y1 in metres
LARGEST_TAG_FILE_BYTES = 64 * 2**20  # about 500,000 tags
SMALLEST_DIVISOR = 1e-12
TIME_EXAMPLE = '{debug_mode: false, speedup_factor: 1800}'
SENSORS_EXAMPLE = '{co2: [{value_at_midnight: 600, value_at_noon: 400, ...}]}'
TABLE_EXAMPLE = 'such as {"bench": {"x0": 0, "y0": 0, "x1": 2, "y1": 1}}'
TAG_EXAMPLE = 'such as {"1": {"x": 1.5, "y": 7.3, "sensors": ["co2"]}}'
COMPONENT_NUMBERS: dict[str, dict[str, Any]] = {
    'value_at_midnight': {'unit': 'the unit of the sensor'},
    'value_at_noon': {'unit': 'the unit of the sensor'},
    'noise_sigma': {'unit': 'the unit of the sensor', 'smallest': 0.0},
    'decay_distance': {'unit': 'metres', 'smallest': SMALLEST_DIVISOR},
    'angle': {'unit': 'degrees'},
}


def shipped_file(name: str) -> Path | None:
    """Return the path of a file that mdp-greenhouse ships; None if it is not installed."""
    spec = importlib.util.find_spec('greenhouse_sim')  # not imported
    folders = (spec.submodule_search_locations if spec else None) or []
    return next((path for each in folders if (path := Path(each, 'configs', name)).is_file()), None)


def read_tag_file(
    path: str | Path, *, has_tables: bool = True
) -> tuple[dict[str, dict[str, Any]], dict[str, Corners]]:
    """
    Return the tags as id -> {x, y, sensors}, and the tables as name -> (x0, y0, x1, y1) in metres.

    The simulator has two formats for tags. Only the nested one has tables; the simulator does not read them,
    nor does this function without `has_tables`.
    Raises StartUpError if the file, a tag or a table is malformed, or if no tag has a sensor. Does not check
    that the sensors exist.
    """
    where = f"tag_file '{path}'"
    data = read_json(path, where, LARGEST_TAG_FILE_BYTES)
    if not isinstance(data, dict):
        raise StartUpError(f'{where}: holds {kind_of(data)} at its top level, not an object of tags')
    is_nested = isinstance(data.get('tags'), dict)
    tags = data['tags'] if is_nested else data
    if not tags:
        raise StartUpError(f'{where}: holds no tags: add at least one, {TAG_EXAMPLE}')
    for tag_id, tag in tags.items():
        _check_tag(tag_id, tag, where)
    tables = _tables_of(data.get('tables', {}), where) if is_nested and has_tables else {}
    if not any(tag['sensors'] for tag in tags.values()):
        raise StartUpError(f'{where}: no tag has a sensor: add a sensor to at least one tag')
    return tags, tables


def _tables_of(tables: Any, where: str) -> dict[str, Corners]:
    if not isinstance(tables, dict):
        raise StartUpError(f'{where}: tables is {kind_of(tables)}, not an object, {TABLE_EXAMPLE}')
    corners: dict[str, Corners] = {}
    for name, table in tables.items():
        here = f"{where}: table '{escaped(name, 64)}'"
        if not isinstance(table, dict):
            raise StartUpError(f'{here} is {kind_of(table)}, not an object, {TABLE_EXAMPLE}')
        x0, y0, x1, y1 = (float(number(table, key, here, 'metres')) for key in ('x0', 'y0', 'x1', 'y1'))
        corners[name] = x0, y0, x1, y1
    return corners


def _check_tag(tag_id: str, tag: Any, where: str) -> None:
    where = f"{where}: tag '{escaped(tag_id, 64)}'"
    if not tag_id.strip() or '\0' in tag_id or any('\ud800' <= c <= '\udfff' for c in tag_id):
        raise StartUpError(f'{where} cannot be sent over ROS: use an id of visible Unicode characters')
    if not isinstance(tag, dict):
        raise StartUpError(f'{where} is {kind_of(tag)}, not an object, {TAG_EXAMPLE}')
    for key in ('x', 'y'):
        number(tag, key, where, unit='metres')
    sensors = tag.get('sensors')
    if not isinstance(sensors, list):
        problem = f'{where}: sensors is {shown(tag, "sensors")}'
        raise StartUpError(f'{problem}: must be a list of names, such as ["co2"]')
    if no_names := [name for name in sensors if not isinstance(name, str)]:
        raise StartUpError(f'{where}: sensors holds {kind_of(no_names[0])}: must hold names, such as ["co2"]')


def read_config(
    path: str | Path, settings: Settings, sensor_types: Collection[str], dynamics_types: Collection[str]
) -> dict[str, Any]:
    """
    Return the simulator's config, validated for a run with these settings.

    `sensor_types` and `dynamics_types` hold the names that the simulator knows.
    Raises StartUpError if the simulator could not serve the config at every hour of the day.
    """
    where = f"sim_config_file '{path}'"
    config = read_yaml(path, where, 'a mapping with time and sensors')
    _check_time(mapping_of(config, 'time', where, TIME_EXAMPLE), settings, f'{where}: time')
    sensors = mapping_of(config, 'sensors', where, SENSORS_EXAMPLE)
    if not sensors:
        raise StartUpError(f'{where}: sensors is empty: name at least one of {_listed(sensor_types)}')
    for name, components in sensors.items():
        if name not in sensor_types:
            problem = f'{where}: unknown sensor type {start_of(name)}'
            raise StartUpError(f'{problem}: known are {_listed(sensor_types)}')
        if not isinstance(components, list) or not components:
            problem = f'{where}: sensor {name!r} is {kind_of(components)}'
            raise StartUpError(f'{problem}: must be a list with at least one component')
        for position, component in enumerate(components, start=1):
            _check_component(component, dynamics_types, f'{where}: sensor {name!r}, component {position}')
    return config


def _check_time(time: dict[str, Any], settings: Settings, where: str) -> None:
    if not isinstance(time.get('debug_mode'), bool):
        raise StartUpError(f'{where}: debug_mode is {shown(time, "debug_mode")}: must be true or false')
    is_frozen = time['debug_mode'] or settings.debug_time_of_day >= 0.0 or settings.debug_seed >= 0
    if 'debug_time_of_day' in time or (is_frozen and settings.debug_time_of_day < 0.0):
        number(time, 'debug_time_of_day', where, unit='hours', smallest=0.0, largest=24.0)
    if 'speedup_factor' in time or not (is_frozen or settings.speedup_factor > 0.0):
        number(time, 'speedup_factor', where, unit='simulated seconds per second', smallest=SMALLEST_DIVISOR)
    if time['debug_mode'] or 'debug_seed' in time:
        seed = time.get('debug_seed')
        if isinstance(seed, bool) or not isinstance(seed, int):
            raise StartUpError(f'{where}: debug_seed is {shown(time, "debug_seed")}: must be a whole number')


def _check_component(component: Any, dynamics_types: Collection[str], where: str) -> None:
    if not isinstance(component, dict):
        problem = f'{where} is {kind_of(component)}'
        raise StartUpError(f'{problem}, not a mapping with value_at_midnight, value_at_noon, ...')
    # The simulator has a default for every key, so only the keys in the file are checked.
    dynamics = component.get('dynamics', 'uniform')
    if not isinstance(dynamics, str) or dynamics not in dynamics_types:
        problem = f'{where}: unknown dynamics {start_of(dynamics)}'
        raise StartUpError(f'{problem}: known are {_listed(dynamics_types)}')
    for key, limits in COMPONENT_NUMBERS.items():
        if key in component:
            number(component, key, where, **limits)
    position = component.get('position', [0.0, 0.0])
    if not isinstance(position, list) or len(position) != 2:
        raise StartUpError(f'{where}: position is {start_of(position)}: must be [x, y] in metres')
    for axis, value in zip('xy', position, strict=True):
        number({axis: value}, axis, f'{where}: position', unit='metres')


def _listed(names: Iterable[str]) -> str:
    return ', '.join(sorted(names))
