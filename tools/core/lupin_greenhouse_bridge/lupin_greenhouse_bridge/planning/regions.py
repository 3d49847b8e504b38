"""Which places of a free space are connected. Does not import ROS."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from lupin_greenhouse_bridge.planning.octagons import Octagons, number_within

TOUCHING_M = 1e-6  # borders that are closer touch
SHRUNK_M = 1e-7
TOP_SIDE = 2  # of an octagon: from its third vertex to its fourth


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
        octagons = Octagons(octagons.low + shrunk_m, octagons.high - shrunk_m)
        borders, sides = _borders(octagons)
        self._columns = _Columns(borders)
        touching = KDTree(borders.reshape(-1, 2)).query_pairs(TOUCHING_M, output_type='ndarray') // 2
        tops = np.flatnonzero(sides == TOP_SIDE)
        above = self._columns.first_above(borders[tops].mean(axis=1) + np.array([0.0, 2.0 * TOUCHING_M]))
        links = np.concatenate([touching, np.column_stack([tops, above])[above >= 0]])
        graph = coo_matrix((np.ones(len(links)), links.T), shape=(len(borders), len(borders)))
        _, self._regions = connected_components(graph, directed=False)

    def of(self, points: np.ndarray) -> np.ndarray:
        """Return the number of the region of each point (points, 2) of the space."""
        return self._regions[self._columns.first_above(points)]


def _borders(octagons: Octagons) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the borders, (borders, 2, 2), and the sides that they are on, from 0 to 7."""
    starts = octagons.vertices()
    ends = np.roll(starts, -1, axis=1).reshape(-1, 2)
    starts = starts.reshape(-1, 2)
    lines, others, enters, leaves = octagons.crossings(starts, ends)
    is_other = others != lines // 8
    lines, enters, leaves = lines[is_other], enters[is_other], leaves[is_other]
    # Side 7 goes from 7.0 to 8.0. A border reaches from the end of what is covered to where more begins.
    corners = np.arange(len(starts) + 1)
    begins, covered = np.concatenate([lines + enters, corners]), np.concatenate([lines + leaves, corners])
    order = np.argsort(begins, kind='stable')
    begins, covered = begins[order][1:], np.maximum.accumulate(covered[order])[:-1]
    is_border = begins - covered > 1e-9
    sides = covered[is_border].astype(int)
    shares = np.stack([covered[is_border], begins[is_border]], axis=1) - sides[:, None]
    return starts[sides, None] + shares[..., None] * (ends - starts)[sides, None], sides % 8


class _Columns:
    """Lines, by the columns of a grid that they are in."""

    def __init__(self, lines: np.ndarray):
        """Take the ends of the lines in an array (lines, 2, 2)."""
        self._lines = lines
        self._spans = np.sort(lines[..., 0], axis=1) + np.array([-TOUCHING_M, TOUCHING_M])
        self._west, self._width_m = self._spans.min(), np.ptp(self._spans) / len(lines)
        numbers = np.flatnonzero(lines[:, 0, 0] != lines[:, 1, 0])  # a vertical line is above no point
        first, last = self._columns_of(self._spans[numbers]).T
        owners, number = number_within(last - first + 1)
        columns = first[owners] + number
        order = np.argsort(columns, kind='stable')
        self._numbers, self._begins = (
            numbers[owners][order],
            np.searchsorted(columns[order], np.arange(len(lines) + 1)),
        )

    def first_above(self, points: np.ndarray) -> np.ndarray:
        """Return the number of the lowest line above each point (points, 2), or through it; -1 for none."""
        columns = self._columns_of(points[:, 0])
        begins = self._begins[columns]
        places, number = number_within(self._begins[columns + 1] - begins)
        numbers = self._numbers[begins[places] + number]
        (x, y), (xa, ya), (xb, yb) = points[places].T, *self._lines[numbers].transpose(1, 2, 0)
        heights = ya + ((x - xa) / (xb - xa)).clip(0.0, 1.0) * (yb - ya)
        west, east = self._spans[numbers].T
        above = np.flatnonzero((x >= west) & (x <= east) & (heights >= y - TOUCHING_M))
        above = above[np.lexsort((heights[above], places[above]))]
        found, lowest = np.unique(places[above], return_index=True)
        first = np.full(len(points), -1)
        first[found] = numbers[above[lowest]]
        return first

    def _columns_of(self, xs: np.ndarray) -> np.ndarray:
        return ((xs - self._west) / self._width_m).astype(int).clip(0, len(self._lines) - 1)
