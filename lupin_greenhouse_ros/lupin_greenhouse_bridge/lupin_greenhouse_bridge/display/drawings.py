# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Draw the greenhouse, its approach poses and a route. Imports matplotlib only to draw, and never ROS."""

import io
import math
import os
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lupin_greenhouse_bridge.display import colours
from lupin_greenhouse_bridge.display.placing import (
    ARROW_M,
    PATH_WIDTH_M,
    PLACE_SHARE,
    Box,
    Point,
    arrows_between,
    bow,
    box_of,
    ends_of_path,
    gaps_to,
    place_labels,
    place_numbers,
    steps_of,
)
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.approach import Approaches
from lupin_greenhouse_bridge.planning.occupancy import OccupancyMap
from lupin_greenhouse_bridge.planning.route import Route
from lupin_greenhouse_bridge.planning.viewpoints import ApproachPose
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

os.environ['MPLBACKEND'] = 'Agg'  # only files are written, so no other backend is asked for
# These sizes are for a view of 4.3 m x 8.3 m with up to 30 tags; scale_of() fits them to others.
USUAL_WIDTH_M, USUAL_HEIGHT_M, USUAL_TAGS = 4.3, 8.3, 30
LARGEST_ZOOM = 4.0
TAG_M, UNREACHABLE_M = 0.12, 0.2
VIEW_MARGIN_M = 0.15
INCHES_PER_M, POINTS = 1.0, 10  # of the labels
ROUTE_ZOOM, ROUTE_DPI = 1.15, 252  # of marks and texts, if tags are few; for twice the width in the document
HEAD = np.array([(0.0, 0.0), (-0.68, 0.26), (-0.56, 0.0), (-0.68, -0.26)])  # the corners of an arrowhead
HEAD_M, BEFORE_TAG_M = 0.115, 0.04  # its scale on a line of sight, and where it ends
SHORT_ARROW_M = 0.17  # that an arrow of the route needs between two stops
HALF_HEAD = 0.42  # from the middle to the tip of an arrow of a path, in lengths that it needs
DOT_M = 0.034  # the radius of the dot at a stop, and at most half of the robot's
BOW = 1.05  # how far away from it lines of sight of other stops are, in its diameters
Sight = tuple[Point, Point]  # a line of sight: from a stop to its tag
Style = dict[str, Any]  # of what matplotlib draws
Mark = Style | tuple[Style, ...]  # in a key, from the bottom to the top
CENTRED: Style = {'ha': 'center', 'va': 'center'}


def point_style(marker: Any, colour: str, size: float, **more: Any) -> Style:
    """Return the style of points without a line between them."""
    return {'marker': marker, 'color': colour, 'markersize': size, 'linestyle': '', **more}


