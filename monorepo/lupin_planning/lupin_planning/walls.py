"""The walls of the greenhouse, which bound the free space and every drawing. Does not import ROS."""

import argparse
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError, escaped, names_text
from lupin_greenhouse_bridge.runtime.arguments import METRES
from lupin_greenhouse_bridge.runtime.parameters import parameter
from lupin_greenhouse_bridge.simulator.config import SIDES, check_sensors, find_config
from lupin_greenhouse_bridge.simulator.layout import Layout

SOUTH, NORTH, WEST, EAST = -math.pi / 2, math.pi / 2, math.pi, 0.0
MOST_NAMED = 4  # tags or tables in a warning
LARGEST_YAW_RAD = 10.0
MARGIN_M = 1.6  # without a config, the robot can stand 1.5 m in front of every tag


class Walls(NamedTuple):
    """The inner faces of the four walls, in metres in the frame of the layout."""

    x0: float
    y0: float
    x1: float
    y1: float

    def has_inside(self, x: float, y: float) -> bool:
        """Return whether a point is inside the walls, or on one."""
        return self.x0 <= x <= self.x1 and self.y0 <= y <= self.y1

    def distance_ahead_m(self, x: float, y: float, angle: float) -> float:
        """Return the distance from a point to the wall in one of the four directions; below 0 outside."""
        return {EAST: self.x1 - x, WEST: x - self.x0, NORTH: self.y1 - y, SOUTH: y - self.y0}[angle]

    def __str__(self) -> str:
        return f'x {self.x0:g} to {self.x1:g} m, y {self.y0:g} to {self.y1:g} m'


def find_walls(layout: Layout, sim_config_file: str = '', walls: object = None) -> Walls:
    """
    Return these walls if any, else those of the greenhouse config, with a corner at the origin.

    `walls` is what parse_walls() takes. '' selects the config of mdp-greenhouse. If that is not installed, or
    the config has no size, the walls are MARGIN_M from the tags and tables.
    Raises StartUpError if either is malformed, or if the config lacks a sensor of the layout.
    """
    config = find_config(sim_config_file)
    if config:
        check_sensors(layout, config)
    if given := parse_walls(walls):
        return given
    if config and SIDES[0] in config.visualization:
        return Walls(0.0, 0.0, *(float(config.visualization[side]) for side in SIDES))
    return walls_around(layout)


def walls_around(layout: Layout) -> Walls:
    """Return walls that are MARGIN_M from the tags and tables."""
    points = [tag[:2] for tag in layout.tags.values()]
    points += [corner for table in layout.tables.values() for corner in (table[:2], table[2:])]
    xs, ys = zip(*points, strict=True)
    return Walls(min(xs) - MARGIN_M, min(ys) - MARGIN_M, max(xs) + MARGIN_M, max(ys) + MARGIN_M)


def warning_of_outside(layout: Layout, walls: Walls) -> str:
    """Return a warning of the tags and tables outside the walls; '' if there are none."""
    tags = [tag_id for tag_id, tag in layout.tags.items() if not walls.has_inside(tag.x, tag.y)]
    tables = [
        name
        for name, (x0, y0, x1, y1) in layout.tables.items()
        if not (walls.has_inside(x0, y0) and walls.has_inside(x1, y1))
    ]
    outside = [names_text(kind, ids, MOST_NAMED) for kind, ids in (('tag', tags), ('table', tables)) if ids]
    if not outside:
        return ''
    remedy = 'set --walls or --sim-config-file, all in metres'
    return f'outside the walls ({walls}): {", ".join(outside)}: {remedy}'


def parse_walls(value: object) -> Walls | None:
    """Return the walls x0 y0 x1 y1 of a text or an array; None if it is empty. Raises StartUpError."""
    if value is None or (isinstance(value, str) and not value.strip()):
        return None
    walls = parse_numbers(value)
    example = '"0 0 4 8"' if isinstance(value, str) else '0 0 4 8'
    if len(walls) != 4 or not (walls[0] < walls[2] and walls[1] < walls[3]):
        raise StartUpError(
            f'walls is {escaped(repr(value), 100)}: must be x0 y0 x1 y1 in metres, with x0 < x1 and y0 < y1,'
            f' such as {example}'
        )
    return Walls(*walls)


def parse_numbers(value: Any) -> list[float]:
    """Return the numbers of a text such as '0 1' or '[0, 1]', or of an array; [] if one is not finite."""
    words = value.strip(' []').replace(',', ' ').split() if isinstance(value, str) else value
    try:
        numbers = [float(word) for word in (words if isinstance(words, Iterable) else [words])]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []


def parse_pose(value: Any) -> list[float]:
    """Return x, y and yaw of what parse_numbers() takes; [] if it is no pose, or its yaw is in degrees."""
    pose = parse_numbers(value)
    return pose if len(pose) == 3 and abs(pose[2]) <= LARGEST_YAW_RAD else []


def walls_parameter() -> Any:
    """Return the field of a node's settings for the walls, which parse_walls() takes."""
    return parameter(
        '',
        'x0 y0 x1 y1 of the walls in metres, as text or as an array; empty: those of sim_config_file.',
        of_any_type=True,
    )


def add_wall_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that find_walls() takes."""
    parser.add_argument(
        '--sim-config-file', default='', metavar='FILE', help="the bridge's sim_config_file, if you set one"
    )
    parser.add_argument(
        '--walls',
        type=METRES,
        nargs=4,
        metavar=('X0', 'Y0', 'X1', 'Y1'),
        help='the walls in metres, in the layout; default: those of the greenhouse config',
    )
