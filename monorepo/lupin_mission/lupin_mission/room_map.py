"""The robot's map, from a latched topic, for the approach poses."""

from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.planning.occupancy import OccupancyMap
from lupin_greenhouse_bridge.runtime.poses import pose_in_plane
from nav_msgs.msg import OccupancyGrid


class RoomMap:
    """Keeps the last message of the topic."""

    def __init__(self, node, topic: str, frame_id: str):
        """Subscribe; a map in another frame is ignored."""
        self._frame_id = frame_id
        self._logger = node.get_logger()
        self._message: OccupancyGrid | None = None
        self._subscription = node.create_subscription(OccupancyGrid, topic, self._on_map, latched())

    def _on_map(self, message: OccupancyGrid) -> None:
        self._message = message

    def take(self) -> OccupancyGrid | None:
        """Return the message to plan the poses with, if there is one, and log it."""
        topic, message = self._subscription.topic_name, self._message
        if message is None or message.header.frame_id != self._frame_id:
            reason = 'no message' if message is None else f"a map in the frame '{message.header.frame_id}'"
            self._logger.info(f'the approach poses are planned without a map: {topic} has {reason}')
            return None
        info = message.info
        self._logger.info(
            f'the approach poses are planned with the map of {topic}: {info.width} x {info.height} cells of'
            f' {info.resolution:g} m'
        )
        return message


def occupancy_of(message: OccupancyGrid) -> OccupancyMap:
    """Return the cells of a message; raises StartUpError if it is malformed."""
    info = message.info
    return OccupancyMap(info.width, info.height, info.resolution, pose_in_plane(info.origin), message.data)
