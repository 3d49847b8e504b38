"""
ROS 2 node `show_readings`: shows received readings in RViz and Foxglove, as markers and as a field.

It subscribes to the readings that others publish, and requests none itself. The field is interpolated from
them: it is not the model of the simulator, which no robot can see.

    ros2 run lupin_readings show_readings --ros-args -p sensor:=co2
"""

import array
import math
import time
from dataclasses import dataclass

from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import StartUpError, escaped, pluralized
from lupin_greenhouse_bridge.interfaces import TagReading
from lupin_greenhouse_bridge.runtime.parameters import (
    check_parameters,
    declare_parameters,
    invalid,
    parameter,
)
from lupin_greenhouse_bridge.runtime.rclpy_internals import steady_timer
from lupin_greenhouse_bridge.runtime.run import run
from lupin_greenhouse_bridge.simulator.layout import require_layout
from lupin_greenhouse_bridge.units import label_of
from lupin_planning.poses import pose_message
from lupin_planning.registration import MAP_FRAME, Transform, read_transform
from lupin_planning.walls import find_walls, parse_walls, walls_parameter
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rclpy.node import Node
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from lupin_readings.colours import colour_limits, read_colour_ranges
from lupin_readings.markers import (
    Scale,
    Scene,
    field_marker,
    grid_over,
    interpolate,
    scaled,
)
from lupin_readings.subscription import subscribe_to_readings, topics_of, topics_parameter
from lupin_readings.summary import extremes_of

NODE_NAME = 'show_readings'
PUBLISH_EVERY_SECONDS = 1.0  # web clients receive a latched topic only when it is published again
MOST_CELLS, MOST_CELLS_MARKED = 1_000_000, 20_000
MOST_UNKNOWN_IDS_LOGGED = 1000  # a publisher of random ids must not fill the memory


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    readings_topics: str = topics_parameter()
    sensor: str = parameter('temperature', 'The sensor whose field is shown.')
    resolution_m: float = parameter(
        0.1, 'Width of a cell of the field, in metres.', smallest=0.01, largest=10.0
    )
    radius_m: float = parameter(
        1.0, 'Distance up to which a reading counts for the field, in metres.', smallest=0.01, largest=100.0
    )
    stale_seconds: float = parameter(
        60.0, 'Age from which a reading is faded, in seconds.', smallest=0.0, largest=1e9
    )
    map_frame: str = parameter(MAP_FRAME, 'The frame of the markers and of the field.')
    layout_in_map: str = parameter(
        '', 'File of register_layout with the pose of the layout in that frame; empty: the layout is the map.'
    )
    tag_file: str = parameter('', "The bridge's tag_locations.json; empty: the simulator's.")
    sim_config_file: str = parameter('', "The bridge's greenhouse_config.yaml; empty: the simulator's.")
    walls: str = walls_parameter()  # or an array

    def __post_init__(self) -> None:
        check_parameters(self)
        parse_walls(self.walls)
        topics_of(self.readings_topics)
        if not self.map_frame.strip():
            raise invalid('map_frame', self.map_frame, 'the name of a frame, such as map')


