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
    END_M,
    PATH_WIDTH_M,
    Box,
    Point,
    arrows_between,
    box_of,
    ends_of_path,
    overlaps,
    place_labels,
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
# In radii of a disc with a number: how close stops are crowded, their dots, their numbers, and how far apart
# these are. And where a number can be around its dot, as complex numbers: the line of sight is at 1, 2, ...
CROWDED, DOT_SHARE, PLATE_SHARE, BESIDE = 2.6, 0.2, 0.92, 1.4
AROUND = np.multiply.outer((1.4, 1.6, 1.8, 2.1), np.exp(1j * np.radians(range(30, 331, 15)))).ravel()
JOINED_M = 0.25  # stops of small robots that are closer share a label
TAG_M, UNREACHABLE_M = 0.1, 0.19
VIEW_MARGIN_M = 0.15
INCHES_PER_M, POINTS = 1.0, 10  # of the labels
ROUTE_ZOOM, ROUTE_DPI = 1.15, 126  # the first is of the marks and the texts, if tags are few
HEAD = np.array([(0.0, 0.0), (-0.68, 0.26), (-0.56, 0.0), (-0.68, -0.26)])  # the corners of an arrowhead
HEAD_M, BEFORE_TAG_M = 0.115, 0.04  # its scale on a line of sight, and where it ends
SHORT_ARROW_M = 0.15  # that an arrow of the route needs between two stops
HALF_HEAD = 0.42  # from the middle to the tip of an arrow of a path, in lengths that it needs
LEADER_POINTS = 1.1  # the width of the line from a stop to its label
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
SIGHT: Style = {'color': colours.TAG_ID, 'linewidth': 0.8}
# In the key, as all until CROWDED_STOP.
NOSE_CORNERS = (1, 0), (0.93, 0.36), (0.66, 0.25), (0.66, -0.25), (0.93, -0.36)
TAG_AND_ID = point_style(r'$■\,3$', colours.TAG_ID, 14, markeredgewidth=0)
DISC = point_style('o', f'{INK}10', 18, markeredgecolor=f'{INK}80', markeredgewidth=0.7)
TURNED = DISC, point_style(NOSE_CORNERS, INK, 18, markeredgewidth=0)
ROBOT = (
    DISC,
    point_style('o', colours.ROUTE, 11),
    point_style(r'$\mathbf{7}$', 'white', 6, markeredgewidth=0),
)
TURN = np.linspace(0.0, 2 * math.pi, 20)
DOT_ASIDE = np.transpose([0.35 * np.cos(TURN) + 1.5, 0.35 * np.sin(TURN)])  # at the right
AIMED = SIGHT, point_style(np.add(HEAD, (1.5, 0.0)), colours.TAG_ID, 20, markeredgewidth=0)
BENT: Style = {'linestyle': (0, (2.5, 1.5)), 'linewidth': 1.0}
BEND_NEAR, BEND_BY = 3.0, 1.7  # in dots: how close a line of sight is to a stop, and how far it is bent away
PLACE_SHARE = 0.2  # of the robot's radius: stops that are closer are at one place
SHARED = 1.4  # by what a dot of several stops is larger
AIMED_BENT = SIGHT | BENT, AIMED[1]
PLATE_ASIDE = np.transpose([0.8 * np.cos(TURN) + 1.5, 0.8 * np.sin(TURN)])
RING_ASIDE = np.transpose([1.1 * np.cos(TURN) - 1.5, 1.1 * np.sin(TURN)])
CROWDED_STOP = (
    point_style(RING_ASIDE, f'{INK}10', 28, markeredgecolor=f'{INK}80', markeredgewidth=0.7),
    point_style(-DOT_ASIDE, colours.ROUTE, 20, markeredgewidth=0),
    point_style('o', 'white', 11, markeredgecolor=colours.ROUTE),
    point_style(r'$\mathbf{9}$', colours.ROUTE, 6, markeredgewidth=0),
)
TWO_STOPS = (
    point_style('o', colours.ROUTE, 4, markeredgewidth=0),
    *(point_style(side * PLATE_ASIDE, 'white', 24, markeredgecolor=colours.ROUTE) for side in (-1, 1)),
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


LINE_SHARE = 0.85  # of a label's height, that a further line takes
LABELS, NUMBERS = LabelSize(0.108, 0.045, 0.195), LabelSize(0.092, 0.1, 0.24)
# Of the number at a robot's centre, and of the id of a tag.
DIGITS, IDS = LabelSize(0.088, 0.0, 0.15), LabelSize(0.088, 0.04, 0.17)
SEE_THROUGH: Style = {'facecolor': f'{INK}10', 'edgecolor': f'{INK}80', 'linewidth': 0.7}
PLATE: Style = {'facecolor': 'white', 'edgecolor': colours.ROUTE, 'linewidth': 1.2, 'zorder': 2.05}
DISC_OF_NUMBER: Style = {'facecolor': colours.ROUTE, 'edgecolor': 'white', 'linewidth': 0.6, 'zorder': 1.92}
NOSE: Style = {'facecolor': INK, 'linewidth': 0, 'zorder': 1.75}
NUMBER: Style = {'color': 'white', 'weight': 'bold', 'size': 0.9 * POINTS, 'zorder': 5, **CENTRED}


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
        figure.savefig(picture, format=ending, dpi=130, bbox_inches='tight', pad_inches=0.15)
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


def draw_robots(axes: Any, stops: Sequence[tuple[ApproachPose, Point]], radius_m: float) -> bool:
    """Draw the disc of a robot to scale, and a nose where it does not face its tag; return whether all do."""
    from matplotlib.patches import Circle, Wedge

    noses = []
    for place, *_ in join_stops([pose[:2] for pose, _ in stops], PLACE_SHARE * radius_m).values():
        axes.add_patch(Circle(place, radius_m, **SEE_THROUGH, zorder=1.7))
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
    stops = [(poses[each], (poses[each][:2], layout.tags[each][:2])) for each in route.tag_ids]
    digits = DIGITS.times(scale).box(str(len(stops)))
    dot_m, place_m = DOT_SHARE * math.hypot(*digits) / 2, PLACE_SHARE * robot_radius_m
    sights = [_sight_around(*line, [pose[:2] for pose, _ in stops], dot_m, place_m) for _, line in stops]
    heads = [_draw_sight(axes, sight, scale, dot_m) for sight in sights]
    are_facing = draw_robots(axes, [(pose, tag) for pose, (_, tag) in stops], robot_radius_m)
    robot_m, line_m = 2 * robot_radius_m, scale * PATH_WIDTH_M / 2
    has_room = math.hypot(*digits) < robot_m
    side_m = math.sqrt(math.pi) * robot_radius_m  # of a square with the area of the disc
    robots = [Box(*pose[:2], side_m, side_m) for pose, _ in stops]
    ways = [route.points_m, *sights]
    lines = [Box(x, y, line_m, line_m) for way in ways for x, y, _ in steps_of(way, line_m)]
    labels = _draw_tags(axes, layout, approaches.unreachable, scale)
    marked = [*heads, *(dot for _, dot, _ in labels)]
    solid, beside = robots, list[Box]()
    if has_room:
        solid, beside = _draw_stops(axes, [pose for pose, _ in stops], ways, digits, robot_radius_m, marked)
    if route.points_m:
        draw_path(axes, route.points_m, solid, scale * SHORT_ARROW_M)
    taken = [*lines, *marked, *robots, *beside]
    bounds, end_m = box_of(walls), max(END_M, robot_m)
    are_shared = len(join_stops([pose[:2] for pose, _ in stops], place_m)) < len(stops)
    ends = [
        (word, Box(x, y, end_m, end_m), colours.ROUTE)
        for word, (x, y, *_) in ends_of_path(route.points_m).items()
    ]
    taken += write_labels(axes, ends, LABELS.times(scale), taken, bounds, weight='bold', zorder=6)
    taken += [Box(*pose[:2], robot_m, robot_m) for pose, _ in stops]
    taken += write_labels(axes, labels, IDS.times(scale), taken, bounds, zorder=6)
    if not has_room:
        _write_numbers_beside(axes, [pose[:2] for pose, _ in stops], robot_radius_m, scale, taken, bounds)
    marks: dict[str, Mark] = {
        'route, in the direction of its arrows': {'color': colours.ROUTE, 'marker': '>', 'markersize': 5},
        f'stop; ring: the robot, radius {robot_radius_m:g} m': ROBOT if has_room else DISC,
        **({'stop, its number beside it': CROWDED_STOP} if beside else {}),
        **({'two stops at one place: the robot turns': TWO_STOPS} if are_shared and beside else {}),
        ('heading, ' if are_facing else '') + 'to the tag that it reads': AIMED,
        **({'the same, drawn bent to clear another stop': AIMED_BENT} if any(map(_is_bent, sights)) else {}),
        **({} if are_facing else {'heading, if it is not to the tag': TURNED}),
        'tag and its id': TAG_AND_ID,
    }
    marks |= {'table': point_style('s', colours.ROUTE_TABLE, 9)} if layout.tables else {}
    marks |= {'tag without a pose': UNREACHABLE} if approaches.unreachable else {}
    marks |= _marks_of_map(occupancy) if occupancy is not None else {}
    figure.set_figheight(height + 1.2 + 0.24 * len(marks))
    # Below the label of the x axis.
    write_key(axes, list(marks.items()), columns=1, borderaxespad=3.6, labelspacing=0.7)
    return figure


def _marks_of_map(occupancy: OccupancyMap) -> dict[str, Mark]:
    """Return what a map of the room shows."""
    unknown = point_style('s', colours.UNKNOWN_PART, 9, alpha=0.5)
    return {
        'obstacle in the map': point_style('s', colours.OBSTACLE, 9),
        **({'unknown in the map': unknown} if occupancy.is_unknown.any() else {}),
    }


def _sight_around(
    start: Point, end: Point, stops: Sequence[Point], dot_m: float, place_m: float
) -> list[Point]:
    """Return the line of sight from a stop to its tag, with a bend if it is too close to another stop."""
    line, here = complex(*end) - complex(*start), complex(*start)
    offsets = np.array([(complex(*stop) - here) / line for stop in stops])
    is_ahead = (offsets.real * abs(line) > place_m) & (offsets.real < 1.0)
    close = offsets[is_ahead & (np.abs(offsets.imag) * abs(line) < BEND_NEAR * dot_m)]
    if not close.size:
        return [start, end]
    shares = np.linspace(0.0, 1.0, 13)
    side = -1j if close[0].imag > 0.0 else 1j
    bend = here + line * (shares + side * BEND_BY * dot_m / abs(line) * 4 * shares * (1 - shares))
    return [(float(each.real), float(each.imag)) for each in bend]


def _is_bent(sight: Sequence[Point]) -> bool:
    return len(sight) > 2


def _draw_sight(axes: Any, sight: Sequence[Point], scale: float, dot_m: float) -> Box:
    """Draw the line of sight from the dot of a stop to its tag; return what its head covers."""
    steps = list(steps_of(sight, dot_m / 4))
    points = [(x, y) for x, y, _ in steps if math.dist((x, y), sight[0]) >= dot_m]
    axes.plot(
        *zip(*points, sight[-1], strict=True), **(SIGHT | BENT if _is_bent(sight) else SIGHT), zorder=1.9
    )
    far = (each for each in reversed(points) if math.dist(each, sight[-1]) > scale * HEAD_M)
    behind, tag = next(far, sight[0]), np.array(sight[-1])
    x, y = tag - scale * BEFORE_TAG_M * (tag - behind) / math.dist(tag, behind)
    return draw_head(axes, behind, (x, y), scale * HEAD_M, colours.TAG_ID, edge=0.0)


def _draw_stops(
    axes: Any,
    poses: Sequence[ApproachPose],
    ways: Sequence[Sequence[Point]],
    digits: tuple[float, float],
    radius_m: float,
    taken: Sequence[Box],
) -> tuple[list[Box], list[Box]]:
    """
    Draw the number of each stop, of this size; the ways are the route, and then the line of sight of each.

    A number is on a disc at its stop; or beside it, if another stop or its line of sight is too close. Return
    the boxes of all that is drawn, and those of the numbers beside their stops.
    """
    from matplotlib.patches import Circle

    disc_m = math.hypot(*digits) / 2
    steps = [(complex(x, y), n) for n, way in enumerate(ways) for x, y, _ in steps_of(way, disc_m / 4)]
    points, numbers = np.reshape(np.array(steps, complex), (-1, 2)).T
    stops = np.array([complex(*pose[:2]) for pose in poses])
    solid, beside, crowded = list[Box](), list[Box](), []
    for number, pose in enumerate(poses, start=1):
        is_near = np.abs(points - stops[number - 1]) < disc_m
        is_near &= (numbers != 0) & (numbers != number)
        stops_m = np.abs(np.delete(stops, number - 1) - stops[number - 1])
        dot_m = disc_m
        if is_near.any() or (stops_m < CROWDED * disc_m).any():
            dot_m = DOT_SHARE * disc_m * (SHARED if (stops_m < PLACE_SHARE * radius_m).any() else 1.0)
            crowded.append(number)
        else:
            axes.text(*pose[:2], number, **NUMBER)
        axes.add_patch(Circle(pose[:2], dot_m, **DISC_OF_NUMBER))
        solid.append(Box(*pose[:2], 2 * dot_m, 2 * dot_m))
    for number in crowded:
        around = [*taken, *solid, *beside]
        box = _box_beside(ways[number], stops, points[numbers != number], around, disc_m, radius_m)
        axes.add_patch(Circle(box[:2], PLATE_SHARE * disc_m, **PLATE))
        axes.text(*box[:2], number, **NUMBER | {'color': colours.ROUTE})
        beside.append(box)
    return [*solid, *beside], beside


def _box_beside(
    sight: Sequence[Point], stops: Any, ways: Any, taken: Sequence[Box], disc_m: float, radius_m: float
) -> Box:
    """
    Return where a stop's number covers least, also of the robots at other stops, and is off other ways.

    It is around the stop, or on the line of sight; beside this line, if another stop is at the same place.
    Stops and points of ways are complex numbers.
    """
    stop, tag = complex(*sight[0]), complex(*sight[-1])
    ahead, last = disc_m * (tag - stop) / abs(tag - stop), abs(tag - stop) / disc_m - 2.0
    is_here = np.abs(stops - stop) < PLACE_SHARE * radius_m
    around = AROUND if is_here.sum() == 1 else AROUND[AROUND.real > np.abs(AROUND) / 2]
    offsets = np.append(np.linspace(BESIDE, max(BESIDE, last), 17), around)
    places, asides = stop + ahead * offsets, np.where(offsets.real > 0.0, np.abs(offsets.imag), np.inf)
    side_m = math.sqrt(math.pi) * PLATE_SHARE * disc_m  # of a square with the area of the number
    boxes = np.array([(each.real, each.imag, side_m, side_m) for each in places])
    costs = 2.0 * overlaps(boxes, np.array(taken)).sum(axis=1) / disc_m**2
    robots_m, ways_m = (
        np.abs(places[:, None] - each).min(axis=1, initial=np.inf) for each in (stops[~is_here], ways)
    )
    costs += 0.5 * np.clip(0.5 + (radius_m - robots_m) / (2 * disc_m), 0.0, 1.0)
    costs += 2.0 * np.maximum(1.4 - ways_m / disc_m, 0.0) + 0.6 * np.abs(offsets)
    costs += np.where(asides > 0.0, 0.2 + 2.0 * np.maximum(1.05 - asides, 0.0), 0.0)
    costs += 0.1 * np.abs(offsets.imag)  # near the line of sight, or behind it
    return Box(*boxes[costs.round(3).argmin()].tolist())


def _write_numbers_beside(
    axes: Any, stops: Sequence[Point], radius_m: float, scale: float, taken: Sequence[Box], bounds: Box
) -> None:
    """Write the numbers of stops beside small robots, each with a line to its robot."""
    groups = join_stops(stops, scale * JOINED_M)
    middles = {text: np.mean(group, axis=0) for text, group in groups.items()}
    numbers = [(text, Box(x, y, 2 * radius_m, 2 * radius_m), 'white') for text, (x, y) in middles.items()]
    frame: Style = {'boxstyle': 'round,pad=0.25,rounding_size=0.5', 'color': colours.ROUTE}
    boxes = write_labels(axes, numbers, NUMBERS.times(scale), taken, bounds, bbox=frame, zorder=5)
    for box, (text, _, _) in zip(boxes, numbers, strict=True):
        for stop in groups[text]:
            share = radius_m / math.dist(stop, box[:2])  # so the line ends at the robot's disc
            ends = zip(box[:2], np.array(stop) + share * (np.array(box[:2]) - stop), strict=True)
            axes.plot(*ends, color=colours.ROUTE, linewidth=LEADER_POINTS, zorder=1.65)


def join_stops(stops: Sequence[Point], joined_m: float) -> dict[str, list[Point]]:
    """Return the places of stops by their numbers; close stops share a text, such as `4, 5`."""
    groups: list[tuple[list[str], list[Point]]] = []
    for number, stop in enumerate(stops, start=1):
        group = next((each for each in groups if math.dist(each[1][0], stop) < joined_m), ([], []))
        groups += [] if group[0] else [group]
        group[0].append(str(number))
        group[1].append(stop)
    return {', '.join(numbers): places for numbers, places in groups}


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
