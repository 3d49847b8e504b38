"""Publish the mission's observations and state, write its log, and show a progress line at a terminal."""

import sys
import time

from geometry_msgs.msg import Point
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.output import ProgressLine
from lupin_greenhouse_bridge.units import sensor_order, value_text
from lupin_msgs.msg import MissionState, TagReading
from lupin_msgs.msg import Observation as ObservationMessage
from lupin_readings.report_line import Observation
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Header, String

from lupin_mission.messages import OBSERVATIONS_TOPIC, Run, observation_message, state_message
from lupin_mission.mission import Mission, Severity

LONGEST_WAIT_FOR_SUBSCRIBERS_SECONDS = 5.0
ACKNOWLEDGED_WITHIN_SECONDS = 0.2


class Announcer:
    """Publishes and logs for a mission node."""

    def __init__(self, node: Node, frame_id: str = 'map', remark: str = ''):
        """Create the publishers; `remark` is appended to each status_detail, and to the last event."""
        self._node = node
        self._remark = remark
        self._frame_id = frame_id
        self._at_tag = node.create_publisher(String, 'mission/at_tag', latched())
        self._observations = node.create_publisher(ObservationMessage, OBSERVATIONS_TOPIC, latched(50))
        self._readings = node.create_publisher(TagReading, 'mission/readings', latched(50))
        self._states = node.create_publisher(MissionState, 'mission/state', latched())
        self._tag_at_hand: str | None = None
        self._progress = ProgressLine(sys.stdout)
        self._event, self._severity = 'the node has started', Severity.INFO
        self._obstacle = ''  # what stops or delays the mission now
        self._failure = ''  # why the last failed tag was not read

    def note(self, event: str, severity: Severity, code: str = '') -> None:
        """Put an event into the state, and log it unless it is routine, with the severity INFO."""
        self._event, self._severity = escaped(event, 1000), severity
        self._obstacle = '' if severity is Severity.INFO else code or self._event
        if severity is Severity.INFO:
            return
        self._progress.clear()
        # rclpy allows only one severity for each line that logs.
        if severity is Severity.WARN:
            self._node.get_logger().warning(self._event)
        else:
            self._node.get_logger().error(self._event)

    def _inform(self, event: str) -> None:
        """Put a routine event into the state, and log it."""
        self.note(event, Severity.INFO)
        self._progress.clear()
        self._node.get_logger().info(self._event)

    def begin_anew(self, event: str) -> None:
        """Log the start of a mission or a reset, and clear the error of the previous mission."""
        self._failure = ''
        self._inform(event)

    def closed(self, observation: Observation, mission_id: str, position: Point | None) -> None:
        """Publish the observation of a tag, and its reading if it was read, and log its outcome."""
        message = observation_message(observation, mission_id, position)
        message.status_detail = self._with_remark(message.status_detail)
        self._stamp(message.header)
        self._observations.publish(message)
        tag = f"tag '{escaped(observation.tag_id, 64)}'"
        if observation.reading:
            self._readings.publish(message.tag_reading)
            values = observation.reading.values
            sensors = sorted(values, key=sensor_order)
            shown = ', '.join(f'{escaped(name, 40)} {value_text(name, values[name])}' for name in sensors)
            pose = f' (pose {observation.pose})' if observation.pose > 1 else ''
            self._inform(f'{tag}{pose}: {shown}')
        elif message.status == ObservationMessage.STATUS_SKIPPED:  # the final table lists every skipped tag
            self.note(f'{tag}: {observation.outcome.value}: {observation.detail}', Severity.INFO)
        else:
            reason = f'{observation.outcome.value}: {escaped(observation.detail, 500)}'
            is_scanned = message.status != ObservationMessage.STATUS_UNREACHABLE
            scan = f'scan failed after {observation.attempts} requests: ' if is_scanned else ''
            self.note(f'{tag}: {scan}{reason}', Severity.WARN)
            self._failure = self._event

    def moved(self, mission: Mission) -> None:
        """Show the progress, and publish the tag that the robot stands at if it has changed."""
        tag_id = mission.tag_at_hand or ''
        if tag_id != self._tag_at_hand:
            self._tag_at_hand = tag_id
            self._at_tag.publish(String(data=tag_id))
        if mission.target:
            closed, total = len(mission.outcomes), len(mission.tag_ids)
            self._progress.show(f'{closed}/{total}  tag {escaped(mission.target, 40)}  {mission.phase}')
        else:
            self._progress.clear()

    def publish_state(self, run: Run | None, lifecycle: str, *, is_estop_engaged: bool = False) -> None:
        """Publish the state of a mission, or of a node without one."""
        message = state_message(run, lifecycle)
        self._stamp(message.header)
        message.estop_engaged = is_estop_engaged
        estop, fault = 'estop_engaged' if is_estop_engaged else '', run.fault if run else ''
        message.last_error = fault or estop or self._obstacle or self._failure
        message.last_event = self._with_remark(self._event)
        message.last_event_severity = self._severity.value
        self._states.publish(message)

    def is_heard(self) -> bool:
        """Return whether somebody subscribes to the readings."""
        return bool(self._readings.get_subscription_count() > 0)

    def has_other_mission(self) -> bool:
        """Return whether another node publishes mission/state, too."""
        return self._node.count_publishers(self._states.topic_name) > 1

    def _with_remark(self, text: str) -> str:
        remark = f' ({self._remark})' if text and self._remark else self._remark
        return f'{text}{remark}'

    def _stamp(self, header: Header) -> None:
        header.stamp = self._node.get_clock().now().to_msg()
        header.frame_id = self._frame_id

    def wait_for_subscribers(self) -> None:
        """Wait until the current subscribers have received everything, with a timeout."""
        self._progress.clear()
        deadline = time.monotonic() + LONGEST_WAIT_FOR_SUBSCRIBERS_SECONDS
        for publisher in (self._observations, self._readings, self._states):
            while not publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGED_WITHIN_SECONDS)):
                if process.is_asked_to_end() or time.monotonic() >= deadline:
                    return
