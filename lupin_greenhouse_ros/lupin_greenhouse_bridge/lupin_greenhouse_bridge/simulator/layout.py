# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Read the layout of the greenhouse as data, without the simulator. Does not import ROS."""

import re
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.simulator.files import read_tag_file, shipped_file


class Tag(NamedTuple):
    """A tag's position in metres, and its sensors."""

    x: float
    y: float
    sensors: list[str]


class Layout(NamedTuple):
    """The tags and tables of the greenhouse, in metres."""

    tags: dict[str, Tag]  # by id, in the order of the file; only tags with a sensor
    tables: dict[str, tuple[float, float, float, float]]  # name -> (x0, y0, x1, y1)


def read_layout(tag_file: str | Path, *, has_tables: bool = True) -> Layout:
    """Return the layout of a tag_locations.json, as read_tag_file() reads it; raises StartUpError."""
    tags, tables = read_tag_file(tag_file, has_tables=has_tables)
    served = {tag_id: tag for tag_id, tag in tags.items() if tag['sensors']}
    return Layout(
        {each: Tag(float(tag['x']), float(tag['y']), tag['sensors']) for each, tag in served.items()}, tables
    )


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
        number = digits.lstrip('0')  # compared as text of a length: an id may have thousands of digits
        parts.append((bool(text), len(number), number or text))
    return parts, tag_id
