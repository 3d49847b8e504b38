# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Find places for labels beside what they name. Does not import ROS."""

from typing import NamedTuple

import numpy as np


class Box(NamedTuple):
    """A rectangle in metres: its centre and its size."""

    x: float
    y: float
    width: float
    height: float


def _overlaps(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the common area of each box with each other one, from arrays (boxes, 4)."""
    middles, sizes = boxes[:, None, :2], boxes[:, None, 2:]
    lows = np.maximum(middles - sizes / 2, others[:, :2] - others[:, 2:] / 2)
    highs = np.minimum(middles + sizes / 2, others[:, :2] + others[:, 2:] / 2)
    return np.maximum(highs - lows, 0.0).prod(axis=2)


def place_labels(
    dots: list[Box], labels: list[tuple[Box, float, float]], room: Box | None = None
) -> list[tuple[float, float]]:
    """
    Return a place for each label beside its dot, where it covers no dot, no earlier label and no wall.

    Each label is given as its dot, its width and its height.
    """
    taken = np.zeros((len(dots) + len(labels), 4))  # the dots, and then the labels
    taken[: len(dots)] = np.reshape(dots, (-1, 4))
    places = []
    for count, (dot, width, height) in enumerate(labels, start=len(dots)):
        aside, above = (dot.width + width) / 2, (dot.height + height) / 2
        tries = [(aside, 0), (-aside, 0), (0, above), (0, -above)]
        tries += [(x * aside, y * above) for y in (0.7, -0.7, 1.0, -1.0) for x in (1, -1)]
        tries += [(2 * x, 2 * y) for x, y in tries]
        boxes = np.array([Box(dot.x + dx, dot.y + dy, width, height) for dx, dy in tries])
        reach = np.array([Box(dot.x, dot.y, 4 * aside + width, 4 * above + height)])
        near = taken[:count][_overlaps(reach, taken[:count])[0] > 0.0]
        costs = _overlaps(boxes, near).sum(axis=1)
        if room:
            costs += width * height - _overlaps(boxes, np.array([room]))[:, 0]
        best = boxes[np.argmin(costs.round(4))]  # the nearest of equals
        taken[count] = best
        places.append((float(best[0]), float(best[1])))
    return places