class ShowReadingsNode(Node):
    """Publishes `~/markers` and `~/field`, latched and once a second."""

    def __init__(self) -> None:
        """Read the layout and subscribe; raises StartUpError."""
        super().__init__(NODE_NAME)
        self._settings = settings = declare_parameters(self, Settings)
        layout = require_layout(settings.tag_file, 'tag_file')
        walls = find_walls(layout, settings.sim_config_file, settings.walls)
        in_map = Transform()
        if settings.layout_in_map:
            in_map = read_transform(settings.layout_in_map, settings.map_frame)
        self._range = Scale(settings.sensor, _colour_range_of(settings))
        self._grid = grid = grid_over(layout, walls, settings.resolution_m)
        if grid.columns * grid.rows > MOST_CELLS:
            raise StartUpError(
                f'parameter resolution_m is {settings.resolution_m:g}: the field would have {grid.columns} x'
                f' {grid.rows} cells: must be larger, for at most {MOST_CELLS} cells'
            )
        self._tags, self._layout_in_map = layout.tags, in_map
        self._scene = Scene(layout, walls, in_map, self._range)
        self._is_field_marked = grid.columns * grid.rows <= MOST_CELLS_MARKED
        if not self._is_field_marked:
            self.get_logger().warning(
                f'the field has {grid.columns} x {grid.rows} cells, more than the {MOST_CELLS_MARKED} that'
                ' markers can show: only ~/field has it; for markers, set a larger resolution_m'
            )
        self._received: dict[
            str, tuple[TagReading, float]
        ] = {}  # last readings by tag id, with arrival times
        self._extremes: list[float] = []  # of all readings so far, so that the colours do not flicker
        self._cells: array.array[int] | None = None  # of the field; None if they are out of date
        self._field_marker: Marker | None = None
        self._unknown_ids: set[str] = set()
        self._markers = self.create_publisher(MarkerArray, '~/markers', latched())
        self._field = self.create_publisher(OccupancyGrid, '~/field', latched())
        topics = subscribe_to_readings(self, topics_of(settings.readings_topics), self._on_reading)
        steady_timer(self, PUBLISH_EVERY_SECONDS, self._publish)
        self._publish()
        tags, sources = pluralized(len(self._tags), 'tag'), ' and '.join(topics)
        self.get_logger().info(f'ready: {tags}, field of {settings.sensor}, readings from {sources}')

    def _on_reading(self, reading: TagReading, _topic: str) -> None:
        tag_id = reading.tag_id
        if tag_id in self._tags:
            self._received[tag_id] = reading, time.monotonic()
            self._cells = None
        elif tag_id not in self._unknown_ids and len(self._unknown_ids) < MOST_UNKNOWN_IDS_LOGGED:
            self._unknown_ids.add(tag_id)
            shown = escaped(tag_id, 64)
            self.get_logger().warning(f"tag '{shown}' is not in the layout: its readings are not shown")

    def _publish(self) -> None:
        header = Header(stamp=self.get_clock().now().to_msg(), frame_id=self._settings.map_frame)
        samples = self._samples()
        if self._cells is None:
            self._update_field(samples)
        grid, in_map = self._grid, self._layout_in_map
        origin = pose_message(*in_map.point(grid.x, grid.y), in_map.yaw)
        size = {'resolution': float(grid.resolution_m), 'width': grid.columns, 'height': grid.rows}
        info = MapMetaData(map_load_time=header.stamp, origin=origin, **size)
        self._field.publish(OccupancyGrid(header=header, info=info, data=self._cells))
        now = time.monotonic()
        aged = {tag_id: (reading, now - since) for tag_id, (reading, since) in self._received.items()}
        stale_seconds, caption = self._settings.stale_seconds, self._caption(samples)
        self._markers.publish(self._scene.markers(header, aged, stale_seconds, caption, self._field_marker))

    def _update_field(self, samples: dict[str, tuple[float, float, float]]) -> None:
        shown = [*self._extremes, *(value for *_, value in samples.values())]
        self._extremes = [min(shown), max(shown)] if shown else []
        self._scene.scale = self._range._replace(limits=colour_limits(self._extremes, self._range.limits))
        field = interpolate(self._grid, list(samples.values()), self._settings.radius_m)
        self._cells = array.array('b', scaled(field, *self._range.limits).tobytes())
        if self._is_field_marked:
            self._field_marker = field_marker(self._grid, field, self._scene.scale, self._layout_in_map)

    def _samples(self) -> dict[str, tuple[float, float, float]]:
        """Return x and y in the layout and the value of each reading of the sensor, by tag id."""
        return {
            tag_id: (*self._tags[tag_id][:2], sensor.value)
            for tag_id, (reading, _) in self._received.items()
            for sensor in reading.readings
            if sensor.name == self._range.sensor and math.isfinite(sensor.value)
        }

    def _caption(self, samples: dict[str, tuple[float, float, float]]) -> str:
        """Return what the colours show, in the words of the page of readings."""
        sensor, (lowest, highest) = self._scene.scale
        lines = [f'{label_of(sensor)}: colours from {lowest:g} to {highest:g}']
        values = {tag_id: value for tag_id, (*_, value) in samples.items()}
        lines += [text for text, _ in extremes_of(sensor, values)]
        if self._is_field_marked:
            lines.append(f'field: interpolated from {pluralized(len(samples), "received reading")},')
            lines.append('not from the model of the simulator')
        return '\n'.join(lines)


def _colour_range_of(settings: Settings) -> tuple[float, float]:
    """Return the lowest and highest value of the sensor's scale; raises StartUpError if it has none."""
    ranges = read_colour_ranges(settings.sim_config_file)
    lowest, highest = ranges.get(settings.sensor, (0.0, 0.0))
    if not lowest < highest:
        shown = escaped(repr(settings.sensor), 60)
        where = f"'{settings.sim_config_file}'" if settings.sim_config_file else 'the greenhouse config'
        raise StartUpError(
            f'parameter sensor is {shown}: {where} has no visualization.colorbar_ranges with min < max'
            f' for this sensor: choose from {", ".join(ranges) or "none"}, or set sim_config_file'
        )
    return lowest, highest


def main(args: list[str] | None = None) -> int:
    """Publish until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, ShowReadingsNode, args)
