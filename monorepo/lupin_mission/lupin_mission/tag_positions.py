"""The positions of tags in the map: from perception, from the layout, or from the robot's own position."""

import math

from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import escaped
from lupin_msgs.msg import DiscoveredTags
from lupin_planning.poses import pose_in_plane
from rclpy.node import Node
from rclpy.qos import QoSProfile


class TagPositions:
    """
    Subscribes to `perception/discovered_tags` and to the pose of the robot.

    `in_layout` has x and y in the map by tag id, for tags that perception has not discovered.
    """

    def __init__(self, node: Node, frame_id: str, amcl_pose_topic: str = 'amcl_pose'):
        """Subscribe, but not to an empty topic; a message in another frame is ignored, with one warning."""
        self._node, self._frame_id = node, frame_id
        self._warned: set[tuple[str, str]] = set()  # topics and frames
        self.in_layout: dict[str, tuple[float, float]] = {}
        self._amcl_pose_topic = amcl_pose_topic
        self._discovered: dict[str, Point] = {}
        self.robot_pose: PoseStamped | None = None
        node.create_subscription(DiscoveredTags, 'perception/discovered_tags', self._on_tags, latched())
        # AMCL latches its pose, and other localisers do not. One subscription alone would miss some poses.
        for qos in (latched(), QoSProfile(depth=1)) if amcl_pose_topic else ():
            node.create_subscription(PoseWithCovarianceStamped, amcl_pose_topic, self._on_pose, qos)

    @property
    def robot_position(self) -> Point | None:
        """The last position of the robot; None if it is unknown."""
        return self.robot_pose and self.robot_pose.pose.position

    def position_of(self, tag_id: str) -> Point | None:
        """Return the position of a tag, or else of the robot at this tag; None if neither is known."""
        if tag_id in self._discovered or tag_id not in self.in_layout:
            return self._discovered.get(tag_id, self.robot_position)
        x, y = self.in_layout[tag_id]
        return Point(x=x, y=y)

    def _on_tags(self, message: DiscoveredTags) -> None:
        if self._is_in_frame('perception/discovered_tags', message.header.frame_id):
            self._discovered = discovered_positions(message)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        pose = message.pose.pose
        is_pose = is_finite(pose.position) and math.isfinite(pose_in_plane(pose).yaw)
        if self._is_in_frame(self._amcl_pose_topic, message.header.frame_id) and is_pose:
            self.robot_pose = PoseStamped(header=message.header, pose=pose)

    def _is_in_frame(self, topic: str, frame_id: str) -> bool:
        if frame_id != self._frame_id and (topic, frame_id) not in self._warned:
            self._warned.add((topic, frame_id))
            wrong = f"{topic} is in the frame '{escaped(frame_id, 64)}' and is ignored"
            self._node.get_logger().warning(f"{wrong}: must be in '{self._frame_id}'")
        return frame_id == self._frame_id


def discovered_positions(message: DiscoveredTags) -> dict[str, Point]:
    """Return the finite positions by tag id. An unset pose has w = 0, and is left out."""
    return {
        tag.tag_id: tag.pose_in_map.position
        for tag in message.tags
        if tag.pose_in_map.orientation.w != 0.0 and is_finite(tag.pose_in_map.position)
    }


def is_finite(position: Point) -> bool:
    """Return whether all coordinates are numbers; a localiser without a pose publishes NaN."""
    return all(map(math.isfinite, (position.x, position.y, position.z)))
