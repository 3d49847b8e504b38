"""
Compute the approach poses, from which the robot's camera sees a tag. Does not import ROS.

The robot drives in the region of its start or, without one, in the region with the best poses of most tags.
Each tag gets the best pose there, or the reason why it has none.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.simulator.layout import Layout

from lupin_planning.grid import Grid, Point
from lupin_planning.occupancy import OccupancyMap
from lupin_planning.poses import PoseInPlane
from lupin_planning.tag_poses import (
    EQUAL_M,
    TagPose,
    are_hidden,
    distances_m,
    find_tag_poses,
    tables_before,
    tables_of,
)
from lupin_planning.viewpoints import (
    ApproachPose,
    ViewingLimits,
    best_first,
    cameras_at,
    directions,
    find_candidates,
    pose_by_hand,
)
from lupin_planning.walls import Walls

# How far an alternative pose is from each one before, or how much it is turned.
ALTERNATIVE_M, ALTERNATIVE_RAD = 0.2, math.radians(20.0)
POSES_AT_ONCE = 64  # whose view is computed


@dataclass(frozen=True)
class Approaches:
    """The approach poses and the reasons of the other tags, by tag id in the order of the layout."""

    grid: Grid
    region: int  # of the grid, that all poses are in; 0 without poses
    poses: dict[str, ApproachPose] = field(default_factory=dict)
    alternatives: dict[str, list[ApproachPose]] = field(default_factory=dict)  # to each pose, the best first
    room_warnings: dict[str, str] = field(default_factory=dict)  # of poses with less room than the clearance
    view_warnings: dict[str, str] = field(default_factory=dict)  # of overrides from which no camera sees
    unreachable: dict[str, str] = field(default_factory=dict)
    grid_warnings: list[str] = field(default_factory=list)  # of large cells, and of places outside the map


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

    `best_first` says which pose is the best. With more than one pose per tag, the next best ones that are at
    least ALTERNATIVE_M or ALTERNATIVE_RAD from each before are its alternatives; a tag with an override has
    none. A map is in the frame of the layout. `progress` is told what is done, how much of it, and of how
    much. Raises StartUpError for a start or end that is not free, if no point is, or for a map of another
    place.
    """
    tag_poses = find_tag_poses(layout, walls)
    warnings = [] if occupancy is None else _check_place_of(occupancy, tag_poses, limits, walls)
    grid = Grid(layout, walls, limits.robot_radius_m, occupancy=occupancy)
    for what, place_m in (('start', start_m), ('end', end_m)):
        if place_m and not grid.is_free(*place_m):
            place = f'the {what} at ({place_m[0]:g}, {place_m[1]:g})'
            robot = f'a robot of radius {limits.robot_radius_m:g} m'
            raise StartUpError(f'{place} is not free for {robot}: choose another within {walls}')
    if not grid.region_count:
        raise StartUpError(
            'tables, tags and the map leave no free space for the robot: choose a smaller radius'
        )
    search = _Search(layout, walls, limits, overrides or {}, grid, tag_poses)
    best = {}
    for count, tag_id in enumerate(layout.tags):
        progress('tags with a pose', count, len(layout.tags))
        best[tag_id] = next(search.poses(tag_id), None)
    regions = Counter(grid.region_of(pose[:2]) for pose in best.values() if pose)
    region = grid.region_of(start_m) if start_m else max(regions, key=regions.__getitem__, default=0)
    found = Approaches(grid, region, grid_warnings=[*warnings, *filter(None, [grid.warning])])
    for tag_id, pose in best.items():
        shown = f"tag '{escaped(tag_id, 64)}'"
        if pose and grid.region_of(pose[:2]) != region:
            pose = next(search.poses(tag_id, region), None)  # noqa: PLW2901
        if pose is None:
            found.unreachable[tag_id] = search.reason(tag_id, start_m)
            continue
        found.poses[tag_id] = pose
        found.alternatives[tag_id] = search.alternatives(tag_id, pose, region, most_per_tag - 1)
        if problem := search.problem(tag_id):
            found.view_warnings[tag_id] = f'{shown}: the camera cannot see it from its override: {problem}'
        room_m = float(grid.gaps_m(pose[:2])[0]) - limits.robot_radius_m
        if room_m < limits.clearance_m - EQUAL_M:
            found.room_warnings[tag_id] = (
                f"{shown}: its pose has {room_m:.3f} m of room beyond the robot's radius, less than the"
                f' clearance of {limits.clearance_m:g} m: the robot fits, so nothing needs to be done'
            )
    return found


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


