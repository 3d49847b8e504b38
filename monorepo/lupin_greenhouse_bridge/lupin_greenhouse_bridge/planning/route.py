# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The order in which a robot visits the tags, and its path. Does not import ROS."""

import itertools
import random
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.free_space import FreeSpace, Point
from lupin_greenhouse_bridge.planning.octagons import Numbers
from lupin_greenhouse_bridge.planning.viewpoints import ApproachPose
from lupin_greenhouse_bridge.planning.visibility_graph import VisibilityGraph

ORDERS = ('given', 'shortest')
NEIGHBOURS = 30  # of each stop, to which the path is known
FAR_M = 1e4  # added to the distance of two stops if the length of the path between them is not known
JOINED = 10  # nearest stops that a stop may be joined to
SMALLEST_GAIN_M = 1e-6
PERTURBATIONS = 600
LONGEST_PERTURBATION = 50  # stops

Progress = Callable[[str, int, int], None]


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
    progress: Progress = lambda *_: None,
) -> Route:
    """
    Return the route along the poses of these tags, or of all: as given, or the shortest found.

    It begins at the start and ends at the end, which may be a dock; without them, any tag may be the first or
    the last. The shortest route goes to the nearest tag each time, and is then improved by 2-opt and by
    exchanging parts.
    `progress` is told what is done, how much of it, and of how much.
    Raises StartUpError for a tag without a pose, or one that is cut off.
    """
    tag_ids = list(poses) if tag_ids is None else list(tag_ids)
    for tag_id in tag_ids:
        if tag_id not in poses:
            raise StartUpError(f"tag '{escaped(tag_id, 64)}' has no approach pose: leave it out of the order")
    at_tags = [poses[tag_id][:2] for tag_id in tag_ids]
    stops = [stop for stop in (start_m, *at_tags, end_m) if stop is not None]
    are_free = free_space.are_free(stops)
    if not are_free.all():
        first = int(are_free.argmin())
        (x, y), is_last = stops[first], first == len(stops) - 1
        what = 'start' if start_m and first == 0 else 'end' if end_m and is_last else 'pose'
        raise StartUpError(f'the {what} at ({x:.2f}, {y:.2f}) is not free: choose another')
    visits, points = list(range(len(stops))), stops
    if len(stops) > 1:
        graph = VisibilityGraph(free_space, np.array(stops))
        if order == 'shortest':
            lengths_m = _lengths_m(graph, np.array(stops), progress)
            visits = _shortest(lengths_m, progress, has_start=start_m is not None, has_end=end_m is not None)
        points = _path(graph, stops, visits, progress)
    tag_of = dict(enumerate(tag_ids, start=int(start_m is not None)))
    return Route([tag_of[each] for each in visits if each in tag_of], points, free_space.length_m(points))


def _path(
    graph: VisibilityGraph,
    stops: list[Point],
    visits: list[int],
    progress: Progress,
) -> list[Point]:
    """Return the points of the path along these stops; raises StartUpError if one is cut off."""
    legs = np.array(list(itertools.pairwise(visits)))
    paths: dict[int, list[int]] = {}
    for leg, nodes in graph.paths(legs):
        paths[leg] = nodes
        progress('legs of the route', len(paths), len(legs))
    points = [stops[visits[0]]]
    for leg, (here, there) in enumerate(legs):
        if leg not in paths:
            (x0, y0), (x1, y1) = stops[here], stops[there]
            raise StartUpError(
                f'({x1:.2f}, {y1:.2f}) is cut off from ({x0:.2f}, {y0:.2f}): leave its tag out,'
                ' or choose another start'
            )
        points += graph.points_m(paths[leg])[1:]
    return points


def _lengths_m(graph: VisibilityGraph, stops: np.ndarray, progress: Progress) -> np.ndarray:
    """Return the lengths of the paths between all stops, and zeros for one more stop, which is anywhere."""
    count = len(stops)
    lengths_m = np.zeros((count + 1, count + 1), dtype=np.float32)
    for done, (stop, found_m) in enumerate(graph.lengths_m(NEIGHBOURS)):
        progress('tags with paths to others', min(done, count), count)
        lengths_m[stop, :count] = found_m
    for stop, place in enumerate(stops):
        row = np.minimum(lengths_m[stop, :count], lengths_m[:count, stop])
        row = np.where(np.isinf(row), FAR_M + np.hypot(*(stops - place).T), row)
        lengths_m[stop, :count] = lengths_m[:count, stop] = row
    return lengths_m


