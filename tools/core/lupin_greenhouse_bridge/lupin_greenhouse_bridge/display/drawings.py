"""Draw the greenhouse, its approach poses and a route. Imports matplotlib only to draw, and never ROS."""

import io
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lupin_greenhouse_bridge.display import colours
from lupin_greenhouse_bridge.display.placing import (
    ARROW_EVERY_M,
    PATH_WIDTH_M,
    Box,
    Point,
    arrows_along,
    ends_of_path,
    length_m,
    place_labels,
    steps_of,
)
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.occupancy import OccupancyMap
from lupin_greenhouse_bridge.planning.route import Route
from lupin_greenhouse_bridge.planning.viewpoints import ApproachPose
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

STOP_HEIGHT_M, JOINED_M = 0.22, 0.25  # stops that are closer share a mark
VIEW_MARGIN_M = 0.15
MOST_ARROWS = 200  # along a path
Style = dict[str, Any]  # of what matplotlib draws
CENTRED: Style = {'ha': 'center', 'va': 'center'}
DASHED = (0, (4, 2))
TAG_M, UNREACHABLE_M = 0.14, 0.24


def point_style(marker: str, colour: str, size: float, **more: Any) -> Style:
    """Return the style of points without a line between them."""
    return {'marker': marker, 'color': colour, 'markersize': size, 'linestyle': '', **more}


TAG, UNREACHABLE = point_style('s', 'black', 5), point_style('X', colours.FAILED, 8)


class LabelSize(NamedTuple):
    """The size of labels in a picture, in metres."""

    character_m: float
    margin_m: float
    height_m: float

    def width_m(self, text: str) -> float:
        """Return the width of a label with this text."""
        return self.character_m * len(text) + self.margin_m


LABELS = LabelSize(0.1, 0.04, 0.18)


def picture_format(path: Path, option: str = '--output') -> str:
    """Return the format of the path's ending; raises StartUpError if matplotlib cannot write it."""
    from matplotlib.backend_bases import FigureCanvasBase

    ending = path.suffix[1:].lower()
    if ending not in (endings := sorted(FigureCanvasBase.get_supported_filetypes())):
        raise StartUpError(f"{option} '{path}': the ending must be one of {', '.join(endings)}")
    return ending


def picture_of(figure: Any, ending: str) -> bytes:
    """Return a figure in a format; raises StartUpError if it cannot be drawn, as one that is too large."""
    from matplotlib.text import Text

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
        axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=colours.TABLE, linewidth=0))
    axes.set_aspect('equal')
    show_all(axes, layout, walls)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel('x (m)')
    axes.spines[:].set_visible(False)  # the walls are the frame
    axes.tick_params(length=0)


def show_all(axes: Any, layout: Layout, walls: Walls, route: Sequence[Point] = ()) -> None:
    """Set the view to the walls, the tags and the route, with a margin around them."""
    points = [walls[:2], walls[2:], *(tag[:2] for tag in layout.tags.values()), *route]
    for set_limits, places in zip((axes.set_xlim, axes.set_ylim), zip(*points, strict=True), strict=True):
        set_limits(min(places) - VIEW_MARGIN_M, max(places) + VIEW_MARGIN_M)


def write_labels(
    axes: Any,
    labels: Sequence[tuple[str, Box, str]],
    size: LabelSize,
    taken: Sequence[Box],
    bounds: Box | None = None,
    **style: Any,
) -> None:
    """Write texts, each given with its dot and its colour, beside their dots and where no box is taken."""
    sized = [(dot, size.width_m(text), size.height_m) for text, dot, _ in labels]
    for place, (text, _, colour) in zip(place_labels(taken, sized, bounds), labels, strict=True):
        axes.text(*place, text, color=colour, fontsize=8, **CENTRED, **style)


