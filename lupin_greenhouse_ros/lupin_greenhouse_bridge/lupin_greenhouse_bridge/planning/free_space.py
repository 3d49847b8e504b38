# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
The free space of a disc robot in a greenhouse, and the shortest paths in it. Does not import ROS.

Each table and each plate of a tag is inflated by the robot's radius to an octagon. A shortest path is
straight between vertices of these octagons, so it is exact, and the robot passes wherever it fits. A grid
would need cells as small as the clearance in the narrowest aisle.
"""

import functools
import heapq
import itertools
import math

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.grid import Grid
from lupin_greenhouse_bridge.planning.tag_poses import find_tag_poses, tables_of
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

# An octagon is eight limits: the lowest and the highest value of x, y, x + y and x - y.
AXES = np.array([(1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0)]).T
LENGTHS = np.linalg.norm(AXES, axis=0)
REACH = 4.0  # cells of the grid: how far links are sought first
AT_ONCE = 512  # nodes whose links are computed together, and lines that are tested


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
        self.diagonal_m = math.hypot(x1 - x0, y1 - y0)
        self.tolerance_m = 1e-9 + 4e-15 * max(map(abs, walls))  # of the numbers, far from the origin
        tables = np.array(tables_of(layout)).reshape(-1, 4)
        plates = np.array([each.ends_of_plate() for each in self.tag_poses.values()])
        along = [shapes @ AXES for shapes in (tables[:, [[0, 1], [0, 3], [2, 1], [2, 3]]], plates)]
        low = np.concatenate([each.min(axis=1) for each in along]) - radius_m * LENGTHS
        high = np.concatenate([each.max(axis=1) for each in along]) + radius_m * LENGTHS
        is_outer = ~_are_within_another(low, high)
        low, high = low[is_outer], high[is_outer]
        self._octagons = Grid(low[:, :2], high[:, :2])
        self._low, self._high = low + self.tolerance_m, high - self.tolerance_m
        vertices = _vertices(low, high)  # (octagons, 8, 2)
        points = vertices.reshape(-1, 2)
        is_free = self.are_free(points)
        self.corners = points[is_free]
        sides = [np.roll(vertices, turn, axis=1) - vertices for turn in (1, -1)]
        self._sides = [each.reshape(-1, 2)[is_free] for each in sides]  # from a corner to those beside it

    def are_free(self, points) -> np.ndarray:
        """Return for each point, of an array (points, 2) in metres, whether the robot can be there."""
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        low, high = self._inside
        is_free = ((points >= low - self.tolerance_m) & (points <= high + self.tolerance_m)).all(axis=1)
        inside = np.flatnonzero(is_free)
        places, octagons = self._octagons.near(points[inside], points[inside])
        along = points[inside[places]] @ AXES
        is_taken = ((along > self._low[octagons]) & (along < self._high[octagons])).all(axis=1)
        is_free[inside[places[is_taken]]] = False
        return is_free

    def is_free(self, x: float, y: float) -> bool:
        """Return whether the robot's centre can be at this point."""
        return bool(self.are_free([(x, y)])[0])

    def are_in_sight(self, start, ends) -> np.ndarray:
        """Return whether the line from a free point, or from each, to each free point (points, 2) is free."""
        ends = np.asarray(ends, dtype=float).reshape(-1, 2)
        starts = np.broadcast_to(np.asarray(start, dtype=float).reshape(-1, 2), ends.shape)
        is_free = np.ones(len(ends), dtype=bool)
        lengths_m = np.abs(ends - starts).max(axis=1)
        first_m, last_m = 0.0, 2.0 * self._octagons.cell_m
        # Part by part: most lines are blocked near the start.
        while len(left := np.flatnonzero(is_free & (lengths_m >= first_m))):
            for part in _parts(left):
                start, end, length_m = starts[part], ends[part], lengths_m[part, None]
                first = start + first_m / np.maximum(length_m, 1e-12) * (end - start)
                last = start + last_m / np.maximum(length_m, last_m) * (end - start)
                is_free[part] = ~self._are_blocked(first, np.where(length_m > last_m, last, end))
            first_m, last_m = last_m, 4.0 * last_m
        return is_free

    def _are_blocked(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return whether each line enters an octagon."""
        lines, octagons = self._octagons.along(starts, ends)
        starts, ends = starts @ AXES, ends @ AXES
        least, most = np.minimum(starts, ends), np.maximum(starts, ends)
        near = np.arange(len(lines))
        for axis in range(4):  # leave out what lies on one side
            line, octagon = lines[near], octagons[near]
            low, high = self._low[octagon, axis], self._high[octagon, axis]
            near = near[(most[line, axis] > low) & (least[line, axis] < high)]
        start, end = starts[lines[near]], ends[lines[near]]
        with np.errstate(divide='ignore', invalid='ignore'):
            meets = np.sort(
                [(limit[octagons[near]] - start) / (end - start) for limit in (self._low, self._high)], axis=0
            )
        first, last = np.fmax(meets[0], 0.0).max(axis=1), np.fmin(meets[1], 1.0).min(axis=1)
        are_blocked = np.zeros(len(starts), dtype=bool)
        are_blocked[lines[near[first < last]]] = True
        return are_blocked

    def are_tangent(self, corners: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """Return whether a line in each direction (lines, 2) passes by its corner, which has this number."""
        turns = [cross(towards, side[corners]) for side in self._sides]
        return (np.minimum(*turns) >= -self.tolerance_m) | (np.maximum(*turns) <= self.tolerance_m)

    def point_of_largest_region(self) -> tuple[float, float]:
        """Return a point of the free region with the most vertices of octagons and corners of the walls."""
        graph, regions = self._regions
        if not len(regions):
            raise StartUpError('tables and tags leave no free space for the robot: choose a smaller radius')
        return tuple(graph.nodes[np.flatnonzero(regions == np.bincount(regions).argmax())[-1]].tolist())

    def regions_of(self, points: np.ndarray) -> np.ndarray:
        """Return the number of the region of each free point (points, 2); -1 if it sees all of its region."""
        graph, regions = self._regions
        found = np.full(len(points), -1)
        for reach_m in graph.reaches_m():
            for part in _parts(np.flatnonzero(found < 0)):
                whose, nodes = graph.seen_from(points[part], reach_m)
                found[part[whose]] = regions[nodes]
        return found

    @functools.cached_property
    def _regions(self) -> tuple['VisibilityGraph', np.ndarray]:
        """The corners and those of the walls, and the number of the region of each."""
        (x0, y0), (x1, y1) = self._inside
        corners = np.array([(x, y) for x in (x0, x1) for y in (y0, y1)])
        graph = VisibilityGraph(self, corners[self.are_free(corners)])
        return graph, graph.regions()

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


class VisibilityGraph:
    """
    The shortest paths between some free points, by their numbers.

    Its nodes are the corners, and then the points. A node's links are computed when a search comes as far.
    """

    def __init__(self, free_space: FreeSpace, points: np.ndarray):
        """Take an array (points, 2) in metres."""
        self._free_space = free_space
        self._first = len(free_space.corners)  # the node of point 0
        self.nodes = np.concatenate([free_space.corners, points])
        self._grid = Grid(self.nodes, self.nodes)
        self._points = list(map(tuple, self.nodes.tolist()))
        self._links: list[list[tuple[float, int]]] = [[] for _ in self._points]  # the shortest first
        self._known_m = np.zeros(len(self.nodes))  # all shorter links are known

    def nearest(self, start: int):
        """Yield each other point that can be reached, and the length of the path in metres, nearest first."""
        for node, length_m, _ in self._search(start):
            if node >= self._first:
                yield node - self._first, length_m

    def path(self, start: int, goal: int) -> list[tuple[float, float]] | None:
        """Return the points of the shortest path; None if there is none."""
        if start == goal:
            return [self._points[self._first + start]] * 2
        for node, _, before in self._search(start):
            if node == self._first + goal:
                path = [node]
                while path[-1] != self._first + start:
                    path.append(before[path[-1]])
                return [self._points[each] for each in reversed(path)]
        return None

    def _search(self, start: int):
        """Yield each other node with its distance, nearest first, and the node before each (Dijkstra)."""
        source = self._first + start
        before, begins_m, heap = {}, {source: 0.0}, []

        def add(node: int, number: int) -> None:
            """Add the next link of a node, or the place where those that are known end."""
            links = self._links[node]
            length_m = links[number][0] if number < len(links) else float(self._known_m[node])
            if length_m < math.inf:
                heapq.heappush(heap, (begins_m[node] + length_m, node, number))

        add(source, 0)
        while heap:
            distance_m, node, number = heapq.heappop(heap)
            if number == len(self._links[node]):
                self._extend(node)
                add(node, number)
                continue
            length_m, other = self._links[node][number]
            if begins_m[node] + length_m > distance_m:  # the known links ended here before
                add(node, number)
                continue
            add(node, number + 1)
            if other in begins_m:
                continue
            begins_m[other], before[other] = distance_m, node
            yield other, distance_m, before
            if other < self._first:  # no path turns at another point
                add(other, 0)

    def reaches_m(self, known_m: float = 0.0):
        """Yield growing distances in metres, and at last the one from wall to wall."""
        reach_m = max(REACH * self._grid.cell_m, 2.0 * known_m)
        while reach_m < self._free_space.diagonal_m:
            yield reach_m
            reach_m *= 2.0
        yield self._free_space.diagonal_m

    def _extend(self, node: int) -> None:
        """Find longer links of a node, and of those around it if they are not long."""
        known_m, shortest_m = self._known_m[node], next(self.reaches_m())
        numbers = np.array([node])
        if known_m <= shortest_m:
            around = self.nodes[numbers]
            _, near = self._grid.near(around - 2 * shortest_m, around + 2 * shortest_m)
            near = near[(self._known_m[near] == known_m) & (near != node)]
            numbers = np.append(numbers, near[:AT_ONCE])
        self._find_links(numbers, known_m, next(self.reaches_m(known_m)))

    def _find_links(self, numbers: np.ndarray, known_m: float, reach_m: float) -> None:
        """Add the links of these nodes up to a length, of which those up to another are known."""
        whose, others, lengths_m = self._links_within(numbers, reach_m, known_m)
        for node, *link in zip(numbers[whose].tolist(), lengths_m.tolist(), others.tolist(), strict=True):
            self._links[node].append(tuple(link))
        self._known_m[numbers] = reach_m if reach_m < self._free_space.diagonal_m else math.inf

    def _links_within(
        self, numbers: np.ndarray, reach_m: float, known_m: float = 0.0, regions: np.ndarray | None = None
    ):
        """
        Return the places of nodes among these, the nodes that each is linked to, and the lengths.

        The shortest links of each come first. Two nodes are linked if the line between them is free, and
        passes by the octagons at both. What is behind a corner, in a line with it, is linked to that corner
        alone. With the numbers of regions, return any free lines between two of them instead.
        """
        starts = self.nodes[numbers]
        whose, others = self._grid.near(starts - reach_m, starts + reach_m)
        if regions is not None:
            is_apart = regions[numbers[whose]] != regions[others]
            whose, others = whose[is_apart], others[is_apart]
        towards = self.nodes[others] - starts[whose]
        lengths_m, angles = np.hypot(*towards.T), np.arctan2(*towards.T[::-1])
        left = np.flatnonzero((lengths_m <= reach_m) & (numbers[whose] != others))
        for ends in (others, numbers[whose]) if regions is None else ():
            left = left[self._are_tangent(ends[left], towards[left])]
        left = left[self._are_first(whose[left], others[left], angles[left], lengths_m[left])]
        left = left[(lengths_m[left] > known_m) | (known_m == 0.0)]
        left = left[self._free_space.are_in_sight(starts[whose[left]], self.nodes[others[left]])]
        left = left[np.lexsort((others[left], lengths_m[left], whose[left]))]
        return whose[left], others[left], lengths_m[left]

    def _are_tangent(self, numbers: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """Return whether a line in each direction (lines, 2) passes by its node, which may be a corner."""
        are_tangent = numbers >= self._first
        at = np.flatnonzero(~are_tangent)
        are_tangent[at] = self._free_space.are_tangent(numbers[at], towards[at])
        return are_tangent

    def _are_first(self, whose, others, angles, lengths_m) -> np.ndarray:
        """Return whether no corner is before each of these nodes, in a line with it."""
        directions = np.round(angles, 12)
        order = np.lexsort((lengths_m, directions, whose))
        is_corner = (others < self._first) & (lengths_m > self._free_space.tolerance_m)
        before = np.cumsum(is_corner[order]) - is_corner[order]
        is_line = np.ones(len(order), dtype=bool)
        is_line[1:] = np.diff(whose[order]).astype(bool) | np.diff(directions[order]).astype(bool)
        are_first = np.empty(len(order), dtype=bool)
        are_first[order] = before == before[is_line][np.cumsum(is_line) - 1]
        return are_first

    def seen_from(self, points: np.ndarray, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Return pairs of the number of a free point (points, 2) and of a node that its paths may turn at."""
        whose, nodes = self._grid.near(points - reach_m, points + reach_m)
        is_tangent = self._are_tangent(nodes, self.nodes[nodes] - points[whose])
        whose, nodes = whose[is_tangent], nodes[is_tangent]
        are_seen = self._free_space.are_in_sight(points[whose], self.nodes[nodes])
        return whose[are_seen], nodes[are_seen]

    def regions(self) -> np.ndarray:
        """Return for each node the number of its region, which is the same where nodes are connected."""
        reach_m = next(self.reaches_m())
        for numbers in _parts(np.arange(len(self.nodes))):
            self._find_links(numbers, 0.0, reach_m)
        found, left = np.full(len(self.nodes), -1), {}
        for node in range(len(found)):
            if found[node] < 0:
                left[node], found[node] = [node], node
                for each in left[node]:  # grows
                    for _, other in self._links[each]:
                        if found[other] < 0:
                            found[other] = node
                            left[node].append(other)
        while len(left) > 1:  # seek a longer link from the smallest region
            region = min(left, key=lambda each: len(left[each]))
            nodes = left.pop(region)
            for reach_m, numbers in itertools.product(self.reaches_m(), _parts(np.array(nodes))):
                _, others, _ = self._links_within(numbers, reach_m, regions=found)
                if len(others):
                    into = int(found[others[0]])
                    found[nodes] = into
                    left.get(into, []).extend(nodes)
                    break
        return found


def _parts(numbers: np.ndarray) -> list[np.ndarray]:
    return np.split(numbers, range(AT_ONCE, len(numbers), AT_ONCE))


def _are_within_another(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return whether each octagon lies within another; of equal ones, the first does not."""
    centres = (low + high)[:, :2] / 2.0
    inner, outer = Grid(low[:, :2], high[:, :2]).near(centres, centres)
    is_within = (low[outer] <= low[inner]).all(axis=1) & (high[inner] <= high[outer]).all(axis=1)
    is_equal = (low[outer] == low[inner]).all(axis=1) & (high[inner] == high[outer]).all(axis=1)
    is_within &= ~is_equal | (outer < inner)
    found = np.zeros(len(low), dtype=bool)
    found[inner[is_within]] = True
    return found


def _vertices(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the corners of octagons, counter-clockwise, in an array (octagons, 8, 2)."""
    (x0, y0, sum0, difference0), (x1, y1, sum1, difference1) = low.T, high.T
    xs = x1, x1, sum1 - y1, difference0 + y1, x0, x0, sum0 - y0, difference1 + y0
    ys = x1 - difference1, sum1 - x1, y1, y1, x0 - difference0, sum0 - x0, y0, y0
    return np.stack([np.stack(xs, axis=1), np.stack(ys, axis=1)], axis=2)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product of each vector (vectors, 2) of one array with that of the other."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
