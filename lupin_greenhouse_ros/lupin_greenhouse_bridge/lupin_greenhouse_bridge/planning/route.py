# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The order in which a robot visits the tags, and its path. Does not import ROS."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.approach import ApproachPose
from lupin_greenhouse_bridge.planning.free_space import FreeSpace, VisibilityGraph
from lupin_greenhouse_bridge.simulator.layout import natural_order

ORDERS = ('given', 'numeric', 'shortest')
MOST_NEIGHBOURS = 40  # of a pose, by their paths: 2-opt exchanges no pair that is farther apart
GAIN_M = 1e-9


class Route(NamedTuple):
    """The tags in the order of visits, and the path along their poses, in metres."""

    tag_ids: list[str]
    points_m: list[tuple[float, float]]  # from the start, or from the first pose
    length_m: float


def plan_route(
    free_space: FreeSpace,
    poses: Mapping[str, ApproachPose],
    start_m: tuple[float, float] | None,
    order: str,
    tag_ids: Sequence[str] | None = None,
) -> Route:
    """
    Return the route along the poses of these tags, or of all: as given, by number, or the shortest found.

    The shortest route goes to the nearest tag first, and is then improved by 2-opt. Raises StartUpError for a
    tag without a pose, or one that the robot cannot drive to.
    """
    tag_ids = list(poses) if tag_ids is None else list(tag_ids)
    for tag_id in tag_ids:
        if tag_id not in poses:
            raise StartUpError(f"tag '{escaped(tag_id, 64)}' has no approach pose: leave it out of the order")
    if order != 'given':
        tag_ids.sort(key=natural_order)
    stops = [(each.x, each.y) for each in map(poses.__getitem__, tag_ids)]
    if start_m is not None:
        stops.insert(0, tuple(start_m))
    if not free_space.are_free(stops).all():
        blocked = stops[int(np.argmin(free_space.are_free(stops)))]
        raise StartUpError(
            f'({blocked[0]:.2f}, {blocked[1]:.2f}) is not free: choose another start, or other poses'
        )
    graph = VisibilityGraph(free_space, np.array(stops, dtype=float).reshape(-1, 2))
    visits = _shortest(graph, len(stops)) if order == 'shortest' else list(range(len(stops)))
    points = stops[:1]
    for here, there in itertools.pairwise(visits):
        if (path := graph.path(here, there)) is None:
            (x0, y0), (x1, y1) = stops[here], stops[there]
            raise StartUpError(
                f'({x1:.2f}, {y1:.2f}) is cut off from ({x0:.2f}, {y0:.2f}): leave its tag out,'
                ' or choose another start'
            )
        points += path[1:]
    first_tag = len(stops) - len(tag_ids)
    return Route(
        [tag_ids[each - first_tag] for each in visits if each >= first_tag],
        points,
        free_space.length_m(points),
    )


def _shortest(graph: VisibilityGraph, count: int) -> list[int]:
    """Return an order of all points that begins with the first, by the lengths of the paths."""
    lengths_m = np.full((count, count), math.inf)
    visits, left = [0] * bool(count), set(range(1, count))
    while left:
        here, following = visits[-1], None
        for number, (other, length_m) in enumerate(graph.nearest(here)):
            lengths_m[here, other] = lengths_m[other, here] = length_m
            if following is None and other in left:
                following = other
            if following is not None and number >= MOST_NEIGHBOURS:
                break
        if following is None:  # cut off: plan_route() says so
            following = min(left)
        left.discard(following)
        visits.append(following)
    return _two_opt(visits, lengths_m)


def _two_opt(visits: list[int], lengths_m: np.ndarray) -> list[int]:
    """Turn round parts of an open route as long as that makes it shorter; the first visit stays."""
    order = np.array(visits)
    is_shorter = True
    while is_shorter:
        is_shorter = False
        for start in range(1, len(order) - 1):
            before, first = order[start - 1], order[start]
            lasts, after = order[start + 1 :], order[start + 2 :]
            gains_m = lengths_m[before, first] - lengths_m[before, lasts]
            gains_m[:-1] += lengths_m[lasts[:-1], after] - lengths_m[first, after]
            best = int(np.argmax(gains_m))
            if gains_m[best] > GAIN_M:
                end = start + 2 + best
                order[start:end] = order[start:end][::-1].copy()
                is_shorter = True
    return order.tolist()
