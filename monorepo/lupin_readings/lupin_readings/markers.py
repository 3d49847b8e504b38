"""Markers of the greenhouse and its last readings, and the field that is interpolated from these."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Pose, Vector3
from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.interfaces import TagReading
from lupin_greenhouse_bridge.simulator.layout import Layout
from lupin_greenhouse_bridge.units import sensor_order, unit_of, value_text
from lupin_planning.poses import pose_message
from lupin_planning.registration import Transform
from lupin_planning.tag_poses import find_tag_poses, tables_of
from lupin_planning.walls import Walls
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from lupin_readings.colours import colours_of

FIELD_NAMESPACE = 'field: interpolated from received readings'
TABLE_HEIGHT_M, TAG_HEIGHT_M = 0.20, 0.30  # a tag's is that of its centre
TILE_M, TILE_THICKNESS_M = 0.16, 0.02  # of a tag, seen from above
TEXT_HEIGHT_M = 0.45  # above everything else
LETTER_M, LETTER_WIDTH_M, LINE_M = 0.08, 0.045, 0.09
STALE_ALPHA, FIELD_ALPHA = 0.5, 0.35
KEY_M, KEY_STEPS = 1.5, 30  # length of the key of the colours
NEAREST_M = 1e-6  # a value of the field that is nearer counts as if it were at this distance
Colour = tuple[float, ...]  # red, green, blue and, if it is not opaque, alpha, from 0 to 1
# As on the page of readings in its dark scheme; a read tag without the shown sensor is white.
TABLE, GREY, WHITE, BLACK = (0.26, 0.3, 0.34), (0.45, 0.5, 0.55), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
BRIGHTEST, LUMA = 0.45, (0.299, 0.587, 0.114)  # the brightest colour with white text on it


class Box(NamedTuple):
    """A rectangle in metres: its centre and its size."""

    x: float
    y: float
    width: float
    height: float


class Scale(NamedTuple):
    """The sensor that is shown by colours, and the values at the ends of the colours, in its unit."""

    sensor: str
    limits: tuple[float, float]

    def colour_of(self, reading: TagReading) -> Colour:
        """Return the colour of a tag with this reading."""
        values = [sensor.value for sensor in reading.readings if sensor.name == self.sensor]
        if not values or math.isnan(values[0]):
            return WHITE
        return tuple(colours_of(values[:1], *self.limits)[0].tolist())


class FieldGrid(NamedTuple):
    """The square cells of a field, in the layout's frame."""

    x: float  # of the corner with the lowest coordinates, in metres
    y: float
    resolution_m: float
    columns: int  # along x
    rows: int  # along y


def grid_over(layout: Layout, walls: Walls, resolution_m: float) -> FieldGrid:
    """Return the grid that covers the walls, the tables and the tags."""
    boxes = np.array([walls, *layout.tables.values(), *(tag[:2] * 2 for tag in layout.tags.values())])
    corner, opposite = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    columns, rows = (max(math.ceil(cells), 1) for cells in (opposite - corner) / resolution_m)
    return FieldGrid(float(corner[0]), float(corner[1]), resolution_m, columns, rows)


def interpolate(grid: FieldGrid, samples: list[tuple[float, float, float]], radius_m: float) -> np.ndarray:
    """
    Return a value for each cell, by row and column; NaN where no sample lies within the radius.

    A sample is x, y and its value. Each cell gets the weighted average of the samples within the radius. The
    weights are those of Franke and Little: ((radius - distance) / (radius * distance))**2. At the radius, the
    weight of a sample is zero, so that the field has no steps. In its own cell, a sample has all the weight.
    """
    xs = grid.x + (np.arange(grid.columns) + 0.5) * grid.resolution_m
    ys = grid.y + (np.arange(grid.rows) + 0.5) * grid.resolution_m
    to_corner_m = grid.resolution_m / math.sqrt(2)  # from the centre of a cell
    reach_m = radius_m + to_corner_m
    weights, sums = np.zeros((2, grid.rows, grid.columns))
    for x, y, value in samples:
        rows = slice(*np.searchsorted(ys, (y - reach_m, y + reach_m)))
        columns = slice(*np.searchsorted(xs, (x - reach_m, x + reach_m)))
        centres_m = np.hypot(xs[columns] - x, ys[rows, np.newaxis] - y)
        distances_m = np.maximum(centres_m - to_corner_m, NEAREST_M)
        weight = (np.maximum(radius_m - distances_m, 0.0) / (radius_m * distances_m)) ** 2
        weights[rows, columns] += weight
        sums[rows, columns] += weight * value
    return np.divide(sums, weights, out=np.full_like(sums, np.nan), where=weights > 0.0)


