# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Find places for labels and arrows in metres. Does not import ROS."""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from lupin_greenhouse_bridge.planning.walls import Walls

ARROW_M = 0.22
ARROW_EVERY, MOST_ARROWS = 4, 200  # along a path without stops: in lengths of an arrow
ARROWS_APART = 0.9  # at least, in lengths of an arrow
# Parts of a path that are as close and as parallel (as a sine) lie beside each other; and its steps at most.
SHARED_M, PARALLEL, MOST_STEPS = 0.06, 0.3, 1000
SMOOTHED = 9  # steps, an odd number
PATH_WIDTH_M = 0.1  # that a label leaves to a path
# Of a label at the double distance from its dot, of one nearer to another dot, and on a box below: shares of
# its area.
FAR_COST, NEARER_COST, BELOW_COST = 0.15, 0.05, 0.05
END_M = 0.24  # the mark at an end of a path
PLACE_SHARE = 0.2  # of the robot's radius: stops that are closer are at one place
# In radii of the disc of a number: the nearest distance from its stop, and the farthest one beyond the robot.
# So far away from it should lines, tags, other numbers, walls and other robots be; the last is the distance
# from another stop, in distances from its own.
NEAREST, BEYOND, ASIDE, DISTANCES, DIRECTIONS, SWEEPS = 1.6, 2.4, 0.7, 17, 72, 3
LINE_APART, TAG_APART, NUMBER_APART, WALL_APART, ROBOT_APART, OTHER_SHARE = 1.35, 2.2, 2.3, 1.3, 2.0, 1.3
# What it costs to hide something, to be near another stop or robot, to be away from the rim of its own robot,
# and to be aside of its heading, at a shared place, or ahead.
HIDING_COST, OTHER_COST, ROBOT_COST, AWAY_COST, ASIDE_COST, AHEAD_COST = 2.0, 0.6, 0.09, 0.1, 1.5, 0.045
Point = tuple[float, float]


class Box(NamedTuple):
    """A rectangle in metres: its centre and its size."""

    x: float
    y: float
    width: float
    height: float