class _Search:
    """Looks for the best poses of each tag."""

    def __init__(
        self,
        layout: Layout,
        walls: Walls,
        limits: ViewingLimits,
        overrides: Mapping[str, PoseInPlane],
        grid: Grid,
        tag_poses: Mapping[str, TagPose],
    ):
        self._walls, self._limits, self._overrides = walls, limits, overrides
        self._grid, self._tag_poses = grid, tag_poses
        self._tables = np.array(tables_of(layout), dtype=float).reshape(-1, 4)

    def poses(self, tag_id: str, region: int | None = None) -> Iterator[ApproachPose]:
        """Yield the free poses from which the tag is seen, in a region or anywhere, the best first."""
        if not self._walls.has_inside(*self._tag_poses[tag_id][:2]):
            return
        if tag_id in self._overrides:
            pose = self._by_hand(tag_id)[0]
            if self._grid.is_free(*pose[:2]) and region in (None, self._grid.region_of(pose[:2])):
                yield pose
            return
        poses = self._with_room(tag_id)
        for first in range(0, len(poses), POSES_AT_ONCE):
            some = poses[first : first + POSES_AT_ONCE]
            is_valid = self._grid.are_free(some[:, :2]) & ~self._are_hidden(tag_id, some)
            if region is not None:
                is_valid &= self._grid.regions_of(some[:, :2]) == region
            for pose in some[is_valid]:
                yield ApproachPose(*pose.tolist())

    def alternatives(self, tag_id: str, best: ApproachPose, region: int, most: int) -> list[ApproachPose]:
        """Return at most so many other poses of a tag in a region, the best first."""
        found = [best]
        if most and tag_id not in self._overrides:
            for pose in self.poses(tag_id, region):
                if len(found) > most:
                    break
                if all(_are_apart(pose, each) for each in found):
                    found.append(pose)
        return found[1:]

    def problem(self, tag_id: str) -> str:
        """Return why the camera cannot see a tag from its override, or ''."""
        return self._by_hand(tag_id)[1] if tag_id in self._overrides else ''

    def reason(self, tag_id: str, start_m: Point | None) -> str:
        """Return why a tag has no pose."""
        limits = self._limits
        robot = f'a robot of radius {limits.robot_radius_m:g} m'
        if not self._walls.has_inside(*self._tag_poses[tag_id][:2]):
            return f'outside the walls ({self._walls}): correct them, or the config of the greenhouse'
        if next(self.poses(tag_id), None):
            origin = (
                f'the start at ({start_m[0]:g}, {start_m[1]:g})' if start_m else 'the rest of the free space'
            )
            return f'cut off from {origin}: no passage between is wide enough for {robot}'
        if tag_id in self._overrides:
            return f'no place for {robot} at its override'
        if self._grid.are_free(self._with_room(tag_id)[:, :2]).any():
            return 'tables hide it wherever the robot has a place'
        if len(self._with_room(tag_id, has_map=False)) > len(self._with_room(tag_id)):
            return (
                'the map has an obstacle or an unknown cell at each place from which the robot would see it'
            )
        within = f'within {limits.largest_standoff_m:g} m and {math.degrees(limits.largest_angle_rad):g}°'
        return f'no place for {robot} {within}'

    def _with_room(self, tag_id: str, *, has_map: bool = True) -> np.ndarray:
        """Return the poses of a tag where the robot has room, the best first, in an array (poses, 5)."""
        poses = find_candidates(self._tag_poses[tag_id], self._limits)
        rooms_m = self._grid.gaps_m(poses[:, :2], has_map=has_map) - self._limits.robot_radius_m
        return np.asarray(poses[best_first(poses, rooms_m, self._limits)])

    def _are_hidden(self, tag_id: str, poses: np.ndarray) -> np.ndarray:
        """Return whether a table hides the tag at each pose (poses, 3 or more)."""
        tag, limits = self._tag_poses[tag_id], self._limits
        reach_m = float(np.hypot(*(poses[:, :2] - tag[:2]).T).max()) + abs(limits.camera_offset_m)
        near = self._tables[distances_m(self._tables, tag[:2]) <= reach_m]
        return are_hidden(cameras_at(poses, limits), tag, tables_before(tag, near, self._walls))

    def _by_hand(self, tag_id: str) -> tuple[ApproachPose, str]:
        """Return the pose of an override, and why the camera cannot see the tag from it, or ''."""
        pose, problem = pose_by_hand(self._overrides[tag_id], self._tag_poses[tag_id], self._limits)
        if not problem and self._are_hidden(tag_id, np.array([pose]))[0]:
            problem = 'a table hides it'
        return pose, problem


def _are_apart(one: ApproachPose, other: ApproachPose) -> bool:
    turned_rad = abs(math.remainder(one.yaw - other.yaw, math.tau))
    return math.dist(one[:2], other[:2]) >= ALTERNATIVE_M - EQUAL_M or turned_rad >= ALTERNATIVE_RAD - EQUAL_M
