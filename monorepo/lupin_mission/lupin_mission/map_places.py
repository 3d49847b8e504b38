"""The places of tags in the map: by the layout, as discovered by perception, or where the robot stands."""

from geometry_msgs.msg import Point, PoseWithCovarianceStamped
from lupin_msgs.msg import DiscoveredTags
from rclpy.qos import DurabilityPolicy, QoSProfile

VOLATILE, LATCHED = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL


class MapPlaces:
    """Listens to `perception/discovered_tags` and to the pose of the robot."""

    def __init__(
        self, node, *, frame_id: str = 'map', amcl_pose_topic: str = 'amcl_pose', layout_places=None
    ):
        """Subscribe; messages of another frame are ignored. The layout's places in the map come first."""
        self._frame_id = frame_id
        self._layout_places: dict[str, Point] = layout_places or {}  # by tag id
        self._tag_places: dict[str, Point] = {}  # by tag id
        self._robot_place: Point | None = None
        node.create_subscription(
            DiscoveredTags,
            'perception/discovered_tags',
            self._on_tags,
            QoSProfile(depth=1, durability=LATCHED),
        )
        # AMCL latches its pose, other localisers do not. Either subscription alone would miss something.
        for durability in (LATCHED, VOLATILE):
            qos = QoSProfile(depth=1, durability=durability)
            node.create_subscription(PoseWithCovarianceStamped, amcl_pose_topic, self._on_pose, qos)

    def at(self, tag_id: str) -> Point | None:
        """Return the place of a tag, else of the robot that stands at it; None if neither is known."""
        return self._layout_places.get(tag_id) or self._tag_places.get(tag_id, self._robot_place)

    @property
    def robot(self) -> Point | None:
        """The place of the robot; None if it is unknown."""
        return self._robot_place

    def _on_tags(self, message) -> None:
        if message.header.frame_id == self._frame_id:
            self._tag_places = {
                tag.tag_id: tag.pose_in_map.position
                for tag in message.tags
                if tag.pose_in_map.orientation.w != 0.0  # 0: never populated
            }

    def _on_pose(self, message) -> None:
        if message.header.frame_id == self._frame_id:
            self._robot_place = message.pose.pose.position
