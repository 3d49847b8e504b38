"""The order in which a robot visits the tags, and its path. Does not import ROS."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError
from scipy.spatial import KDTree

from lupin_planning.grid import Grid, Point, length_m
from lupin_planning.viewpoints import ApproachPose

ORDERS = ('given', 'shortest')
NEIGHBOURS = 30  # of each stop, to which the length of the path is computed
UNKNOWN_M = 1e3  # added to the distance of two stops if the length of the path between them is not
MOST_WORK = 1800  # stops, times the orders that are tried: all first stops of 42, and one of 1,800
SMALLEST_GAIN_M = 1e-6

Progress = Callable[[str, int, int], None]


class Route(NamedTuple):
    """The tags in the order of visits, and the path along their poses, in metres."""

    tag_ids: list[str]
    points_m: list[Point]  # from the start or the first pose to the last pose or the end
    length_m: float


def plan_route(  # noqa: PLR0913 - the options are passed by name
    grid: Grid,
    poses: Mapping[str, ApproachPose],
    start_m: Point | None,
    order: str,
    tag_ids: Sequence[str] | None = None,
    end_m: Point | None = None,
    *,
    progress: Progress = lambda *_: None,
) -> Route:
    """
    Return the route along the poses of these tags, or of all: as given, or the shortest found.

    Each of the tags has a pose. The route begins at the start and ends at the end, which may be a dock;
    without them, any tag may be the first or the last. `progress` is called with what is done, how much of
    it, and of how much. Raises StartUpError if a stop is not free, or is cut off from the one before.
    """
    tag_ids = list(poses if tag_ids is None else tag_ids)
    at_tags = [poses[tag_id][:2] for tag_id in tag_ids]
    stops = [stop for stop in (start_m, *at_tags, end_m) if stop is not None]
    visits = list(range(len(stops)))
    if order == 'shortest' and len(stops) > 2:
        lengths_m = _lengths_m(grid, np.array(stops), progress)
        visits = _shortest(lengths_m, has_start=start_m is not None, has_end=end_m is not None)
    points = [stops[visits[0]]] if stops else []
    for done, (here, there) in enumerate(itertools.pairwise(visits), 1):
        progress('legs of the route', done, len(stops) - 1)
        path = grid.path(stops[here], stops[there])
        if path is None:
            (x0, y0), (x1, y1) = stops[here], stops[there]
            raise StartUpError(
                f'the robot cannot drive from ({x0:.2f}, {y0:.2f}) to ({x1:.2f}, {y1:.2f}): one of them is'
                ' not free, or no passage between is wide enough: choose another start or end'
            )
        points += path[1:]
    tag_of = dict(enumerate(tag_ids, start=int(start_m is not None)))
    return Route([tag_of[visit] for visit in visits if visit in tag_of], points, length_m(points))


def _lengths_m(grid: Grid, stops: np.ndarray, progress: Progress) -> np.ndarray:
    """Return the lengths of the paths between near stops, and estimates for the others."""
    lengths_m = UNKNOWN_M + np.hypot(*(stops[:, None] - stops).transpose(2, 0, 1))
    near = KDTree(stops).query(stops, min(NEIGHBOURS + 1, len(stops)))[1]
    for stop, others in enumerate(near):
        progress('tags with paths to others', stop, len(stops))
        found_m = grid.lengths_m(tuple(stops[stop]), stops[others])
        lengths_m[stop, others] = np.where(np.isfinite(found_m), found_m, lengths_m[stop, others])
    return np.asarray(np.minimum(lengths_m, lengths_m.T))


def _shortest(lengths_m: np.ndarray, *, has_start: bool, has_end: bool) -> list[int]:
    """Return the shortest order found of all stops, of which the first and the last may be fixed."""
    anywhere = len(lengths_m)  # one more stop, which has no distance to any other
    lengths_m = np.pad(lengths_m, (0, 1))
    begin = 0 if has_start else anywhere
    end = anywhere - 1 if has_end else anywhere
    between = [stop for stop in range(anywhere) if stop not in (begin, end)]
    orders = []
    nearest_first = sorted(between, key=lengths_m[begin].__getitem__)
    for first in nearest_first[:: math.ceil(len(between) ** 2 / MOST_WORK)]:
        order = [begin, *_nearest_first(first, between, lengths_m), end]
        orders.append(_improved(order, lengths_m))
    best = min(orders, key=lambda order: round(float(lengths_m[order[:-1], order[1:]].sum()), 6))
    return [stop for stop in best.tolist() if stop != anywhere]


def _nearest_first(start: int, stops: list[int], lengths_m: np.ndarray) -> list[int]:
    """Return an order that begins at a stop, and goes to the nearest of the others each time."""
    order, left = [start], [stop for stop in stops if stop != start]
    while left:
        order.append(left.pop(int(lengths_m[order[-1], left].argmin())))
    return order


def _improved(stops: list[int], lengths_m: np.ndarray) -> np.ndarray:
    """Return an order with parts reversed (2-opt) as long as that makes it shorter; its ends stay."""
    order = np.array(stops)
    while True:
        between_m = lengths_m[np.ix_(order, order)]
        legs_m = between_m.diagonal(1)
        # To reverse the part from i + 1 to j exchanges the legs behind i and behind j.
        gains_m = np.triu(legs_m[:, None] + legs_m - between_m[:-1, :-1] - between_m[1:, 1:], 1)
        i, j = np.unravel_index(gains_m.argmax(), gains_m.shape)
        if gains_m[i, j] <= SMALLEST_GAIN_M:
            return order
        order[i + 1 : j + 1] = order[i + 1 : j + 1][::-1]