def write_key(owner: Any, marks: Sequence[tuple[str, Style]], columns: int, **style: Any) -> None:
    """Write below the axes or the figure what each mark means; Matplotlib 3.5 has no `outside` for it."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], label=label, **mark) for label, mark in marks]
    place = {'loc': 'upper center', 'bbox_to_anchor': (0.5, 0.0), 'frameon': False}
    owner.legend(handles=handles, ncol=columns, **place, **style)


def draw_path(axes: Any, points: Sequence[Point], taken: Collection[Box] = ()) -> None:
    """Draw a thin path from a circle to a square, with arrows where none of these boxes is."""
    axes.plot(*zip(*points, strict=True), color=colours.ROUTE, linewidth=0.9, zorder=1.5)
    style = {'arrowstyle': '-|>', 'color': colours.ROUTE, 'linewidth': 0, 'mutation_scale': 11}
    every_m = max(ARROW_EVERY_M, length_m(points) / MOST_ARROWS)
    for x, y, heading in arrows_along(points, every_m, taken):
        tip = x + 0.01 * math.cos(heading), y + 0.01 * math.sin(heading)
        axes.annotate('', tip, (x, y), arrowprops=style, zorder=1.6)
    for marker, place in (('o', points[0]), ('s', points[-1])):
        axes.scatter(*place, s=28, marker=marker, color='white', edgecolor=colours.ROUTE, zorder=2.5)


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
    axes.set_ylabel('y (m)')
    counts = f'{len(poses)} of {len(layout.tags)} tags have a pose; the route is {route.length_m:.1f} m long'
    axes.set_title(f'where a robot stands to read each tag\n{counts}', fontsize=11)
    sights = [((pose.x, pose.y), layout.tags[tag_id][:2]) for tag_id, pose in poses.items()]
    sight: Style = {'color': colours.SIGHT, 'linestyle': DASHED}
    for line in sights:
        axes.plot(*zip(*line, strict=True), **sight, linewidth=0.7, zorder=1.4)
    stops = join_stops([poses[tag_id][:2] for tag_id in route.tag_ids])
    if route.points_m:
        draw_path(axes, route.points_m, stops.values())
    frame: Style = {
        'boxstyle': 'round,pad=0.25,rounding_size=0.7',
        'facecolor': 'white',
        'edgecolor': colours.ROUTE,
    }
    for text, stop in stops.items():
        style: Style = {'fontsize': 8, 'color': colours.ROUTE, 'zorder': 5, 'bbox': frame}
        axes.text(stop.x, stop.y, text if len(text) > 1 else f' {text} ', **CENTRED, **style)
    points = [(x, y) for path in (*sights, route.points_m) for x, y, _ in steps_of(path, PATH_WIDTH_M)]
    lines = [Box(*point, PATH_WIDTH_M, PATH_WIDTH_M) for point in points]
    _draw_tags(axes, layout, unreachable, route, [*stops.values(), *lines])
    marks: list[tuple[str, Style, bool]] = [
        (
            'route, in the direction of its arrows',
            {'color': colours.ROUTE, 'marker': '>', 'markersize': 5},
            True,
        ),
        (
            'stop of the robot, in order; close ones share a mark',
            point_style('o', colours.ROUTE, 10, markerfacecolor='white'),
            True,
        ),
        ('from a stop to its tag', sight, True),
        ('tag and its id', TAG, True),
        ('table', point_style('s', colours.TABLE, 9), True),
        ('tag without a pose', UNREACHABLE, bool(unreachable)),
        ('obstacle in the map', point_style('s', colours.OBSTACLE, 8), occupancy is not None),
    ]
    shown = [(label, {'linewidth': 0.9, **mark}) for label, mark, is_shown in marks if is_shown]
    write_key(axes, shown, columns=2, fontsize=9, borderaxespad=3.6)  # below the label of the x axis
    return figure


def join_stops(stops: list[Point]) -> dict[str, Box]:
    """Return the marks of the stops along a route: their numbers, such as `4, 5` or `19-21`, and a place."""
    groups: list[list[tuple[int, Point]]] = []
    for number, stop in enumerate(stops, start=1):
        group = next((each for each in groups if math.dist(each[0][1], stop) < JOINED_M), [])
        groups += [] if group else [group]
        group.append((number, stop))
    marks = {}
    for group in groups:
        numbers, places = zip(*group, strict=True)
        is_run = len(numbers) > 2 and numbers[-1] - numbers[0] == len(numbers) - 1
        text = f'{numbers[0]}-{numbers[-1]}' if is_run else ', '.join(map(str, numbers))
        x, y = np.mean(places, axis=0).tolist()
        marks[text] = Box(x, y, LABELS.width_m(text) + 0.04, STOP_HEIGHT_M)
    return marks


def _draw_map(axes: Any, occupancy: OccupancyMap) -> None:
    """Draw the obstacles and the unknown parts of a map, over the tables and below the rest."""
    from matplotlib.colors import to_rgba
    from matplotlib.transforms import Affine2D

    cells = np.zeros((*occupancy.is_occupied.shape, 4))
    cells[occupancy.is_occupied] = to_rgba(colours.OBSTACLE, 0.8)
    cells[occupancy.is_unknown] = to_rgba(colours.UNKNOWN_PART, 0.5)
    height, width = np.array(occupancy.is_occupied.shape) * occupancy.resolution_m
    x, y, yaw = occupancy.origin
    axes.imshow(
        cells,
        origin='lower',
        extent=(0.0, width, 0.0, height),
        interpolation='none',
        transform=Affine2D().rotate(yaw).translate(x, y) + axes.transData,
        zorder=1.5,
    )


def _draw_tags(
    axes: Any, layout: Layout, unreachable: Collection[str], route: Route, taken: Sequence[Box]
) -> None:
    """Draw the tags, and write their ids and the words at the ends of the route where no box is taken."""
    labels = []
    for tag_id, tag in layout.tags.items():
        mark, side_m = (UNREACHABLE, UNREACHABLE_M) if tag_id in unreachable else (TAG, TAG_M)
        axes.plot(*tag[:2], **mark, zorder=3)
        labels.append((tag_id, Box(*tag[:2], side_m, side_m), mark['color']))
    labels += [(word, mark, colours.ROUTE) for word, mark in ends_of_path(route.points_m).items()]
    dots = [dot for _, dot, _ in labels]
    write_labels(axes, labels, LABELS, [*dots, *taken], fontweight='bold', zorder=6)
