# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The markers that show the greenhouse and the last reading of each tag."""

import math
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Pose, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from lupin_greenhouse_bridge.display.colours import colours_of
from lupin_greenhouse_bridge.display.field import FieldGrid
from lupin_greenhouse_bridge.display.placing import Box, place_labels
from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.interfaces import TagReading
from lupin_greenhouse_bridge.planning.registration import Transform
from lupin_greenhouse_bridge.planning.tag_poses import find_tag_poses, tables_of
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.runtime.poses import pose_message
from lupin_greenhouse_bridge.simulator.layout import Layout
from lupin_greenhouse_bridge.units import sensor_order, unit_of, value_text

FIELD_NAMESPACE = 'field: interpolated from received readings'
TABLE_HEIGHT_M, TAG_HEIGHT_M = 0.20, 0.30  # a tag's is that of its centre
TILE_M, TILE_THICKNESS_M = 0.16, 0.02  # of a tag, seen from above
TEXT_HEIGHT_M = 0.45  # above everything else
LETTER_M, LETTER_WIDTH_M, LINE_M = 0.08, 0.045, 0.09
STALE_ALPHA, FIELD_ALPHA = 0.5, 0.35
KEY_M, KEY_STEPS = 1.5, 30  # length of the key of the colours
Colour = tuple[float, ...]  # red, green, blue and, if it is not opaque, alpha, from 0 to 1
# As on the page of readings in its dark scheme; a read tag without the shown sensor is white.
TABLE, GREY, WHITE, BLACK = (0.26, 0.3, 0.34), (0.45, 0.5, 0.55), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
BRIGHTEST, LUMA = 0.45, (0.299, 0.587, 0.114)  # on which a text is white


class Scale(NamedTuple):
    """The sensor that is shown by colours, and the values at the ends of the colours, in its unit."""

    sensor: str
    limits: tuple[float, float]

    def colour_of(self, reading: TagReading) -> Colour:
        """Return the colour of a tag with this reading."""
        values = [each.value for each in reading.readings if each.name == self.sensor]
        if not values or math.isnan(values[0]):
            return WHITE
        red, green, blue = colours_of(values[:1], *self.limits)[0].tolist()
        return red, green, blue


class Plate(NamedTuple):
    """A tag in the map: where its id is, its direction in radians, and where its label is."""

    dot: Box
    facing: float
    label: Box

    def marker(self, number: int, colour: Colour) -> Marker:
        """Return the marker of the tag."""
        size = (TILE_M, TILE_M, TILE_THICKNESS_M)
        at = pose_message(self.dot.x, self.dot.y, self.facing, TAG_HEIGHT_M)
        return _marker('tags', number, Marker.CUBE, colour, size, pose=at)


def place_plates(layout: Layout, walls: Walls, layout_in_map: Transform) -> dict[str, Plate]:
    """Return the tags in the map, by id; raises StartUpError for a table without an area."""
    tag_poses = find_tag_poses(layout, walls)
    dots = {
        tag_id: Box(*layout_in_map.point(each.x, each.y), max(len(tag_id) * LETTER_WIDTH_M, TILE_M), TILE_M)
        for tag_id, each in tag_poses.items()
    }
    # As wide and as high as a label of three or four digits for each sensor of the tag.
    texts = [
        [_value_line(each, 999.9) for each in sorted(tag.sensors, key=sensor_order)]
        for tag in layout.tags.values()
    ]
    sizes = [(max(map(len, lines)) * LETTER_WIDTH_M, (len(lines) + 1) * LINE_M) for lines in texts]
    places = place_labels(
        list(dots.values()), [(dot, *size) for dot, size in zip(dots.values(), sizes, strict=True)]
    )
    return {
        tag_id: Plate(dot, layout_in_map.heading(tag_poses[tag_id].facing), Box(*place, *size))
        for (tag_id, dot), place, size in zip(dots.items(), places, sizes, strict=True)
    }