BAR_POINTS = 20, 30  # of a scale of colours, above its axes
TABLE: Style = {'facecolor': colours.TABLE, 'linewidth': 0}
TAG, UNREACHABLE = point_style('s', colours.TAG_ID, 5), point_style('X', colours.FAILED, 8)
INK = '#1f2328'  # of the robot, whose nose has twice this angle and this share of the radius
NOSE_DEGREES, NOSE_SHARE, ASIDE_DEGREES = 21, 0.3, 2.0  # the last: of a heading that is not to the tag
SIGHT_POINTS = 300  # of a line of sight with a bow
SIGHT: Style = {'color': colours.TAG_ID, 'linewidth': 0.8}
# In the key.
NOSE_CORNERS = (1, 0), (0.93, 0.36), (0.66, 0.25), (0.66, -0.25), (0.93, -0.36)
TAG_AND_ID = point_style(r'$■\,3$', colours.TAG_ID, 14, markeredgewidth=0)
DISC = point_style('o', f'{INK}10', 18, markeredgecolor=f'{INK}80', markeredgewidth=0.7)
TURNED = DISC, point_style(NOSE_CORNERS, INK, 18, markeredgewidth=0)
SEVEN = np.array([(-4, 5), (4, 5), (4, 3), (0, -5), (-2, -5), (2, 3), (-4, 3)])
TURN = np.linspace(0.0, 2 * math.pi, 40)
DOT_ASIDE = np.transpose([0.35 * np.cos(TURN) + 1.5, 0.35 * np.sin(TURN)])  # at the right
AIMED = SIGHT, point_style(np.add(HEAD, (1.5, 0.0)), colours.TAG_ID, 20, markeredgewidth=0)
CIRCLE = np.column_stack([np.cos(TURN), np.sin(TURN)])
ALONG = np.linspace(0.0, 1.0, 40)
STOP = (
    point_style(2.0 * CIRCLE - (7, 0), colours.ROUTE, 18, markeredgewidth=0),
    point_style(5.4 * CIRCLE + (3, 0), colours.ROUTE, 16.8, markeredgewidth=0),
    point_style(np.add(SEVEN, (5.2, 0)), 'white', 10.7, markeredgewidth=0),
)
STOPS_AT_ONE_PLACE = (
    point_style('o', colours.ROUTE, 4, markeredgewidth=0),
    *(point_style(4.5 * CIRCLE + (x, 0), colours.ROUTE, 22.6, markeredgewidth=0) for x in (-6.8, 6.8)),
    point_style(r'$\mathbf{7\quad\;8}$', 'white', 17, markeredgewidth=0),
)
PAST_A_STOP = (
    AIMED[1],
    point_style('o', colours.ROUTE, 4, markeredgewidth=0),
    point_style(
        np.column_stack([20 * ALONG - 10, -4.6 * bow(ALONG, 0.5)]),
        'none',
        20,
        markeredgecolor=colours.TAG_ID,
        markeredgewidth=0.8,
    ),
)


class LabelSize(NamedTuple):
    """The size of labels of one line in a picture, in metres."""

    character_m: float
    margin_m: float
    height_m: float

    def width_m(self, text: str) -> float:
        """Return the width of a label with this text."""
        return self.character_m * max(map(len, text.split('\n'))) + self.margin_m

    def box(self, text: str) -> tuple[float, float]:
        """Return the width and the height of a label with this text of one or more lines."""
        return self.width_m(text), self.height_m * (1 + LINE_SHARE * text.count('\n'))

    def times(self, scale: float) -> 'LabelSize':
        """Return the size of labels where a metre takes less room by this factor."""
        return LabelSize(*(scale * each for each in self))


KEY_INCHES, KEY_ROW_INCHES = 1.26, 0.27  # below a route: the height without rows, and of a row
KEY_BELOW: Style = {
    'borderaxespad': 3.6,  # so it is below the label of the x axis
    'labelspacing': 1.1,
    'columnspacing': 1.6,
    'handlelength': 2.0,
    'handletextpad': 0.6,
}
LINE_SHARE = 0.85  # of a label's height, that a further line takes
LABELS = LabelSize(0.108, 0.045, 0.195)
# Of the number of a stop, of the id of a tag, and of the words at the ends of a route.
DIGITS, IDS, ENDS = LabelSize(0.09, 0.0, 0.12), LabelSize(0.088, 0.01, 0.15), LabelSize(0.055, 0.2, 0.195)
SEE_THROUGH: Style = {'facecolor': f'{INK}10', 'edgecolor': f'{INK}80', 'linewidth': 0.7}
DOT_OF_STOP: Style = {'facecolor': colours.ROUTE, 'edgecolor': 'white', 'linewidth': 0.5, 'zorder': 1.92}
DISC_OF_NUMBER: Style = DOT_OF_STOP | {'linewidth': 0.6, 'zorder': 2.2}
NOSE: Style = {'facecolor': INK, 'linewidth': 0, 'zorder': 1.75}
LEADER: Style = {'color': colours.ROUTE, 'linewidth': 0.8, 'zorder': 1.65}
NUMBER: Style = {'color': 'white', 'weight': 'bold', 'size': 0.95 * POINTS, 'zorder': 5, **CENTRED}


def picture_format(path: Path, option: str = '--output') -> str:
    """Return the format of the path's ending; raises StartUpError if matplotlib cannot write it."""
    from matplotlib import backend_bases

    ending = path.suffix[1:].lower()
    if ending not in (endings := sorted(backend_bases.FigureCanvasBase.get_supported_filetypes())):
        raise StartUpError(f"{option} '{path}': the ending must be one of {', '.join(endings)}")
    return ending


