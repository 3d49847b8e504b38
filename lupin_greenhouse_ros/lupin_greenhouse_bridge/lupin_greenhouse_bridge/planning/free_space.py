# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
The free space of a disc robot in a greenhouse, and the shortest paths in it. Does not import ROS.

Each table and each plate of a tag is inflated by the robot's radius to an octagon. A shortest path is
straight between vertices of these octagons, so it is exact, and the robot passes wherever it fits. A grid
would need cells as small as the clearance in the narrowest aisle.
"""

import heapq
import itertools
import math

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.tag_poses import Table, find_tag_poses, tables_of
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

# An octagon is eight limits: the lowest and the highest value of x, y, x + y and x - y.
AXES = np.array([(1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0)]).T
LENGTHS = np.linalg.norm(AXES, axis=0)


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
        self._inside = np.array([x0, y0]) + radius_m, np.array([x1, y1]) - radius_m
        self._tolerance_m = 1e-9 + 4e-15 * max(map(abs, walls))  # of the numbers, far from the origin
        shapes = [_corners(each) for each in tables_of(layout)]
        shapes += [each.ends_of_plate() for each in self.tag_poses.values()]
        octagons: list[tuple[np.ndarray, np.ndarray]] = []  # without those that lie within another
        for shape in shapes:
            along = shape @ AXES
            low, high = along.min(axis=0) - radius_m * LENGTHS, along.max(axis=0) + radius_m * LENGTHS
            if not any((a <= low).all() and (high <= b).all() for a, b in octagons):
                octagons.append((low, high))
        self._low, self._high = np.array(octagons).swapaxes(0, 1)
        self._low, self._high = self._low + self._tolerance_m, self._high - self._tolerance_m
        vertices = np.array([_vertices(*each) for each in octagons])  # (octagon, 8, 2)
        points = vertices.reshape(-1, 2)
        is_free = self.are_free(points)
        self._corners = points[is_free]
        sides = [np.roll(vertices, turn, axis=1) - vertices for turn in (1, -1)]
        self._sides = [each.reshape(-1, 2)[is_free] for each in sides]  # from a corner to those beside it
        self._between: list[list[tuple[int, float]]] | None = None

    def are_free(self, points) -> np.ndarray:
        """Return for each point, of an array (points, 2) in metres, whether the robot can be there."""
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        low, high = self._inside
        is_free = ((points >= low - self._tolerance_m) & (points <= high + self._tolerance_m)).all(axis=1)
        with np.errstate(invalid='ignore'):  # of a point at infinity, which is not free
            along = points @ AXES
        for low, high in zip(self._low, self._high, strict=True):
            is_free &= ~((along > low) & (along < high)).all(axis=1)
        return is_free

    def is_free(self, x: float, y: float) -> bool:
        """Return whether the robot's centre can be at this point."""
        return bool(self.are_free([(x, y)])[0])

    def are_in_sight(self, start, ends) -> np.ndarray:
        """
        Return whether the straight line is free from one free point, or from each, to each of an array.

        The arrays have the shape (points, 2), in metres.
        """
        starts, ends = (np.asarray(each, dtype=float).reshape(-1, 2) @ AXES for each in (start, ends))
        starts = np.broadcast_to(starts, ends.shape)
        is_free = np.ones(len(ends), dtype=bool)
        if len(ends) < len(self._low):
            for number, line in enumerate(zip(starts, ends, strict=True)):
                is_free[number] = not len(_crossing(*line, self._low, self._high))
            return is_free
        for low, high in zip(self._low, self._high, strict=True):
            left = np.flatnonzero(is_free)
            is_free[left[_crossing(starts[left], ends[left], low, high)]] = False
        return is_free

    def point_of_largest_region(self) -> tuple[float, float]:
        """Return a point of the free region with the most vertices of octagons and corners of the walls."""
        (x0, y0), (x1, y1) = self._inside
        corners = np.array([(x, y) for x in (x0, x1) for y in (y0, y1)])
        corners = corners[self.are_free(corners)]
        nodes, links = np.concatenate([self._corners, corners]), self.links(corners)
        left, largest = set(range(len(nodes))), []
        while left:
            region = [left.pop()]
            for node in region:  # grows
                new = {other for other, _ in links[node]} & left
                left -= new
                region += new
            largest = max(largest, region, key=len)
        if not largest:
            raise StartUpError('tables and tags leave no free space for the robot: choose a smaller radius')
        return tuple(nodes[max(largest)].tolist())

    def path(self, start_m, goal_m) -> list[tuple[float, float]] | None:
        """Return the points of the shortest path, in metres; None if an end is not free, or cut off."""
        ends = np.array([start_m, goal_m], dtype=float)
        if not self.are_free(ends).all():
            return None
        return VisibilityGraph(self, ends).path(0, 1)

    @staticmethod
    def length_m(path) -> float:
        """Return the length of a path in metres."""
        return sum(itertools.starmap(math.dist, itertools.pairwise(path)))

    def links(self, points: np.ndarray) -> list[list[tuple[int, float]]]:
        """
        Return for each corner, and then for each free point, the nodes in sight and their distances.

        Nodes are numbered in this order. A shortest path turns only at a corner, and there only around it.
        """
        if self._between is None:
            self._between = [[] for _ in self._corners]
            self._link(self._between, self._corners, _pairs(len(self._corners)))
        count = len(self._corners)
        nodes = np.concatenate([self._corners, points])
        links = [list(each) for each in self._between] + [[] for _ in points]
        to_corners = np.indices((count, len(points))).reshape(2, -1).T + np.array([0, count])
        self._link(links, nodes, np.concatenate([to_corners, _pairs(len(points)) + count]))
        return links

    def _link(self, links, nodes: np.ndarray, pairs: np.ndarray) -> None:
        """Add to links each pair of nodes that are in sight of each other."""
        for one, other in ((0, 1), (1, 0)):
            at_corner = pairs[:, one] < len(self._corners)
            corner, across = pairs[at_corner, one], nodes[pairs[at_corner, other]]
            towards = across - nodes[corner]
            turns = [_cross(towards, side[corner]) for side in self._sides]
            is_tangent = np.ones(len(pairs), dtype=bool)
            is_tangent[at_corner] = (np.minimum(*turns) >= -self._tolerance_m) | (
                np.maximum(*turns) <= self._tolerance_m
            )
            pairs = pairs[is_tangent]
        starts, ends = nodes[pairs[:, 0]], nodes[pairs[:, 1]]
        in_sight = self.are_in_sight(starts, ends)
        lengths_m = np.linalg.norm(ends - starts, axis=1)
        for (one, other), length_m in zip(
            pairs[in_sight].tolist(), lengths_m[in_sight].tolist(), strict=True
        ):
            links[one].append((other, length_m))
            links[other].append((one, length_m))


