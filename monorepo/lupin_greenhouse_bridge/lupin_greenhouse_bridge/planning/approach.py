# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Compute the approach poses, from which the robot's camera sees a tag. Does not import ROS."""

import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.free_space import FreeSpace, VisibilityGraph
from lupin_greenhouse_bridge.planning.tag_poses import TagPose
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.files import number, read_yaml
from lupin_greenhouse_bridge.simulator.layout import Layout

STEP_M = 0.02
STEP_RAD = math.radians(1.5)


class ApproachPose(NamedTuple):
    """A pose of the robot in the layout's frame, with its +x axis towards the centre of the tag."""

    x: float  # metres
    y: float
    yaw: float  # radians to the x axis
    distance_m: float  # the standoff: from the robot to the tag
    angle_rad: float  # the incidence angle: between the line of sight and the normal of the tag


@dataclass(frozen=True)
class ViewingLimits:
    """The limits of an approach pose. Raises StartUpError for values that allow none."""

    robot_radius_m: float = 0.20
    smallest_standoff_m: float = 0.3  # from the robot to the tag
    largest_standoff_m: float = 1.0
    preferred_standoff_m: float = 0.5
    largest_angle_rad: float = math.pi / 4  # of incidence
    clearance_m: float = 0.005  # between the robot and what it must not touch

    def __post_init__(self):
        if not 0.0 < self.smallest_standoff_m <= self.preferred_standoff_m <= self.largest_standoff_m < 1e3:
            raise StartUpError(
                f'the standoffs are {self.smallest_standoff_m:g}, {self.preferred_standoff_m:g} and'
                f' {self.largest_standoff_m:g} m: must be above 0, and the smallest, the preferred and the'
                ' largest in this order'
            )
        if not 0.0 <= self.largest_angle_rad < math.pi / 2:
            degrees = math.degrees(self.largest_angle_rad)
            raise StartUpError(
                f'the largest incidence angle is {degrees:g} degrees: must be from 0 to below 90'
            )
        if not (self.robot_radius_m >= 0.0 and self.clearance_m >= 0.0):
            raise StartUpError(
                f'the radius of the robot is {self.robot_radius_m:g} m and its clearance'
                f' {self.clearance_m:g} m: must not be below 0'
            )


class Override(NamedTuple):
    """The values that a team sets by hand for one tag, in the layout's frame; None is computed."""

    yaw: float | None = None  # of the robot, in radians
    standoff: float | None = None  # metres to the tag
    goal_x: float | None = None
    goal_y: float | None = None


class Approaches(NamedTuple):
    """The approach poses and the reasons of the other tags, by tag id in the order of the layout."""

    poses: dict[str, ApproachPose]
    unreachable: dict[str, str]
    free_space: FreeSpace


def find_approaches(
    layout: Layout,
    walls: Walls,
    limits: ViewingLimits,
    *,
    start_m: tuple[float, float] | None = None,
    overrides: Mapping[str, Override] | None = None,
) -> Approaches:
    """
    Return an approach pose for each tag that the robot can look at.

    Each pose is free, and connected to the start; without a start, to the largest part of the free space.
    Among such poses the one nearest to the preferred standoff wins, then the one with the smallest incidence
    angle. Raises StartUpError for a start that is not free, or if no point is free.
    """
    free_space = FreeSpace(layout, walls, limits.robot_radius_m, limits.clearance_m)
    if start_m is None:
        start_m, origin = free_space.point_of_largest_region(), 'the rest of the free space'
    else:
        origin = f'the start at ({start_m[0]:g}, {start_m[1]:g})'
    if not free_space.is_free(*start_m):
        raise StartUpError(
            f'{origin} is not free for a robot of radius {limits.robot_radius_m:g} m: choose another'
        )
    region = _Region(free_space, start_m)
    poses, unreachable = {}, {}
    for tag_id, tag in free_space.tag_poses.items():
        if not walls.has_inside(tag.x, tag.y):
            unreachable[tag_id] = f'outside the walls ({walls}): set walls, or sim_config_file'
            continue
        override = (overrides or {}).get(tag_id, Override())
        has_free_pose = False
        for candidates in _candidates(tag, limits, override):
            is_free = free_space.are_free([each[:2] for each in candidates])
            has_free_pose |= bool(is_free.any())
            if pose := region.first(list(itertools.compress(candidates, is_free))):
                poses[tag_id] = pose
                break
        else:
            unreachable[tag_id] = f'cut off from {origin}' if has_free_pose else _no_place(limits, override)
    return Approaches(poses, unreachable, free_space)


def _no_place(limits: ViewingLimits, override: Override) -> str:
    robot = f'no place for a robot of radius {limits.robot_radius_m:g} m'
    if override != Override():
        return f'{robot} where the overrides set the pose'
    return f'{robot} within {limits.largest_standoff_m:g} m and {math.degrees(limits.largest_angle_rad):g}°'


