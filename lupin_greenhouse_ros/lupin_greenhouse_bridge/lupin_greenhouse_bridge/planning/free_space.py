# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
The free space of a disc robot in a greenhouse, and the shortest paths in it. Does not import ROS.

Each table and each plate of a tag is inflated by the robot's radius to an octagon, so the robot passes
wherever it fits. A grid would need cells as small as the clearance in the narrowest aisle.
"""

import functools
import itertools
import math
from collections.abc import Iterable

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.octagons import AXES, AXIS_LENGTHS, Octagons
from lupin_greenhouse_bridge.planning.regions import Regions
from lupin_greenhouse_bridge.planning.tag_poses import Table, TagPose, find_tag_poses, tables_of
from lupin_greenhouse_bridge.planning.visibility_graph import VisibilityGraph
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

WALL_M = 1.0  # how thick the walls are
LINES_AT_ONCE = 4096


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

    def are_free(self, points) -> np.ndarray:
        """Return for each point, of an array (points, 2) in metres, whether the robot can be there."""
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        low, high = self._low - self._rounding_m, self._high + self._rounding_m
        are_free = ((points >= low) & (points <= high)).all(axis=1)
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

    def are_in_sight(self, start, ends) -> np.ndarray:
        """Return whether the line from a free point, or from each, to each free point (points, 2) is free."""
        ends = np.asarray(ends, dtype=float).reshape(-1, 2)
        starts = np.broadcast_to(np.asarray(start, dtype=float).reshape(-1, 2), ends.shape)
        lengths_m = np.hypot(*(ends - starts).T)
        directions = (ends - starts) / np.maximum(lengths_m, self._rounding_m)[:, None]
        are_free = np.ones(len(ends), dtype=bool)
        # Part by part: most lines are blocked near the start.
        first_m, last_m = 0.0, 2.0 * self._octagons.square_m
        while len(left := np.flatnonzero(are_free & (lengths_m >= first_m))):
            for some in np.split(left, range(LINES_AT_ONCE, len(left), LINES_AT_ONCE)):
                along = directions[some]
                firsts = starts[some] + first_m * along
                lasts = starts[some] + np.minimum(lengths_m[some], last_m)[:, None] * along
                blocked, *_ = self._octagons.crossings(firsts, lasts)
                are_free[some[blocked]] = False
            first_m, last_m = last_m, 4.0 * last_m
        return are_free

    def are_tangent(self, corners: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """Return whether a line in each direction (lines, 2) passes by its corner, which has this number."""
        turns = [cross(towards, side[corners]) for side in self._sides]
        return (np.minimum(*turns) >= -self._rounding_m) | (np.maximum(*turns) <= self._rounding_m)

    def regions_of(self, points) -> np.ndarray:
        """Return the number of the connected region that each free point (points, 2) is in."""
        return self._regions.of(np.asarray(points, dtype=float).reshape(-1, 2))

    @functools.cached_property
    def _regions(self) -> Regions:
        return Regions(self._octagons)

    def path(self, start_m, goal_m) -> list[tuple[float, float]] | None:
        """Return the points of the shortest path, in metres; None if an end is not free, or cut off."""
        ends = np.array([start_m, goal_m], dtype=float)
        if not self.are_free(ends).all() or len(set(self.regions_of(ends))) > 1:
            return None
        for _, path in VisibilityGraph(self, ends).paths(np.array([(0, 1)])):
            return list(map(tuple, path.tolist()))
        return None

    @staticmethod
    def length_m(path) -> float:
        """Return the length of a path in metres."""
        return sum(itertools.starmap(math.dist, itertools.pairwise(path)))


def _inflated(tables: list[Table], walls: Walls, radius_m: float, tag_poses: Iterable[TagPose]) -> Octagons:
    """Return the octagons of tables, plates and walls, without those that lie in another one."""
    x0, y0, x1, y1 = walls
    left, bottom, right, top = x0 - WALL_M, y0 - WALL_M, x1 + WALL_M, y1 + WALL_M
    around = [
        (left, bottom, right, y0),
        (left, y1, right, top),
        (left, bottom, x0, top),
        (x1, bottom, right, top),
    ]
    rectangles = np.array([*tables, *around])
    plates = np.array([each.ends_of_plate() for each in tag_poses])
    low, high = [], []
    for shapes in rectangles[:, [[0, 1], [0, 3], [2, 1], [2, 3]]], plates:
        along = shapes.clip((left, bottom), (right, top)) @ AXES
        low.append(along.min(axis=1) - radius_m * AXIS_LENGTHS)
        high.append(along.max(axis=1) + radius_m * AXIS_LENGTHS)
    return Octagons(np.concatenate(low), np.concatenate(high)).without_those_in_others()


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product of each vector (vectors, 2) of one array with that of the other."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