class VisibilityGraph:
    """The shortest paths between some free points, by their numbers."""

    def __init__(self, free_space: FreeSpace, points: np.ndarray):
        """Take an array (points, 2) in metres."""
        self._links = free_space.links(points)
        self._first = len(self._links) - len(points)  # the node of point 0
        self._nodes = [*map(tuple, free_space._corners.tolist()), *map(tuple, points.tolist())]

    def nearest(self, start: int):
        """Yield each other point that can be reached, and the length of the path in metres, nearest first."""
        for node, length_m, _ in self._search(start):
            if node >= self._first:
                yield node - self._first, length_m

    def corners_from(self, start: int) -> np.ndarray:
        """Return the corners that can be reached from a point, in an array (corners, 2)."""
        nodes = [node for node, _, _ in self._search(start) if node < self._first]
        return np.array([self._nodes[node] for node in nodes]).reshape(-1, 2)

    def path(self, start: int, goal: int) -> list[tuple[float, float]] | None:
        """Return the points of the shortest path; None if there is none."""
        if start == goal:
            return [self._nodes[self._first + start]] * 2
        for node, _, before in self._search(start):
            if node == self._first + goal:
                path = [node]
                while path[-1] != self._first + start:
                    path.append(before[path[-1]])
                return [self._nodes[each] for each in reversed(path)]
        return None

    def _search(self, start: int):
        """Yield each other node with its distance, nearest first, and the node before each (Dijkstra)."""
        source = self._first + start
        distances_m, before, done = {source: 0.0}, {}, set()
        heap = [(0.0, source)]
        while heap:
            distance_m, node = heapq.heappop(heap)
            if node in done:
                continue
            done.add(node)
            if node != source:
                yield node, distance_m, before
                if node >= self._first:
                    continue  # no path turns at another point
            for other, length_m in self._links[node]:
                if distance_m + length_m < distances_m.get(other, math.inf):
                    distances_m[other] = distance_m + length_m
                    before[other] = node
                    heapq.heappush(heap, (distance_m + length_m, other))


def _crossing(start, end, low, high) -> np.ndarray:
    """
    Return the numbers of the straight lines that enter an octagon.

    Takes each along the AXES: many lines and the limits of one octagon, or one line and many octagons.
    """
    start, end, low, high = np.broadcast_arrays(start, end, low, high)
    near = np.arange(len(start))
    for axis in range(4):  # leave out what lies on one side
        a, b = start[near, axis], end[near, axis]
        near = near[(np.maximum(a, b) > low[near, axis]) & (np.minimum(a, b) < high[near, axis])]
    start, end, low, high = (each[near] for each in (start, end, low, high))
    with np.errstate(divide='ignore', invalid='ignore'):
        meets = np.sort([(limit - start) / (end - start) for limit in (low, high)], axis=0)
    first, last = np.fmax(meets[0], 0.0).max(axis=1), np.fmin(meets[1], 1.0).min(axis=1)
    return near[first < last]


def _pairs(count: int) -> np.ndarray:
    """Return the numbers of each pair of things, in an array (pairs, 2)."""
    return np.stack(np.triu_indices(count, 1), axis=1)


def _corners(table: Table) -> np.ndarray:
    return np.array([(x, y) for x in (table.x0, table.x1) for y in (table.y0, table.y1)])


def _vertices(low: np.ndarray, high: np.ndarray) -> list[tuple[float, float]]:
    """Return the corners of an octagon, counter-clockwise."""
    (x0, y0, sum0, difference0), (x1, y1, sum1, difference1) = low, high
    return [
        (x1, x1 - difference1),
        (x1, sum1 - x1),
        (sum1 - y1, y1),
        (difference0 + y1, y1),
        (x0, x0 - difference0),
        (x0, sum0 - x0),
        (sum0 - y0, y0),
        (difference1 + y0, y0),
    ]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
