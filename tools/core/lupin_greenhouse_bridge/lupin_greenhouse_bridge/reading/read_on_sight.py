"""
ROS 2 node `read_on_sight`: reads each tag that an AprilTag detector sees, and publishes the reading.

It is a client of the bridge, for robots with a detector. It never waits in a callback.

    ros2 run lupin_greenhouse_bridge read_on_sight --ros-args -p cooldown_seconds:=30.0
"""

import re
import time
from dataclasses import dataclass

from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidServiceNameException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from lupin_greenhouse_bridge.contract import (
    DEFAULT_SERVICE,
    SERVICE_QOS,
    STATUS_NAMES,
    fault_of_reading,
    latched,
)
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.interfaces import GetTagReading, TagReading
from lupin_greenhouse_bridge.reading.detections import FAMILIES, Sightings, detection_messages
from lupin_greenhouse_bridge.runtime.graph import duplicate_server_warning
from lupin_greenhouse_bridge.runtime.parameters import (
    check_parameters,
    declare_parameters,
    invalid,
    parameter,
)
from lupin_greenhouse_bridge.runtime.run import run

NODE_NAME = 'read_on_sight'
LOOK_EVERY_SECONDS = 0.1
LOOK_FOR_SERVERS_EVERY_SECONDS = 10.0
NOW_AND_THEN = {'throttle_duration_sec': 5.0}  # each call of the logger for itself
MOST_UNKNOWN_IDS_LOGGED = 1000  # a detector that reports random ids must not fill the memory


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

    def __post_init__(self):
        check_parameters(self)
        if not re.fullmatch(r'[^{}]*\{id(:0?\d{1,2}d)?\}[^{}]*', self.tag_id_format):
            accepted = "a text with {id} once, like 'tag_{id}' or '{id:03d}'"
            raise invalid('tag_id_format', self.tag_id_format, accepted)

    def tag_id(self, number: int) -> str:
        """Return the tag id of a tag with this number."""
        return self.tag_id_format.format(id=number)


class ReadOnSightNode(Node):
    """Turns detections into readings on the topic `~/readings`."""

    def __init__(self):
        """Subscribe to the detector; raises StartUpError."""
        super().__init__(NODE_NAME)
        self._settings = settings = declare_parameters(self, Settings)
        self._sightings = Sightings(settings)
        self._futures = {}  # by tag id
        self._unknown_ids = set()
        self._has_warned_of_family = False
        self._next_look_for_servers = 0.0  # when to look for a second server of the service
        self._readings = self.create_publisher(TagReading, '~/readings', latched(50))
        try:
            self._client = self.create_client(
                GetTagReading, settings.bridge_service_name, qos_profile=SERVICE_QOS
            )
        except InvalidServiceNameException as error:
            raise StartUpError(
                f'parameter bridge_service_name is not a service name: {escaped(str(error), 300)}'
            ) from error
        # Best effort is compatible with every publisher.
        self.create_subscription(
            detection_messages().AprilTagDetectionArray,
            settings.detections_topic,
            self._on_detections,
            qos_profile_sensor_data,
        )
        self.create_timer(LOOK_EVERY_SECONDS, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        topic = self.resolve_topic_name(settings.detections_topic)
        self.get_logger().info(f'ready: detections from {topic}, readings from {self._client.srv_name}')

    def _on_detections(self, message) -> None:
        for each in message.detections:
            if each.family in FAMILIES:
                self._sightings.see(self._settings.tag_id(each.id), time.monotonic())
            elif not self._has_warned_of_family:
                self._has_warned_of_family = True
                family = escaped(each.family, 40)
                self.get_logger().warning(
                    f"ignored a tag of the family '{family}': the tags of the greenhouse are {FAMILIES[0]}"
                )
        self._send()

    def _look(self) -> None:
        """Give up requests after their timeout, and send the next ones."""
        self._sightings.forget(time.monotonic())
        for tag_id in self._sightings.overdue(time.monotonic()):
            if not (future := self._futures.pop(tag_id, None)):  # answered meanwhile, in another thread
                continue
            self._client.remove_pending_request(future)
            if not self._sightings.timed_out(tag_id, time.monotonic()):
                self.get_logger().warning(
                    f"tag '{escaped(tag_id, 64)}': no reply from {self._client.srv_name}", **NOW_AND_THEN
                )
        self._send()

    def _send(self) -> None:
        if not self._client.service_is_ready():
            self.get_logger().warning(
                f'no service {self._client.srv_name}: start the bridge, or set bridge_service_name',
                **NOW_AND_THEN,
            )
            return
        self._warn_of_two_servers()
        while (tag_id := self._sightings.next()) is not None:
            sent_at = time.monotonic()
            future = self._client.call_async(GetTagReading.Request(tag_id=tag_id))  # raises if ROS refuses it
            self._sightings.asked(tag_id, sent_at)
            self._futures[tag_id] = future
            future.add_done_callback(lambda future, tag_id=tag_id: self._on_answer(tag_id, future))

    def _warn_of_two_servers(self) -> None:
        """Look once in a while: the second server may be found late."""
        if self._sightings.next() is not None and time.monotonic() >= self._next_look_for_servers:
            self._next_look_for_servers = time.monotonic() + LOOK_FOR_SERVERS_EVERY_SECONDS
            if warning := duplicate_server_warning(self, self._client.srv_name):
                self.get_logger().warning(warning)

    def _on_answer(self, tag_id: str, future) -> None:
        if self._futures.get(tag_id) is not future:  # given up meanwhile, in a multi-threaded executor
            return
        del self._futures[tag_id]
        self._sightings.answered(tag_id, time.monotonic())
        response = future.result()
        if response.status == GetTagReading.Response.STATUS_UNKNOWN_TAG:
            if tag_id not in self._unknown_ids and len(self._unknown_ids) < MOST_UNKNOWN_IDS_LOGGED:
                self._unknown_ids.add(tag_id)
                self.get_logger().warning(escaped(response.error_message, 300))
        elif fault := _fault_of(response, tag_id):
            self.get_logger().warning(f"tag '{escaped(tag_id, 64)}': {fault}", **NOW_AND_THEN)
        else:
            self._readings.publish(response.reading)


def _fault_of(response: GetTagReading.Response, tag_id: str) -> str:
    """Return why the reading in a response to a request for a tag is not published; '' if it is."""
    if response.status != GetTagReading.Response.STATUS_OK:
        status = STATUS_NAMES.get(response.status, response.status)
        return f'{status}: {escaped(response.error_message, 300)}'
    fault = fault_of_reading(response.reading)
    if not fault and response.reading.tag_id != tag_id:
        fault = f"it is of tag '{escaped(response.reading.tag_id, 64)}'"
    return fault and f'the reading is not published: {fault}'


def main(args=None) -> int:
    """Publish until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, ReadOnSightNode, args)
