# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
ROS 2 node `record_readings`: keeps each value that it receives as a row of a SQLite or CSV file.

ros2 run lupin_greenhouse_bridge record_readings --ros-args -p file:=readings.csv
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.recording.buffered_writer import BufferedWriter
from lupin_greenhouse_bridge.recording.rows import rows_of
from lupin_greenhouse_bridge.recording.store import open_store
from lupin_greenhouse_bridge.recording.subscription import subscribe_to_readings, topics_of, topics_parameter
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, declare_parameters, parameter
from lupin_greenhouse_bridge.runtime.run import run
from lupin_greenhouse_bridge.simulator.layout import find_layout

NODE_NAME = 'record_readings'
WRITE_EVERY_SECONDS = 0.5
ENDED, LOST_ROWS = 0, 1


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    readings_topics: str = topics_parameter()
    file: str = parameter(
        'readings.sqlite', 'The file to write or to continue: .sqlite or .db for SQLite, or .csv.'
    )
    tag_file: str = parameter(
        '', "The bridge's tag_locations.json, for the positions; empty: the one of mdp-greenhouse."
    )

    def __post_init__(self):
        check_parameters(self)
        topics_of(self.readings_topics)


class RecordReadingsNode(Node):
    """Writes what it has received twice a second."""

    def __init__(self):
        """Open the file and subscribe; raises StartUpError."""
        super().__init__(NODE_NAME)
        settings = declare_parameters(self, Settings)
        layout = find_layout(settings.tag_file)
        self._places = {tag_id: (tag.x, tag.y) for tag_id, tag in layout.tags.items()} if layout else {}
        store = open_store(settings.file)
        if store.mended:
            self.get_logger().warning(store.mended)
        self._writer = BufferedWriter(store, self.get_logger())
        topics = subscribe_to_readings(self, topics_of(settings.readings_topics), self._on_reading)
        self.create_timer(WRITE_EVERY_SECONDS, self._write, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.get_logger().info(
            f'ready: readings from {", ".join(topics)} into {Path(settings.file).resolve()}'
        )

    def _on_reading(self, reading, topic: str) -> None:
        self._writer.add(rows_of(reading, topic, self._places.get(reading.tag_id)), time.monotonic())

    def _write(self) -> None:
        self._writer.write(time.monotonic())

    def end(self) -> int:
        """Write the last rows; return the exit code."""
        if lost := self._writer.end():
            self.get_logger().error(f'{pluralized(lost, "row")} lost')
            return LOST_ROWS
        return ENDED


def main(args=None) -> int:
    """Record until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, RecordReadingsNode, args, conclude=RecordReadingsNode.end)


if __name__ == '__main__':
    sys.exit(main())
