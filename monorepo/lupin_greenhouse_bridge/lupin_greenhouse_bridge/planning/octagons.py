# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
Octagons, as the obstacles of a disc robot, and what lies in them. Does not import ROS.

The limits of an octagon are the lowest and the highest value of x, y, x + y and x - y in it.
"""

import math

import numpy as np
from scipy.spatial import KDTree

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

    def without_those_in_others(self) -> 'Octagons':
        """Return the octagons that do not lie in another one; of equal ones, the first."""
        inner, outer = self._near((self.low + self.high)[:, :2] / 2.0, 0.0)
        is_in = (self.low[outer] <= self.low[inner]).all(axis=1)
        is_in &= (self.high[inner] <= self.high[outer]).all(axis=1)
        is_in &= (
            (self.low[outer] != self.low[inner]).any(axis=1)
            | (self.high[outer] != self.high[inner]).any(axis=1)
            | (outer < inner)
        )
        is_left = np.ones(len(self), dtype=bool)
        is_left[inner[is_in]] = False
        return Octagons(self.low[is_left], self.high[is_left])

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

    def _near(self, points: np.ndarray, distance_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers of points and of octagons that may be within this distance, in two arrays."""
        reach_m = distance_m + math.sqrt(0.5) * self.square_m + 1e-9
        pairs = KDTree(points).sparse_distance_matrix(self._marks, reach_m, output_type='ndarray')
        return np.divmod(np.unique(pairs['i'] * len(self) + self._owners[pairs['j']]), len(self))


def number_within(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return, for counts such as [2, 3], the arrays [0, 0, 1, 1, 1] and [0, 1, 0, 1, 2]."""
    owners = np.repeat(np.arange(len(counts)), counts)
    return owners, np.arange(len(owners)) - (np.cumsum(counts) - counts)[owners]
