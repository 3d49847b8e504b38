"""
Compute the approach poses, from which the robot's camera sees a tag. Does not import ROS.

The robot drives in the region of its start or, without one, in the region with poses of the most tags.
Each tag gets the best pose there, or the reason why it has none.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.simulator.layout import Layout

from lupin_planning.grid import SMALLEST_ROOM_M, Grid, Point
from lupin_planning.occupancy import OccupancyMap
from lupin_planning.poses import PoseInPlane
from lupin_planning.tag_poses import (
    EQUAL_M,
    TagPose,
    are_hidden,
    find_tag_poses,
    tables_of,
)
from lupin_planning.viewpoints import (
    ApproachPose,
    ViewingLimits,
    best_first,
    cameras_at,
    find_candidates,
    override_pose,
    wrapped,
)
from lupin_planning.walls import Walls

# How far an alternative pose is from each one before, or how much it is turned.
ALTERNATIVE_M, ALTERNATIVE_RAD = 0.2, math.radians(20.0)


@dataclass(frozen=True)
class Approaches:
    """The approach poses and the reasons of the other tags, by tag id in the order of the layout."""

    grid: Grid
    region: int  # of the grid, that all poses are in; 0 without poses
    poses: dict[str, ApproachPose] = field(default_factory=dict)
    alternatives: dict[str, list[ApproachPose]] = field(default_factory=dict)  # to each pose, the best first
    unreachable: dict[str, str] = field(default_factory=dict)
    room_warnings: dict[str, str] = field(default_factory=dict)  # by tag id: less room than the clearance
    warnings: list[str] = field(default_factory=list)  # large cells, and overrides from which no camera sees


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
    none. A map is in the frame of the layout. `progress` is called with what is done, how much of it, and of
    how much. Raises StartUpError for a start or end that is not free, if no point is, or for a map of another
    place.
    """
    if occupancy is not None:
        _check_place_of(occupancy, layout, walls)
    grid = Grid(layout, walls, limits.robot_radius_m, occupancy)
    robot = f'a robot of radius {limits.robot_radius_m:g} m'
    for name, place_m in (('start', start_m), ('end', end_m)):
        if place_m and not grid.is_free(*place_m):
            place = f'the {name} at ({place_m[0]:g}, {place_m[1]:g})'
            raise StartUpError(f'{place} is not free for {robot}: choose another within {walls}')
    if not grid.region_count:
        raise StartUpError(
            'tables, tags and the map leave no free space for the robot: choose a smaller radius'
        )
    tables = np.array(tables_of(layout), dtype=float).reshape(-1, 4)
    scene = _Scene(grid, walls, tables, limits, most_per_tag)
    tag_poses = find_tag_poses(layout, walls)
    views = {}
    for count, (tag_id, tag) in enumerate(tag_poses.items()):
        progress('tags with a pose', count, len(tag_poses))
        views[tag_id] = scene.view_of(tag, (overrides or {}).get(tag_id))
    counts = Counter(region for view in views.values() for region in view.poses)
    region = grid.region_of(start_m) if start_m else max(counts, key=counts.__getitem__, default=0)
    found = Approaches(grid, region, warnings=[grid.warning] if grid.warning else [])
    origin = f'the start at ({start_m[0]:g}, {start_m[1]:g})' if start_m else 'the rest of the free space'
    cut_off = f'cut off from {origin}: no passage between is wide enough for {robot}'
    for tag_id, view in views.items():
        if region not in view.poses:
            found.unreachable[tag_id] = cut_off if view.poses else view.reason
            continue
        found.poses[tag_id], *found.alternatives[tag_id] = view.poses[region]
        shown = f"tag '{escaped(tag_id, 64)}'"
        if view.problem:
            found.warnings.append(f'{shown}: the camera cannot see it from its override: {view.problem}')
        (room_m,) = grid.rooms_m(found.poses[tag_id][:2])
        if room_m < limits.clearance_m - EQUAL_M:
            found.room_warnings[tag_id] = (
                f"{shown}: its pose has {room_m:.3f} m of room beyond the robot's radius, less than the"
                f' clearance of {limits.clearance_m:g} m: the robot fits, so nothing needs to be done'
            )
    return found


