# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
Draw the greenhouse, its approach poses and a route, and find places for labels. Does not import ROS.

Imports matplotlib only to draw, because the markers need the labels alone.
"""

import io
import itertools
import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.approach import ApproachPose
from lupin_greenhouse_bridge.planning.occupancy import OccupancyMap
from lupin_greenhouse_bridge.planning.route import Route
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

COLOURS = 'viridis'  # readable in black and white, and for colour-blind people
ROUTE_COLOUR, BAD_COLOUR, SIGHT_COLOUR = '#3d6fa8', '#b3261e', '0.4'
OBSTACLE_COLOUR = '#e69f00'  # in the map of the room
TABLE_COLOUR = '#e3e6ea'  # without an edge, which would cross the labels
ARROW_EVERY_M = 0.8
WAY_M = 0.1  # the width that a label leaves to a route
TAG_M, BAD_TAG_M, STOP_M = 0.14, 0.24, 0.22
JOINED_M = 0.25  # stops that are closer share a mark
CHARACTER_M, LINE_M = 0.1, 0.18  # of a label in the picture
VIEW_M = 0.15  # around all that is drawn


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


def _overlaps(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the common area of each box with each other one, from arrays (boxes, 4)."""
    middles, sizes = boxes[:, None, :2], boxes[:, None, 2:]
    lows = np.maximum(middles - sizes / 2, others[:, :2] - others[:, 2:] / 2)
    highs = np.minimum(middles + sizes / 2, others[:, :2] + others[:, 2:] / 2)
    return np.maximum(highs - lows, 0.0).prod(axis=2)


def place_labels(
    dots: list[Box], labels: list[tuple[Box, float, float]], bounds: Box | None = None
) -> list[tuple[float, float]]:
    """
    Return the centre of each label: beside its dot, off the other dots and labels, and within the bounds.

    Each label is given as its dot, its width and its height. On a dot without a size, its label may lie,
    or beside it with a gap.
    """
    taken = np.zeros((len(dots) + len(labels), 4))  # the dots, and then the labels
    taken[: len(dots)] = np.reshape(dots, (-1, 4))
    places = []
    for count, (dot, width, height) in enumerate(labels, start=len(dots)):
        gap = 0.5 * height if dot.width == 0 else 0.0  # to a dot that the label could cover
        aside, above = (dot.width + gap + width) / 2, (dot.height + gap + height) / 2
        tries = [(aside, 0), (-aside, 0), (0, above), (0, -above)]
        tries += [(x * aside, y * above) for y in (0.7, -0.7, 1.0, -1.0) for x in (1, -1)]
        tries += [(2 * x, 2 * y) for x, y in tries]
        tries = [(0, 0)] * (dot.width == 0) + tries
        boxes = np.array([Box(dot.x + dx, dot.y + dy, width, height) for dx, dy in tries])
        around = np.array([Box(dot.x, dot.y, 4 * aside + width, 4 * above + height)])
        near = taken[:count][_overlaps(around, taken[:count])[0] > 0.0]
        costs = _overlaps(boxes, near).sum(axis=1)
        if bounds:
            costs += width * height - _overlaps(boxes, np.array([bounds]))[:, 0]
        best = boxes[np.argmin(costs.round(4))]  # the nearest of equals
        taken[count] = best
        places.append((float(best[0]), float(best[1])))
    return places


def picture_of(figure: Any, path: Path, option: str = '--output') -> bytes:
    """
    Return a figure in the format of the path's ending, PNG if it has none.

    Raises StartUpError, which names the option of the path, for a format that matplotlib cannot write, and
    for a figure that it cannot draw, such as one that is too large.
    """
    from matplotlib.text import Text

    ending = path.suffix[1:].lower() or 'png'
    if ending not in (endings := sorted(figure.canvas.get_supported_filetypes())):
        raise StartUpError(f"{option} '{path}': the ending must be one of {', '.join(endings)}")
    for text in figure.findobj(Text):  # what a file holds is text and no formula
        text.set_text(text.get_text().replace('$', r'\$'))
    picture = io.BytesIO()
    try:
        figure.savefig(picture, format=ending, dpi=130, bbox_inches='tight', pad_inches=0.15)
    except ValueError as error:
        raise StartUpError(f'the picture cannot be drawn: {error}') from error
    return picture.getvalue()


def draw_greenhouse(axes: Any, layout: Layout, walls: Walls) -> None:
    """Draw walls, tables and a scale in metres; the view includes tags outside the walls."""
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import MaxNLocator

    axes.add_patch(Rectangle(walls[:2], walls.x1 - walls.x0, walls.y1 - walls.y0, fill=False, linewidth=1.5))
    for x0, y0, x1, y1 in layout.tables.values():
        axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=TABLE_COLOUR, linewidth=0))
    xs, ys = zip(walls[:2], walls[2:], *(tag[:2] for tag in layout.tags.values()), strict=True)
    axes.set_xlim(min(xs) - VIEW_M, max(xs) + VIEW_M)
    axes.set_ylim(min(ys) - VIEW_M, max(ys) + VIEW_M)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True))
    axes.set_aspect('equal')
    axes.set_xlabel('x (m)')


