# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Interpolate values that were read at some positions onto a grid. Does not import ROS."""

import math
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

NEAREST_M = 1e-6  # a value that is nearer counts as if it were at this distance


class FieldGrid(NamedTuple):
    """The square cells of a field, in the layout's frame."""

    x: float  # of the corner with the lowest coordinates, in metres
    y: float
    resolution_m: float
    columns: int  # along x
    rows: int  # along y


def grid_over(layout: Layout, walls: Walls, resolution_m: float) -> FieldGrid:
    """Return the grid that covers the walls, the tables and the tags."""
    places = [tag[:2] for tag in layout.tags.values()]
    corners = [corner for each in (walls, *layout.tables.values()) for corner in (each[:2], each[2:])]
    xs, ys = zip(*places, *corners, strict=True)
    columns, rows = (max(math.ceil((max(each) - min(each)) / resolution_m), 1) for each in (xs, ys))
    return FieldGrid(min(xs), min(ys), resolution_m, columns, rows)


def interpolate(grid: FieldGrid, samples: list[tuple[float, float, float]], radius_m: float) -> np.ndarray:
    """
    Return a value for each cell, by row and column; NaN where no sample lies within the radius.

    A sample is x, y and its value. Each cell gets the weighted average of the samples within the radius. The
    weights are those of Franke and Little: ((radius - distance) / (radius * distance))**2. At the radius, the
    weight of a sample is zero, so that the field has no steps. In its own cell, a sample has all the weight.
    """
    xs = grid.x + (np.arange(grid.columns) + 0.5) * grid.resolution_m
    ys = grid.y + (np.arange(grid.rows) + 0.5)[:, np.newaxis] * grid.resolution_m
    to_corner_m = grid.resolution_m / math.sqrt(2)  # from the centre of a cell
    weights, sums = np.zeros((2, grid.rows, grid.columns))
    for x, y, value in samples:
        distances_m = np.maximum(np.hypot(xs - x, ys - y) - to_corner_m, NEAREST_M)
        weight = (np.maximum(radius_m - distances_m, 0.0) / (radius_m * distances_m)) ** 2
        weights += weight
        sums += weight * value
    return np.divide(sums, weights, out=np.full_like(sums, np.nan), where=weights > 0.0)


def scaled(values: np.ndarray, lowest: float, highest: float) -> np.ndarray:
    """Return values as whole numbers: 0 at the lowest or below, 100 at the highest or above, -1 for NaN."""
    with np.errstate(invalid='ignore'):
        shares = np.clip(np.rint(100.0 * (values - lowest) / (highest - lowest)), 0.0, 100.0)
    return np.where(np.isnan(shares), -1.0, shares).astype(np.int8)
