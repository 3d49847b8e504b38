# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
Octagons, as the obstacles of a disc robot, and what lies in them. Does not import ROS.

The limits of an octagon are the lowest and the highest value of x, y, x + y and x - y in it.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

Numbers = NDArray[np.intp]
LINES_AT_ONCE = 4096
TOUCHING_M = 1e-6  # borders that are closer touch
SHRUNK_M = 1e-7
TOP_SIDE = 2  # of an octagon: from its third vertex to its fourth
AXES = np.array([(1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0)]).T
AXIS_LENGTHS = np.linalg.norm(AXES, axis=0)


class Octagons:
    """Many octagons. What lies on the side of an octagon is not in it."""

    def __init__(self, low: np.ndarray, high: np.ndarray):
        """Take the limits in metres, in two arrays (octagons, 4)."""
        self.low, self.high = low, high
        # A tree finds the octagons near a place by marks in the middle of squares, which cover each octagon.
        sizes = (high - low)[:, :2]
        self.square_m = max(
            float(np.median(sizes.max(axis=1))),
            # A large table has at most about 64 times as many marks as there are octagons.
            math.sqrt(sizes.prod(axis=1).mean() / 64.0),
            sizes.sum(axis=1).mean() / 64.0,
        )
        squares = np.ceil(sizes / self.square_m).astype(int).clip(1)
        self._owners, number = number_within(squares.prod(axis=1))
        column_and_row = np.column_stack(np.divmod(number, squares[self._owners, 1]))
        marks = low[self._owners, :2] + (column_and_row + 0.5) * (sizes / squares)[self._owners]
        self._marks = KDTree(marks)

    def __len__(self) -> int:
        return len(self.low)

    def vertices(self) -> np.ndarray:
        """Return the vertices, counter-clockwise from the lower end of the east side: (octagons, 8, 2)."""
        (x0, y0, sum0, difference0), (x1, y1, sum1, difference1) = self.low.T, self.high.T
        xs = x1, x1, sum1 - y1, difference0 + y1, x0, x0, sum0 - y0, difference1 + y0
        ys = x1 - difference1, sum1 - x1, y1, y1, x0 - difference0, sum0 - x0, y0, y0
        return np.stack([np.stack(xs, axis=1), np.stack(ys, axis=1)], axis=2)

    def cover(self, points: np.ndarray) -> np.ndarray:
        """Return whether each point (points, 2) is in an octagon."""
        places, octagons = self._near(points, 0.0)
        along = points[places] @ AXES
        is_in = ((along > self.low[octagons]) & (along < self.high[octagons])).all(axis=1)
        are_covered = np.zeros(len(points), dtype=bool)
        are_covered[places[is_in]] = True
        return are_covered

    def crossings(
        self, starts: np.ndarray, ends: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """
        Return where lines pass through octagons.

        Takes both ends of each line, in two arrays (lines, 2). Returns four arrays (crossings): the number of
        the line, the number of the octagon, and the shares of the line at which it enters and leaves it.
        """
        pieces = np.ceil(np.hypot(*(ends - starts).T) / (2.0 * self.square_m)).astype(int).clip(1)
        lines, number = number_within(pieces)
        shares = (number + 0.5) / pieces[lines]
        middles = starts[lines] + shares[:, None] * (ends - starts)[lines]
        places, octagons = self._near(middles, self.square_m)
        lines, octagons = np.divmod(np.unique(lines[places] * len(self) + octagons), len(self))
        starts, ends = (starts @ AXES)[lines], (ends @ AXES)[lines]
        low, high = self.low[octagons], self.high[octagons]
        is_near = ((np.maximum(starts, ends) > low) & (np.minimum(starts, ends) < high)).all(axis=1)
        starts, ends, low, high = (each[is_near] for each in (starts, ends, low, high))
        with np.errstate(divide='ignore'):
            meets = np.sort([(low - starts) / (ends - starts), (high - starts) / (ends - starts)], axis=0)
        enters, leaves = meets[0].max(axis=1).clip(0.0), meets[1].min(axis=1).clip(None, 1.0)
        is_in = enters < leaves
        return lines[is_near][is_in], octagons[is_near][is_in], enters[is_in], leaves[is_in]

    def first_entered(self, starts: np.ndarray, ends: np.ndarray) -> tuple[Numbers, np.ndarray]:
        """
        Return the number of the octagon that each line enters first, -1 for none, and the place (lines, 2).

        Takes both ends of each line, in two arrays (lines, 2).
        """
        lengths_m = np.hypot(*(ends - starts).T)
        directions = (ends - starts) / np.maximum(lengths_m, 1e-9)[:, None]
        first, places = np.full(len(starts), -1), ends.copy()
        # Part by part, because most lines enter one near their start.
        begin_m, end_m = 0.0, 2.0 * self.square_m
        while len(left := np.flatnonzero((first < 0) & (lengths_m >= begin_m))):
            for some in np.split(left, range(LINES_AT_ONCE, len(left), LINES_AT_ONCE)):
                begins = starts[some] + begin_m * directions[some]
                parts = np.minimum(lengths_m[some], end_m)[:, None] * directions[some] + starts[some] - begins
                lines, octagons, enters, _ = self.crossings(begins, begins + parts)
                order = np.lexsort((enters, lines))
                lines, at = np.unique(lines[order], return_index=True)
                first[some[lines]] = octagons[order[at]]
                places[some[lines]] = begins[lines] + enters[order[at], None] * parts[lines]
            begin_m, end_m = end_m, 4.0 * end_m
        return first, places

    def _near(self, points: np.ndarray, distance_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers of points and of octagons that may be within this distance, in two arrays."""
        reach_m = distance_m + math.sqrt(0.5) * self.square_m + 1e-9
        pairs = KDTree(points).sparse_distance_matrix(self._marks, reach_m, output_type='ndarray')
        return np.divmod(np.unique(pairs['i'] * len(self) + self._owners[pairs['j']]), len(self))


class Regions:
    """
    The connected regions of the space between octagons, by number.

    The borders of the space are the parts of the octagons' sides that are in no other octagon. Borders that
    touch belong to the same region, and so does the border above the top of an octagon: from obstacle to
    obstacle, this connects all borders of a region. A point is in the region of the border above it.
    """

    def __init__(self, octagons: Octagons):
        """Take octagons that enclose the space."""
        # Each one shrinks by another length, so that no two sides are on the same line.
        shrunk_m = SHRUNK_M * np.linspace(1.0, 2.0, len(octagons))[:, None]
        self._octagons = Octagons(octagons.low + shrunk_m, octagons.high - shrunk_m)
        self._vertices = self._octagons.vertices()
        self._begins, ends = self._borders()
        sides = self._begins.astype(int)
        from_m, to_m = (
            each.reshape(-1, 2)[sides] for each in (self._vertices, np.roll(self._vertices, -1, axis=1))
        )
        shares = np.stack([self._begins, ends], axis=1) - sides[:, None]
        borders = from_m[:, None] + shares[..., None] * (to_m - from_m)[:, None]
        touching = KDTree(borders.reshape(-1, 2)).query_pairs(TOUCHING_M, output_type='ndarray') // 2
        tops = np.flatnonzero(sides % 8 == TOP_SIDE)
        above = self._border_above(borders[tops].mean(axis=1) + np.array([0.0, 2.0 * TOUCHING_M]))
        links = np.concatenate([touching, np.column_stack([tops, above])[above >= 0]])
        graph = coo_matrix((np.ones(len(links)), links.T), shape=(len(borders), len(borders)))
        self._regions: Numbers = connected_components(graph, directed=False)[1]

    def of(self, points: np.ndarray) -> Numbers:
        """Return the number of the region of each point (points, 2) of the space."""
        return self._regions[self._border_above(points)]

    def _borders(self) -> tuple[np.ndarray, np.ndarray]:
        """
        Return where the borders begin and end on the perimeters of the octagons, in ascending order.

        Side 7 of octagon 0 goes from 7.0 to 8.0, and side 0 of octagon 1 from there to 9.0.
        """
        starts, ends = self._vertices.reshape(-1, 2), np.roll(self._vertices, -1, axis=1).reshape(-1, 2)
        sides, others, enters, leaves = self._octagons.crossings(starts, ends)
        is_other = others != sides // 8
        corners = np.arange(len(starts) + 1)
        # A border reaches from the end of what is covered to where more begins.
        covered_from = np.concatenate([(sides + enters)[is_other], corners])
        covered_to = np.concatenate([(sides + leaves)[is_other], corners])
        order = np.argsort(covered_from, kind='stable')
        begins, ends = np.maximum.accumulate(covered_to[order])[:-1], covered_from[order][1:]
        is_border = ends - begins > 1e-9
        return begins[is_border], ends[is_border]

    def _border_above(self, points: np.ndarray) -> Numbers:
        """Return the number of the first border straight above each point (points, 2); -1 for none."""
        ends = points.copy()
        ends[:, 1] = self._octagons.high[:, 1].max()
        octagons, places = self._octagons.first_entered(points, ends)
        # From below, a line enters through side 5, 6 or 7.
        corners_x = self._vertices[octagons][:, [5, 6, 7, 0], 0]
        part = (places[:, :1] >= corners_x[:, 1:3]).sum(axis=1)
        west, east = (corners_x[np.arange(len(points)), part + each] for each in (0, 1))
        shares = ((places[:, 0] - west) / np.maximum(east - west, 1e-12)).clip(0.0, 1.0 - 1e-9)
        numbers = np.searchsorted(self._begins, 8 * octagons + 5 + part + shares, side='right') - 1
        return np.where(octagons >= 0, numbers, -1)


def number_within(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return, for counts such as [2, 3], the arrays [0, 0, 1, 1, 1] and [0, 1, 0, 1, 2]."""
    owners = np.repeat(np.arange(len(counts)), counts)
    return owners, np.arange(len(owners)) - (np.cumsum(counts) - counts)[owners]
