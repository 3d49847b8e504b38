"""Draw the greenhouse, its approach poses and a route. Imports matplotlib only to draw, and never ROS."""

import io
import itertools
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
    crossing_of,
    ends_of_path,
    overlaps,
    place_labels,
    place_rows,
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
JOINED_M = 0.25  # stops of small robots that are closer share a label
TAG_M, UNREACHABLE_M = 0.12, 0.2
VIEW_MARGIN_M = 0.15
INCHES_PER_M, POINTS = 1.0, 10  # of the labels
ROUTE_ZOOM, ROUTE_DPI = 1.15, 252  # of marks and texts, if tags are few; for twice the width in the document
HEAD = np.array([(0.0, 0.0), (-0.68, 0.26), (-0.56, 0.0), (-0.68, -0.26)])  # the corners of an arrowhead
HEAD_M, BEFORE_TAG_M = 0.115, 0.04  # its scale on a line of sight, and where it ends
SHORT_ARROW_M = 0.17  # that an arrow of the route needs between two stops
HALF_HEAD = 0.42  # from the middle to the tip of an arrow of a path, in lengths that it needs
LEADER_POINTS = 1.1  # the width of the line from a stop to its label
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
SIGHT: Style = {'color': colours.TAG_ID, 'linewidth': 0.8}
SIGHT_GAP_M = 0.04  # square to the line for which it is left
UNCLEAR = 1.2  # in radii of a number's disc: a line that crosses another so close to its stop has its number
PLACE_SHARE = 0.2  # of the robot's radius: stops that are closer are at one place
# In the key.
NOSE_CORNERS = (1, 0), (0.93, 0.36), (0.66, 0.25), (0.66, -0.25), (0.93, -0.36)
TAG_AND_ID = point_style(r'$■\,3$', colours.TAG_ID, 14, markeredgewidth=0)
DISC = point_style('o', f'{INK}10', 18, markeredgecolor=f'{INK}80', markeredgewidth=0.7)
TURNED = DISC, point_style(NOSE_CORNERS, INK, 18, markeredgewidth=0)
STOP = (
    point_style('o', colours.ROUTE, 11, markeredgewidth=0),
    point_style(r'$\mathbf{7}$', 'white', 6, markeredgewidth=0),
)
TURN = np.linspace(0.0, 2 * math.pi, 40)
HALF_TURN = np.exp(0.5j * (TURN - math.pi))
DOT_ASIDE = np.transpose([0.35 * np.cos(TURN) + 1.5, 0.35 * np.sin(TURN)])  # at the right
AIMED = SIGHT, point_style(np.add(HEAD, (1.5, 0.0)), colours.TAG_ID, 20, markeredgewidth=0)
SEVEN = np.add([(-4, 5), (4, 5), (4, 3), (0, -5), (-2, -5), (2, 3), (-4, 3)], (-4, 9))
AIMED_FROM = *AIMED, point_style(SEVEN, colours.ROUTE, 18, markeredgewidth=0)
ROW = np.concatenate([HALF_TURN + 0.9, -HALF_TURN - 0.9])
STOPS_AT_ONE_PLACE = (
    DISC,
    point_style(np.transpose([ROW.real, ROW.imag]), colours.ROUTE, 21, markeredgewidth=0),
    point_style(r'$\mathbf{7\;8}$', 'white', 13, markeredgewidth=0),
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


KEY_INCHES, KEY_ROW_INCHES = 1.52, 0.27  # below a route: the height without rows, and of a row
KEY_BELOW: Style = {
    'borderaxespad': 3.6,  # so it is below the label of the x axis
    'labelspacing': 1.1,
    'columnspacing': 1.6,
    'handlelength': 1.7,
    'handletextpad': 0.5,
}
LINE_SHARE = 0.85  # of a label's height, that a further line takes
LABELS, NUMBERS = LabelSize(0.108, 0.045, 0.195), LabelSize(0.092, 0.1, 0.24)
# Of the number of a stop, and of the id of a tag.
DIGITS, IDS = LabelSize(0.082, 0.0, 0.115), LabelSize(0.088, 0.01, 0.15)
SEE_THROUGH: Style = {'facecolor': f'{INK}10', 'edgecolor': f'{INK}80', 'linewidth': 0.7}
DISC_OF_NUMBER: Style = {'facecolor': colours.ROUTE, 'edgecolor': 'white', 'linewidth': 0.6, 'zorder': 1.92}
NOSE: Style = {'facecolor': INK, 'linewidth': 0, 'zorder': 1.75}
NUMBER: Style = {'color': 'white', 'weight': 'bold', 'size': 0.85 * POINTS, 'zorder': 5, **CENTRED}


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
    for first, *_ in group_stops([pose[:2] for pose, _ in stops], PLACE_SHARE * radius_m):
        axes.add_patch(Circle(stops[first][0][:2], radius_m, **SEE_THROUGH, zorder=1.4))
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
    robot_m, line_m = 2 * robot_radius_m, scale * PATH_WIDTH_M / 2
    side_m = math.sqrt(math.pi) * robot_radius_m  # of a square with the area of the disc
    robots = [Box(*place, side_m, side_m) for place, _ in sights]
    places = group_stops([place for place, _ in sights], PLACE_SHARE * robot_radius_m)
    disc_m = math.hypot(*DIGITS.times(scale).box(str(len(stops)))) / 2
    has_room = disc_m < robot_radius_m
    numbers = _draw_numbers(axes, places, sights, route.points_m, disc_m) if has_room else robots
    seen = [_sight_from(number, *sight) for number, sight in zip(numbers, sights, strict=True)]
    heads = [_draw_sight(axes, sight, seen, scale) for sight in seen]
    path = _path_through(numbers, places, sights, route.points_m)
    lines = [Box(x, y, line_m, line_m) for way in (path, *sights) for x, y, _ in steps_of(way, line_m)]
    labels = _draw_tags(axes, layout, approaches.unreachable, scale)
    if path:
        draw_path(axes, path, numbers, scale * SHORT_ARROW_M)
    taken = [*lines, *heads, *(dot for _, dot, _ in labels), *robots, *numbers]
    bounds, end_m = box_of(walls), max(END_M, robot_m)
    ends = [(word, Box(x, y, end_m, end_m), colours.ROUTE) for word, (x, y, *_) in ends_of_path(path).items()]
    taken += write_labels(axes, ends, LABELS.times(scale), taken, bounds, weight='bold', zorder=6)
    unclear = _unclear(places, sights, UNCLEAR * disc_m) if has_room else []
    for at in unclear:
        taken.append(_write_beside(axes, str(at + 1), sights[at], robot_radius_m, DIGITS.times(scale), taken))
    taken += [Box(*place, 0.9 * robot_m, 0.9 * robot_m) for place, _ in sights]  # without their corners
    taken += write_labels(axes, labels, IDS.times(scale), taken, bounds, zorder=6)
    if not has_room:
        _write_numbers_beside(axes, [place for place, _ in sights], robot_radius_m, scale, taken, bounds)
    is_aside = any(
        math.dist(each[:2], place) > disc_m / 4 for each, (place, _) in zip(numbers, sights, strict=True)
    )
    heading = 'heading to tag' if are_facing else 'to tag'
    marks: dict[str, Mark] = {
        'route': {'color': colours.ROUTE, 'marker': '>', 'markersize': 5},
        'stop (exact place:\ngrey circle)' if is_aside else 'stop': STOP,
        **({'stops at one place': STOPS_AT_ONE_PLACE} if has_room and len(places) < len(stops) else {}),
        'tag and its id': TAG_AND_ID,
        **({f'{heading} (blue\nnumber: its stop)': AIMED_FROM} if unclear else {heading: AIMED}),
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


def _sight_from(number: Box, place: Point, tag: Point) -> Sight:
    """Return a line of sight from its place or, if the number is behind it, from beside the number."""
    here, ahead = complex(*place), complex(*tag) - complex(*place)
    behind = min(0.0, ((complex(*number[:2]) - here) / ahead).real)
    start = here + behind * ahead
    return (start.real, start.imag), tag


def _draw_sight(axes: Any, sight: Sight, sights: Sequence[Sight], scale: float) -> Box:
    """
    Draw a line of sight; return what its head covers.

    It has a gap where it crosses another line that is there nearer to its start.
    """
    start, tag = np.array(sight)
    ahead = (tag - start) / (length_m := math.dist(*sight))
    gaps_m = []
    for other in sights:
        at_m, other_at_m = crossing_of(sight, other) or (0.0, math.inf)
        if other_at_m < at_m:
            x, y = np.subtract(*other) / math.dist(*other)
            half_m = scale * SIGHT_GAP_M / 2 / max(abs(float(ahead[0] * y - ahead[1] * x)), 0.3)
            gaps_m.append((at_m - half_m, at_m + half_m))
    from_m = 0.0
    for gap_m, gap_end_m in (*sorted(gaps_m), (length_m, length_m)):
        if from_m < gap_m:
            piece = [start + from_m * ahead, start + gap_m * ahead]
            axes.plot(*np.transpose(piece), **SIGHT, zorder=1.9)
        from_m = max(from_m, gap_end_m)
    tip = tag - scale * BEFORE_TAG_M * ahead
    return draw_head(axes, sight[0], (float(tip[0]), float(tip[1])), scale * HEAD_M, colours.TAG_ID, edge=0.0)


def _path_through(
    numbers: Sequence[Box], places: Sequence[Sequence[int]], sights: Sequence[Sight], path: Sequence[Point]
) -> list[Point]:
    """Return the path through the numbers of the stops, or through the middle of those of one place."""
    middles = {}
    for stops in places:
        x, y = np.mean([numbers[at][:2] for at in stops], axis=0)
        middles.update({sights[at][0]: (float(x), float(y)) for at in stops})
    return [middles.get(point, point) for point in path]


def _unclear(places: Sequence[Sequence[int]], sights: Sequence[Sight], near_m: float) -> list[int]:
    """Return the stops whose line of sight needs its number: at a shared place, or on the line of another."""
    unclear = {at for stops in places if len(stops) > 1 for at in stops}
    for at, sight in enumerate(sights):
        crossings = (crossing_of(sight, other) for other in sights)
        unclear |= {at for each in crossings if each and each[0] < near_m}
    return sorted(unclear)


def _write_beside(
    axes: Any, text: str, sight: Sight, from_m: float, size: LabelSize, taken: Sequence[Box]
) -> Box:
    """Write the number of a stop beside its line of sight, where it is clearest; return its box."""
    start, ahead = complex(*sight[0]), complex(*sight[1]) - complex(*sight[0])
    ahead /= abs(ahead)
    width, height = size.box(text)
    slant = abs(ahead.real * ahead.imag)  # at which the corners of a text are far from the line
    aside_m = 0.02 + (1 - 0.6 * slant) * (abs(ahead.imag) * width + abs(ahead.real) * height) / 2
    along_m = np.linspace(from_m + 0.06, math.dist(*sight) - 0.12, 9)
    tries = start + ahead * np.add.outer(along_m, (1j * aside_m, -1j * aside_m)).ravel()
    boxes = np.array([(each.real, each.imag, 1.6 * width, 1.6 * height) for each in tries])
    x, y = boxes[overlaps(boxes, np.array(taken)).sum(axis=1).round(4).argmin(), :2].tolist()
    axes.text(x, y, text, weight='bold', fontsize=0.85 * POINTS, color=colours.ROUTE, zorder=6, **CENTRED)
    return Box(x, y, width, height)


def _draw_numbers(
    axes: Any,
    places: Sequence[Sequence[int]],
    sights: Sequence[Sight],
    path: Sequence[Point],
    disc_m: float,
) -> list[Box]:
    """Draw the number of each stop on a disc, and those of one place on one shape; return their boxes."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    yaws = [float(np.angle(complex(*tag) - complex(*place))) for place, tag in sights]
    rows = place_rows(
        [sights[first][0] for first, *_ in places],
        [[yaws[at] for at in stops] for stops in places],
        [*sights, *itertools.pairwise(path)],
        disc_m,
    )
    boxes: dict[int, Box] = {}
    for stops, centres in zip(places, rows, strict=True):
        ends = complex(*centres[0]) - disc_m * HALF_TURN, complex(*centres[-1]) + disc_m * HALF_TURN
        outline = Outline([(each.real, each.imag) for each in np.concatenate(ends)], closed=True)
        axes.add_patch(PathPatch(outline, **DISC_OF_NUMBER))
        for at, centre in zip(stops, centres, strict=True):
            axes.text(*centre, at + 1, **NUMBER)
            boxes[at] = Box(*centre, 2 * disc_m, 2 * disc_m)
    return [boxes[at] for at in range(len(sights))]


def _write_numbers_beside(
    axes: Any, stops: Sequence[Point], radius_m: float, scale: float, taken: Sequence[Box], bounds: Box
) -> None:
    """Write the numbers of stops beside small robots, each with a line to its robot."""
    groups = group_stops(stops, scale * JOINED_M)
    numbers = []
    for group in groups:
        x, y = np.mean([stops[at] for at in group], axis=0)
        text = ', '.join(str(at + 1) for at in group)
        numbers.append((text, Box(x, y, 2 * radius_m, 2 * radius_m), 'white'))
    frame: Style = {'boxstyle': 'round,pad=0.25,rounding_size=0.5', 'color': colours.ROUTE}
    boxes = write_labels(axes, numbers, NUMBERS.times(scale), taken, bounds, bbox=frame, zorder=5)
    for box, group in zip(boxes, groups, strict=True):
        for stop in (stops[at] for at in group):
            share = radius_m / math.dist(stop, box[:2])  # so the line ends at the robot's disc
            ends = zip(box[:2], np.array(stop) + share * (np.array(box[:2]) - stop), strict=True)
            axes.plot(*ends, color=colours.ROUTE, linewidth=LEADER_POINTS, zorder=1.65)


def group_stops(stops: Sequence[Point], joined_m: float) -> list[list[int]]:
    """Return the indices of stops that are close to the first of their group."""
    groups: list[list[int]] = []
    for at, stop in enumerate(stops):
        group = next((each for each in groups if math.dist(stops[each[0]], stop) < joined_m), [])
        groups += [] if group else [group]
        group.append(at)
    return groups


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
