# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
The free space of a disc robot in a greenhouse. Does not import ROS.

Each table and each plate of a tag is inflated by the robot's radius to an octagon, so the robot passes
wherever it fits. A grid would need cells as small as the clearance in the narrowest aisle.
"""

import functools
import itertools
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.octagons import AXES, AXIS_LENGTHS, Numbers, Octagons, Regions
from lupin_greenhouse_bridge.planning.tag_poses import Table, TagPose, find_tag_poses, tables_of
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

WALL_M = 1.0  # how thick the walls are

Point = tuple[float, float]
Flags = NDArray[np.bool_]


class FreeSpace:
    """Where the centre of a disc robot can be: not within its radius of a table, a tag's plate or a wall."""

    def __init__(self, layout: Layout, walls: Walls, radius_m: float, clearance_m: float = 0.0):
        """
        Take the robot's radius and its clearance, which is added to the radius, in metres.

        Raises StartUpError for a table without an area, or a robot that does not fit between the walls.
        """
        x0, y0, x1, y1 = walls
        apart_m = min(x1 - x0, y1 - y0)
        if not 0.0 <= 2 * (radius_m + clearance_m) < apart_m:
            beside = f' and clearance {clearance_m:g} m' if clearance_m else ''
            raise StartUpError(
                f'a robot of radius {radius_m:g} m{beside} does not fit between the walls, which are'
                f' {apart_m:g} m apart: choose a smaller radius, or set walls'
            )
        self.tag_poses = find_tag_poses(layout, walls)
        self.robot_radius_m = radius_m
        radius_m += clearance_m
        self._low, self._high = np.array([x0, y0]) + radius_m, np.array([x1, y1]) - radius_m
        self.diagonal_m = math.hypot(x1 - x0, y1 - y0)
        self._rounding_m = 1e-9 + 4e-15 * max(map(abs, walls))
        octagons = _inflated(tables_of(layout), walls, radius_m, self.tag_poses.values())
        self._octagons = Octagons(octagons.low + self._rounding_m, octagons.high - self._rounding_m)
        vertices = octagons.vertices()
        are_free = self.are_free(vertices.reshape(-1, 2))
        self.corners = vertices.reshape(-1, 2)[are_free]
        sides = [np.roll(vertices, turn, axis=1) - vertices for turn in (1, -1)]
        self._sides = [each.reshape(-1, 2)[are_free] for each in sides]  # from a corner to those beside it

    def are_free(self, points: ArrayLike) -> Flags:
        """Return for each point, of an array (points, 2) in metres, whether the robot can be there."""
        points = _points(points)
        beyond_m = np.maximum(self._low - points, points - self._high).max(axis=1)
        are_free = np.asarray(beyond_m <= self._rounding_m)
        are_free[are_free] = ~self._octagons.cover(points[are_free])
        return are_free

    def is_free(self, x: float, y: float) -> bool:
        """Return whether the robot's centre can be at this point."""
        return bool(self.are_free([(x, y)])[0])

    def is_empty(self) -> bool:
        """Return whether the robot has no place, not even in a corner of the walls."""
        (x0, y0), (x1, y1) = self._low, self._high
        corners = [(x0, y0), (x0, y1), (x1, y0), (x1, y1)]
        return not (len(self.corners) or self.are_free(corners).any())

    def are_in_sight(self, starts: ArrayLike, ends: ArrayLike) -> Flags:
        """Return whether the line from each free point to another one, or from one to each, is free."""
        starts, ends = np.broadcast_arrays(_points(starts), _points(ends))
        return self._octagons.first_entered(starts, ends)[0] < 0

    def are_tangent(self, corners: Numbers, towards: np.ndarray) -> Flags:
        """Return whether a line in each direction (lines, 2) passes by its corner, which has this number."""
        turns = [towards[:, 0] * each[corners, 1] - towards[:, 1] * each[corners, 0] for each in self._sides]
        is_left, is_right = np.minimum(*turns) >= -self._rounding_m, np.maximum(*turns) <= self._rounding_m
        return np.asarray(is_left | is_right)

    def regions_of(self, points: ArrayLike) -> Numbers:
        """Return the number of the connected region that each free point (points, 2) is in."""
        return self._regions.of(_points(points))

    @functools.cached_property
    def _regions(self) -> Regions:
        return Regions(self._octagons)

    @staticmethod
    def length_m(path: Iterable[Point]) -> float:
        """Return the length of a path in metres."""
        return sum(itertools.starmap(math.dist, itertools.pairwise(path)))


def _inflated(tables: list[Table], walls: Walls, radius_m: float, tag_poses: Iterable[TagPose]) -> Octagons:
    """Return the octagons of tables, plates and walls, of equal ones only one."""
    x0, y0, x1, y1 = walls
    left, bottom, right, top = x0 - WALL_M, y0 - WALL_M, x1 + WALL_M, y1 + WALL_M
    around = [
        (left, bottom, right, y0),
        (left, y1, right, top),
        (left, bottom, x0, top),
        (x1, bottom, right, top),
    ]
    corners = np.array([*tables, *around])[:, [[0, 1], [0, 3], [2, 1], [2, 3]]]
    plates = np.array([each.ends_of_plate() for each in tag_poses])[:, [0, 0, 1, 1]]
    along = np.concatenate([corners, plates]).clip((left, bottom), (right, top)) @ AXES
    limits = np.hstack([along.min(axis=1), along.max(axis=1)])
    limits += np.concatenate([-radius_m * AXIS_LENGTHS, radius_m * AXIS_LENGTHS])
    low, high = np.split(np.unique(limits, axis=0), 2, axis=1)
    return Octagons(low, high)


def _points(points: ArrayLike) -> np.ndarray:
    return np.asarray(points, dtype=float).reshape(-1, 2)
