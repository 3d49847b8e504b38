"""
ROS 2 node `passive_observer`: turns the readings of read_on_sight into observations.

It publishes nothing during a mission, because the mission publishes its own observations.

    ros2 run lupin_mission passive_observer --ros-args -p layout_in_map:=layout_in_map.yaml
"""

from dataclasses import dataclass

from lupin_greenhouse_bridge.contract import fault_of_reading, latched
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.runtime.parameters import (
    check_parameters,
    declare_parameters,
    invalid,
    parameter,
)
from lupin_greenhouse_bridge.runtime.run import run
from lupin_greenhouse_bridge.simulator.layout import require_layout
from lupin_msgs.msg import MissionState, Observation, TagReading
from lupin_planning.registration import read_transform
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from lupin_mission.messages import OBSERVATIONS_TOPIC, pose_at
from lupin_mission.tag_positions import TagPositions

NODE_NAME = 'passive_observer'
SOURCE = 'PassiveObserver'
BUSY_STATES = ('PREPARE', 'EXPLORING', 'INSPECTING', 'MONITORING', 'RETURNING')
# Arguments of the team's observer, which calls the bridge itself. Here, read_on_sight calls it.
WITHOUT_EFFECT = (
    'bridge_service_name',
    'discovered_tags_topic',
    'mission_state_topic',
    'refresh_period_s',
    'source_name',
    'tick_period_s',
    'twin_state_topic',
)


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    layout_in_map: str = parameter(
        '', 'The file of register_layout: where the layout lies in the map; empty: no poses from the layout.'
    )
    tag_file: str = parameter(
        '', "The bridge's tag_locations.json for layout_in_map; empty: the one of mdp-greenhouse."
    )
    observations_topic: str = parameter(OBSERVATIONS_TOPIC, 'The topic of the observations.')
    map_frame: str = parameter('map', 'The frame of the poses, and of the headers of all messages.')

    def __post_init__(self) -> None:
        check_parameters(self)
        if not self.observations_topic:
            raise invalid('observations_topic', '', 'the name of a topic')
        if self.tag_file and not self.layout_in_map:
            raise StartUpError('parameter tag_file has no effect without layout_in_map: set both')

    def positions_in_layout(self) -> dict[str, tuple[float, float]]:
        """Return x and y in the map by tag id; {} without a layout. Raises StartUpError."""
        if not self.layout_in_map:
            return {}
        transform = read_transform(self.layout_in_map, self.map_frame)
        layout = require_layout(self.tag_file, 'tag_file')
        return {tag_id: transform.point(tag.x, tag.y) for tag_id, tag in layout.tags.items()}


class PassiveObserver(Node):
    """Publishes an observation of each reading, with the position of the tag or of the robot."""

    def __init__(self) -> None:
        """Read the layout and subscribe; raises StartUpError."""
        super().__init__(NODE_NAME)
        settings = declare_parameters(self, Settings, without_effect=WITHOUT_EFFECT)
        self._lifecycle_state = ''
        self._frame_id = settings.map_frame
        self._positions = TagPositions(self, self._frame_id)
        self._positions.in_layout = settings.positions_in_layout()
        self._states = self.create_subscription(MissionState, 'mission/state', self._on_state, latched())
        # Not latched: the robot has left the position of an old reading.
        readings = self.create_subscription(
            TagReading, 'read_on_sight/readings', self._on_reading, QoSProfile(depth=50)
        )
        self._observations = self.create_publisher(Observation, settings.observations_topic, latched(50))
        self.get_logger().info(
            f'ready: readings from {readings.topic_name}, observations on {self._observations.topic_name}'
        )

    def _on_state(self, message: MissionState) -> None:
        self._lifecycle_state = message.lifecycle_state

    def _on_reading(self, reading: TagReading) -> None:
        has_mission = self.count_publishers(self._states.topic_name) > 0  # A crashed mission has none.
        if has_mission and self._lifecycle_state in BUSY_STATES:
            return
        if fault := fault_of_reading(reading):
            tag = escaped(reading.tag_id, 64)
            self.get_logger().warning(f"reading of tag '{tag}' ignored: {fault}", throttle_duration_sec=1.0)
            return
        observation = Observation(
            header=Header(stamp=self.get_clock().now().to_msg(), frame_id=self._frame_id),
            source=SOURCE,
            kind=Observation.KIND_TAG_READING,
            status=Observation.STATUS_OK,
            tag_reading=reading,
            tag_pose_in_map=pose_at(self._positions.position_of(reading.tag_id)),
        )
        observation.flower.pose.pose = observation.anomaly.pose.pose = pose_at(None)
        self._observations.publish(observation)


def main(args: list[str] | None = None) -> int:
    """Publish until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, PassiveObserver, args)
