"""
ROS 2 node `read_on_sight`: reads each tag that an AprilTag detector sees, and publishes the reading.

It is a client of the bridge, for robots with a detector. It never waits in a callback.

    ros2 run lupin_readings read_on_sight --ros-args -p cooldown_seconds:=30.0
"""

import re
import time
from dataclasses import dataclass
from functools import partial
from typing import Any

from lupin_greenhouse_bridge.contract import DEFAULT_SERVICE, SERVICE_QOS, answer_of, latched
from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.interfaces import GetTagReading, TagReading
from lupin_greenhouse_bridge.runtime.graph import domain_id, duplicate_server_warning
from lupin_greenhouse_bridge.runtime.parameters import (
    check_parameters,
    declare_parameters,
    invalid,
    parameter,
)
from lupin_greenhouse_bridge.runtime.rclpy_internals import steady_timer
from lupin_greenhouse_bridge.runtime.run import run
from lupin_greenhouse_bridge.units import value_text
from rclpy.client import Client
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.task import Future

from lupin_readings.detections import FAMILIES, Sightings, detection_messages
from lupin_readings.subscription import watch_publishers

NODE_NAME = 'read_on_sight'
LOOK_EVERY_SECONDS = 0.1
LOOK_FOR_SERVERS_EVERY_SECONDS = 10.0
DISCOVERY_SECONDS = 3.0
LOG_EVERY_SECONDS = 5.0
MOST_IDS_LOGGED = 1000  # a detector that reports random ids must not fill the memory


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    detections_topic: str = parameter('/detections', 'An apriltag_msgs/AprilTagDetectionArray topic.')
    bridge_service_name: str = parameter(DEFAULT_SERVICE, 'The GetTagReading service.')
    tag_id_format: str = parameter(
        '{id}', "Format that turns the number of a tag into a tag id, such as 'tag_{id:02d}'."
    )
    cooldown_seconds: float = parameter(
        10.0, 'Seconds after a reading before the tag is requested again.', smallest=0.0, largest=86400.0
    )
    request_timeout_seconds: float = parameter(
        2.0, 'Seconds to wait for each reply.', smallest=0.001, largest=3600.0
    )
    max_attempts: int = parameter(
        3, 'Failed requests for a tag in a row before the node pauses for this tag.', smallest=1, largest=1000
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        if not re.fullmatch(r'[^{}]*\{id(:0?\d{1,2}d)?\}[^{}]*', self.tag_id_format):
            accepted = "a text with {id} once, like 'tag_{id}' or '{id:03d}'"
            raise invalid('tag_id_format', self.tag_id_format, accepted)

    @property
    def patience_seconds(self) -> float:
        """How long all attempts for a tag may take, and how late a reply may come."""
        return self.max_attempts * self.request_timeout_seconds

    def tag_id(self, number: int) -> str:
        """Return the tag id of a tag with this number."""
        return self.tag_id_format.format(id=number)


class ReadOnSightNode(Node):
    """Turns detections into readings on the topic `~/readings`."""

    def __init__(self) -> None:
        """Subscribe to the detector; raises StartUpError."""
        super().__init__(NODE_NAME)
        self._settings = settings = declare_parameters(self, Settings)
        self._sightings = Sightings(settings)
        # The last request for each tag, and when it was sent. A late reply to it still counts.
        self._requests: dict[str, tuple[Future[GetTagReading.Response], float]] = {}
        self._logged: set[tuple[str, str]] = set()  # tag ids and statuses
        self._has_warned_of_family = False
        self._no_service_since_s: float | None = None
        self._has_warned_of_no_service = False
        self._next_look_for_servers = 0.0  # when to check for a second server
        self._readings = self.create_publisher(TagReading, '~/readings', latched(50))
        self._client: Client[Any, Any] = self.create_client(
            GetTagReading, settings.bridge_service_name, qos_profile=SERVICE_QOS
        )
        self.create_subscription(
            detection_messages().AprilTagDetectionArray,
            settings.detections_topic,
            self._on_detections,
            qos_profile_sensor_data,  # best effort is compatible with every publisher
        )
        steady_timer(self, LOOK_EVERY_SECONDS, self._look)
        topic = self.resolve_topic_name(settings.detections_topic)
        watch_publishers(self, [topic], 'a detector that starts, set detections_topic')
        self.get_logger().info(f'ready: detections from {topic}, readings from {self._client.srv_name}')

    def _on_detections(self, message: Any) -> None:
        for detection in message.detections:
            if detection.family in FAMILIES:
                self._sightings.see(self._settings.tag_id(detection.id), time.monotonic())
            elif not self._has_warned_of_family:
                self._has_warned_of_family = True
                family = escaped(detection.family, 40)
                self.get_logger().warning(
                    f"ignored a tag of the family '{family}': the tags of the greenhouse are {FAMILIES[0]}"
                )
        self._send()

    def _look(self) -> None:
        """Handle the timeouts of requests, and send the next request."""
        now = time.monotonic()
        self._sightings.forget(now)
        for tag_id in self._sightings.overdue(now):
            if not self._sightings.timed_out(tag_id, now):
                self.get_logger().warning(
                    f"tag '{escaped(tag_id, 64)}': no reply from {self._client.srv_name}",
                    throttle_duration_sec=LOG_EVERY_SECONDS,
                )
        for tag_id, (_, sent_at) in list(self._requests.items()):
            if now - sent_at >= self._settings.patience_seconds:
                self._give_up(tag_id)
        self._send()

    def _give_up(self, tag_id: str) -> None:
        """Ignore the reply to the last request for a tag, if any."""
        if tag_id in self._requests:
            self._client.remove_pending_request(self._requests.pop(tag_id)[0])

    def _send(self) -> None:
        if not self._client.service_is_ready():
            self._warn_of_no_service()
            return
        if self._has_warned_of_no_service:
            self.get_logger().info(f'{self._client.srv_name} is available now')
        self._no_service_since_s, self._has_warned_of_no_service = None, False
        if (tag_id := self._sightings.next()) is not None:
            self._warn_of_two_servers()
            sent_at = time.monotonic()
            future = self._client.call_async(GetTagReading.Request(tag_id=tag_id))  # raises if ROS refuses it
            self._sightings.asked(tag_id, sent_at)
            self._give_up(tag_id)
            self._requests[tag_id] = future, sent_at
            future.add_done_callback(partial(self._on_reply, tag_id))

    def _warn_of_no_service(self) -> None:
        """Warn after some seconds, because DDS needs time to discover a running bridge."""
        now = time.monotonic()
        if self._no_service_since_s is None:
            self._no_service_since_s = now
        if now - self._no_service_since_s >= DISCOVERY_SECONDS:
            self._has_warned_of_no_service = True
            self.get_logger().warning(
                f'no service {self._client.srv_name} on domain {domain_id()}: start the bridge, or set'
                ' bridge_service_name or ROS_DOMAIN_ID',
                throttle_duration_sec=LOG_EVERY_SECONDS,
            )

    def _warn_of_two_servers(self) -> None:
        """Check from time to time, because DDS may discover the second server late."""
        if time.monotonic() >= self._next_look_for_servers:
            self._next_look_for_servers = time.monotonic() + LOOK_FOR_SERVERS_EVERY_SECONDS
            if warning := duplicate_server_warning(self, self._client.srv_name):
                self.get_logger().warning(warning)

    def _on_reply(self, tag_id: str, future: 'Future[GetTagReading.Response]') -> None:
        if tag_id not in self._requests or self._requests[tag_id][0] is not future:
            return  # given up before the executor ran this callback
        del self._requests[tag_id]
        self._sightings.answered(tag_id, time.monotonic())
        self._send()
        answer = answer_of(tag_id, future.result())
        if answer.reading is not None:
            self._readings.publish(answer.reading)
            if self._is_first(tag_id, answer.status):
                sensors = answer.reading.readings
                values = [f'{sensor.name} {value_text(sensor.name, sensor.value)}' for sensor in sensors]
                shown = escaped(', '.join(values), 300)
                self.get_logger().info(f"tag '{escaped(tag_id, 64)}': {shown}")
        elif answer.status == 'UNKNOWN_TAG':
            if self._is_first(tag_id, answer.status):
                self.get_logger().warning(escaped(answer.error_message, 300))
        else:
            self.get_logger().warning(
                f"tag '{escaped(tag_id, 64)}': {answer.status}: {escaped(answer.error_message, 300)}",
                throttle_duration_sec=LOG_EVERY_SECONDS,
            )

    def _is_first(self, tag_id: str, status: str) -> bool:
        """Return whether to log this status of a tag. Each is logged once."""
        is_first = (tag_id, status) not in self._logged and len(self._logged) < MOST_IDS_LOGGED
        if is_first:
            self._logged.add((tag_id, status))
        return is_first


def main(args: list[str] | None = None) -> int:
    """Publish until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, ReadOnSightNode, args)
