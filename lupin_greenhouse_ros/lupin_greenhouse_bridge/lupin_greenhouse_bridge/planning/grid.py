# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Find which of many rectangles are near a place, or along a line. Does not import ROS."""

import math

import numpy as np


class Grid:
    """Rectangles along the axes, by the cells of a grid that they touch."""

    def __init__(self, low: np.ndarray, high: np.ndarray):
        """Take their lowest and their highest corners, in two arrays (rectangles, 2), in metres."""
        count = len(low)
        self._origin = low.min(axis=0, initial=math.inf) if count else np.zeros(2)
        size = high.max(axis=0) - self._origin if count else np.ones(2)
        widest = np.median((high - low).max(axis=1)) if count else 0.0
        self.cell_m = float(max(widest, math.sqrt(size.prod() / max(count, 1)), size.max() / 4096, 1e-6))
        first, last = (((each - self._origin) // self.cell_m).astype(int) for each in (low, high))
        self._size = last.max(axis=0, initial=0) + 1
        numbers, rows = _spread(first[:, 1], last[:, 1] + 1)
        places, columns = _spread(first[numbers, 0], last[numbers, 0] + 1)
        cells = rows[places] * self._size[0] + columns
        order = np.argsort(cells, kind='stable')
        self._items = numbers[places][order]
        self._starts = np.searchsorted(cells[order], np.arange(self._size.prod() + 1))

    def near(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Return pairs of the numbers of a box and of a rectangle that may touch it, in two arrays.

        Takes the corners of the boxes. All that touch are there, some more, and some more than once.
        """
        first, last = self._cells(low), self._cells(high)
        boxes, rows = _spread(first[:, 1], last[:, 1] + 1)
        return self._items_of(boxes, rows, first[boxes, 0], last[boxes, 0])

    def along(self, starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return pairs of the numbers of a line and of a rectangle that may touch it, as near() does."""
        is_down = (starts[:, 1] > ends[:, 1])[:, None]
        starts, ends = np.where(is_down, ends, starts), np.where(is_down, starts, ends)
        lines, rows = _spread(self._cells(starts)[:, 1], self._cells(ends)[:, 1] + 1)
        start, towards = starts[lines], (ends - starts)[lines]
        enters = self._origin[1] + self.cell_m * rows - start[:, 1]
        with np.errstate(divide='ignore', invalid='ignore'):
            shares = enters / towards[:, 1], (enters + self.cell_m) / towards[:, 1]
        shares = np.fmin(np.fmax(shares[0], 0.0), 1.0), np.fmax(np.fmin(shares[1], 1.0), 0.0)
        first, last = (self._cells(start + share[:, None] * towards)[:, 0] for share in shares)
        return self._items_of(lines, rows, np.minimum(first, last), np.maximum(first, last))

    def _cells(self, points: np.ndarray) -> np.ndarray:
        """Return the column and the row of the cell nearest to each point, in an array (points, 2)."""
        return np.clip((points - self._origin) // self.cell_m, 0, self._size - 1).astype(int)

    def _items_of(self, queries, rows, first, last) -> tuple[np.ndarray, np.ndarray]:
        """Return the queries, and what is in their cells from the first to the last one of a row."""
        row = rows * self._size[0]
        places, items = _spread(self._starts[row + first], self._starts[row + last + 1])
        return queries[places], self._items[items]


def _spread(starts: np.ndarray, stops: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers from each start to below its stop, with the place of the start, in two arrays."""
    counts = stops - starts
    places = np.repeat(np.arange(len(counts)), counts)
    return places, np.arange(len(places)) + np.repeat(starts - np.cumsum(counts) + counts, counts)