def steps_of(points: list[tuple[float, float]], length_m: float):
    """Yield x, y and heading of points along a path, each as far from the last one."""
    rest = 0.0
    for (x, y), (to_x, to_y) in itertools.pairwise(points):
        leg_m, at = math.dist((x, y), (to_x, to_y)), rest
        while at < leg_m:
            share = at / leg_m
            yield x + (to_x - x) * share, y + (to_y - y) * share, math.atan2(to_y - y, to_x - x)
            at += length_m
        rest = at - leg_m


def draw_path(axes: Any, points: list[tuple[float, float]], places: Collection[Box] = ()) -> None:
    """Draw a thin path with arrows where none of these places is, from a circle to a square."""
    axes.plot(*zip(*points, strict=True), color=ROUTE_COLOUR, linewidth=0.9, zorder=1.5)
    style = {'arrowstyle': '-|>', 'color': ROUTE_COLOUR, 'linewidth': 0, 'mutation_scale': 11}
    last, taken = points[0], list(places)  # a circle marks the start
    for x, y, heading in steps_of(points, ARROW_EVERY_M / 8):
        is_free = not any(math.hypot(x - each.x, y - each.y) < (each.width + WAY_M) / 2 for each in taken)
        if is_free and math.dist((x, y), last) > ARROW_EVERY_M:
            tip = x + 0.01 * math.cos(heading), y + 0.01 * math.sin(heading)
            axes.annotate('', tip, (x, y), arrowprops=style, zorder=1.6)
            last = x, y
            taken.append(Box(x, y, STOP_M, STOP_M))
    for marker, place in (('o', points[0]), ('s', points[-1])):
        axes.scatter(*place, s=28, marker=marker, color='white', edgecolor=ROUTE_COLOUR, zorder=2.5)


def label_path(points: list[tuple[float, float]]) -> dict[str, Box]:
    """Return the words at the start and the end of a path, and their places."""
    places = [Box(*place, BAD_TAG_M, BAD_TAG_M) for place in (*points[:1], *points[-1:])]
    if not places:
        return {}
    if math.dist(points[0], points[-1]) < WAY_M:
        return {'start and end': places[0]}
    return dict(zip(('start', 'end'), places, strict=True))