def box_of(walls: Walls) -> Box:
    """Return the rectangle within the walls."""
    x0, y0, x1, y1 = walls
    return Box((x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0)


def overlaps(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the common area of each box with each other one, from arrays (boxes, 4)."""
    middles, sizes = boxes[:, None, :2], boxes[:, None, 2:]
    lows = np.maximum(middles - sizes / 2, others[:, :2] - others[:, 2:] / 2)
    highs = np.minimum(middles + sizes / 2, others[:, :2] + others[:, 2:] / 2)
    areas: np.ndarray = np.maximum(highs - lows, 0.0).prod(axis=2)
    return areas


def place_labels(
    dots: Sequence[Box],
    labels: Sequence[tuple[Box, float, float]],
    bounds: Box | None = None,
    below: Sequence[Box] = (),
) -> list[Point]:
    """
    Return the centre of each label: nearest to its own dot, off the dots and labels, and within the bounds.

    Each label is given as its dot, its width and its height. A label may lie on its own dot if this dot has
    no size, or else beside it with a gap; and on a box below, if the other places are worse.
    """
    taken = np.zeros((len(dots) + len(labels), 4))  # the dots, and then the labels
    taken[: len(dots)] = np.reshape(dots, (-1, 4))
    labelled = np.reshape([dot for dot, _, _ in labels], (-1, 4))
    places = []
    for count, (dot, width, height) in enumerate(labels, start=len(dots)):
        gap = 0.5 * height if dot.width == 0 else 0.0
        aside, above = (dot.width + gap + width) / 2, (dot.height + gap + height) / 2
        tries = [(aside, 0), (-aside, 0), (0, above), (0, -above)]
        tries += [(x * aside, y * above) for y in (0.7, -0.7, 1.0, -1.0) for x in (1, -1)]
        tries += [(2 * x, 2 * y) for x, y in tries]
        tries = [(0, 0)] * (dot.width == 0) + tries
        boxes = np.array([Box(dot.x + dx, dot.y + dy, width, height) for dx, dy in tries])
        around = np.array([Box(dot.x, dot.y, 4 * aside + width, 4 * above + height)])
        near = taken[:count][overlaps(around, taken[:count])[0] > 0.0]
        costs = overlaps(boxes, near).sum(axis=1)
        costs += BELOW_COST * overlaps(boxes, np.reshape(below, (-1, 4))).sum(axis=1)
        if dot.width:
            others = labelled[overlaps(around, labelled)[0] > 0.0]
            distances_m, to_dot_m = (
                np.hypot(*(boxes[:, None] - each)[..., :2].T) for each in (others, np.array([dot]))
            )
            costs[(distances_m < to_dot_m - 1e-9).any(axis=0)] += NEARER_COST * width * height
            costs[len(tries) // 2 :] += FAR_COST * width * height
        if bounds:
            costs += width * height - overlaps(boxes, np.array([bounds]))[:, 0]
        best = boxes[np.argmin(costs.round(4))]  # the nearest of equals
        taken[count] = best
        places.append((float(best[0]), float(best[1])))
    return places


def place_numbers(
    sights: Sequence[tuple[Point, Point]],
    path: Sequence[Point],
    tags: Sequence[Point],
    walls: Walls,
    robot_m: float,
    disc_m: float,
) -> list[Point]:
    """
    Return the centres of the numbers of the stops from which these lines of sight begin, each on a disc.

    A number lies at the rim of the robot, or a little farther away, where it hides no line, tag or other
    number: behind the robot, or on its own line of sight if several stops are at one place.
    """
    lines = np.reshape(
        [complex(*end) for line in (*sights, *itertools.pairwise(path)) for end in line], (-1, 2)
    )
    starts, ends = lines.T / disc_m
    stops, marks = starts[: len(sights)], np.array([complex(*tag) for tag in tags]) / disc_m
    x0, y0, x1, y1 = np.array(walls) / disc_m
    radius = robot_m / disc_m
    rim = max(radius, NEAREST)
    turns = np.exp(2j * math.pi * np.arange(DIRECTIONS) / DIRECTIONS)
    tried = np.multiply.outer(np.linspace(NEAREST, rim + BEYOND, DISTANCES), turns).ravel()
    reach = rim + BEYOND + radius + ROBOT_APART
    numbers = stops.copy()
    for at in SWEEPS * list(range(len(stops))):
        here, discs = stops[at], (stops[at] + tried)[:, None]
        others = stops[np.abs(stops - here) > PLACE_SHARE * radius]
        is_alone = len(others) == len(stops) - 1
        ahead = (turns * np.exp(-1j * np.angle(ends[at] - here))).real
        costs = AWAY_COST * (np.abs(tried) - rim - (0.0 if is_alone else ASIDE)) ** 2
        costs += np.tile(AHEAD_COST * ahead if is_alone else -ASIDE_COST * ahead, DISTANCES)
        is_near = gaps_to(here, starts, ends) < reach
        is_near[at] = is_alone
        costs += HIDING_COST * _lack(gaps_to(discs, starts[is_near], ends[is_near]), LINE_APART)
        for points, apart in ((marks, TAG_APART), (np.delete(numbers, at), NUMBER_APART)):
            costs += HIDING_COST * _lack(np.abs(discs - points[np.abs(points - here) < reach]), apart)
        to_walls = np.hstack([discs.real - x0, x1 - discs.real, discs.imag - y0, y1 - discs.imag])
        costs += HIDING_COST * _lack(to_walls, WALL_APART)
        to_others = np.abs(discs - others[np.abs(others - here) < reach])
        costs += OTHER_COST * _lack(to_others, OTHER_SHARE * np.abs(tried)[:, None])
        costs += ROBOT_COST * _lack(to_others, radius + ROBOT_APART)
        numbers[at] = discs[costs.round(6).argmin(), 0]
    return [(disc_m * float(each.real), disc_m * float(each.imag)) for each in numbers]


def bow(along: np.ndarray, at: float) -> np.ndarray:
    """Return how far aside a bow is, as shares: along it from 0 to 1, and farthest at this place."""
    before, after = np.clip(along / at, 0.0, 1.0), np.clip((along - at) / (1.0 - at), 0.0, 1.0)
    aside: np.ndarray = np.sin(math.pi / 2 * before) * np.cos(math.pi / 2 * after) ** 2
    return aside


def _lack(gaps: np.ndarray, wanted: float | np.ndarray) -> np.ndarray:
    """Return for each row of gaps the sum of the squares of what they lack."""
    lacks: np.ndarray = (np.maximum(wanted - gaps, 0.0) ** 2).sum(axis=1)
    return lacks


def gaps_to(points: Any, starts: Any, ends: Any) -> np.ndarray:
    """Return the distances of points from lines, all given as arrays of complex numbers."""
    lines = ends - starts
    shares = ((points - starts) * np.conj(lines)).real / np.maximum(np.abs(lines) ** 2, 1e-12)
    gaps: np.ndarray = np.abs(points - starts - np.clip(shares, 0.0, 1.0) * lines)
    return gaps


def steps_of(points: Sequence[Point], every_m: float) -> Iterator[tuple[float, float, float]]:
    """Yield x, y and heading of points along a path, this far from each other."""
    rest = 0.0
    for (x, y), (to_x, to_y) in itertools.pairwise(points):
        leg_m, at = math.dist((x, y), (to_x, to_y)), rest
        while at < leg_m:
            share = at / leg_m
            yield x + (to_x - x) * share, y + (to_y - y) * share, math.atan2(to_y - y, to_x - x)
            at += every_m
        rest = at - leg_m


def arrows_between(
    points: Sequence[Point], stops: Sequence[Box], arrow_m: float = ARROW_M
) -> list[tuple[float, float, float]]:
    """Return x, y and heading near the middle of each leg of a path that has room for an arrow."""
    steps, step_m = list(steps_of(points, arrow_m / 8)), arrow_m / 8
    places, is_leg = np.reshape(steps, (-1, 3))[:, :2], np.ones(len(steps), bool)
    for stop in stops:
        is_leg &= np.hypot(*(places - stop[:2]).T) > stop.width / 2
    groups = itertools.groupby(zip(steps, is_leg, strict=True), lambda each: bool(each[1]))
    legs = [[each for each, _ in leg] for is_free, leg in groups if is_free]
    arrows: list[tuple[float, float, float]] = []
    for leg in (each for each in legs if len(each) * step_m > arrow_m):
        middle = len(leg) // 2
        outwards = sorted(range(4, len(leg) - 4), key=lambda n: abs(n - middle))
        straight = [leg[n] for n in outwards if math.dist(leg[n - 4][:2], leg[n + 4][:2]) > 0.999 * arrow_m]
        others, apart_m = [at[:2] for at in arrows], ARROWS_APART * arrow_m
        is_free = (each for each in straight if all(math.dist(each[:2], at) > apart_m for at in others))
        arrows.append(next(is_free, leg[middle]))
    return arrows


def stops_of(points: Sequence[Point]) -> list[Point]:
    """Return where a robot stood on its path: the points that are there twice in a row."""
    return list(dict.fromkeys(here for here, there in itertools.pairwise(points) if here == there))


def marks_of(points: Sequence[Point], arrow_m: float = ARROW_M) -> list[Box]:
    """Return the boxes between which a path has arrows: its stops, or even distances if it has none."""
    every_m = max(ARROW_EVERY * arrow_m, length_m(points) / MOST_ARROWS)
    places = stops_of(points) or [(x, y) for x, y, _ in steps_of(points, every_m)]
    return [Box(*place, arrow_m, arrow_m) for place in places]


def lanes_of(points: Sequence[Point]) -> np.ndarray:
    """
    Return rows of x, y, heading and how to shift the point, so that parts that share a piece are apart.

    A shift is in x and y, in distances between two lanes. The first part is at the right of the next one.
    """
    step_m = max(SHARED_M / 2, length_m(points) / MOST_STEPS)
    if len(points) > MOST_STEPS:
        points = [*((x, y) for x, y, _ in steps_of(points, step_m)), points[-1]]
    steps = [each for leg in itertools.pairwise(points) for each in steps_of(leg, step_m)]
    last_heading = steps[-1][2] if steps else 0.0
    x, y, heading = np.array([*steps, (*points[-1], last_heading)]).T
    is_near = np.hypot(x[:, None] - x, y[:, None] - y) < SHARED_M
    is_near &= np.abs(np.sin(heading[:, None] - heading)) < PARALLEL
    parts = np.cumsum(np.diff(is_near, axis=1, prepend=False) & is_near, axis=1)
    lanes, first = (parts[:, -1] + 1) / 2 - parts.diagonal(), heading[is_near.argmax(axis=1)]
    shifts = np.column_stack([lanes * np.sin(first), -lanes * np.cos(first)])
    padded = np.pad(shifts, ((SMOOTHED // 2, SMOOTHED // 2), (0, 0)), 'symmetric')
    mean = np.full(SMOOTHED, 1 / SMOOTHED)
    shifts = np.column_stack([np.convolve(each, mean, 'valid') for each in padded.T])
    shifts[[0, -1]] = 0.0  # where the marks of the ends are
    return np.column_stack([x, y, heading, shifts])


def ends_of_path(points: Sequence[Point]) -> dict[str, Box]:
    """Return the words at the start and the end of a path, and the marks beside which they lie."""
    marks = [Box(*point, END_M, END_M) for point in (*points[:1], *points[-1:])]
    if marks and math.dist(points[0], points[-1]) < PATH_WIDTH_M:
        return {'start, end': marks[0]}
    return dict(zip(('start', 'end'), marks, strict=False))


def length_m(points: Sequence[Point]) -> float:
    """Return the length of a path."""
    return sum(itertools.starmap(math.dist, itertools.pairwise(points)))


def closest_m(points: Sequence[Point]) -> float:
    """Return the distance of the two closest points that are not at the same place; 1.0 if there are none."""
    places = np.unique(np.reshape(points, (-1, 2)), axis=0)
    apart_m = [float(np.hypot(*(places[n + 1 :] - place).T).min()) for n, place in enumerate(places[:-1])]
    return min(apart_m, default=1.0)
