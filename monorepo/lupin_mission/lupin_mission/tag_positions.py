"""The positions of tags in the map: from the layout, from perception, or from the robot's own position."""

import math

from geometry_msgs.msg import Point, PoseWithCovarianceStamped
from lupin_greenhouse_bridge.contract import latched
from lupin_msgs.msg import DiscoveredTags
from rclpy.qos import QoSProfile


class TagPositions:
    """Subscribes to `perception/discovered_tags` and to the pose of the robot."""

    def __init__(
        self, node, *, frame_id: str = 'map', amcl_pose_topic: str = 'amcl_pose', layout_positions=None
    ):
        """Subscribe; messages in another frame are ignored. The positions of the layout take precedence."""
        self._frame_id = frame_id
        self._layout_positions: dict[str, Point] = layout_positions or {}  # by tag id
        self._discovered_positions: dict[str, Point] = {}  # by tag id
        self.robot_position: Point | None = None  # until it is known
        node.create_subscription(
            DiscoveredTags,
            'perception/discovered_tags',
            self._on_tags,
            latched(),
        )
        # AMCL latches its pose, other localisers do not. Either subscription alone would miss something.
        for qos in (latched(), QoSProfile(depth=1)):
            node.create_subscription(PoseWithCovarianceStamped, amcl_pose_topic, self._on_pose, qos)

    def position_of(self, tag_id: str) -> Point | None:
        """Return the position of a tag, or else of the robot at this tag; None if neither is known."""
        known = self._discovered_positions | self._layout_positions
        return known.get(tag_id, self.robot_position)

    def _on_tags(self, message) -> None:
        if message.header.frame_id == self._frame_id:
            self._discovered_positions = {
                tag.tag_id: tag.pose_in_map.position
                for tag in message.tags
                if tag.pose_in_map.orientation.w != 0.0  # 0: never populated
                and is_finite(tag.pose_in_map.position)
            }

    def _on_pose(self, message) -> None:
        if message.header.frame_id == self._frame_id and is_finite(message.pose.pose.position):
            self.robot_position = message.pose.pose.position


def is_finite(position: Point) -> bool:
    """Return whether all coordinates are numbers; a localiser without a pose publishes NaN."""
    return all(map(math.isfinite, (position.x, position.y, position.z)))
