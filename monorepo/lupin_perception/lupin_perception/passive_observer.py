"""
ROS 2 node `passive_observer`: turns the readings of read_on_sight into observations.

It is silent while a mission runs, which publishes observations of its own.
"""

import sys

from geometry_msgs.msg import Point, Pose, Quaternion
from lupin_greenhouse_bridge.node.parameters import warn_of_unknown_parameters
from lupin_greenhouse_bridge.node.run import run
from lupin_msgs.msg import MissionState, Observation, TagReading
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from lupin_perception.map_places import MapPlaces

NODE_NAME = 'passive_observer'
SOURCE = 'PassiveObserver'
MAP_FRAME = 'map'
BUSY_STATES = ('PREPARE', 'EXPLORING', 'INSPECTING', 'MONITORING', 'RETURNING')
LATCHED = DurabilityPolicy.TRANSIENT_LOCAL


def pose_at(place: Point | None) -> Pose:
    """Return the pose at a place, without a direction; w = 0 marks it as unset."""
    return Pose(position=place or Point(), orientation=Quaternion(w=float(place is not None)))


class PassiveObserver(Node):
    """Publishes an observation of each reading, with the place of the tag or of the robot."""

    def __init__(self):
        super().__init__(NODE_NAME)
        warn_of_unknown_parameters(self)
        self._lifecycle_state = ''
        self._places = MapPlaces(self, frame_id=MAP_FRAME)
        latched = QoSProfile(depth=1, durability=LATCHED)
        self._states = self.create_subscription(MissionState, 'mission/state', self._on_state, latched)
        # Not latched: the robot has left the place of an old reading.
        readings = self.create_subscription(
            TagReading, 'read_on_sight/readings', self._on_reading, QoSProfile(depth=50)
        )
        self._observations = self.create_publisher(
            Observation, 'floranova/observations', QoSProfile(depth=50, durability=LATCHED)
        )
        self.get_logger().info(
            f'ready: readings from {readings.topic_name}, observations on {self._observations.topic_name}'
        )

    def _on_state(self, message) -> None:
        self._lifecycle_state = message.lifecycle_state

    def _on_reading(self, reading) -> None:
        if self._lifecycle_state in BUSY_STATES and self._has_mission():
            return
        observation = Observation(
            source=SOURCE,
            kind=Observation.KIND_TAG_READING,
            status=Observation.STATUS_OK,
            tag_reading=reading,
        )
        observation.header.stamp = self.get_clock().now().to_msg()
        observation.header.frame_id = MAP_FRAME
        observation.tag_pose_in_map = pose_at(self._places.at(reading.tag_id))
        observation.flower.pose.pose = observation.anomaly.pose.pose = pose_at(None)
        self._observations.publish(observation)

    def _has_mission(self) -> bool:
        """Return whether the node lives that published the state: a mission that crashed says no more."""
        return self.count_publishers(self._states.topic_name) > 0


def main(args=None) -> int:
    """Publish until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, PassiveObserver, args)


if __name__ == '__main__':
    sys.exit(main())