def draw_route(
    layout: Layout,
    walls: Walls,
    poses: Mapping[str, ApproachPose],
    unreachable: Collection[str],
    route: Route,
    occupancy: OccupancyMap | None = None,
) -> Any:
    """
    Return a figure of the greenhouse, the route, its stops with numbers, and unreachable tags in red.

    A map of the room, in the frame of the layout, lies beneath: its obstacles orange, its unknown parts grey.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.2, 8.8), layout='constrained')
    axes = figure.add_subplot()
    if occupancy is not None:
        _draw_map(axes, occupancy)
    draw_greenhouse(axes, layout, walls)
    axes.spines[:].set_visible(False)  # the walls are the frame
    axes.tick_params(length=0)
    stops = join_stops([poses[tag_id][:2] for tag_id in route.tag_ids])
    sights = [((each.x, each.y), layout.tags[tag_id][:2]) for tag_id, each in poses.items()]
    for pose, tag in sights:
        axes.plot(
            *zip(pose, tag, strict=True), color=SIGHT_COLOUR, linewidth=0.7, linestyle=(0, (4, 2)), zorder=1.4
        )
    if route.points_m:
        draw_path(axes, route.points_m, stops.values())
    frame = {'boxstyle': 'round,pad=0.25,rounding_size=0.7', 'facecolor': 'white', 'edgecolor': ROUTE_COLOUR}
    for text, stop in stops.items():
        style = {'ha': 'center', 'va': 'center', 'fontsize': 8, 'color': ROUTE_COLOUR, 'zorder': 5}
        axes.text(*stop[:2], text if len(text) > 1 else f' {text} ', bbox=frame, **style)
    paths = [*sights, route.points_m]
    ways = [Box(x, y, WAY_M, WAY_M) for path in paths for x, y, _ in steps_of(path, WAY_M)]
    _draw_tags(axes, layout, unreachable, [*stops.values(), *ways], label_path(route.points_m))
    axes.set_ylabel('y (m)')
    counts = f'{len(poses)} of {len(layout.tags)} tags have a pose; the route is {route.length_m:.1f} m long'
    axes.set_title(f'where a robot stands to read each tag\n{counts}', fontsize=11)
    _draw_key(axes, has_unreachable=bool(unreachable), has_map=occupancy is not None)
    return figure


def join_stops(stops: list[tuple[float, float]]) -> dict[str, Box]:
    """Return the marks of the stops along a route: their numbers, such as `4, 5` or `19-21`, and a place."""
    groups: list[list[tuple[int, tuple[float, float]]]] = []
    for number, stop in enumerate(stops, start=1):
        group = next((each for each in groups if math.dist(each[0][1], stop) < JOINED_M), [])
        groups += [] if group else [group]
        group.append((number, stop))
    marks = {}
    for group in groups:
        numbers, places = zip(*group, strict=True)
        is_run = len(numbers) > 2 and numbers[-1] - numbers[0] == len(numbers) - 1
        text = f'{numbers[0]}-{numbers[-1]}' if is_run else ', '.join(map(str, numbers))
        marks[text] = Box(*np.mean(places, axis=0).tolist(), CHARACTER_M * len(text) + 0.08, STOP_M)
    return marks


def _draw_map(axes: Any, occupancy: OccupancyMap) -> None:
    """Draw the obstacles and the unknown parts of a map, over the tables and below the rest."""
    from matplotlib.colors import to_rgba
    from matplotlib.transforms import Affine2D

    colours = np.zeros((*occupancy.is_occupied.shape, 4))
    colours[occupancy.is_occupied] = to_rgba(OBSTACLE_COLOUR, 0.8)
    colours[occupancy.is_unknown] = to_rgba('0.7', 0.5)
    height, width = np.array(occupancy.is_occupied.shape) * occupancy.resolution_m
    x, y, yaw = occupancy.origin
    axes.imshow(
        colours,
        origin='lower',
        extent=(0.0, width, 0.0, height),
        interpolation='none',
        transform=Affine2D().rotate(yaw).translate(x, y) + axes.transData,
        zorder=1.5,
    )


def _draw_tags(
    axes: Any, layout: Layout, unreachable: Collection[str], taken: list[Box], words: Mapping[str, Box]
) -> None:
    """Draw the tags, and write their ids and these words where none of these boxes is."""
    for is_bad, style in (
        (False, {'marker': 's', 'markersize': 5, 'color': 'black'}),
        (True, {'marker': 'X', 'markersize': 8, 'color': BAD_COLOUR}),
    ):
        if some := [tag[:2] for tag_id, tag in layout.tags.items() if (tag_id in unreachable) is is_bad]:
            axes.plot(*zip(*some, strict=True), ls='', zorder=3, **style)
    sizes_m = [BAD_TAG_M if tag_id in unreachable else TAG_M for tag_id in layout.tags]
    dots = [Box(tag.x, tag.y, side, side) for tag, side in zip(layout.tags.values(), sizes_m, strict=True)]
    places = dict(zip(layout.tags, dots, strict=True)) | words
    labels = [(dot, CHARACTER_M * len(text) + 0.04, LINE_M) for text, dot in places.items()]
    style = {'ha': 'center', 'va': 'center', 'fontsize': 8, 'zorder': 6}
    for place, text in zip(place_labels([*dots, *taken], labels), places, strict=True):
        is_tag = text in layout.tags
        colour = ROUTE_COLOUR if not is_tag else BAD_COLOUR if text in unreachable else 'black'
        axes.text(*place, text, color=colour, fontweight='bold', **style)


def _draw_key(axes: Any, *, has_unreachable: bool, has_map: bool) -> None:
    """Write below the axes what each mark means."""
    marks = [
        ('route, in the direction of its arrows', {'color': ROUTE_COLOUR, 'marker': '>', 'markersize': 5}),
        (
            'stop of the robot, in order; close ones share a mark',
            {'color': ROUTE_COLOUR, 'ls': '', 'marker': 'o', 'markersize': 10, 'markerfacecolor': 'white'},
        ),
        ('from a stop to its tag', {'color': SIGHT_COLOUR, 'ls': (0, (4, 2))}),
        ('tag and its id', {'color': 'black', 'ls': '', 'marker': 's', 'markersize': 5}),
        ('table', {'color': TABLE_COLOUR, 'ls': '', 'marker': 's', 'markersize': 9}),
    ]
    if has_unreachable:
        marks.append(('tag without a pose', {'color': BAD_COLOUR, 'ls': '', 'marker': 'X', 'markersize': 8}))
    if has_map:
        style = {'color': OBSTACLE_COLOUR, 'ls': '', 'marker': 's', 'markersize': 8}
        marks.append(('obstacle in the map', style))
    for label, style in marks:
        axes.plot([], [], linewidth=0.9, label=label, **style)
    # Below the label of the x axis, in whatever size the axes are.
    axes.legend(
        loc='upper center', bbox_to_anchor=(0.5, 0.0), borderaxespad=3.6, ncol=2, frameon=False, fontsize=9
    )