def picture_of(figure: Any, ending: str) -> bytes:
    """Return a figure in a format; raises StartUpError if it cannot be drawn, as one that is too large."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):  # what a file holds is text and no formula
        text.set_text(text.get_text().replace('$', r'\$'))
    picture = io.BytesIO()
    try:
        figure.draw_without_rendering()  # lays it out: doing so once is not exact
        figure.savefig(picture, format=ending, dpi=200, bbox_inches='tight', pad_inches=0.15)
    except ValueError as error:
        raise StartUpError(f'the picture cannot be drawn: {error}') from error
    return picture.getvalue()


def scale_of(layout: Layout, walls: Walls) -> tuple[float, float, float]:
    """
    Return the width and the height of the view in metres, and by what to multiply the sizes of its marks.

    A picture of many tags is larger, so that there is room for their labels.
    """
    x0, y0, x1, y1 = _view_of(layout, walls)
    zoom = min(max(1.0, math.sqrt(len(layout.tags) / USUAL_TAGS)), LARGEST_ZOOM)
    return x1 - x0, y1 - y0, max((x1 - x0) / USUAL_WIDTH_M, (y1 - y0) / USUAL_HEIGHT_M) / zoom


def draw_greenhouse(axes: Any, layout: Layout, walls: Walls, table: Style = TABLE) -> None:
    """Draw walls, tables and a scale in metres; the view includes tags outside the walls."""
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import MaxNLocator

    axes.add_patch(Rectangle(walls[:2], walls.x1 - walls.x0, walls.y1 - walls.y0, fill=False, linewidth=0.9))
    for x0, y0, x1, y1 in layout.tables.values():
        axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, **table))
    axes.set_aspect('equal')
    show_all(axes, layout, walls)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel('x (m)')
    axes.spines[:].set_visible(False)  # the walls are the frame
    axes.tick_params(length=0)


def show_all(axes: Any, layout: Layout, walls: Walls, route: Sequence[Point] = ()) -> None:
    """Set the view to the walls, the tags and the route, with a margin around them."""
    x0, y0, x1, y1 = _view_of(layout, walls, route)
    axes.set(xlim=(x0, x1), ylim=(y0, y1))


def _view_of(layout: Layout, walls: Walls, route: Sequence[Point] = ()) -> tuple[float, float, float, float]:
    points = np.array([walls[:2], walls[2:], *(tag[:2] for tag in layout.tags.values()), *route])
    ends = (points.min(axis=0) - VIEW_MARGIN_M).tolist(), (points.max(axis=0) + VIEW_MARGIN_M).tolist()
    return (*ends[0], *ends[1])


def write_labels(
    axes: Any,
    labels: Sequence[tuple[str, Box, str]],
    size: LabelSize,
    taken: Sequence[Box],
    bounds: Box | None = None,
    below: Sequence[Box] = (),
    **style: Any,
) -> list[Box]:
    """Write texts, each given with its dot and its colour, beside their dots and where no box is taken."""
    sized = [(dot, *size.box(text)) for text, dot, _ in labels]
    places = place_labels(taken, sized, bounds, below)
    for place, (text, _, colour) in zip(places, labels, strict=True):
        axes.text(*place, text, color=colour, **{'fontsize': POINTS, **CENTRED, **style})
    return [Box(*place, *each[1:]) for place, each in zip(places, sized, strict=True)]


def write_key(owner: Any, marks: Sequence[tuple[str, Mark]], columns: int, **style: Any) -> Any:
    """Write what each mark means: below the axes or the figure, if the style has no place; return the key."""
    from matplotlib.lines import Line2D

    layers = (mark if isinstance(mark, tuple) else (mark,) for _, mark in marks)
    handles = [tuple(Line2D([], [], **each) for each in mark) for mark in layers]
    place = {'loc': 'upper center', 'bbox_to_anchor': (0.5, 0.0), 'frameon': False}
    return owner.legend(handles, [label for label, _ in marks], ncol=columns, **{**place, **style})


def draw_colour_bar(axes: Any, values: Any, walls: Walls, **style: Any) -> Any:
    """Draw the scale of coloured values above the axes and as wide as the walls; return it."""
    from matplotlib.transforms import Bbox

    place = axes.figure.add_axes((0.0, 0.0, 1.0, 1.0), label='<colorbar>')

    def above(_place: Any, _renderer: Any) -> Bbox:
        top, to_figure = axes.get_position().y1, axes.transData - axes.figure.transFigure
        y0, y1 = (top + points / 72 / axes.figure.get_figheight() for points in BAR_POINTS)
        (x0, _), (x1, _) = to_figure.transform([walls[:2], walls[2:]])
        return Bbox([[x0, y0], [x1, y1]])

    place.set_axes_locator(above)
    return axes.figure.colorbar(values, cax=place, orientation='horizontal', **style)


def draw_path(axes: Any, points: Sequence[Point], stops: Sequence[Box], arrow_m: float = ARROW_M) -> None:
    """Draw a path from a circle to a square, with its marks and an arrow between two stops."""
    axes.plot(*zip(*points, strict=True), color=colours.ROUTE, linewidth=1.2, zorder=1.5)
    head = '-|>,head_width=0.15,head_length=0.5'
    style = {'arrowstyle': head, 'color': colours.ROUTE, 'linewidth': 0, 'mutation_scale': 14, 'shrinkB': 0}
    for x, y, heading in arrows_between(points, stops, arrow_m):
        tip = x + HALF_HEAD * arrow_m * math.cos(heading), y + HALF_HEAD * arrow_m * math.sin(heading)
        axes.annotate('', tip, (x, y), arrowprops=style, zorder=1.6)
    middles = [each[:2] for each in stops]
    for marker, place in (('o', points[0]), ('s', points[-1])):
        if place not in middles:
            axes.scatter(*place, s=28, marker=marker, color='white', edgecolor=colours.ROUTE, zorder=2.5)


def places_of(stops: Sequence[Point], robot_m: float) -> list[Point]:
    """Return the places of stops; those that are much closer than the robot is large are one place."""
    places = list[Point]()
    for stop in stops:
        places += [] if any(math.dist(stop, each) < PLACE_SHARE * robot_m for each in places) else [stop]
    return places


def draw_robots(axes: Any, stops: Sequence[tuple[ApproachPose, Point]], radius_m: float) -> bool:
    """Draw the disc of a robot to scale, and a nose where it does not face its tag; return whether all do."""
    from matplotlib.patches import Circle, Wedge

    noses = []
    for place in places_of([pose[:2] for pose, _ in stops], radius_m):
        axes.add_patch(Circle(place, radius_m, **SEE_THROUGH, zorder=1.4))
    for pose, tag in stops:
        to_tag = math.atan2(tag[1] - pose.y, tag[0] - pose.x)
        if math.cos(pose.yaw - to_tag) < math.cos(math.radians(ASIDE_DEGREES)):
            ends = (math.degrees(pose.yaw) + side * NOSE_DEGREES for side in (-1, 1))
            noses.append(Wedge(pose[:2], radius_m, *ends, width=NOSE_SHARE * radius_m, **NOSE))
            axes.add_patch(noses[-1])
    return not noses


def draw_head(axes: Any, start: Point, tip: Point, scale_m: float, colour: str, edge: float = 0.4) -> Box:
    """Draw the head of an arrow over every disc and line; return what it covers."""
    from matplotlib.patches import Polygon

    cos, sin = np.subtract(tip, start) / math.dist(start, tip)
    corners = tip + scale_m * HEAD @ [(cos, sin), (-sin, cos)]
    axes.add_patch(Polygon(corners, facecolor=colour, edgecolor='white', linewidth=edge, zorder=2.1))
    return Box(*corners.mean(axis=0), *np.ptp(corners, axis=0))


def ahead_of(pose: ApproachPose, distance_m: float) -> Point:
    """Return the point at this distance from a robot at its heading."""
    return pose.x + distance_m * math.cos(pose.yaw), pose.y + distance_m * math.sin(pose.yaw)


def draw_route(
    layout: Layout,
    walls: Walls,
    approaches: Approaches,
    route: Route,
    occupancy: OccupancyMap | None = None,
) -> Any:
    """
    Return a figure of the greenhouse, the route, the robot at its numbered stops, and the unreachable tags.

    A map of the room, in the frame of the layout, lies beneath: its obstacles orange, its unknown parts grey.
    """
    from matplotlib.figure import Figure

    poses, robot_radius_m = approaches.poses, approaches.free_space.robot_radius_m
    width_m, height_m, scale = scale_of(layout, walls)
    scale *= ROUTE_ZOOM if len(layout.tags) <= USUAL_TAGS else 1.0
    width, height = (size_m / scale * INCHES_PER_M for size_m in (width_m, height_m))
    figure = Figure((max(4.0, width + 0.6), height), ROUTE_DPI, layout='constrained')
    axes = figure.add_subplot(anchor='N')  # all the room that is left is for the key
    if occupancy is not None:
        _draw_map(axes, occupancy)
    draw_greenhouse(axes, layout, walls, TABLE | {'facecolor': colours.ROUTE_TABLE})
    axes.set_ylabel('y (m)')
    title = f'A route of {route.length_m:.1f} m past {len(poses)} of {len(layout.tags)} tags'
    axes.set_title(title, fontsize=1.2 * POINTS, weight='bold')
    stops = [(poses[each], layout.tags[each][:2]) for each in route.tag_ids]
    sights = [(pose[:2], tag) for pose, tag in stops]
    are_facing = draw_robots(axes, stops, robot_radius_m)
    dot_m = min(scale * DOT_M, robot_radius_m / 2)
    disc_m = math.hypot(*DIGITS.times(scale).box(str(len(stops)))) / 2
    tags = [tag[:2] for tag in layout.tags.values()]
    numbers = place_numbers(sights, route.points_m, tags, walls, robot_radius_m, disc_m)
    dots = [Box(*place, 2 * dot_m, 2 * dot_m) for place, _ in sights]
    discs = [Box(*number, 2 * disc_m, 2 * disc_m) for number in numbers]
    _draw_stops(axes, dots, discs, robot_radius_m)
    passed = [_passed_by(sight, dots) for sight in sights]
    heads = [_draw_sight(axes, *each, scale) for each in zip(sights, passed, strict=True)]
    if route.points_m:
        draw_path(axes, route.points_m, dots + discs, scale * SHORT_ARROW_M)
    labels = _draw_tags(axes, layout, approaches.unreachable, scale)
    line_m, robot_m = scale * PATH_WIDTH_M / 2, 1.8 * robot_radius_m  # without the corners of its box
    lines = (step for way in (route.points_m, *sights) for step in steps_of(way, line_m))
    robots = [Box(*place, robot_m, robot_m) for place, _ in sights]
    taken = [Box(x, y, line_m, line_m) for x, y, _ in lines]
    taken += [*heads, *discs, *robots, *(dot for _, dot, _ in labels)]
    bounds, disc_of = box_of(walls), {dot[:2]: disc for dot, disc in zip(dots, discs, strict=True)}
    words = ends_of_path(route.points_m).items()
    ends = [(word, disc_of.get(mark[:2], mark), colours.ROUTE) for word, mark in words]
    taken += write_labels(axes, ends, ENDS.times(scale), taken, bounds, weight='bold', zorder=6)
    write_labels(axes, labels, IDS.times(scale), taken, bounds, zorder=6)
    are_shared = len(places_of([place for place, _ in sights], robot_radius_m)) < len(stops)
    heading, past = 'heading to tag', 'heading past a stop'
    if not are_facing:
        heading, past = 'to tag', 'to tag, past a stop'
    marks: dict[str, Mark] = {
        'route': {'color': colours.ROUTE, 'marker': '>', 'markersize': 5},
        'stop and its number': STOP,
        **({'stops at one place': STOPS_AT_ONE_PLACE} if are_shared else {}),
        'tag and its id': TAG_AND_ID,
        heading: AIMED,
        **({past: PAST_A_STOP} if any(passed) else {}),
        **({} if are_facing else {'heading not to tag': TURNED}),
        f'robot, radius {robot_radius_m:g} m': DISC,
        **({'table': point_style('s', colours.ROUTE_TABLE, 9)} if layout.tables else {}),
        **({'tag without a pose': UNREACHABLE} if approaches.unreachable else {}),
        **(_marks_of_map(occupancy) if occupancy is not None else {}),
    }
    figure.set_figheight(height + KEY_INCHES + KEY_ROW_INCHES * math.ceil(len(marks) / 2))
    write_key(axes, list(marks.items()), columns=2, **KEY_BELOW)
    return figure


def _marks_of_map(occupancy: OccupancyMap) -> dict[str, Mark]:
    """Return what a map of the room shows."""
    unknown = point_style('s', colours.UNKNOWN_PART, 9, alpha=0.5)
    return {
        'obstacle in the map': point_style('s', colours.OBSTACLE, 9),
        **({'unknown in the map': unknown} if occupancy.is_unknown.any() else {}),
    }


def _draw_stops(axes: Any, dots: Sequence[Box], discs: Sequence[Box], robot_m: float) -> None:
    """Draw the dot and the number of each stop, and a line between them if the number is off the robot."""
    from matplotlib.patches import Circle

    for number, (dot, disc) in enumerate(zip(dots, discs, strict=True), start=1):
        axes.add_patch(Circle(dot[:2], dot.width / 2, **DOT_OF_STOP))
        axes.add_patch(Circle(disc[:2], disc.width / 2, **DISC_OF_NUMBER))
        axes.text(*disc[:2], number, **NUMBER)
        if math.dist(dot[:2], disc[:2]) > robot_m + 0.75 * disc.width:
            axes.plot(*zip(dot[:2], disc[:2], strict=True), **LEADER)


def _passed_by(sight: Sight, dots: Sequence[Box]) -> list[Box]:
    """Return the dots of other stops that a line of sight would almost touch."""
    start, tag = (complex(*end) for end in sight)
    x, y, width, _ = np.transpose(dots)
    from_line, from_start = gaps_to(x + 1j * y, start, tag), np.abs(x + 1j * y - start)
    is_passed = (from_line < BOW * width) & (from_start > BOW * width)
    return [dot for dot, each in zip(dots, is_passed, strict=True) if each]


def _draw_sight(axes: Any, sight: Sight, passed: Sequence[Box], scale: float) -> Box:
    """Draw a line of sight, in a bow around the dots that it passes; return what its head covers."""
    start, tag = (complex(*end) for end in sight)
    along = np.linspace(0.0, 1.0, SIGHT_POINTS if passed else 2)
    aside, ahead = np.zeros_like(along), tag - start
    for x, y, width, _ in passed:
        dot = (complex(x, y) - start) / ahead
        most = dot.imag - math.copysign(BOW * width / abs(ahead), dot.imag)
        bowed = most * bow(along, min(max(dot.real, 0.1), 0.9))
        aside = np.where(np.abs(bowed) > np.abs(aside), bowed, aside)
    points = start + (along + 1j * aside) * ahead
    axes.plot(points.real, points.imag, **SIGHT, zorder=1.45)
    tip = tag - scale * BEFORE_TAG_M * ahead / abs(ahead)
    return draw_head(axes, sight[0], (tip.real, tip.imag), scale * HEAD_M, colours.TAG_ID, edge=0.0)


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
        zorder=1.1,
    )


def _draw_tags(
    axes: Any, layout: Layout, unreachable: Collection[str], scale: float
) -> list[tuple[str, Box, str]]:
    """Draw the tags, and return their labels."""
    labels = []
    for tag_id, tag in layout.tags.items():
        mark, side_m = (UNREACHABLE, UNREACHABLE_M) if tag_id in unreachable else (TAG, TAG_M)
        axes.plot(*tag[:2], **mark, zorder=3)
        colour = colours.FAILED if tag_id in unreachable else colours.TAG_ID
        labels.append((tag_id, Box(*tag[:2], scale * side_m, scale * side_m), colour))
    return labels
