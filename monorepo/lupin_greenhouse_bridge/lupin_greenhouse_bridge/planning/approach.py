# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Where the robot stands to look at a tag: the approach poses. Does not import ROS."""

import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.free_space import FreeSpace, VisibilityGraph
from lupin_greenhouse_bridge.planning.tag_poses import TagPose, find_tag_poses
from lupin_greenhouse_bridge.simulator.files import number, read_yaml
from lupin_greenhouse_bridge.simulator.layout import Layout

STEP_M = 0.02
STEP_RAD = math.radians(1.5)


class ApproachPose(NamedTuple):
    """A pose of the robot in the layout's frame, with its +x axis towards the centre of the tag."""

    x: float  # metres
    y: float
    yaw: float  # radians to the x axis
    distance_m: float  # to the tag
    angle_rad: float  # between the line of sight and the normal of the tag


@dataclass(frozen=True)
class ViewingLimits:
    """How a robot can stand to look at a tag. Raises StartUpError for values that allow no pose."""

    robot_radius_m: float = 0.20
    smallest_distance_m: float = 0.3
    largest_distance_m: float = 1.0
    preferred_distance_m: float = 0.5
    largest_angle_rad: float = math.pi / 4
    clearance_m: float = 0.005  # between the robot and what it must not touch

    def __post_init__(self):
        if not 0.0 < self.smallest_distance_m <= self.preferred_distance_m <= self.largest_distance_m < 1e3:
            raise StartUpError(
                f'the distances to a tag are {self.smallest_distance_m:g}, {self.preferred_distance_m:g} and'
                f' {self.largest_distance_m:g} m: must be above 0, and the smallest, the preferred and the'
                ' largest in this order'
            )
        if not 0.0 <= self.largest_angle_rad < math.pi / 2:
            degrees = math.degrees(self.largest_angle_rad)
            raise StartUpError(
                f'the largest angle to the normal of a tag is {degrees:g} degrees: must be from 0 to below 90'
            )
        if not (self.robot_radius_m >= 0.0 and self.clearance_m >= 0.0):
            raise StartUpError(
                f'the radius of the robot is {self.robot_radius_m:g} m and its clearance'
                f' {self.clearance_m:g} m: must not be below 0'
            )


class Override(NamedTuple):
    """What a team has set by hand for one tag, in the layout's frame; None is computed."""

    yaw: float | None = None  # of the robot, in radians
    standoff: float | None = None  # metres to the tag
    goal_x: float | None = None
    goal_y: float | None = None


class Approaches(NamedTuple):
    """The approach poses by tag id in the order of the layout, and why each other tag has none."""

    poses: dict[str, ApproachPose]
    unreachable: dict[str, str]


def find_approaches(
    layout: Layout,
    reach: ViewingLimits,
    *,
    start_m: tuple[float, float] | None = None,
    overrides: Mapping[str, Override] | None = None,
) -> Approaches:
    """
    Return an approach pose for each tag that the robot can look at.

    A pose is free, and the robot can drive there from the start, or without a start from outside the tables.
    Among such poses the one nearest to the preferred distance wins, then the one with the smallest angle.
    Raises StartUpError for a start that is not free, or a layout without a floor for this robot.
    """
    floor = FreeSpace(layout, reach.robot_radius_m + reach.clearance_m)
    if start_m is not None and not floor.is_free(*start_m):
        raise StartUpError(
            f'the start at ({start_m[0]:g}, {start_m[1]:g}) is not free for a robot of radius'
            f' {reach.robot_radius_m:.2f} m: choose another'
        )
    region = _Region(floor, floor.outermost() if start_m is None else start_m)
    since = 'the rest of the floor' if start_m is None else f'the start at ({start_m[0]:g}, {start_m[1]:g})'
    poses, unreachable = {}, {}
    for tag_id, tag in find_tag_poses(layout).items():
        override = (overrides or {}).get(tag_id, Override())
        has_place = False
        for candidates in _candidates(tag, reach, override):
            free = list(itertools.compress(candidates, floor.are_free([each[:2] for each in candidates])))
            has_place |= bool(free)
            if pose := region.first(free):
                poses[tag_id] = pose
                break
        else:
            unreachable[tag_id] = f'cut off from {since}' if has_place else _no_place(reach, override)
    return Approaches(poses, unreachable)


def _no_place(reach: ViewingLimits, override: Override) -> str:
    robot = f'no place for a robot of radius {reach.robot_radius_m:.2f} m'
    if override != Override():
        return f'{robot} where the overrides set the pose'
    return f'{robot} within {reach.largest_distance_m:g} m and {math.degrees(reach.largest_angle_rad):g}°'


def _candidates(tag: TagPose, reach: ViewingLimits, override: Override):
    """Yield lists of poses, the best first."""
    distances_m = [reach.preferred_distance_m]
    distances_m += _steps(reach.preferred_distance_m, reach.smallest_distance_m, STEP_M)
    distances_m += _steps(reach.preferred_distance_m, reach.largest_distance_m, STEP_M)
    distances_m.sort(key=lambda each: round(abs(each - reach.preferred_distance_m), 9))
    left = _steps(0.0, reach.largest_angle_rad, STEP_RAD)
    angles = [0.0, *(turn * angle for angle in left for turn in (1, -1))]
    if override.standoff is not None:
        distances_m = [override.standoff]
    if override.yaw is not None:
        angles = [override.yaw + math.pi - tag.facing]
    if override.goal_x is not None or override.goal_y is not None:
        distances_m, angles = distances_m[:1], angles[:1]
    for some_m in (distances_m[:1], distances_m[1:]):  # most tags need no more than the first
        yield [
            _pose(tag, distance_m, tag.facing + angle, override) for distance_m in some_m for angle in angles
        ]