def _candidates(tag: TagPose, limits: ViewingLimits, override: Override):
    """Yield lists of poses, the best first."""
    preferred_m = limits.preferred_standoff_m
    standoffs_m = [
        preferred_m,
        *_steps(preferred_m, limits.smallest_standoff_m, STEP_M),
        *_steps(preferred_m, limits.largest_standoff_m, STEP_M),
    ]
    standoffs_m.sort(key=lambda each: round(abs(each - preferred_m), 9))
    one_side = _steps(0.0, limits.largest_angle_rad, STEP_RAD)
    angles = [0.0, *(sign * angle for angle in one_side for sign in (1, -1))]
    if override.standoff is not None:
        standoffs_m = [override.standoff]
    if override.yaw is not None:
        angles = [override.yaw + math.pi - tag.facing]
    if override.goal_x is not None or override.goal_y is not None:
        standoffs_m, angles = standoffs_m[:1], angles[:1]
    for some_m in (standoffs_m[:1], standoffs_m[1:]):  # most tags need no more than the first
        yield [
            _pose(tag, standoff_m, tag.facing + angle, override) for standoff_m in some_m for angle in angles
        ]


def _steps(start: float, end: float, step: float) -> list[float]:
    """Return the values from a start, which is left out, to an end, which is not."""
    count = math.ceil(round(abs(end - start) / step, 6))
    return [start + math.copysign(n * step, end - start) for n in range(1, count)] + [end] * bool(count)


def _pose(tag: TagPose, standoff_m: float, direction: float, override: Override) -> ApproachPose:
    """Return the pose at this standoff and in this direction from a tag, or where the override sets it."""
    x = tag.x + standoff_m * math.cos(direction) if override.goal_x is None else override.goal_x
    y = tag.y + standoff_m * math.sin(direction) if override.goal_y is None else override.goal_y
    sight = math.atan2(tag.y - y, tag.x - x)
    return ApproachPose(
        x,
        y,
        sight if override.yaw is None else math.remainder(override.yaw, math.tau),
        math.hypot(tag.x - x, tag.y - y),
        abs(math.remainder(sight + math.pi - tag.facing, math.tau)),
    )


class _Region:
    """The part of the free space that is connected to a point."""

    def __init__(self, free_space: FreeSpace, start_m: tuple[float, float]):
        start = np.array([start_m], dtype=float)
        self._free_space = free_space
        # Each point of the region has one of these in sight.
        self._marks = np.concatenate([start, VisibilityGraph(free_space, start).corners_from(0)])

    def first(self, poses: list[ApproachPose]) -> ApproachPose | None:
        """Return the first of some free poses that is in the region; None if none is."""
        left = poses
        while left:
            point = left[0][:2]
            if self._holds(point):
                return left[0]
            in_sight = self._free_space.are_in_sight(point, [each[:2] for each in left])  # of itself too
            left = list(itertools.compress(left, ~in_sight))
        return None

    def _holds(self, point) -> bool:
        nearest_first = np.argsort(np.linalg.norm(self._marks - point, axis=1), kind='stable')
        some, others = np.split(self._marks[nearest_first], [8])
        return bool(
            self._free_space.are_in_sight(point, some).any()
            or self._free_space.are_in_sight(point, others).any()
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
    found, warnings = {}, []
    for tag_id, values in overrides.items():
        here = f"{where}: tag '{escaped(str(tag_id), 64)}'"
        _check_mapping(values, _LIMITS, path, here, 'overrides', tag_id)
        override = Override(**{key: float(number(values, key, here, **_LIMITS[key])) for key in values or {}})
        if str(tag_id) in layout_ids:
            found[str(tag_id)] = override
        else:
            warnings.append(f'{here} is not in the layout: its override has no effect')
    return found, warnings


def _check_mapping(data, keys: Collection[str] | None, path: str | Path, where: str, *parents) -> None:
    """Raise StartUpError for anything but a mapping with these keys; None is an empty mapping."""
    if data is not None and not isinstance(data, dict):
        raise StartUpError(f'{where}: is not a mapping, {_EXAMPLE}')
    for key in data or {}:
        if keys is not None and key not in keys:
            raise StartUpError(
                f"{where}: line {_line_of(path, *parents, key)}: unknown key '{escaped(str(key), 64)}':"
                f' use {", ".join(keys)}'
            )


def _line_of(path: str | Path, *keys) -> int:
    """Return the line number, in a YAML file, of the last of these keys, each in the one before."""
    import yaml  # imported here: read_yaml has found it

    # JSON may be indented with tabs, YAML may not.
    node = yaml.compose(Path(path).read_text(encoding='utf-8').replace('\t', ' '))
    line = 1
    for key in keys:
        for name, value in node.value:
            if name.value == str(key):
                line, node = name.start_mark.line + 1, value
                break
    return line