def scaled(values: np.ndarray, lowest: float, highest: float) -> np.ndarray:
    """Return values as whole numbers: 0 at the lowest or below, 100 at the highest or above, -1 for NaN."""
    shares = np.clip(np.rint(100.0 * (values - lowest) / (highest - lowest)), 0.0, 100.0)
    return np.where(np.isnan(shares), -1.0, shares).astype(np.int8)


def field_marker(
    grid: FieldGrid, values: np.ndarray, scale: Scale, layout_in_map: Transform
) -> Marker | None:
    """Return the cells that have a value, in their colours; None if there are none."""
    rows, columns = np.nonzero(~np.isnan(values))
    if not len(rows):
        return None
    places = (np.stack([columns, rows], axis=-1) + 0.5) * grid.resolution_m
    colours = colours_of(values[rows, columns], *scale.limits)
    origin = pose_message(*layout_in_map.point(grid.x, grid.y), layout_in_map.yaw)
    return _rectangles('field', origin, (grid.resolution_m,) * 2, places, colours, FIELD_ALPHA)


class Scene:
    """The greenhouse in the frame of a map."""

    def __init__(self, layout: Layout, walls: Walls, layout_in_map: Transform, scale: Scale):
        """Compute the positions of all markers; raises StartUpError for a table without an area."""
        self.scale = scale
        tag_poses = find_tag_poses(layout, walls)
        self._dots: dict[str, Box] = {}
        self._facing: dict[str, float] = {}
        sizes = []
        for tag_id, tag in layout.tags.items():
            x, y, facing = tag_poses[tag_id]
            id_width_m = max(len(tag_id) * LETTER_WIDTH_M, TILE_M)
            self._dots[tag_id] = Box(*layout_in_map.point(x, y), id_width_m, TILE_M)
            self._facing[tag_id] = layout_in_map.heading(facing)
            # Room for a line of up to four digits for each sensor of the tag, and for the age.
            widest = max(len(_value_line(sensor, 999.9)) for sensor in tag.sensors)
            sizes.append((widest * LETTER_WIDTH_M, (len(tag.sensors) + 1) * LINE_M))
        dots = list(self._dots.values())
        places = place_labels(dots, sizes)
        self._label_places = dict(zip(self._dots, places, strict=True))
        middle_x = sum(x for x, _ in places) / len(places)
        corners = [layout_in_map.point(x, y) for x in walls[::2] for y in walls[1::2]]
        lowest_of_labels = min(y - height / 2 for (_, y), (_, height) in zip(places, sizes, strict=True))
        lowest_y = min(lowest_of_labels, *(y for _, y in corners))
        self._caption_place = middle_x, lowest_y - 5 * LINE_M
        self._background = [_key(middle_x - KEY_M / 2, lowest_y - 2 * LINE_M)]
        for number, table in enumerate(tables_of(layout)):
            x, y = layout_in_map.point((table.x0 + table.x1) / 2, (table.y0 + table.y1) / 2)
            size = (table.x1 - table.x0, table.y1 - table.y0, TABLE_HEIGHT_M)
            at = pose_message(x, y, layout_in_map.yaw, TABLE_HEIGHT_M / 2)
            self._background.append(_marker('tables', number, Marker.CUBE, TABLE, size, pose=at))

    def markers(
        self,
        header: Header,
        readings: dict[str, tuple[TagReading, float]],
        stale_seconds: float,
        caption: str,
        field: Marker | None = None,
    ) -> MarkerArray:
        """
        Return the tables, the tags with their ids, the readings with their ages, and the caption.

        The readings are given by tag id, with their ages in seconds. A reading that is older than
        `stale_seconds` is faded.
        """
        markers = [*self._background, *([field] if field else [])]
        for number, (tag_id, dot) in enumerate(self._dots.items()):
            colour: Colour = GREY
            alpha = 1.0
            if tag_id in readings:
                reading, age = readings[tag_id]
                colour = self.scale.colour_of(reading)
                alpha = STALE_ALPHA if age > stale_seconds else 1.0
                sensors = sorted(reading.readings, key=lambda sensor: sensor_order(sensor.name))
                lines = [_value_line(sensor.name, sensor.value) for sensor in sensors]
                text = '\n'.join([*lines, age_text(age)])
                markers.append(_text('readings', number, self._label_places[tag_id], text, alpha))
            at = pose_message(dot.x, dot.y, self._facing[tag_id], TAG_HEIGHT_M)
            tile = (TILE_M, TILE_M, TILE_THICKNESS_M)
            is_bright = np.dot(colour, LUMA) > BRIGHTEST and dot.width <= TILE_M
            markers += [
                _marker('tags', number, Marker.CUBE, (*colour, alpha), tile, pose=at),
                _text('ids', number, dot[:2], escaped(tag_id, 40), colour=BLACK if is_bright else WHITE),
            ]
        markers.append(_text(FIELD_NAMESPACE, 0, self._caption_place, caption))
        for marker in markers:
            marker.header = header
        return MarkerArray(markers=markers)