def _shortest(lengths_m: np.ndarray, progress: Progress, *, has_start: bool, has_end: bool) -> list[int]:
    """Return an order of all stops but the last, which is anywhere. The first and last may be fixed."""
    anywhere = len(lengths_m) - 1
    free = anywhere - has_end
    order = _nearest_first(lengths_m[:free, :free]) + [free] * has_end
    # Where no stop is fixed, the order begins and ends anywhere.
    tour = _Tour([anywhere] * (not has_start) + order + [anywhere] * (not has_end), lengths_m)
    tour.improve(range(anywhere), progress)
    chance = random.Random(0)  # noqa: S311 - the same route each time
    for number in range(PERTURBATIONS if anywhere > 3 else 0):
        progress('improvements of the order', number, PERTURBATIONS)
        tour.perturb(chance)
    return [each for each in tour.order.tolist() if each != anywhere]


def _nearest_first(lengths_m: np.ndarray) -> list[int]:
    """Return an order that begins with stop 0, and goes to the nearest of the others each time."""
    order, is_left = [0], np.ones(len(lengths_m), dtype=bool)
    for _ in range(len(lengths_m) - 1):
        is_left[order[-1]] = False
        order.append(int(np.where(is_left, lengths_m[order[-1]], np.inf).argmin()))
    return order


class _Tour:
    """An order of stops that 2-opt makes shorter; its first and its last stop stay."""

    def __init__(self, order: list[int], lengths_m: np.ndarray):
        """Take an order, and the lengths of the paths between all stops, of which the last is `anywhere`."""
        self.order, self._lengths_m = np.array(order), lengths_m
        self._places = np.empty(len(lengths_m), dtype=int)
        self._places[self.order] = np.arange(len(order))
        self._legs_m = self._between_m(self.order[:-1], self.order[1:])
        most = min(JOINED, len(lengths_m) - 2)
        self._near = [np.argpartition(row[:-1], most)[: most + 1] for row in lengths_m[:-1]]

    def improve(self, stops: Iterable[int], progress: Progress = lambda *_: None) -> None:
        """Make the order shorter around these stops, as long as that goes."""
        queue = deque(stops)
        queued = set(queue)
        while queue:
            progress('tags in an order', len(self.order) - len(queue), len(self.order))
            stop = queue.popleft()
            queued.discard(stop)
            changed = self._improve_at(stop) - queued
            queue.extend(changed)
            queued |= changed

    def perturb(self, chance: random.Random) -> None:
        """Exchange two parts that follow each other, and improve around them; undo what is not shorter."""
        before = self.order.copy(), self._places.copy(), self._legs_m.copy()
        begin = chance.randrange(1, len(self.order) - 2)
        last = min(begin + LONGEST_PERTURBATION, len(self.order) - 1)
        middle, end = sorted(chance.sample(range(begin + 1, last + 1), 2))
        self._put(begin, np.concatenate([self.order[middle:end], self.order[begin:middle]]))
        middle = begin + end - middle
        self.improve(self.order[[begin - 1, begin, middle - 1, middle, end - 1, end]].tolist())
        if self._legs_m.sum() > before[-1].sum() - SMALLEST_GAIN_M:
            self.order, self._places, self._legs_m = before

    def _improve_at(self, stop: int) -> set[int]:
        """Reverse the best part between a leg of this stop and one near it; return where the legs change."""
        place, legs_m, order = self._places[stop], self._legs_m, self.order
        if not 0 < place < len(legs_m):
            return set()
        near = self._places[self._near[stop]]
        legs = np.concatenate([near[near < len(legs_m)], near[near > 0] - 1, [0, len(legs_m) - 1]])
        changes = []
        for leg in (place - 1, place):
            joined_m = self._between_m(order[leg], order[legs])
            joined_m += self._between_m(order[leg + 1], order[legs + 1])
            gains_m = np.where(legs == leg, 0.0, legs_m[leg] + legs_m[legs] - joined_m)
            best = gains_m.argmax()
            changes.append((gains_m[best], *sorted((leg, legs[best]))))
        gain_m, first, last = max(changes)
        if gain_m <= SMALLEST_GAIN_M:
            return set()
        self._put(first + 1, order[first + 1 : last + 1][::-1])
        return set(order[[first, first + 1, last, last + 1]].tolist())

    def _between_m(self, here: Numbers, there: Numbers) -> np.ndarray:
        """Return the lengths of the paths between these stops; a sum in single precision would be rounded."""
        return np.asarray(self._lengths_m[here, there], dtype=float)

    def _put(self, begin: int, stops: Numbers) -> None:
        """Put these stops into the order, from this place on."""
        end = begin + len(stops)
        self.order[begin:end] = stops
        self._places[stops] = np.arange(begin, end)
        self._legs_m[begin - 1 : end] = self._between_m(
            self.order[begin - 1 : end], self.order[begin : end + 1]
        )
