# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The order in which a robot visits the tags, and its path. Does not import ROS."""

import itertools
import random
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.approach import ApproachPose
from lupin_greenhouse_bridge.planning.free_space import FreeSpace, VisibilityGraph
from lupin_greenhouse_bridge.simulator.layout import natural_order

ORDERS = ('given', 'numeric', 'shortest')
MOST_NEIGHBOURS = 40  # of a pose, by their paths: 2-opt exchanges no pair that is farther apart
FAR_M = 1e6  # between points whose path is not known
GAIN_M = 1e-6  # more than the rounding of FAR_M
KICKS = 60


class Route(NamedTuple):
    """The tags in the order of visits, and the path along their poses, in metres."""

    tag_ids: list[str]
    points_m: list[tuple[float, float]]  # from the start or the first pose to the last pose or the end
    length_m: float


def plan_route(
    free_space: FreeSpace,
    poses: Mapping[str, ApproachPose],
    start_m: tuple[float, float] | None,
    order: str,
    tag_ids: Sequence[str] | None = None,
    end_m: tuple[float, float] | None = None,
) -> Route:
    """
    Return the route along the poses of these tags, or of all: as given, by number, or the shortest found.

    It begins at the start and ends at the end, which may be a dock; without them, any tag may be the first or
    the last. The shortest route goes to the nearest tag each time, and is then improved by 2-opt and Or-opt.
    Raises StartUpError for a tag without a pose, or one that is cut off.
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
    if end_m is not None:
        stops.append(tuple(end_m))
    if not free_space.are_free(stops).all():
        blocked = stops[int(np.argmin(free_space.are_free(stops)))]
        raise StartUpError(
            f'({blocked[0]:.2f}, {blocked[1]:.2f}) is not free: choose another start, or other poses'
        )
    graph = VisibilityGraph(free_space, np.array(stops, dtype=float).reshape(-1, 2))
    visits = list(range(len(stops)))
    if order == 'shortest':
        visits = _shortest(graph, len(stops), has_start=start_m is not None, has_end=end_m is not None)
    points = [stops[each] for each in visits[:1]]
    for here, there in itertools.pairwise(visits):
        if (path := graph.path(here, there)) is None:
            (x0, y0), (x1, y1) = stops[here], stops[there]
            raise StartUpError(
                f'({x1:.2f}, {y1:.2f}) is cut off from ({x0:.2f}, {y0:.2f}): leave its tag out,'
                ' or choose another start'
            )
        points += path[1:]
    tag_of = dict(enumerate(tag_ids, start=int(start_m is not None)))
    return Route(
        [tag_of[each] for each in visits if each in tag_of],
        points,
        free_space.length_m(points),
    )


def _shortest(graph: VisibilityGraph, count: int, *, has_start: bool, has_end: bool) -> list[int]:
    """Return an order of all points by their paths. Point 0 may be a start, and the last one an end."""
    beside_all, behind_end, end = count, count + 1, count - 1
    lengths_m = np.full((count + 2, count + 2), FAR_M)
    lengths_m[beside_all] = lengths_m[:, beside_all] = 0.0  # from there, any point may be the first
    lengths_m[behind_end] = lengths_m[:, behind_end] = FAR_M
    lengths_m[end, behind_end] = lengths_m[behind_end, end] = 0.0  # to there, only the end may be the last
    visits, left = [0] * bool(count), set(range(1, count - has_end))
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
    visits += [end] * (has_end and count > 1)
    for here in visits[-2:]:
        for other, length_m in itertools.islice(graph.nearest(here), MOST_NEIGHBOURS + 1):
            lengths_m[here, other] = lengths_m[other, here] = length_m
    visits = [*([] if has_start else [beside_all]), *visits, *([behind_end] if has_end else [])]
    order = _improved(np.array(visits), lengths_m)
    chance = random.Random(0)  # noqa: S311 - the same route each time
    for _ in range(KICKS if 8 <= count <= MOST_NEIGHBOURS else 0):
        other = _improved(_kicked(order, chance), lengths_m)
        if _length_m(other, lengths_m) < _length_m(order, lengths_m) - GAIN_M:
            order = other
    return [visit for visit in order.tolist() if visit < count]


def _length_m(order: np.ndarray, lengths_m: np.ndarray) -> float:
    return float(lengths_m[order[:-1], order[1:]].sum())


def _kicked(order: np.ndarray, chance: random.Random) -> np.ndarray:
    """Return the order with two parts exchanged, which 2-opt and Or-opt cannot undo in one step."""
    a, b, c = sorted(chance.sample(range(1, len(order)), 3))
    return np.concatenate([order[:a], order[b:c], order[a:b], order[c:]])


def _improved(order: np.ndarray, lengths_m: np.ndarray) -> np.ndarray:
    """Return the order after 2-opt and Or-opt, as long as either makes it shorter; the first visit stays."""
    order = order.copy()
    while _two_opt(order, lengths_m) | _or_opt(order, lengths_m):
        pass
    return order


def _two_opt(order: np.ndarray, lengths_m: np.ndarray) -> bool:
    """Turn round each part of an open route whose turn makes it shorter; return whether there was one."""
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
    return is_shorter


def _or_opt(order: np.ndarray, lengths_m: np.ndarray) -> bool:
    """Move each part of up to three visits to where that makes it shorter; return whether there was one."""
    is_shorter = False
    for size in (1, 2, 3):
        for start in range(1, len(order) - size + 1):
            part, rest = order[start : start + size], np.delete(order, np.s_[start : start + size])
            gain_m = _length_m(order[start - 1 : start + size + 1], lengths_m)
            if start < len(rest):
                gain_m -= lengths_m[rest[start - 1], rest[start]]
            for turned in (part, part[::-1]):
                costs_m = lengths_m[rest, turned[0]] + _length_m(part, lengths_m)
                costs_m[:-1] += lengths_m[turned[-1], rest[1:]] - lengths_m[rest[:-1], rest[1:]]
                best = int(np.argmin(costs_m))
                if costs_m[best] < gain_m - GAIN_M:
                    order[:] = np.insert(rest, best + 1, turned)
                    is_shorter = True
                    break
    return is_shorter
