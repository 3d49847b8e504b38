"""Read the layout of the greenhouse as data, without the simulator. Does not import ROS."""

import importlib.util
import json
import math
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError, printable


class Tag(NamedTuple):
    """A tag's position in metres, and its sensors."""

    x: float
    y: float
    sensors: list[str]


class Layout(NamedTuple):
    """The tags and tables of the greenhouse, in metres."""

    tags: dict[str, Tag]  # by id, in the order of the file; only tags with a sensor
    tables: dict[str, tuple[float, float, float, float]]  # name -> (x0, y0, x1, y1)


def read_layout(tag_file: str) -> Layout:
    """
    Return the layout of a tag_locations.json; raises StartUpError.

    Reads both of the simulator's formats. The bridge validates a tag file; this function only reads it.
    """
    where = f"tag_file '{printable(tag_file, 500)}'"
    try:
        data = json.loads(Path(tag_file).read_text(encoding='utf-8'))
        is_nested = isinstance(data.get('tags'), dict)
        tags = {
            tag_id: Tag(_metres(tag['x']), _metres(tag['y']), list(tag['sensors']))
            for tag_id, tag in (data['tags'] if is_nested else data).items()
            if tag['sensors']
        }
        tables = {
            name: tuple(_metres(table[key]) for key in ('x0', 'y0', 'x1', 'y1'))
            for name, table in (data.get('tables', {}) if is_nested else {}).items()
        }
    except OSError as error:
        raise StartUpError(f'{where} cannot be read: {error.strerror}: name a tag_locations.json') from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise StartUpError(
            f'{where} is not a tag_locations.json ({type(error).__name__}: {error}):'
            ' name the file that the bridge loads'
        ) from error
    if not tags:
        raise StartUpError(f'{where}: no tag has a sensor: name the file that the bridge loads')
    return Layout(tags, tables)


def _metres(value) -> float:
    metres = float(value)
    if isinstance(value, (str, bool)) or not math.isfinite(metres):
        raise ValueError(f'{value!r} is not a number of metres')
    return metres


def shipped_file(name: str) -> str:
    """Return the path of a file that mdp-greenhouse ships; '' if it is not installed."""
    spec = importlib.util.find_spec('greenhouse_sim')  # not imported
    folders = spec.submodule_search_locations if spec else []
    return next((str(path) for each in folders if (path := Path(each, 'configs', name)).is_file()), '')


def find_layout(tag_file: str) -> Layout | None:
    """Return the layout of tag_file, or of the shipped file for ''; None without either."""
    path = tag_file or shipped_file('tag_locations.json')
    return read_layout(path) if path else None
