"""The positions of tags in the map: from perception, from the layout, or from the robot's own position."""

import math

from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped
from lupin_greenhouse_bridge.contract import latched
from lupin_msgs.msg import DiscoveredTags
from rclpy.node import Node
from rclpy.qos import QoSProfile


class TagPositions:
    """
    Subscribes to `perception/discovered_tags` and to the pose of the robot.

    `in_layout` has the positions that perception may not know: x and y in the map by tag id.
    """

    def __init__(self, node: Node, frame_id: str, amcl_pose_topic: str = 'amcl_pose'):
        """Subscribe, but not to an empty topic; messages in another frame are ignored."""
        self._frame_id = frame_id
        self.in_layout: dict[str, tuple[float, float]] = {}
        self._discovered: dict[str, Point] = {}
        self.robot_pose: PoseStamped | None = None
        node.create_subscription(DiscoveredTags, 'perception/discovered_tags', self._on_tags, latched())
        # AMCL latches its pose, other localisers do not. Either subscription alone would miss something.
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
        if message.header.frame_id == self._frame_id:
            self._discovered = discovered_positions(message)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        if message.header.frame_id == self._frame_id and is_finite(message.pose.pose.position):
            self.robot_pose = PoseStamped(header=message.header, pose=message.pose.pose)


def discovered_positions(message: DiscoveredTags) -> dict[str, Point]:
    """Return the position of each tag, by tag id, if it is finite, and set: w is 0 in an unset pose."""
    return {
        tag.tag_id: tag.pose_in_map.position
        for tag in message.tags
        if tag.pose_in_map.orientation.w != 0.0 and is_finite(tag.pose_in_map.position)
    }


def is_finite(position: Point) -> bool:
    """Return whether all coordinates are numbers; a localiser without a pose publishes NaN."""
    return all(map(math.isfinite, (position.x, position.y, position.z)))
