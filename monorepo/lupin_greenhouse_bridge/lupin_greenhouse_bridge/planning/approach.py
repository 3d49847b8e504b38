# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Compute the approach poses, from which the robot's camera sees a tag. Does not import ROS."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.free_space import FreeSpace
from lupin_greenhouse_bridge.planning.occupancy import OccupancyMap
from lupin_greenhouse_bridge.planning.overrides import Override
from lupin_greenhouse_bridge.planning.surroundings import AllSurroundings
from lupin_greenhouse_bridge.planning.tag_poses import TagPose, tables_of
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

STEP_M = 0.02
STEP_RAD = math.radians(1.5)
SMALLEST_ROOM_M = 0.01  # beyond the robot's radius, as the footprint_padding of Nav2
FIRST = 64  # poses that are tried before all others
TIGHT_M = 0.02  # with less room, a steeper view is better
SAME_M = 1e-9
# Another pose of a tag shows it from elsewhere.
OTHER_M, OTHER_RAD = 0.2, math.radians(20.0)


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
    steepest_angle_rad: float = math.pi / 3  # of incidence, where the others leave less room than TIGHT_M
    clearance_m: float = 0.05  # beyond the radius; where there is less, the roomiest pose counts
    arrival_tolerance_m: float = 0.06  # how far from its pose the robot may arrive
    arrival_tolerance_rad: float = 0.15
    camera_offset_m: float = 0.0  # of the camera, ahead of the robot's centre

    def __post_init__(self):
        if not 0.0 < self.smallest_standoff_m <= self.preferred_standoff_m <= self.largest_standoff_m < 1e3:
            raise StartUpError(
                f'the standoffs are {self.smallest_standoff_m:g}, {self.preferred_standoff_m:g} and'
                f' {self.largest_standoff_m:g} m: must be above 0, and the smallest, the preferred and the'
                ' largest in this order'
            )
        for name, angle_rad in (('largest', self.largest_angle_rad), ('steepest', self.steepest_angle_rad)):
            if not 0.0 <= angle_rad < math.pi / 2:
                degrees = math.degrees(angle_rad)
                raise StartUpError(
                    f'the {name} incidence angle is {degrees:g} degrees: must be from 0 to below 90'
                )
        if not (self.robot_radius_m >= 0.0 and self.clearance_m >= 0.0):
            raise StartUpError(
                f'the radius of the robot is {self.robot_radius_m:g} m and its clearance'
                f' {self.clearance_m:g} m: must not be below 0'
            )
        if not (self.arrival_tolerance_m >= 0.0 and self.arrival_tolerance_rad >= 0.0):
            raise StartUpError(
                f'the arrival tolerances are {self.arrival_tolerance_m:g} m and'
                f' {self.arrival_tolerance_rad:g} rad: must not be below 0'
            )
        if not abs(self.camera_offset_m) < self.smallest_standoff_m:
            raise StartUpError(
                f"the camera is {self.camera_offset_m:g} m ahead of the robot's centre: must be less than"
                f' the smallest standoff, which is {self.smallest_standoff_m:g} m'
            )

    @property
    def steepest_rad(self) -> float:
        """The largest incidence angle where there is little room."""
        return max(self.largest_angle_rad, self.steepest_angle_rad)

    @property
    def smallest_room_m(self) -> float:
        """The room beyond the radius that each pose and each path has."""
        return min(SMALLEST_ROOM_M, self.clearance_m)


@dataclass(frozen=True)
class Approaches:
    """The approach poses and the reasons of the other tags, by tag id in the order of the layout."""

    free_space: FreeSpace
    poses: dict[str, ApproachPose] = field(default_factory=dict)
    alternatives: dict[str, list[ApproachPose]] = field(default_factory=dict)  # to each pose, the best first
    room_warnings: dict[str, str] = field(default_factory=dict)  # of poses with less room than the clearance
    unreachable: dict[str, str] = field(default_factory=dict)


