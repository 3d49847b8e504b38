# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Read tag_locations.json: where the tags and tables are. Needs neither the simulator nor ROS."""

import importlib.util
import re
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.simulator.files import read_json, schema_of, unread_keys, validate

SCHEMA = schema_of('tag_locations')


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
    unread_keys: tuple[str, ...] = ()  # the places of the keys that nothing reads


def shipped_file(name: str) -> Path | None:
    """Return the path of a file that mdp-greenhouse ships; None if it is not installed."""
    spec = importlib.util.find_spec('greenhouse_sim')  # not imported
    return Path(spec.origin).parent / 'configs' / name if spec and spec.origin else None


def read_layout(path: str | Path) -> Layout:
    """
    Return the layout of a tag file in one of the two formats that the simulator reads.

    Only the nested format has tables. Raises StartUpError if the file is malformed, or if no tag has a
    sensor. Does not check that the config has the sensors.
    """
    where = f"tag_file '{path}'"
    data = read_json(path, where)
    validate(data, SCHEMA, where)
    is_nested = isinstance(data.get('tags'), dict)
    tags = {
        tag_id: Tag(float(tag['x']), float(tag['y']), tag['sensors'])
        for tag_id, tag in (data['tags'] if is_nested else data).items()
    }
    tables = {
        name: (float(table['x0']), float(table['y0']), float(table['x1']), float(table['y1']))
        for name, table in (data.get('tables', {}) if is_nested else {}).items()
    }
    served = {tag_id: tag for tag_id, tag in tags.items() if tag.sensors}
    if not served:
        raise StartUpError(f'{where}: no tag has a sensor: add a sensor to at least one tag')
    schema = SCHEMA['then' if is_nested else 'else']
    unread = tuple(unread_keys(data, schema, SCHEMA['definitions']))
    return Layout(served, tables, tuple(tag_id for tag_id in tags if tag_id not in served), path, unread)


def find_layout(tag_file: str) -> Layout | None:
    """Return the layout of tag_file, or of the shipped file for ''; None without it. Raises StartUpError."""
    path = tag_file or shipped_file('tag_locations.json')
    return read_layout(path) if path else None


def require_layout(tag_file: str, setting: str = '--tag-file') -> Layout:
    """Return the layout that find_layout() finds; if there is none, raises StartUpError with this setting."""
    if layout := find_layout(tag_file):
        return layout
    raise StartUpError(f"mdp-greenhouse is not installed here: name the bridge's tag file with {setting}")


def find_places(tag_file: str) -> dict[str, tuple[float, float]]:
    """Return x and y in metres by tag id, from the layout that find_layout() finds; raises StartUpError."""
    layout = find_layout(tag_file)
    return {tag_id: (tag.x, tag.y) for tag_id, tag in layout.tags.items()} if layout else {}


def natural_order(tag_id: str) -> tuple[list[tuple[bool, int, str]], str]:
    """Return a sort key for tag ids: tag_2 comes before tag_10, and numbers come before words."""
    parts = []
    for digits, text in re.findall('([0-9]+)|([^0-9]+)', tag_id):
        shortened = digits.lstrip('0')  # compared as text, because int() refuses thousands of digits
        parts.append((bool(text), len(shortened), shortened or text))
    return parts, tag_id
