# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
Compute the approach poses, from which the robot's camera sees a tag. Does not import ROS.

Each tag first gets its best pose anywhere. The robot drives in the region that has most of these poses, or in
that of its start. A tag with its pose in another region gets its best pose in this one, or none.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.free_space import FreeSpace, Point
from lupin_greenhouse_bridge.planning.occupancy import ConnectedParts, OccupancyMap
from lupin_greenhouse_bridge.planning.octagons import Numbers
from lupin_greenhouse_bridge.planning.tag_poses import (
    EQUAL_M,
    Obstacles,
    Surroundings,
    TagPose,
    tables_of,
)
from lupin_greenhouse_bridge.planning.viewpoints import (
    ApproachPose,
    ViewingLimits,
    best_first,
    directions,
    find_candidates,
    pose_by_hand,
    wrapped,
)
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.runtime.poses import PoseInPlane
from lupin_greenhouse_bridge.simulator.layout import Layout

# How far an alternative pose is from each one before, or how much it is turned.
ALTERNATIVE_M, ALTERNATIVE_RAD = 0.2, math.radians(20.0)


@dataclass(frozen=True)
class Approaches:
    """The approach poses and the reasons of the other tags, by tag id in the order of the layout."""

    free_space: FreeSpace
    region_of: Callable[[Point], int]  # the number of the region of a free place
    region: int  # that all poses are in: connected in the free space and in the map; -1 without poses
    poses: dict[str, ApproachPose] = field(default_factory=dict)
    alternatives: dict[str, list[ApproachPose]] = field(default_factory=dict)  # to each pose, the best first
    room_warnings: dict[str, str] = field(default_factory=dict)  # of poses with less room than the clearance
    view_warnings: dict[str, str] = field(default_factory=dict)  # of overrides from which no camera sees
    unreachable: dict[str, str] = field(default_factory=dict)
    map_warnings: list[str] = field(default_factory=list)  # of places that are outside the map