def _check_place_of(occupancy: OccupancyMap, layout: Layout, walls: Walls) -> None:
    """Raise StartUpError if most tags are outside the map: it is of another place."""
    extent = occupancy.extent
    count = sum(extent.has_inside(tag.x, tag.y) for tag in layout.tags.values())
    if 2 * count < len(layout.tags):
        shown = Walls(*(round(edge_m, 2) + 0.0 for edge_m in extent))
        raise StartUpError(
            f'the map holds only {count} of the {len(layout.tags)} tags: it reaches from {shown}, and the'
            f' greenhouse from {walls}, both in the frame of the layout: find where the layout lies in this'
            ' map with register_layout'
        )


class _View(NamedTuple):
    """The free poses from which the camera sees a tag."""

    poses: dict[int, list[ApproachPose]]  # by region: the best, and its alternatives
    reason: str  # why there is none
    problem: str = ''  # why the camera does not see the tag from its override


class _Scene(NamedTuple):
    """What decides from where the camera sees a tag. All poses are arrays (poses, 5)."""

    grid: Grid
    walls: Walls
    tables: np.ndarray
    limits: ViewingLimits
    most_per_tag: int

    def view_of(self, tag: TagPose, override: PoseInPlane | None) -> _View:
        """Return the poses of a tag; that of an override even if the camera does not see the tag from it."""
        limits, robot = self.limits, f'a robot of radius {self.limits.robot_radius_m:g} m'
        if not self.walls.has_inside(tag.x, tag.y):
            reason = f'outside the walls ({self.walls}): correct them, or the config of the greenhouse'
            return _View({}, reason)
        if override:
            pose, problem = override_pose(override, tag, limits)
            poses = np.array([pose])
            if not problem and self.are_hidden(poses, tag).any():
                problem = 'a table hides it'
            by_region = self.by_region(poses[self.grid.are_free(poses[:, :2])])
            return _View(by_region, f'no place for {robot} at its override', problem)
        candidates = find_candidates(tag, limits)
        rooms_m = self.grid.rooms_m(candidates[:, :2])
        is_free = rooms_m >= 0.0
        if is_free.any():
            free = candidates[is_free]
            free = free[best_first(free, rooms_m[is_free], limits)]
            seeing = free[~self.are_hidden(free, tag)]
            return _View(self.by_region(seeing), 'tables hide it wherever the robot has a place')
        if self.has_map_obstacle(candidates):
            where = 'at each place from which the robot would see it'
            return _View({}, f'the map has an obstacle or an unknown cell {where}')
        angle = f'{math.degrees(limits.largest_angle_rad):g}°'
        return _View({}, f'no place for {robot} within {limits.largest_standoff_m:g} m and {angle}')

    def are_hidden(self, poses: np.ndarray, tag: TagPose) -> np.ndarray:
        """Return whether a table hides the tag at each pose."""
        return are_hidden(cameras_at(poses, self.limits), tag, self.tables, self.walls)

    def has_map_obstacle(self, poses: np.ndarray) -> bool:
        """Return whether the robot would have room at one of the poses without the map."""
        needed_m = self.limits.robot_radius_m + SMALLEST_ROOM_M
        has_room = self.grid.layout_distances_m(poses[:, :2]) >= needed_m
        return bool((has_room & (self.grid.obstacle_distances_m(poses[:, :2]) < needed_m)).any())

    def by_region(self, poses: np.ndarray) -> dict[int, list[ApproachPose]]:
        """Return the best of the poses in each region, and its alternatives."""
        regions = self.grid.regions_of(poses[:, :2])
        return {region: self.apart(poses[regions == region]) for region in set(regions.tolist())}

    def apart(self, poses: np.ndarray) -> list[ApproachPose]:
        """Return the first of the poses, and the next ones that are apart from those before."""
        found: list[ApproachPose] = []
        while len(poses) and len(found) < self.most_per_tag:
            found.append(ApproachPose(*poses[0].tolist()))
            moved_m = np.hypot(*(poses[:, :2] - poses[0, :2]).T)
            turned_rad = np.abs(wrapped(poses[:, 2] - poses[0, 2]))
            poses = poses[(moved_m >= ALTERNATIVE_M - EQUAL_M) | (turned_rad >= ALTERNATIVE_RAD - EQUAL_M)]
        return found