class Scene:
    """The greenhouse in the frame of a map."""

    def __init__(self, layout: Layout, walls: Walls, layout_in_map: Transform, scale: Scale):
        """Compute the positions of all markers; raises StartUpError for a table without an area."""
        self._layout_in_map, self.scale = layout_in_map, scale
        self._tables = tables_of(layout)
        self._plates = place_plates(layout, walls, layout_in_map)
        labels = [plate.label for plate in self._plates.values()]
        middle_x = sum(each.x for each in labels) / len(labels)
        corners = [layout_in_map.point(x, y) for x in walls[::2] for y in walls[1::2]]
        lowest_y = min(*(each.y - each.height / 2 for each in labels), *(y for _, y in corners))
        self._key_place = middle_x - KEY_M / 2, lowest_y - 2 * LINE_M
        self._caption_place = middle_x, lowest_y - 5 * LINE_M

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
        markers = [self._table(number) for number in range(len(self._tables))]
        markers += [self._key()] + [field] * (field is not None)
        for number, (tag_id, plate) in enumerate(self._plates.items()):
            colour: Colour = GREY
            alpha = 1.0
            if tag_id in readings:
                reading, age = readings[tag_id]
                colour = self.scale.colour_of(reading)
                alpha = STALE_ALPHA if age > stale_seconds else 1.0
                values = sorted(reading.readings, key=lambda each: sensor_order(each.name))
                lines = [_value_line(each.name, each.value) for each in values]
                text = '\n'.join([*lines, age_text(age)])
                markers.append(_text('readings', number, plate.label, text, alpha))
            is_bright = np.dot(colour, LUMA) > BRIGHTEST and plate.dot.width <= TILE_M
            markers += [
                plate.marker(number, (*colour, alpha)),
                _text('ids', number, plate.dot, escaped(tag_id, 40), colour=BLACK if is_bright else WHITE),
            ]
        markers.append(_text(FIELD_NAMESPACE, 0, self._caption_place, caption))
        for each in markers:
            each.header = header
        return MarkerArray(markers=markers)

    def _table(self, number: int) -> Marker:
        table = self._tables[number]
        x, y = self._layout_in_map.point((table.x0 + table.x1) / 2, (table.y0 + table.y1) / 2)
        size = (table.x1 - table.x0, table.y1 - table.y0, TABLE_HEIGHT_M)
        at = pose_message(x, y, self._layout_in_map.yaw, TABLE_HEIGHT_M / 2)
        return _marker('tables', number, Marker.CUBE, TABLE, size, pose=at)

    def _key(self) -> Marker:
        """Return a bar of the colours, from the lowest value on the left to the highest."""
        step_m = KEY_M / KEY_STEPS
        steps = np.arange(KEY_STEPS) + 0.5
        colours = colours_of(steps, 0, KEY_STEPS)
        places = np.stack([steps * step_m, 0 * steps], axis=-1)
        return _rectangles('key', pose_message(*self._key_place, 0.0), (step_m, LINE_M), places, colours, 1.0)


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


def age_text(seconds: float) -> str:
    """Return an age in its largest whole unit, such as `3 min ago`."""
    for unit, length in (('h', 3600), ('min', 60)):
        if seconds >= length:
            return f'{seconds // length:.0f} {unit} ago'
    return f'{seconds:.0f} s ago'


def plain(text: str) -> str:
    """Return a text in ASCII, because RViz cannot draw other characters."""
    text = text.replace('°', 'deg ').replace('³', '3')
    return text.encode('ascii', 'backslashreplace').decode()


def _value_line(sensor: str, value: float) -> str:
    return plain(
        f'{escaped(sensor.replace("_", " "), 40)} {value_text(sensor, value)} {unit_of(sensor)}'.rstrip()
    )


def _rectangles(
    namespace: str,
    origin: Pose,
    size: tuple[float, float],
    places: np.ndarray,
    colours: np.ndarray,
    alpha: float,
) -> Marker:
    """Return one flat marker of rectangles around these places from its origin."""
    return _marker(
        namespace,
        0,
        Marker.CUBE_LIST,
        (*WHITE, alpha),
        (*size, 0.01),
        pose=origin,
        points=[Point(x=x, y=y) for x, y in places.tolist()],
        colors=[ColorRGBA(r=r, g=g, b=b, a=alpha) for r, g, b in colours.tolist()],
    )


def _text(
    namespace: str,
    number: int,
    place: Box | tuple[float, float],
    text: str,
    alpha: float = 1.0,
    colour: Colour = WHITE,
) -> Marker:
    return _marker(
        namespace,
        number,
        Marker.TEXT_VIEW_FACING,
        (*colour, alpha),
        (LETTER_WIDTH_M / 2, 0.0, LETTER_M),  # RViz takes the width of a space from x
        pose=pose_message(place[0], place[1], 0.0, TEXT_HEIGHT_M),
        text=plain(text),
    )


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