def _steps(start: float, end: float, step: float) -> list[float]:
    """Return the values from a start, which is left out, to an end, which is not."""
    count = math.ceil(round(abs(end - start) / step, 6))
    return [start + math.copysign(n * step, end - start) for n in range(1, count)] + [end] * bool(count)


def _pose(tag: TagPose, distance_m: float, direction: float, override: Override) -> ApproachPose:
    """Return the pose at this distance and in this direction from a tag, or where the override sets it."""
    x = tag.x + distance_m * math.cos(direction) if override.goal_x is None else override.goal_x
    y = tag.y + distance_m * math.sin(direction) if override.goal_y is None else override.goal_y
    sight = math.atan2(tag.y - y, tag.x - x)
    return ApproachPose(
        x,
        y,
        sight if override.yaw is None else math.remainder(override.yaw, math.tau),
        math.hypot(tag.x - x, tag.y - y),
        abs(math.remainder(sight + math.pi - tag.facing, math.tau)),
    )


class _Region:
    """The part of the floor that the robot can drive to from a point."""

    def __init__(self, floor: FreeSpace, start_m: tuple[float, float]):
        start = np.array([start_m], dtype=float)
        self._floor = floor
        self._marks = np.concatenate(
            [start, VisibilityGraph(floor, start).corners_from(0)]
        )  # any other point sees one

    def first(self, poses: list[ApproachPose]) -> ApproachPose | None:
        """Return the first of some free poses that the robot can drive to; None if it cannot to any."""
        left = poses
        while left:
            point = left[0][:2]
            if self._holds(point):
                return left[0]
            in_sight = self._floor.are_in_sight(point, [each[:2] for each in left])  # itself too
            left = list(itertools.compress(left, ~in_sight))
        return None

    def _holds(self, point) -> bool:
        nearest_first = np.argsort(np.linalg.norm(self._marks - point, axis=1), kind='stable')
        some, others = np.split(self._marks[nearest_first], [8])
        return bool(
            self._floor.are_in_sight(point, some).any() or self._floor.are_in_sight(point, others).any()
        )


_EXAMPLE = 'such as {overrides: {"7": {yaw: 1.57, standoff: 0.4}}}'
_LIMITS = {
    'yaw': {'unit': 'radians', 'smallest': -10.0, 'largest': 10.0},
    'standoff': {'unit': 'metres', 'smallest': 0.2, 'largest': 1.5},
    'goal_x': {'unit': 'metres'},
    'goal_y': {'unit': 'metres'},
}


def read_overrides(path: str | Path, layout_ids: Collection[str]) -> tuple[dict[str, Override], list[str]]:
    """
    Return the overrides of an approach_overrides.yaml by tag id, and a warning for each unknown id.

    Raises StartUpError if the file is malformed.
    """
    where = f"approach overrides '{escaped(str(path), 500)}'"
    data = read_yaml(path, where, 'it has three levels')
    _check_mapping(data, ('overrides',), path, where)
    overrides = {} if data is None or data.get('overrides') is None else data['overrides']
    _check_mapping(overrides, None, path, where)
    found = {}
    for tag_id, values in overrides.items():
        here = f"{where}: tag '{escaped(str(tag_id), 64)}'"
        _check_mapping(values, _LIMITS, path, here)
        found[str(tag_id)] = Override(
            **{key: float(number(values, key, here, **_LIMITS[key])) for key in values or {}}
        )
    strangers = [tag_id for tag_id in found if tag_id not in layout_ids]
    return {tag_id: each for tag_id, each in found.items() if tag_id in layout_ids}, [
        f"{where}: tag '{escaped(tag_id, 64)}' is not in the layout: its override has no effect"
        for tag_id in strangers
    ]


def _check_mapping(data, keys: Collection[str] | None, path: str | Path, where: str) -> None:
    """Raise StartUpError for anything but a mapping with these keys; nothing at all is an empty mapping."""
    if data is not None and not isinstance(data, dict):
        raise StartUpError(f'{where}: is not a mapping, {_EXAMPLE}')
    for key in data or {}:
        if keys is not None and key not in keys:
            raise StartUpError(
                f"{where}: line {_line_of(path, key)}: unknown key '{escaped(str(key), 64)}':"
                f' use {", ".join(keys)}'
            )


def _line_of(path: str | Path, key) -> int:
    """Return the number of the first line of a YAML file that has this key."""
    import yaml  # imported here: read_yaml has found it

    def keys(node):
        if node.id == 'mapping':
            for name, value in node.value:
                yield name
                yield from keys(value)

    text = (
        Path(path).read_text(encoding='utf-8').replace('\t', ' ')
    )  # JSON may be indented with tabs, YAML may not
    lines = {name.value: name.start_mark.line + 1 for name in reversed([*keys(yaml.compose(text))])}
    return lines.get(str(key), 1)
