"""Read tag_locations.json: where the tags and tables are. Needs neither the simulator nor ROS."""

import importlib.util
import re
from pathlib import Path
from typing import Any, NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.simulator.json_yaml import kind_of, number, read_json, shown, unknown_keys

LARGEST_FILE_BYTES = 64 * 2**20  # about 500,000 tags
TABLE_EXAMPLE = 'such as {"bench": {"x0": 0, "y0": 0, "x1": 2, "y1": 1}}'
TAG_EXAMPLE = 'such as {"1": {"x": 1.5, "y": 7.3, "sensors": ["co2"]}}'


class Tag(NamedTuple):
    """A tag's position in metres, and its sensors."""

    x: float
    y: float
    sensors: list[str]


class Layout(NamedTuple):
    """The tags and tables of the greenhouse, in metres."""

    tags: dict[str, Tag]  # by id, in the order of the file; only tags with a sensor
    tables: dict[str, tuple[float, float, float, float]]  # name -> (x0, y0, x1, y1)
    tags_without_sensors: tuple[str, ...] = ()  # their ids
    path: str | Path = ''  # of the tag file


def shipped_file(name: str) -> Path | None:
    """Return the path of a file that mdp-greenhouse ships; None if it is not installed."""
    spec = importlib.util.find_spec('greenhouse_sim')  # not imported
    folders = (spec.submodule_search_locations if spec else None) or []
    return next((path for each in folders if (path := Path(each, 'configs', name)).is_file()), None)


def read_layout(path: str | Path, *, has_tables: bool = True) -> Layout:
    """
    Return the layout of a tag file, which has one of the two formats that the simulator reads.

    Only the nested format has tables; the simulator does not read them, nor does this function without
    `has_tables`. Raises StartUpError if the file, a tag or a table is malformed, or if no tag has a sensor.
    Does not check that the sensors exist.
    """
    where = f"tag_file '{path}'"
    data = read_json(path, where, LARGEST_FILE_BYTES)
    if not isinstance(data, dict):
        raise StartUpError(f'{where}: holds {kind_of(data)} at its top level, not an object of tags')
    is_nested = isinstance(data.get('tags'), dict)
    entries = data['tags'] if is_nested else data
    # In the flat format, an object of objects is no tag, but may be a misspelt `tags`.
    groups = data if is_nested else {key: each for key, each in data.items() if _holds_objects(each)}
    unknown_keys(groups, ('tags', 'tables'), where)
    # The simulator's editor saves {"units": "m"} before it has the first tag.
    if not entries or (isinstance(entries.get('units'), str) and entries.keys() <= {'units', 'tables'}):
        raise StartUpError(f'{where}: holds no tags: add at least one, {TAG_EXAMPLE}')
    tags = {tag_id: _tag(tag_id, entry, where) for tag_id, entry in entries.items()}
    tables = _tables(data.get('tables', {}), where) if is_nested and has_tables else {}
    served = {tag_id: tag for tag_id, tag in tags.items() if tag.sensors}
    if not served:
        raise StartUpError(f'{where}: no tag has a sensor: add a sensor to at least one tag')
    return Layout(served, tables, tuple(tag_id for tag_id in tags if tag_id not in served), path)


def _holds_objects(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(each, dict) for each in value.values())


def _tag(tag_id: str, entry: Any, where: str) -> Tag:
    where = f"{where}: tag '{escaped(tag_id, 64)}'"
    if not tag_id.strip() or '\0' in tag_id or any('\ud800' <= c <= '\udfff' for c in tag_id):
        raise StartUpError(f'{where} cannot be sent over ROS: use an id of visible Unicode characters')
    if not isinstance(entry, dict):
        raise StartUpError(f'{where} is {kind_of(entry)}, not an object, {TAG_EXAMPLE}')
    x, y = (float(number(entry, axis, where, 'metres')) for axis in 'xy')
    sensors = entry.get('sensors')
    if not isinstance(sensors, list):
        problem = f'{where}: sensors is {shown(entry, "sensors")}'
        raise StartUpError(f'{problem}: must be a list of names, such as ["co2"]')
    for name in sensors:
        if not isinstance(name, str):
            raise StartUpError(f'{where}: sensors holds {kind_of(name)}: must hold names, such as ["co2"]')
    return Tag(x, y, sensors)


def _tables(tables: Any, where: str) -> dict[str, tuple[float, float, float, float]]:
    if not isinstance(tables, dict):
        raise StartUpError(f'{where}: tables is {kind_of(tables)}, not an object, {TABLE_EXAMPLE}')
    corners = {}
    for name, table in tables.items():
        here = f"{where}: table '{escaped(name, 64)}'"
        if not isinstance(table, dict):
            raise StartUpError(f'{here} is {kind_of(table)}, not an object, {TABLE_EXAMPLE}')
        x0, y0, x1, y1 = (float(number(table, key, here, 'metres')) for key in ('x0', 'y0', 'x1', 'y1'))
        corners[name] = x0, y0, x1, y1
    return corners


def find_layout(tag_file: str) -> Layout | None:
    """Return the layout of tag_file, or of the shipped file for ''; None without it. Raises StartUpError."""
    path = tag_file or shipped_file('tag_locations.json')
    return read_layout(path) if path else None


def require_layout(tag_file: str, setting: str = '--tag-file') -> Layout:
    """Return what find_layout() finds; raises StartUpError, which names this setting, if that is None."""
    if layout := find_layout(tag_file):
        return layout
    raise StartUpError(f"mdp-greenhouse is not installed here: name the bridge's tag file with {setting}")


def find_places(tag_file: str) -> dict[str, tuple[float, float]]:
    """Return x and y in metres by tag id, from the layout that find_layout() finds; raises StartUpError."""
    layout = find_layout(tag_file)
    return {tag_id: (tag.x, tag.y) for tag_id, tag in layout.tags.items()} if layout else {}


def natural_order(tag_id: str) -> tuple[list[tuple[bool, int, str]], str]:
    """Return a sort key for tag ids, such that tag_2 comes before tag_10, and numbers come before words."""
    parts = []
    for digits, text in re.findall('([0-9]+)|([^0-9]+)', tag_id):
        shortened = digits.lstrip('0')  # compared as text of a length: an id may have thousands of digits
        parts.append((bool(text), len(shortened), shortened or text))
    return parts, tag_id