def find_approaches(  # noqa: PLR0913 - the options are passed by name
    layout: Layout,
    walls: Walls,
    limits: ViewingLimits,
    *,
    start_m: tuple[float, float] | None = None,
    overrides: Mapping[str, Override] | None = None,
    most_per_tag: int = 1,
    occupancy: OccupancyMap | None = None,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> Approaches:
    """
    Return an approach pose for each tag that the robot can look at.

    Each pose is free, has the whole tag in view, and is connected to the start; without a start, to the
    largest part of the free space. Those with the clearance win, then those with view and room after an
    arrival beside the pose, then the one nearest to the preferred standoff, then the one with the smallest
    incidence angle. Without that room, the roomiest pose wins.
    With more than one pose per tag, the next best ones that are at least OTHER_M or OTHER_RAD from each
    before are its alternatives; where an override sets the pose, there is none.
    A map, in the frame of the layout, leaves only the poses from which it is free by the radius and the
    clearance. The free space, and with it the paths, does not know it.
    `progress` is told what is done, how much of it, and of how much.
    Raises StartUpError for a start that is not free, if no point is free, or for a map of another place.
    """
    free_space = FreeSpace(layout, walls, limits.robot_radius_m, limits.smallest_room_m)
    if start_m is None:
        start_m, origin = free_space.point_of_largest_region(), 'the rest of the free space'
    else:
        origin = f'the start at ({start_m[0]:g}, {start_m[1]:g})'
    if not free_space.is_free(*start_m):
        raise StartUpError(
            f'{origin} is not free for a robot of radius {limits.robot_radius_m:g} m: choose another'
        )
    tags = np.array(list(free_space.tag_poses.values()))
    before_tags = tags[:, :2] + limits.preferred_standoff_m * _directions(tags[:, 2])
    if occupancy is not None:
        _check_place_of(occupancy, before_tags, walls)
    region = _Region(free_space, start_m, before_tags)
    search = _Search(layout, walls, limits, free_space, region, occupancy)
    found = Approaches(free_space)
    for count, (tag_id, tag) in enumerate(free_space.tag_poses.items()):
        progress('tags with a pose', count, len(free_space.tag_poses))
        if not walls.has_inside(tag.x, tag.y):
            found.unreachable[tag_id] = f'outside the walls ({walls}): set walls, or sim_config_file'
            continue
        override = (overrides or {}).get(tag_id, Override())
        trial = search.best(tag_id, tag, override)
        if trial.pose is None:
            found.unreachable[tag_id] = trial.reason(origin, limits, override)
            continue
        found.poses[tag_id] = trial.pose
        found.alternatives[tag_id] = (
            search.others(tag_id, tag, override, trial.pose, most_per_tag) if most_per_tag > 1 else []
        )
        if trial.room_m < limits.clearance_m - SAME_M:
            found.room_warnings[tag_id] = (
                f"tag '{escaped(tag_id, 64)}': its pose has {trial.room_m:.3f} m of room beyond the robot's"
                f' radius, less than the clearance of {limits.clearance_m:g} m'
            )
    return found


def _check_place_of(occupancy: OccupancyMap, places: np.ndarray, walls: Walls) -> None:
    """Raise StartUpError if the map holds fewer than half of the places (tags, 2) before the tags."""
    count = int(occupancy.have_inside(places).sum())
    if 2 * count < len(places):
        map_extent, greenhouse = (
            Walls(*(round(each, 2) + 0.0 for each in extent)) for extent in (occupancy.extent, walls)
        )
        raise StartUpError(
            f'the map holds only {count} of the {len(places)} places before the tags: it reaches from'
            f' {map_extent}, and the greenhouse from {greenhouse}, both in the frame of the layout: find'
            ' where the layout lies in this map with register_layout'
        )


@dataclass
class _Trial:
    """What the search for a pose of one tag found."""

    pose: ApproachPose | None = None
    room_m: float = 0.0
    has_place: bool = False  # some pose is free
    has_view: bool = False  # some free pose has the tag in view
    is_in_map: bool = False  # the map is free at one of these
    map_gap_m: float = -1.0  # where the map leaves most room
    is_map_unknown: bool = False  # what is nearest there

    def reason(self, origin: str, limits: ViewingLimits, override: Override) -> str:
        """Return why a tag has no pose; the origin is where the robot starts."""
        if self.is_in_map:
            return f'cut off from {origin}'
        if self.has_view:
            kind = 'is unknown' if self.is_map_unknown else 'has an obstacle'
            return (
                f'the map {kind} {self.map_gap_m:.2f} m from every pose, and the robot needs'
                f' {limits.robot_radius_m + limits.clearance_m:g} m'
            )
        if self.has_place:
            return 'tables or other tags hide it wherever the robot has a place'
        robot = f'no place for a robot of radius {limits.robot_radius_m:g} m'
        if override != Override():
            return f'{robot} where the overrides set the pose'
        return f'{robot} within {limits.largest_standoff_m:g} m and {math.degrees(limits.steepest_rad):g}°'


class _Search:
    """Looks for the best pose of each tag."""

    def __init__(
        self,
        layout: Layout,
        walls: Walls,
        limits: ViewingLimits,
        free_space: FreeSpace,
        region: '_Region',
        occupancy: OccupancyMap | None,
    ):
        self._limits, self._free_space, self._region = limits, free_space, region
        self._occupancy = occupancy
        self._surroundings = AllSurroundings(tables_of(layout), walls, free_space.tag_poses)

    def best(self, tag_id: str, tag: TagPose, override: Override) -> _Trial:
        """Return the best pose of a tag; most tags need no more than the preferred standoff."""
        preferred = _candidates(tag, self._limits, override, is_preferred=True)
        trial = self._try(tag_id, preferred, worst_rank=0)
        return trial if trial.pose else self._try(tag_id, _candidates(tag, self._limits, override))

    def others(
        self, tag_id: str, tag: TagPose, override: Override, best: ApproachPose, most: int
    ) -> list[ApproachPose]:
        """Return the alternatives to the best pose of a tag, with which it has at most so many."""
        candidates, found = _candidates(tag, self._limits, override), [best]
        while len(found) < most:
            apart_m = np.linalg.norm(candidates[:, :2] - found[-1][:2], axis=1)
            turned_rad = np.abs(_wrapped(candidates[:, 2] - found[-1].yaw))
            candidates = candidates[(apart_m >= OTHER_M - SAME_M) | (turned_rad >= OTHER_RAD - SAME_M)]
            if not (pose := self._try(tag_id, candidates).pose):
                break
            found.append(pose)
        return found[1:]

    def _try(self, tag_id: str, poses: np.ndarray, worst_rank: float = math.inf) -> _Trial:
        """Find the best of some poses, an array (poses, 5), with at most this rank."""
        limits, trial = self._limits, _Trial()
        beyond_m = max(limits.robot_radius_m + limits.clearance_m, -limits.camera_offset_m)
        reach_m = float(poses[:, 3].max(initial=0.0)) + beyond_m
        around = self._surroundings.of(tag_id, reach_m)
        rooms_m = around.gaps_m(poses[:, :2]) - limits.robot_radius_m
        for order in np.split(_best_first(poses, rooms_m, limits, worst_rank), [FIRST]):
            free = order[self._free_space.are_free(poses[order, :2])]
            trial.has_place |= bool(len(free))
            eyes = poses[free, :2] + limits.camera_offset_m * _directions(poses[free, 2])
            seen = free[around.are_in_view(eyes)]
            trial.has_view |= bool(len(seen))
            seen = seen[self._are_free_in_map(poses[seen, :2], trial)]
            trial.is_in_map |= bool(len(seen))
            number = self._region.first(poses[seen, :2])
            if number is not None:
                trial.pose = ApproachPose(*poses[seen[number]].tolist())
                trial.room_m = float(rooms_m[seen[number]])
                break
        return trial

    def _are_free_in_map(self, points: np.ndarray, trial: _Trial) -> np.ndarray:
        """Return whether the map leaves room at each point (points, 2), and note the most room."""
        if self._occupancy is None or not len(points):
            return np.ones(len(points), dtype=bool)
        needed_m = self._limits.robot_radius_m + self._limits.clearance_m
        gaps_m, are_unknown = self._occupancy.gaps_m(points, needed_m)
        most = gaps_m.argmax()
        if gaps_m[most] > trial.map_gap_m:
            trial.map_gap_m, trial.is_map_unknown = float(gaps_m[most]), bool(are_unknown[most])
        return gaps_m >= needed_m - SAME_M


def _best_first(
    poses: np.ndarray, rooms_m: np.ndarray, limits: ViewingLimits, worst_rank: float
) -> np.ndarray:
    """
    Return the numbers of the poses, an array (poses, 5), that have room and at most this rank.

    The ranks: 0 clearance, and room and view allow for an arrival beside the pose; 1 clearance, and the view
    does; 2 clearance; 3 not tight; 4 not tight, but a steep view; 5 others.
    """
    is_steep = poses[:, 4] > limits.largest_angle_rad + SAME_M
    has_clearance = rooms_m >= limits.clearance_m - SAME_M
    tight_m = min(TIGHT_M, limits.clearance_m)
    is_tight = rooms_m < tight_m - SAME_M
    enough_m = max(limits.clearance_m, tight_m + limits.arrival_tolerance_m)
    is_close = rooms_m < enough_m - SAME_M
    allows_arrival = _allow_arrival(poses, limits)
    conditions = [is_tight, is_steep, ~has_clearance, ~allows_arrival, is_close]
    ranks = np.select(conditions, [5, 4, 3, 2, 1], 0)
    room_mm = np.round(1e3 * np.minimum(rooms_m, enough_m))
    off_m = np.round(np.abs(poses[:, 3] - limits.preferred_standoff_m), 9)
    order = np.lexsort((np.round(poses[:, 4], 9), off_m, ~allows_arrival, -room_mm, ranks))
    has_room = rooms_m >= limits.smallest_room_m - SAME_M
    return order[(has_room & (ranks <= worst_rank))[order]]


def _allow_arrival(poses: np.ndarray, limits: ViewingLimits) -> np.ndarray:
    """Return whether the view from each pose is within the limits after an arrival within the tolerances."""
    standoffs_m, angles = poses[:, 3], poses[:, 4]
    aside_m = limits.arrival_tolerance_m + abs(limits.camera_offset_m) * limits.arrival_tolerance_rad
    to_camera_m = np.maximum(standoffs_m - limits.camera_offset_m, SAME_M)
    turn = np.arcsin(np.minimum(aside_m / to_camera_m, 1.0))  # of the line of sight
    nearest_m = min(limits.smallest_standoff_m + limits.arrival_tolerance_m, limits.preferred_standoff_m)
    farthest_m = max(limits.largest_standoff_m - limits.arrival_tolerance_m, limits.preferred_standoff_m)
    return (
        (angles + np.maximum(turn, limits.arrival_tolerance_rad) <= limits.largest_angle_rad + SAME_M)
        & (standoffs_m >= nearest_m - SAME_M)
        & (standoffs_m <= farthest_m + SAME_M)
    )


def _candidates(
    tag: TagPose, limits: ViewingLimits, override: Override, *, is_preferred: bool = False
) -> np.ndarray:
    """Return the possible poses of a tag, or only those at the preferred standoff, in an array (poses, 5)."""
    preferred_m = limits.preferred_standoff_m
    standoffs_m = [
        preferred_m,
        *_steps(preferred_m, limits.smallest_standoff_m, STEP_M),
        *_steps(preferred_m, limits.largest_standoff_m, STEP_M),
    ][: 1 if is_preferred else None]
    one_side = _steps(0.0, limits.largest_angle_rad, STEP_RAD)
    one_side += _steps(limits.largest_angle_rad, limits.steepest_rad, STEP_RAD)
    angles = [0.0, *(sign * angle for angle in one_side for sign in (1, -1))]
    if override.standoff is not None:
        standoffs_m = [override.standoff]
    if override.yaw is not None:
        angles = [override.yaw + math.pi - tag.facing]
    if override.goal_x is not None or override.goal_y is not None:
        standoffs_m, angles = standoffs_m[:1], angles[:1]
    standoffs, angles = (each.ravel() for each in np.meshgrid(standoffs_m, angles, indexing='ij'))
    if override == Override():  # a tag looks narrower from the side: a steep view must be nearer
        narrow_m = limits.largest_standoff_m / math.cos(limits.largest_angle_rad)
        is_wide = standoffs <= np.maximum(narrow_m * np.cos(angles), limits.smallest_standoff_m) + SAME_M
        is_wide |= np.abs(angles) <= limits.largest_angle_rad
        standoffs, angles = standoffs[is_wide], angles[is_wide]
    places = tag[:2] + standoffs[:, None] * _directions(tag.facing + angles)
    for axis, value in enumerate((override.goal_x, override.goal_y)):
        if value is not None:
            places[:, axis] = value
    towards = tag[:2] - places
    sights = np.arctan2(towards[:, 1], towards[:, 0])
    yaws = sights if override.yaw is None else np.full(len(places), math.remainder(override.yaw, math.tau))
    incidences = np.abs(_wrapped(sights + math.pi - tag.facing))
    return np.column_stack([places, yaws, np.hypot(*towards.T), incidences])


def _directions(angles: np.ndarray) -> np.ndarray:
    """Return the unit vectors of angles to the x axis, in an array (angles, 2)."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _wrapped(angles: np.ndarray) -> np.ndarray:
    """Return angles from -pi to pi."""
    return angles - math.tau * np.round(angles / math.tau)


def _steps(start: float, end: float, step: float) -> list[float]:
    """Return the values from a start, which is left out, to an end, which is not."""
    count = math.ceil(round(abs(end - start) / step, 6))
    return [start + math.copysign(n * step, end - start) for n in range(1, count)] + [end] * bool(count)


class _Region:
    """The part of the free space that is connected to a point."""

    def __init__(self, free_space: FreeSpace, start_m: tuple[float, float], likely: np.ndarray):
        """Take points (points, 2) that may be asked for; all at once is faster."""
        self._free_space, self._start_m = free_space, start_m
        likely = np.concatenate([[start_m], likely[free_space.are_free(likely)]])
        self._numbers = dict(
            zip(map(tuple, likely.tolist()), free_space.regions_of(likely).tolist(), strict=True)
        )
        self._number = self._numbers[tuple(start_m)]

    def first(self, points: np.ndarray) -> int | None:
        """Return the number of the first of some free points that is in the region; None if none is."""
        left = np.arange(len(points))
        while len(left):
            if self._holds(points[left[0]]):
                return int(left[0])
            left = left[~self._free_space.are_in_sight(points[left[0]], points[left])]  # not itself either
        return None

    def _holds(self, point: np.ndarray) -> bool:
        number = self._numbers.get(tuple(point.tolist()))
        if number is None:
            number = self._free_space.regions_of(point[None])[0]
        if min(number, self._number) < 0:
            return bool(self._free_space.are_in_sight(self._start_m, point)[0])
        return number == self._number
