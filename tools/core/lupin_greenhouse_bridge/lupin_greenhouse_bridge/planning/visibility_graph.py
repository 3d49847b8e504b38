"""The shortest paths between points of a free space. Does not import ROS."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree

from lupin_greenhouse_bridge.planning.free_space import FreeSpace, Point
from lupin_greenhouse_bridge.planning.octagons import Numbers

NEAREST = 256  # nodes to which a node can be linked
NODES_AT_ONCE = 4096
DISTANCES_AT_ONCE = 2**22


def shortest_path(free_space: FreeSpace, start_m: ArrayLike, goal_m: ArrayLike) -> list[Point] | None:
    """Return the points of the shortest path, in metres; None if an end is not free, or cut off."""
    ends = np.stack([start_m, goal_m])
    if not free_space.are_free(ends).all() or len(set(free_space.regions_of(ends))) > 1:
        return None
    graph = VisibilityGraph(free_space, ends)
    for _, nodes in graph.paths(np.array([(0, 1)])):
        return graph.points_m(nodes)
    return None


class VisibilityGraph:
    """
    The shortest paths between free points, which go straight from corner to corner of the octagons.

    The nodes are the corners, and then the points. Two nodes are linked if the line between them is free and
    passes by the octagons at both. A node is linked only to nodes among the 256 nearest. With no more nodes,
    as in a greenhouse of 29 tags, each path is the shortest one; with more, a long path can be some
    thousandths longer. If some points have no path although they are connected, more nodes are linked.
    """

    def __init__(self, free_space: FreeSpace, points: np.ndarray):
        """Take the points in metres in an array (points, 2)."""
        self._free_space = free_space
        self._first = len(free_space.corners)  # the node of point 0
        self._nodes = np.concatenate([free_space.corners, points])
        self._nearest = NEAREST
        self._graph = self._linked()
        while self._nearest < len(self._nodes) and self._lacks_paths():
            self._nearest *= 4
            self._graph = self._linked()

    def lengths_m(self, neighbours: int) -> Iterator[tuple[int, np.ndarray]]:
        """
        Yield the number of each point, and the lengths of the paths from it to all points, in metres.

        Only the lengths to the nearest others are finite, at least to so many neighbours if it has them. A
        point can come again, with more of them.
        """
        points = self._nodes[self._first :]
        limits_m = np.full(len(points), np.inf)
        if neighbours + 1 < len(points):
            limits_m = 1.5 * KDTree(points).query(points, [neighbours + 1])[0][:, 0]
        left = np.arange(len(points))
        while len(left):
            lack_neighbours = []
            for place, lengths_m, _ in self._search(self._graph, left, limits_m[left]):
                point, found_m = left[place], lengths_m[self._first :]
                yield point, found_m
                if np.isfinite(found_m).sum() <= neighbours and limits_m[point] < np.inf:
                    lack_neighbours.append(point)
            left = np.array(lack_neighbours, dtype=int)
            limits_m[left] *= np.where(limits_m[left] < self._free_space.diagonal_m, 4.0, np.inf)

    def paths(self, legs: np.ndarray) -> Iterator[tuple[int, list[int]]]:
        """
        Yield the number of each leg that has a path, and the nodes of its shortest path.

        Takes the number of the first and of the last point of each leg, (legs, 2).
        """
        starts, ends = self._first + legs.T
        straight_m = np.hypot(*(self._nodes[ends] - self._nodes[starts]).T)
        left = np.arange(len(legs))
        for limits_m in (2.0 * straight_m, np.full(len(legs), np.inf)):
            longer = []
            for place, lengths_m, before in self._search(self._graph, legs[left, 0], limits_m[left]):
                leg = left[place]
                if np.isfinite(lengths_m[ends[leg]]):
                    yield leg, _trace(before, ends[leg])
                else:
                    longer.append(leg)
            left = np.array(longer, dtype=int)

    def points_m(self, nodes: list[int]) -> list[Point]:
        """Return the points of a path, in metres."""
        return list(map(tuple, self._nodes[nodes].tolist()))

    def _search(
        self, graph: csr_matrix, points: np.ndarray, limits_m: np.ndarray
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """
        Search for paths from these points that are not longer than the limit of each, or than a larger one.

        Yields the place of each point in the array, the lengths of the paths from it to all nodes, and the
        nodes before them.
        """
        at_once = max(1, DISTANCES_AT_ONCE // len(self._nodes))
        order = np.argsort(limits_m)
        for begin in range(0, len(order), at_once):
            some = order[begin : begin + at_once]
            lengths_m, before = dijkstra(
                graph,
                indices=self._first + points[some],
                limit=limits_m[some[-1]],
                return_predecessors=True,
            )
            yield from zip(some, lengths_m, before, strict=True)

    def _linked(self) -> csr_matrix:
        """Return the matrix of the lengths of the links."""
        tree, count = KDTree(self._nodes), len(self._nodes)
        links = []
        for first in range(0, count, NODES_AT_ONCE):
            numbers = np.arange(first, min(first + NODES_AT_ONCE, count))
            others = tree.query(self._nodes[numbers], min(self._nearest, count))[1].ravel()
            numbers = np.repeat(numbers, len(others) // len(numbers))
            numbers, others = np.minimum(numbers, others), np.maximum(numbers, others)
            towards = self._nodes[others] - self._nodes[numbers]
            is_link = self._are_tangent(numbers, towards) & self._are_tangent(others, towards)
            is_link &= numbers != others
            links.append(np.unique(numbers[is_link] * count + others[is_link]))
        numbers, others = np.divmod(np.unique(np.concatenate(links)), count)
        are_in_sight = self._free_space.are_in_sight(self._nodes[numbers], self._nodes[others])
        numbers, others = numbers[are_in_sight], others[are_in_sight]
        lengths_m = np.hypot(*(self._nodes[numbers] - self._nodes[others]).T).clip(
            1e-12
        )  # 0 would be no link
        graph = csr_matrix((lengths_m, (numbers, others)), shape=(count, count))
        return graph + graph.T

    def _are_tangent(self, numbers: Numbers, towards: np.ndarray) -> np.ndarray:
        """Return whether a line in each direction (lines, 2) passes by its node, which may be a corner."""
        are_tangent = np.ones(len(numbers), dtype=bool)
        is_corner = numbers < self._first
        are_tangent[is_corner] = self._free_space.are_tangent(numbers[is_corner], towards[is_corner])
        return are_tangent

    def _lacks_paths(self) -> bool:
        """Return whether points have no path to others of their region."""
        regions = self._free_space.regions_of(self._nodes[self._first :])
        _, parts = connected_components(self._graph, directed=False)
        return len(set(zip(regions, parts[self._first :], strict=True))) > len(set(regions))


def _trace(before: np.ndarray, goal: int) -> list[int]:
    """Return the nodes of a path to this goal, from the node before each node."""
    nodes = [goal]
    while before[nodes[-1]] >= 0:
        nodes.append(before[nodes[-1]])
    return nodes[::-1]