def place_labels(dots: Sequence[Box], sizes: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the centre of the label of each dot: the first place beside it with the least on it."""
    taken, places = np.array(dots), []
    for dot, (width, height) in zip(dots, sizes, strict=True):
        aside, above = (dot.width + width) / 2, (dot.height + height) / 2
        near = [(aside, 0.0), (-aside, 0.0), (0.0, above), (0.0, -above)]
        near += [(x * aside, y * above) for y in (0.7, -0.7, 1.0, -1.0) for x in (1, -1)]
        centres = [(dot.x + far * x, dot.y + far * y) for far in (1, 2) for x, y in near]
        covered = [_covered_m2(Box(*centre, width, height), taken) for centre in centres]
        places.append(centres[int(np.argmin(np.round(covered, 4)))])
        taken = np.vstack([taken, (*places[-1], width, height)])
    return places


def _covered_m2(box: Box, others: np.ndarray) -> float:
    """Return the area of a box that the other boxes cover."""
    low = np.maximum(np.subtract(box[:2], np.divide(box[2:], 2)), others[:, :2] - others[:, 2:] / 2)
    high = np.minimum(np.add(box[:2], np.divide(box[2:], 2)), others[:, :2] + others[:, 2:] / 2)
    return float(np.maximum(high - low, 0.0).prod(axis=1).sum())


def age_text(seconds: float) -> str:
    """Return an age in its largest whole unit, such as `3 min ago`."""
    for unit, length in (('h', 3600), ('min', 60)):
        if seconds >= length:
            return f'{seconds // length:.0f} {unit} ago'
    return f'{seconds:.0f} s ago'


def plain(text: str) -> str:
    """Return a text in ASCII, because RViz cannot draw other characters."""
    text = text.replace('°', 'deg ').replace('³', '3').replace('₂', '2')
    return text.encode('ascii', 'backslashreplace').decode()


def _value_line(sensor: str, value: float) -> str:
    name = escaped(sensor.replace('_', ' '), 40)
    return plain(f'{name} {value_text(sensor, value)} {unit_of(sensor)}'.rstrip())


def _key(x: float, y: float) -> Marker:
    """Return a bar of the colours, from the lowest value on the left to the highest."""
    step_m = KEY_M / KEY_STEPS
    steps = np.arange(KEY_STEPS) + 0.5
    places = np.stack([steps * step_m, 0 * steps], axis=-1)
    colours = colours_of(steps, 0, KEY_STEPS)
    return _rectangles('key', pose_message(x, y, 0.0), (step_m, LINE_M), places, colours, 1.0)


def _rectangles(
    namespace: str,
    origin: Pose,
    size: tuple[float, float],
    places: np.ndarray,
    colours: np.ndarray,
    alpha: float,
) -> Marker:
    """Return one flat marker of rectangles around these places from its origin."""
    points = [Point(x=x, y=y) for x, y in places.tolist()]
    colors = [ColorRGBA(r=r, g=g, b=b, a=alpha) for r, g, b in colours.tolist()]
    kind, look = Marker.CUBE_LIST, ((*WHITE, alpha), (*size, 0.01))
    return _marker(namespace, 0, kind, *look, pose=origin, points=points, colors=colors)


def _text(
    namespace: str,
    number: int,
    place: tuple[float, float],
    text: str,
    alpha: float = 1.0,
    colour: Colour = WHITE,
) -> Marker:
    size = LETTER_WIDTH_M / 2, 0.0, LETTER_M  # RViz takes the width of a space from x
    at = pose_message(*place, 0.0, TEXT_HEIGHT_M)
    kind = Marker.TEXT_VIEW_FACING
    return _marker(namespace, number, kind, (*colour, alpha), size, pose=at, text=plain(text))


def _marker(
    namespace: str, number: int, kind: int, colour: Colour, size: tuple[float, float, float], **fields: Any
) -> Marker:
    return Marker(
        ns=namespace,
        id=number,
        type=kind,
        action=Marker.ADD,
        frame_locked=True,  # in another fixed frame, RViz moves it with the map
        scale=Vector3(**dict(zip('xyz', size, strict=True))),
        color=ColorRGBA(**{'a': 1.0, **dict(zip('rgba', colour, strict=False))}),
        **fields,
    )
