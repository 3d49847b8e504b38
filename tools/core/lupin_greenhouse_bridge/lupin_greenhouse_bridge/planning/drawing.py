"""
Draw the greenhouse, its approach poses and a route, and find places for labels. Does not import ROS.

Imports matplotlib only to draw, because the markers need the labels alone.
"""

import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from lupin_greenhouse_bridge.planning.approach import ApproachPose
from lupin_greenhouse_bridge.planning.occupancy import OccupancyMap
from lupin_greenhouse_bridge.planning.route import Route
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

COLOURS = 'viridis'  # readable in black and white, and for colour-blind people
ROUTE_COLOUR, POSE_COLOUR, BAD_COLOUR, OBSTACLE_COLOUR = '#56b4e9', '#0072b2', '#d00000', '#e69f00'
ARROW_M, TAG_M, BAD_TAG_M = 0.22, 0.14, 0.24
CHARACTER_M, LINE_M = 0.1, 0.18  # of a label in the picture
VIEW_M = 0.15  # around all that is drawn


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
    dots: list[Box], labels: list[tuple[Box, float, float]], bounds: Box | None = None
) -> list[tuple[float, float]]:
    """
    Return the centre of each label: beside its dot, off the other dots and labels, and within the bounds.

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
        around = np.array([Box(dot.x, dot.y, 4 * aside + width, 4 * above + height)])
        near = taken[:count][_overlaps(around, taken[:count])[0] > 0.0]
        costs = _overlaps(boxes, near).sum(axis=1)
        if bounds:
            costs += width * height - _overlaps(boxes, np.array([bounds]))[:, 0]
        best = boxes[np.argmin(costs.round(4))]  # the nearest of equals
        taken[count] = best
        places.append((float(best[0]), float(best[1])))
    return places


def draw_greenhouse(axes: Any, layout: Layout, walls: Walls) -> None:
    """Draw walls, tables and a scale in metres; the view includes tags outside the walls."""
    from matplotlib.patches import Rectangle

    axes.add_patch(Rectangle(walls[:2], walls.x1 - walls.x0, walls.y1 - walls.y0, fill=False, linewidth=1.5))
    for x0, y0, x1, y1 in layout.tables.values():
        axes.add_patch(
            Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor='0.92', edgecolor='0.55', linewidth=0.8)
        )
    xs, ys = zip(walls[:2], walls[2:], *(tag[:2] for tag in layout.tags.values()), strict=True)
    axes.set_xlim(min(xs) - VIEW_M, max(xs) + VIEW_M)
    axes.set_ylim(min(ys) - VIEW_M, max(ys) + VIEW_M)
    axes.set_aspect('equal')
    axes.set_xlabel('x (m)')


def draw_route(
    layout: Layout,
    walls: Walls,
    poses: Mapping[str, ApproachPose],
    unreachable: Collection[str],
    route: Route,
    occupancy: OccupancyMap | None = None,
) -> Any:
    """
    Return a figure of the greenhouse, the poses as arrows, the route, and unreachable tags in red.

    A map of the room, in the frame of the layout, lies beneath: its obstacles orange, its unknown parts grey.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.2, 8.8), layout='constrained')
    axes = figure.add_subplot()
    if occupancy is not None:
        _draw_map(axes, occupancy)
    draw_greenhouse(axes, layout, walls)
    if route.points_m:
        axes.plot(*zip(*route.points_m, strict=True), color=ROUTE_COLOUR, linewidth=1.8, label='route')
        axes.plot(
            *route.points_m[0], 'o', markersize=9, markerfacecolor='white', color=POSE_COLOUR, label='start'
        )
    arrows = [
        (each.x, each.y, math.cos(each.yaw) * ARROW_M, math.sin(each.yaw) * ARROW_M)
        for each in poses.values()
    ]
    if arrows:
        scale = {'angles': 'xy', 'scale_units': 'xy', 'scale': 1, 'width': 0.008}
        axes.quiver(*zip(*arrows, strict=True), **scale, color=POSE_COLOUR, zorder=4)
        axes.plot([], [], ls='', marker=r'$\rightarrow$', markersize=12, color=POSE_COLOUR, label='pose')
    _draw_tags(axes, layout, unreachable, [Box(x + dx / 2, y + dy / 2, 0.2, 0.2) for x, y, dx, dy in arrows])
    axes.set_ylabel('y (m)')
    axes.set_title(
        f'{len(poses)} of {len(layout.tags)} tags have a pose; route {route.length_m:.1f} m', fontsize=10
    )
    axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.06), ncol=5, frameon=False, fontsize=9)
    return figure


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
    axes.plot([], [], 's', color=OBSTACLE_COLOUR, label='map')


def _draw_tags(axes: Any, layout: Layout, unreachable: Collection[str], taken: list[Box]) -> None:
    """Draw the tags, and their ids where these boxes are not."""
    from matplotlib.patheffects import withStroke

    for is_bad, style in (
        (False, {'marker': 's', 'markersize': 4.5, 'color': 'black', 'label': 'tag'}),
        (True, {'marker': 'X', 'markersize': 8, 'color': BAD_COLOUR, 'label': 'tag without a pose'}),
    ):
        if some := [tag[:2] for tag_id, tag in layout.tags.items() if (tag_id in unreachable) is is_bad]:
            axes.plot(*zip(*some, strict=True), ls='', zorder=3, **style)
    sizes_m = [BAD_TAG_M if tag_id in unreachable else TAG_M for tag_id in layout.tags]
    dots = [Box(tag.x, tag.y, side, side) for tag, side in zip(layout.tags.values(), sizes_m, strict=True)]
    labels = [(dot, CHARACTER_M * len(tag_id), LINE_M) for tag_id, dot in zip(layout.tags, dots, strict=True)]
    style = {'ha': 'center', 'va': 'center', 'fontsize': 8, 'fontweight': 'bold', 'zorder': 6}
    outline = [withStroke(linewidth=2, foreground='white')]
    for place, tag_id in zip(place_labels([*dots, *taken], labels), layout.tags, strict=True):
        colour = BAD_COLOUR if tag_id in unreachable else 'black'
        axes.text(*place, tag_id, color=colour, path_effects=outline, **style)
