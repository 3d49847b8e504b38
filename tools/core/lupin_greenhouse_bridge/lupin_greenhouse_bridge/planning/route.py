"""The order in which a robot visits the tags, and its path. Does not import ROS."""

import collections
import itertools
import math
import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.approach import ApproachPose
from lupin_greenhouse_bridge.planning.free_space import FreeSpace, VisibilityGraph
from lupin_greenhouse_bridge.simulator.layout import natural_order

ORDERS = ('given', 'numeric', 'shortest')
NEIGHBOURS = 10  # of a stop, by their paths: it is joined to no others
KNOWN = 4000  # paths, at least, whose lengths are known
FAR_M = 1e6  # more than any path: between points whose path is not known
GAIN_M = 1e-6  # more than the rounding of FAR_M
KICKS = 300
LONGEST_KICK = 50  # points


class Route(NamedTuple):
    """The tags in the order of visits, and the path along their poses, in metres."""

    tag_ids: list[str]
    points_m: list[tuple[float, float]]  # from the start or the first pose to the last pose or the end
    length_m: float


def plan_route(  # noqa: PLR0913 - the options are passed by name
    free_space: FreeSpace,
    poses: Mapping[str, ApproachPose],
    start_m: tuple[float, float] | None,
    order: str,
    tag_ids: Sequence[str] | None = None,
    end_m: tuple[float, float] | None = None,
    *,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> Route:
    """
    Return the route along the poses of these tags, or of all: as given, by number, or the shortest found.

    It begins at the start and ends at the end, which may be a dock; without them, any tag may be the first or
    the last. The shortest route goes to the nearest tag each time, and is then improved by 2-opt and Or-opt.
    `progress` is told what is done, how much of it, and of how much.
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
        ends = {'has_start': start_m is not None, 'has_end': end_m is not None}
        visits = _shortest(graph, stops, progress, **ends)
    points = [stops[each] for each in visits[:1]]
    for number, (here, there) in enumerate(itertools.pairwise(visits)):
        progress('legs of the route', number, len(visits) - 1)
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


def _shortest(
    graph: VisibilityGraph, stops: list, progress: Callable, *, has_start: bool, has_end: bool
) -> list[int]:
    """Return an order of all stops by their paths. Stop 0 may be a start, and the last one an end."""
    count = len(stops)
    if count < 3:
        return list(range(count))
    most = max(NEIGHBOURS, KNOWN // count)
    near = []
    for each in range(count):
        progress('tags with paths to others', each, count)
        near.append(dict(itertools.islice(graph.nearest(each), most)))
    first = _nearest_first(near, np.array(stops[: count - has_end])) + [count - 1] * has_end
    for here, others in enumerate(near):
        for other, length_m in others.items():
            near[other].setdefault(here, length_m)
    # From the last stop back to the first, the tour passes by one that is beside all.
    for each in range(count):
        near[each][count] = 0.0
    for end in [0] * has_start + [count - 1] * has_end:
        near[end][count] = -FAR_M
    near.append({each: near[each][count] for each in range(count)})
    tour = _Tour([*first, count], near, [*stops, stops[0]])
    tour.improve(range(count), progress)
    chance = random.Random(0)  # noqa: S311 - the same route each time
    for number in range(KICKS):
        progress('improvements of the order', number, KICKS)
        tour.kick(chance)
    place = tour.order.index(count)
    visits = tour.order[place + 1 :] + tour.order[:place]
    is_turned = visits[0] != 0 if has_start else has_end and visits[-1] != count - 1
    return visits[::-1] if is_turned else visits


def _nearest_first(near: list[dict[int, float]], stops: np.ndarray) -> list[int]:
    """Return an order of these stops that goes to the nearest each time, along a path if one is left."""
    order, is_left = [0], np.ones(len(near), dtype=bool)
    is_left[len(stops) :] = False
    while len(order) < len(stops):
        is_left[order[-1]] = False
        following = next((each for each in near[order[-1]] if is_left[each]), None)
        if following is None:
            left = np.flatnonzero(is_left)
            following = int(left[np.hypot(*(stops[left] - stops[order[-1]]).T).argmin()])
        order.append(following)
    return order


class _Tour:
    """A round tour of stops by their numbers, which 2-opt and Or-opt make shorter."""

    def __init__(self, order: list[int], lengths_m: list[dict[int, float]], stops: list):
        """Take an order, for each stop the lengths of the paths to others, and the places of stops."""
        self.order, self._lengths_m, self._stops = order, lengths_m, stops
        self._near = [sorted(each, key=each.get)[: NEIGHBOURS + 1] for each in lengths_m]
        self._places = {stop: place for place, stop in enumerate(order)}
        self._exchanges: list[tuple[int, int, int, int]] = []  # since the last kick
        self._gain_m = 0.0  # by these

    def improve(self, stops: Iterable[int], progress: Callable = lambda *_: None) -> None:
        """Make the tour shorter around these stops, as long as that goes."""
        queue = collections.deque(stops)
        is_queued = set(queue)
        while queue:
            progress('tags in an order', len(self.order) - len(queue), len(self.order))
            stop = queue.popleft()
            is_queued.discard(stop)
            while changed := self._two_opt(stop) or self._or_opt(stop):
                queue.extend(each for each in changed if each not in is_queued)
                is_queued.update(changed)

    def kick(self, chance: random.Random) -> None:
        """Exchange two parts that follow each other, and improve around them; undo what is not shorter."""
        self._exchanges.clear()
        self._gain_m = 0.0
        at = chance.randrange(len(self.order))
        middle, last = sorted(chance.sample(range(1, min(len(self.order) - 1, LONGEST_KICK)), 2))
        places = (at, at + 1, at + middle, at + middle + 1, at + last, at + last + 1)
        a, b, c, d, e, f = (self.order[each % len(self.order)] for each in places)
        self._exchange(a, b, e, f)
        self._exchange(a, e, d, c)
        self._exchange(e, c, b, f)
        self.improve((a, b, c, d, e, f))
        if self._gain_m < GAIN_M:
            for a, b, c, d in self._exchanges[::-1]:
                self._exchange(a, c, b, d)

    def _two_opt(self, a: int) -> tuple[int, ...]:
        """Join a stop to one that is near, and those beside both; return what has changed."""
        for step in (1, -1):
            b = self._beside(a, step)
            for c in self._near[a]:
                gain_m = self._m(a, b) - self._m(a, c)
                if gain_m <= GAIN_M:
                    break
                d = self._beside(c, step)
                gain_m += self._m(c, d) - self._m(b, d)
                if gain_m > GAIN_M:
                    self._exchange(a, b, c, d)
                    return a, b, c, d
        return ()

    def _or_opt(self, a: int) -> tuple[int, ...]:
        """Move a part of up to three stops, of which this is the first, beside one that is near it."""
        for step in (1, -1):
            part, before = [a], self._beside(a, -step)
            while len(part) <= 3 and (after := self._beside(part[-1], step)) != before:
                last = part[-1]
                without_m = self._m(before, a) + self._m(last, after) - self._m(before, after)
                for c in self._near[a]:
                    if without_m - self._m(a, c) <= GAIN_M:
                        break
                    for turn in (step, -step):
                        d = self._beside(c, turn)
                        gain_m = without_m - self._m(a, c) + self._m(c, d) - self._m(last, d)
                        if gain_m > GAIN_M and c not in part and d not in part:
                            x, y = (c, d) if turn == step else (d, c)
                            self._exchange(before, a, x, y)
                            self._exchange(before, x, after, last)
                            if turn == step:
                                self._exchange(x, last, a, y)
                            return before, a, last, after, c, d
                part.append(after)
        return ()

    def _m(self, here: int, there: int) -> float:
        """Return the length of the path between two stops, or the distance and FAR_M, in metres."""
        length_m = self._lengths_m[here].get(there)
        return FAR_M + math.dist(self._stops[here], self._stops[there]) if length_m is None else length_m

    def _beside(self, stop: int, step: int) -> int:
        """Return the next stop of the tour, or with -1 the one before."""
        return self.order[(self._places[stop] + step) % len(self.order)]

    def _exchange(self, a: int, b: int, c: int, d: int) -> None:
        """Join a to c and b to d, in place of a to b and c to d: d is on that side of c as b is of a."""
        self._exchanges.append((a, b, c, d))
        self._gain_m += self._m(a, b) + self._m(c, d) - self._m(a, c) - self._m(b, d)
        count, order, places = len(self.order), self.order, self._places
        first, last = (places[b], places[c]) if self._beside(a, 1) == b else (places[a], places[d])
        if 2 * ((last - first) % count + 1) > count:  # turn round the other part instead
            first, last = last + 1, first - 1
        for turn in range(((last - first) % count + 1) // 2):
            one, other = (first + turn) % count, (last - turn) % count
            order[one], order[other] = order[other], order[one]
            places[order[one]], places[order[other]] = one, other