def find_approaches(  # noqa: PLR0913 - the options are passed by name
    layout: Layout,
    walls: Walls,
    limits: ViewingLimits,
    *,
    start_m: Point | None = None,
    end_m: Point | None = None,
    overrides: Mapping[str, PoseInPlane] | None = None,
    most_per_tag: int = 1,
    occupancy: OccupancyMap | None = None,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> Approaches:
    """
    Return an approach pose for each tag that the robot can look at.

    Each pose is free, has the whole tag in view, and is connected to the start; without a start, all are in
    the region that has the best poses of most tags. Poses with the clearance win, then
    those with view and room after an arrival beside the pose, then the one nearest to the preferred standoff,
    then the one with the smallest incidence angle. Without that room, the roomiest pose wins.
    With more than one pose per tag, the next best ones that are at least ALTERNATIVE_M or ALTERNATIVE_RAD
    from each before are its alternatives; a tag with an override has none.
    A map, in the frame of the layout, leaves only the poses from which it is free by the radius and the
    clearance, and which such places in the map connect. The paths do not know the map.
    `progress` is told what is done, how much of it, and of how much.
    Raises StartUpError for a start or end that is not free, if no point is, or for a map of another place.
    """
    free_space = _free_space(layout, walls, limits, start_m, end_m)
    map_warnings = []
    if occupancy is not None:
        map_warnings = _check_place_of(occupancy, free_space.tag_poses, limits, walls)
    search = _Search(layout, walls, limits, overrides or {}, free_space, occupancy)
    views = {}
    for count, tag_id in enumerate(layout.tags):
        progress('tags with a pose', count, len(layout.tags))
        views[tag_id] = search.best(tag_id)
    counts = Counter(view.region for view in views.values() if view.pose)
    region = search.region_of(start_m) if start_m else max(counts, key=counts.__getitem__, default=-1)
    found = Approaches(free_space, search.region_of, region, map_warnings=map_warnings)
    for tag_id, view in views.items():
        if view.pose and view.region != region:
            in_map = ' in the map' if search.are_apart_in_map(view.region, region) else ''
            reason = (
                f'cut off from {_named(start_m)}{in_map}: no passage between is wide enough for a robot of'
                f' radius {limits.robot_radius_m:g} m'
            )
            view = search.best(tag_id, region)._replace(reason=reason)  # noqa: PLW2901
        if view.pose is None:
            found.unreachable[tag_id] = view.reason
            continue
        found.alternatives[tag_id] = search.alternatives(tag_id, view.pose, region, most_per_tag - 1)
        found.poses[tag_id] = view.pose
        shown = f"tag '{escaped(tag_id, 64)}'"
        if view.problem:
            problem = f'the camera cannot see it from its override: {view.problem}'
            found.view_warnings[tag_id] = f'{shown}: {problem}'
        if view.room_m < limits.clearance_m - EQUAL_M:
            found.room_warnings[tag_id] = (
                f"{shown}: its pose has {view.room_m:.3f} m of room beyond the robot's radius, less than the"
                f' clearance of {limits.clearance_m:g} m: the robot fits, so nothing needs to be done'
            )
    return found


def _free_space(
    layout: Layout, walls: Walls, limits: ViewingLimits, start_m: Point | None, end_m: Point | None
) -> FreeSpace:
    """Return where the robot can be; raises StartUpError if that is nowhere, or not at the start or end."""
    free_space = FreeSpace(layout, walls, limits.robot_radius_m, limits.smallest_room_m)
    for what, place_m in (('start', start_m), ('end', end_m)):
        if place_m and not free_space.is_free(*place_m):
            robot = f'a robot of radius {limits.robot_radius_m:g} m'
            place = f'the {what} at ({place_m[0]:g}, {place_m[1]:g})'
            raise StartUpError(f'{place} is not free for {robot}: choose another within {walls}')
    if free_space.is_empty():
        raise StartUpError('tables and tags leave no free space for the robot: choose a smaller radius')
    return free_space


def _named(start_m: Point | None) -> str:
    return f'the start at ({start_m[0]:g}, {start_m[1]:g})' if start_m else 'the rest of the free space'


def _check_place_of(
    occupancy: OccupancyMap, tag_poses: Mapping[str, TagPose], limits: ViewingLimits, walls: Walls
) -> list[str]:
    """Return a warning if some places before the tags are outside; raises StartUpError if most are."""
    tags = np.array(list(tag_poses.values()))
    places = tags[:, :2] + limits.preferred_standoff_m * directions(tags[:, 2])
    count = int(occupancy.have_inside(places).sum())
    map_extent, greenhouse = (
        Walls(*(round(each, 2) + 0.0 for each in extent)) for extent in (occupancy.extent, walls)
    )
    problem = (
        f'the map holds only {count} of the {len(places)} places before the tags: it reaches from'
        f' {map_extent}, and the greenhouse from {greenhouse}, both in the frame of the layout'
    )
    if 2 * count < len(places):
        raise StartUpError(f'{problem}: find where the layout lies in this map with register_layout')
    is_enough = count == len(places) or not occupancy.is_unknown_taken
    remedy = 'check layout_in_map, or what approach_poses finds with --unknown free'
    return [] if is_enough else [f'{problem}: {remedy}']


class _View(NamedTuple):
    """The best pose of a tag, or the reason why it has none."""

    reason: str
    pose: ApproachPose | None = None
    room_m: float = 0.0  # beyond the robot's radius
    region: int = -1  # of the free space
    problem: str = ''  # why the camera cannot see the tag from a pose that is set by hand


class _Search:
    """Looks for the best poses of each tag."""

    def __init__(
        self,
        layout: Layout,
        walls: Walls,
        limits: ViewingLimits,
        overrides: Mapping[str, PoseInPlane],
        free_space: FreeSpace,
        occupancy: OccupancyMap | None,
    ):
        self._walls, self._limits, self._overrides = walls, limits, overrides
        self._free_space, self._occupancy = free_space, occupancy
        self._obstacles = Obstacles(tables_of(layout), walls, free_space.tag_poses)
        self._needed_m = limits.robot_radius_m + limits.clearance_m  # of room in the map
        self._parts = None if occupancy is None else ConnectedParts(occupancy, self._needed_m)

    def regions_of(self, points: np.ndarray) -> Numbers:
        """Return a number for each free point (points, 2), which is equal for those that are connected."""
        regions = self._free_space.regions_of(points)
        return regions if self._parts is None else regions * (self._parts.count + 1) + self._parts.of(points)

    def region_of(self, place_m: Point) -> int:
        """Return the region of one free point."""
        return int(self.regions_of(np.array([place_m]))[0])

    def are_apart_in_map(self, one: int, other: int) -> bool:
        """Return whether two regions are connected in the free space, but not in the map."""
        return self._parts is not None and one // (self._parts.count + 1) == other // (self._parts.count + 1)

    def best(self, tag_id: str, region: int | None = None) -> _View:
        """Return the best pose of a tag in a region, or anywhere."""
        if not self._walls.has_inside(*self._free_space.tag_poses[tag_id][:2]):
            return _View(f'outside the walls ({self._walls}): correct them, or the config of the greenhouse')
        if tag_id in self._overrides:
            return self._by_hand(tag_id, region)
        # Most tags need no more than the preferred standoff.
        nearby = self._candidates(tag_id, at_preferred_standoff=True)
        view = self._best_of(tag_id, nearby, region, worst_rank=0)
        return view if view.pose else self._best_of(tag_id, self._candidates(tag_id), region)

    def alternatives(self, tag_id: str, best: ApproachPose, region: int, most: int) -> list[ApproachPose]:
        """Return at most so many other poses of a tag in a region, the best first."""
        if not most or tag_id in self._overrides:
            return []
        poses, found = self._candidates(tag_id), [best]
        while len(found) <= most:
            apart_m = np.linalg.norm(poses[:, :2] - found[-1][:2], axis=1)
            turned_rad = np.abs(wrapped(poses[:, 2] - found[-1].yaw))
            poses = poses[(apart_m >= ALTERNATIVE_M - EQUAL_M) | (turned_rad >= ALTERNATIVE_RAD - EQUAL_M)]
            if not (pose := self._best_of(tag_id, poses, region).pose):
                break
            found.append(pose)
        return found[1:]

    def _by_hand(self, tag_id: str, region: int | None) -> _View:
        """Return the pose of an override, if the robot can be there."""
        limits, tag = self._limits, self._free_space.tag_poses[tag_id]
        place = np.array([self._overrides[tag_id][:2]])
        if not self._free_space.are_free(place)[0]:
            return _View(f'no place for a robot of radius {limits.robot_radius_m:g} m at its override')
        if region is not None and self.region_of(self._overrides[tag_id][:2]) != region:
            return _View('')
        pose, problem = pose_by_hand(self._overrides[tag_id], tag, limits)
        beyond_m = limits.robot_radius_m + limits.room_for_arrival_m + abs(limits.camera_offset_m)
        around = self._obstacles.around(tag_id, pose.distance_m + beyond_m)
        room_m = float(around.gaps_m(place)[0]) - limits.robot_radius_m
        eye = place + limits.camera_offset_m * directions(np.array([pose.yaw]))
        if not problem and not around.are_in_view(eye)[0]:
            problem = 'a table or another tag hides it'
        view = self._free_in_map(pose, room_m, place)
        return view._replace(problem=problem) if view.pose else view

    def _free_in_map(self, pose: ApproachPose, room_m: float, place: np.ndarray) -> _View:
        """Return the view from a free pose, if the map leaves enough room there."""
        if self._occupancy is not None:
            gaps_m, _ = self._occupancy.gaps_m(place, self._needed_m)
            if gaps_m[0] < self._needed_m - EQUAL_M:
                return _View(
                    f'the map has no room at its override: {gaps_m[0]:.2f} m, and the robot needs'
                    f' {self._needed_m:g} m'
                )
        return _View('', pose, room_m, self.region_of(pose[:2]))

    def _candidates(self, tag_id: str, *, at_preferred_standoff: bool = False) -> np.ndarray:
        """Return the possible poses of a tag in an array (poses, 5)."""
        tag = self._free_space.tag_poses[tag_id]
        return find_candidates(tag, self._limits, at_preferred_standoff=at_preferred_standoff)

    def _best_of(
        self, tag_id: str, poses: np.ndarray, region: int | None, worst_rank: float = math.inf
    ) -> _View:
        """Return the best of some poses of a tag, an array (poses, 5), in a region and with this rank."""
        limits = self._limits
        beyond_m = max(limits.robot_radius_m + limits.room_for_arrival_m, -limits.camera_offset_m)
        around = self._obstacles.around(tag_id, float(poses[:, 3].max(initial=0.0)) + beyond_m)
        poses = poses[self._free_space.are_free(poses[:, :2])]
        if region is not None:
            poses = poses[self.regions_of(poses[:, :2]) == region]
        rooms_m = around.gaps_m(poses[:, :2]) - limits.robot_radius_m
        order = best_first(poses, rooms_m, limits, worst_rank)
        if not len(order):
            where = f'within {limits.largest_standoff_m:g} m and {math.degrees(limits.steepest_rad):g}°'
            return _View(f'no place for a robot of radius {limits.robot_radius_m:g} m {where}')
        return self._first_valid(around, poses[order], rooms_m[order])

    def _first_valid(self, around: Surroundings, poses: np.ndarray, rooms_m: np.ndarray) -> _View:
        """Return the first of some free poses that has the tag in view, and is free in the map too."""
        eyes = poses[:, :2] + self._limits.camera_offset_m * directions(poses[:, 2])
        valid = np.flatnonzero(around.are_in_view(eyes))
        if not len(valid):
            return _View('tables or other tags hide it wherever the robot has a place')
        if self._occupancy is not None:
            needed_m = self._needed_m
            gaps_m, are_unknown = self._occupancy.gaps_m(poses[valid, :2], needed_m)
            roomiest = gaps_m.argmax()
            if gaps_m[roomiest] < needed_m - EQUAL_M:
                kind = 'is unknown' if are_unknown[roomiest] else 'has an obstacle'
                return _View(
                    f'the map {kind} {gaps_m[roomiest]:.2f} m from every pose,'
                    f' and the robot needs {needed_m:g} m'
                )
            valid = valid[gaps_m >= needed_m - EQUAL_M]
        pose = ApproachPose(*poses[valid[0]].tolist())
        return _View('', pose, float(rooms_m[valid[0]]), self.region_of(pose[:2]))
