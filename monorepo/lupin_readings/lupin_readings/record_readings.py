"""
ROS 2 node `record_readings`: keeps each value that it receives as a row of a SQLite file.

ros2 run lupin_readings record_readings --ros-args -p file:=readings.sqlite
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_greenhouse_bridge.contract import DEFAULT_SERVICE, info_of, info_request, parameter_service_of
from lupin_greenhouse_bridge.errors import StartUpError, escaped, pluralized
from lupin_greenhouse_bridge.interfaces import TagReading
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, declare_parameters, parameter
from lupin_greenhouse_bridge.runtime.rclpy_internals import RcutilsLogger, steady_timer
from lupin_greenhouse_bridge.runtime.run import run
from lupin_greenhouse_bridge.simulator.layout import find_places
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from lupin_readings.rows import Row, fault_of, rows_of
from lupin_readings.store import LOCKED_FOR_SECONDS, Store, StoreError
from lupin_readings.subscription import (
    subscribe_to_readings,
    take_what_has_arrived,
    topics_of,
    topics_parameter,
)

NODE_NAME = 'record_readings'
ASK_EVERY_SECONDS = 1.0
MOST_ROWS = 50_000  # waiting in memory
WRITE_EVERY_SECONDS = 0.5
ERROR_EVERY_SECONDS = 10.0
LAST_WAIT_SECONDS = 3.0  # at the end, for a file that another program locks
TAG_FILE_UNKNOWN = 'the bridge did not report its tag_file'
SHIPPED_PLACES = 'using the positions of mdp-greenhouse (set tag_file for others)'


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    readings_topics: str = topics_parameter()
    file: str = parameter(
        'readings.sqlite', 'The SQLite file to write or to continue: NAME.sqlite or NAME.db.'
    )
    tag_file: str = parameter(
        '', "The bridge's tag_locations.json, for the positions; empty: the one that the bridge uses."
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        topics_of(self.readings_topics)


class Buffer:
    """
    The rows that are not written yet. While the file cannot be written, at most MOST_ROWS wait here.

    The line "N rows kept" acknowledges that the first N new rows are on the disk.
    """

    def __init__(
        self, store: Store, logger: RcutilsLogger, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Write to an open store. The clock is monotonic, in seconds."""
        self._store, self._logger, self._clock = store, logger, clock
        self._waiting: list[Row] = []
        self._kept = self._dropped = 0
        self._next_error_at = -math.inf

    def add(self, rows: Sequence[Row]) -> None:
        """Take rows; those that do not fit are counted as dropped."""
        room = MOST_ROWS - len(self._waiting)
        self._waiting += rows[:room]
        self._dropped += len(rows[room:])

    def write(self, wait_seconds: float = LOCKED_FOR_SECONDS) -> None:
        """Write the waiting rows, and log the result."""
        if not self._waiting:
            return
        try:
            new_count = self._store.keep(self._waiting, wait_seconds)
        except StoreError as error:
            if self._clock() >= self._next_error_at:
                self._next_error_at = self._clock() + ERROR_EVERY_SECONDS
                waiting = pluralized(len(self._waiting), 'row')
                self._logger.error(f'{error}: {waiting} waiting in memory, {self._dropped} dropped')
            return
        self._waiting.clear()
        self._kept += new_count
        if new_count:
            self._logger.info(f'{pluralized(self._kept, "row")} kept')

    def end(self) -> int:
        """Write the waiting rows, and return how many rows were lost since the start."""
        self._next_error_at = -math.inf
        self.write(LAST_WAIT_SECONDS)
        self._dropped += len(self._waiting)
        self._waiting.clear()
        self._store.close()
        return self._dropped


class RecordReadingsNode(Node):
    """Takes readings, and writes them twice a second."""

    def __init__(self) -> None:
        """Open the file and subscribe; raises StartUpError."""
        super().__init__(NODE_NAME)
        settings = declare_parameters(self, Settings)
        self._places_m = find_places(settings.tag_file)
        self._has_places = bool(settings.tag_file)
        self._refused = 0
        self._buffer = Buffer(Store(settings.file), self.get_logger())
        topics = subscribe_to_readings(self, topics_of(settings.readings_topics), self._on_reading)
        if not self._has_places:
            self._bridge: Client[Any, Any]
            self._bridge = self.create_client(GetParameters, parameter_service_of(DEFAULT_SERVICE))
            self._request: Future[GetParameters.Response] | None = None
            self._timer = steady_timer(self, ASK_EVERY_SECONDS, self._ask_for_tag_file)
        steady_timer(self, WRITE_EVERY_SECONDS, self._buffer.write)
        file = Path(settings.file).resolve()
        self.get_logger().info(f'ready: readings from {", ".join(topics)} into {file}')

    def _on_reading(self, reading: TagReading, topic: str) -> None:
        if not self._has_places:
            self._has_places = True  # the warning comes once
            self.get_logger().warning(f'{TAG_FILE_UNKNOWN}: {SHIPPED_PLACES}')
        rows = rows_of(reading, topic, self._places_m.get(reading.tag_id))
        # Invalid rows would make the file unreadable.
        self._buffer.add([row for row in rows if not fault_of(row)])
        if faults := list(filter(None, map(fault_of, rows))):
            self._refused += len(faults)
            self.get_logger().warning(
                f"tag '{escaped(reading.tag_id, 64)}': {escaped(faults[0], 200)}:"
                f' {pluralized(self._refused, "row")} refused so far',
                throttle_duration_sec=ERROR_EVERY_SECONDS,
            )

    def _ask_for_tag_file(self) -> None:
        if self._request:  # DDS can drop a request that comes before discovery is complete
            self._bridge.remove_pending_request(self._request)
        if self._bridge.service_is_ready():
            self._request = self._bridge.call_async(info_request())
            self._request.add_done_callback(self._on_tag_file)

    def _on_tag_file(self, request: 'Future[GetParameters.Response]') -> None:
        self._timer.cancel()
        self._has_places = True
        try:
            response = request.result()
            info = response and info_of(response)
            if not (info and info.tag_ids):
                raise StartUpError(TAG_FILE_UNKNOWN)
            if info.tag_file:
                self._places_m = find_places(info.tag_file)
                shown = escaped(info.tag_file, 500)
                self.get_logger().info(f"using the positions of the bridge's tag_file {shown}")
        except StartUpError as error:  # such as a file on another machine
            self.get_logger().warning(f'{error}: {SHIPPED_PLACES}')

    def end(self) -> int:
        """Write the last rows; return the exit code."""
        take_what_has_arrived(self)
        if self._refused:
            self.get_logger().warning(
                f'{pluralized(self._refused, "row")} refused, because a value is invalid'
            )
        if lost := self._buffer.end():
            self.get_logger().error(f'{pluralized(lost, "row")} lost')
        return 1 if lost else 0


def main(args: list[str] | None = None) -> int:
    """Record until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, RecordReadingsNode, args, conclude=RecordReadingsNode.end)
