"""
One occupancy grid of walls, tables, tags and a map: where the centre of a disc robot can be. No ROS.

A cell is free if the nearest obstacle is at least the radius and SMALLEST_ROOM_M away from its centre. Paths
lead through the centres of free cells, and are then pulled taut.
"""

import functools
import itertools
import math
from collections.abc import Iterable

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.simulator.layout import Layout
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra

from lupin_planning.occupancy import OccupancyMap
from lupin_planning.tag_poses import EQUAL_M, distances_m, tables_of
from lupin_planning.walls import Walls

SMALLEST_ROOM_M = 0.01  # beyond the robot's radius, as the footprint_padding of Nav2
CELL_M = 0.02
MOST_CELLS = 1_250_000  # 500 square metres; a larger greenhouse has larger cells
STEPS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2))  # and back: 16 directions
MARGIN_M = 1.0  # around the ends of a path, where it is searched for first
FAR_M = 2.0  # distances to obstacles are exact up to here
ROUNDING_M = 1e-3  # of distances between the centres of cells

Point = tuple[float, float]
Window = tuple[int, int, int, int]  # of the grid: first column and row, and those behind the last
Flags = NDArray[np.bool_]
Numbers = NDArray[np.intp]


class Grid:
    """The free cells of a greenhouse, their connected regions, and the paths through them."""

    def __init__(
        self, layout: Layout, walls: Walls, radius_m: float, occupancy: OccupancyMap | None = None
    ) -> None:
        """
        Take the radius of the robot, and a map in the frame of the layout.

        Raises StartUpError for a table without an area, or a robot that does not fit between the walls.
        """
        x0, y0, x1, y1 = self._walls = walls
        self.robot_radius_m, self._needed_m = radius_m, radius_m + SMALLEST_ROOM_M
        apart_m = min(x1 - x0, y1 - y0)
        if not 2 * self._needed_m < apart_m:
            raise StartUpError(
                f'a robot of radius {radius_m:g} m does not fit between the walls, which are {apart_m:g} m'
                ' apart: choose a smaller radius, or set walls'
            )
        self.cell_m = max(CELL_M, math.sqrt((x1 - x0) * (y1 - y0) / MOST_CELLS))
        columns, rows = (math.ceil(side_m / self.cell_m - EQUAL_M) for side_m in (x1 - x0, y1 - y0))
        self._xs = x0 + (np.arange(columns) + 0.5) * self.cell_m
        self._ys = y0 + (np.arange(rows) + 0.5) * self.cell_m
        tags = [(x, y, x, y) for x, y, _ in layout.tags.values()]
        self._boxes = np.array([*tables_of(layout), *tags])
        self._distances_m = self._distances_in_layout_m()
        self._map_distances_m = np.full((columns, rows), FAR_M)
        if occupancy is not None:
            self._map_distances_m = self._distances_in_map_m(occupancy)
            self._distances_m = np.minimum(self._distances_m, self._map_distances_m)
        self._free = self._distances_m >= self._needed_m - EQUAL_M
        self._regions, self.region_count = ndimage.label(self._free, np.ones((3, 3)))
        # The column and row of the free cell that is nearest to each cell, (2, columns, rows).
        self._nearest_free = ndimage.distance_transform_edt(
            ~self._free, return_distances=False, return_indices=True
        )
        self._graph = functools.lru_cache(2)(self._graph_of)

    @property
    def warning(self) -> str:
        """What the grid may miss because its cells are large, or ''."""
        if self.cell_m <= CELL_M:
            return ''
        narrowest_m = 2 * self._needed_m + self.cell_m
        return f'cells of {100 * self.cell_m:.1f} cm: passages of less than {narrowest_m:.2f} m may be missed'

    def layout_distances_m(self, points: ArrayLike) -> np.ndarray:
        """Return the distance of each point (points, 2) to the nearest wall, table or tag."""
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        x0, y0, x1, y1 = self._walls
        x, y = points.T
        away_m = np.min([x - x0, y - y0, x1 - x, y1 - y], axis=0)  # below 0 beyond the walls
        if len(points):
            middle = points.mean(axis=0)
            reach_m = FAR_M + float(np.hypot(*(points - middle).T).max())
            near = self._boxes[distances_m(self._boxes, middle) <= reach_m]
            away_m = np.minimum(away_m, distances_m(near, points[:, None]).min(axis=1, initial=np.inf))
        return np.asarray(away_m)

    def obstacle_distances_m(self, points: ArrayLike) -> np.ndarray:
        """Return the distance of each point (points, 2) to the nearest obstacle of the layout and the map."""
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        in_map_m = self._interpolated(self._map_distances_m, points)
        return np.asarray(np.minimum(self.layout_distances_m(points), in_map_m))

    def rooms_m(self, points: ArrayLike) -> np.ndarray:
        """Return the room beyond the robot's radius at points (points, 2); -inf where it cannot be."""
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        away_m = self.obstacle_distances_m(points)
        offsets_m = np.abs(self._centres(self._nearest(points)) - points).max(axis=1)
        is_free = (away_m >= self._needed_m - EQUAL_M) & (offsets_m <= 1.5 * self.cell_m)
        return np.where(is_free, away_m - self.robot_radius_m, -np.inf)

    def are_free(self, points: ArrayLike) -> Flags:
        """Return for each point (points, 2) whether the robot's centre can be there."""
        return self.rooms_m(points) >= 0.0

    def is_free(self, x: float, y: float) -> bool:
        """Return whether the robot's centre can be at this point."""
        return bool(self.are_free([(x, y)])[0])

    def regions_of(self, points: ArrayLike) -> Numbers:
        """Return the number of the connected region that each free point (points, 2) is in."""
        i, j = self._nearest(points).T
        return np.asarray(self._regions[i, j])

    def region_of(self, place_m: Point) -> int:
        """Return the region of one free point."""
        return int(self.regions_of(place_m)[0])

    def lengths_m(self, point: Point, others: np.ndarray) -> np.ndarray:
        """Return the length of a path from a free point to each of some others; infinite without one."""
        cells, margin_m = self._nearest([point, *others]), MARGIN_M
        while True:
            window = self._window(cells, margin_m)
            graph, nodes = self._graph(window)
            first, *last = nodes[tuple((cells - window[:2]).T)]
            lengths_m = dijkstra(graph, indices=first)[last]
            if np.isfinite(lengths_m).all() or window == (0, 0, *self._free.shape):
                return np.asarray(lengths_m)
            margin_m *= 2.0

    def path(self, start: Point, goal: Point) -> list[Point] | None:
        """Return the points of a shortest path in metres; None if an end is not free, or cut off."""
        ends = np.array([start, goal])
        if not self.are_free(ends).all() or len(set(self.regions_of(ends))) > 1:
            return None
        cells, margin_m = self._nearest(ends), MARGIN_M
        while True:
            window = self._window(cells, margin_m)
            graph, nodes = self._graph(window)
            first, last = nodes[tuple((cells - window[:2]).T)]
            lengths_m, before = dijkstra(graph, indices=first, return_predecessors=True)
            # A path that leaves the window is longer than twice its margin.
            if lengths_m[last] <= 2.0 * margin_m or window == (0, 0, *self._free.shape):
                break
            margin_m *= 2.0
        trace = [last]
        while trace[-1] != first:
            trace.append(before[trace[-1]])
        centres = self._centres(np.argwhere(nodes >= 0)[trace[::-1]] + window[:2])
        return self._taut([start, *map(tuple, centres.tolist()), goal])

    def are_in_sight(self, starts: ArrayLike, ends: ArrayLike) -> Flags:
        """Return whether the robot can drive straight from each free point (points, 2) to another."""
        starts, ends = (np.asarray(points, dtype=float).reshape(-1, 2) for points in (starts, ends))
        count = int(np.hypot(*(ends - starts).T).max(initial=0.0) / self.cell_m) + 2
        shares = np.linspace(0.0, 1.0, count)[:, None, None]
        points = starts + shares * (ends - starts)
        away_m = self._interpolated(self._distances_m, points.reshape(-1, 2)).reshape(points.shape[:2])
        return np.asarray(away_m.min(axis=0) >= self._needed_m - ROUNDING_M)

    def _taut(self, points: list[Point]) -> list[Point]:
        """Return a path without the points past which the robot can drive straight."""
        taut, at = [points[0]], 0
        while at < len(points) - 1:
            ends = np.array(points[at + 1 :])
            are_in_sight = self.are_in_sight(np.broadcast_to(points[at], ends.shape), ends)
            at += 1 + int(np.flatnonzero(are_in_sight).max(initial=0))
            taut.append(points[at])
        return taut

    def _distances_in_layout_m(self) -> np.ndarray:
        """Return the distance from the centre of each cell to the nearest wall, table or tag."""
        x0, y0, x1, y1 = self._walls
        reach_m = self._needed_m + 2 * self.cell_m  # farther obstacles do not matter
        to_x, to_y = np.minimum(self._xs - x0, x1 - self._xs), np.minimum(self._ys - y0, y1 - self._ys)
        away_m = np.minimum(np.minimum(to_x[:, None], to_y), reach_m)
        for left, bottom, right, top in self._boxes:
            i = slice(*np.searchsorted(self._xs, (left - reach_m, right + reach_m)))
            j = slice(*np.searchsorted(self._ys, (bottom - reach_m, top + reach_m)))
            dx = np.maximum(np.maximum(left - self._xs[i], self._xs[i] - right), 0.0)
            dy = np.maximum(np.maximum(bottom - self._ys[j], self._ys[j] - top), 0.0)
            away_m[i, j] = np.minimum(away_m[i, j], np.hypot(dx[:, None], dy))
        return np.asarray(away_m)

    def _distances_in_map_m(self, occupancy: OccupancyMap) -> np.ndarray:
        """Return the distance from the centre of each cell to the nearest obstacle of a map, up to FAR_M."""
        shape = len(self._xs), len(self._ys)
        xs, ys = (axis.ravel() for axis in np.meshgrid(self._xs, self._ys, indexing='ij'))
        is_obstacle = occupancy.are_obstacles(xs, ys).reshape(shape)
        cells = self._cells(occupancy.obstacle_points())  # those of a map may be smaller
        i, j = cells[((cells >= 0) & (cells < shape)).all(axis=1)].T
        is_obstacle[i, j] = True
        if not is_obstacle.any():
            return np.full(shape, FAR_M)
        away_m = ndimage.distance_transform_edt(~is_obstacle) * self.cell_m - self.cell_m / 2.0
        return np.asarray(np.clip(away_m, 0.0, FAR_M))

    def _interpolated(self, values: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return the values of the cells at points (points, 2), interpolated between their centres."""
        columns, rows = ((points - self._walls[:2]) / self.cell_m - 0.5).T
        return np.asarray(ndimage.map_coordinates(values, [columns, rows], order=1, mode='nearest'))

    def _cells(self, points: ArrayLike) -> Numbers:
        """Return the column and row of each point (points, 2)."""
        offsets_m = np.asarray(points, dtype=float).reshape(-1, 2) - self._walls[:2]
        return np.asarray(np.floor(offsets_m / self.cell_m).astype(int))

    def _centres(self, cells: Numbers) -> np.ndarray:
        """Return the centre of each cell (cells, 2)."""
        return np.asarray(self._walls[:2] + (cells + 0.5) * self.cell_m)

    def _nearest(self, points: ArrayLike) -> Numbers:
        """Return the free cell that is nearest to each point (points, 2), as columns and rows."""
        columns, rows = self._free.shape
        i, j = self._cells(points).T
        nearest = self._nearest_free[:, i.clip(0, columns - 1), j.clip(0, rows - 1)]
        return np.asarray(nearest.T, dtype=int)

    def _window(self, cells: Numbers, margin_m: float) -> Window:
        """Return the part of the grid with these cells and a margin around them."""
        margin = math.ceil(margin_m / self.cell_m)
        (i0, j0), (i1, j1) = cells.min(axis=0) - margin, cells.max(axis=0) + margin + 1
        columns, rows = self._free.shape
        return max(i0, 0), max(j0, 0), min(i1, columns), min(j1, rows)

    def _graph_of(self, window: Window) -> tuple[csr_matrix, Numbers]:
        """Return the graph of the free cells of a window, and the node of each cell, or -1."""
        i0, j0, i1, j1 = window
        free = self._free[i0:i1, j0:j1]
        count = int(free.sum())
        nodes = np.full(free.shape, -1)
        nodes[free] = np.arange(count)
        ends, lengths_m = [], []
        for di, dj in STEPS:
            here = nodes[: -di or None, max(-dj, 0) : -dj if dj > 0 else None].ravel()
            there = nodes[di:, max(dj, 0) : dj if dj < 0 else None].ravel()
            is_link = (here >= 0) & (there >= 0)
            ends.append(np.stack([here[is_link], there[is_link]]))
            lengths_m.append(np.full(ends[-1].shape[1], math.hypot(di, dj) * self.cell_m))
        here, there = np.concatenate(ends, axis=1)
        graph = coo_matrix((np.concatenate(lengths_m), (here, there)), shape=(count, count)).tocsr()
        return graph + graph.T, nodes


def length_m(path: Iterable[Point]) -> float:
    """Return the length of a path in metres."""
    return sum(itertools.starmap(math.dist, itertools.pairwise(path)))
