"""Plan the drives in a separate thread, so that a large greenhouse does not block any callback."""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.occupancy import OccupancyMap
from lupin_greenhouse_bridge.runtime.poses import pose_in_plane
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node

from lupin_mission.plan import Place, Plan
from lupin_mission.settings import Settings
from lupin_mission.tags import Tags


class Drives(NamedTuple):
    """A plan, the tags in the order of visits, and the warnings that no drives before these had."""

    plan: Plan
    tag_ids: list[str]
    warnings: list[str]


class Planner:
    """Handles one request for a plan after the other. The futures can raise StartUpError."""

    def __init__(self, node: Node, settings: Settings, tags: Tags):
        """Subscribe to the map."""
        self._settings, self._tags = settings, tags
        self._logger = node.get_logger()
        self._newest_map: OccupancyGrid | None = None
        self._maps = node.create_subscription(OccupancyGrid, settings.map_topic, self._on_map, latched())
        self._thread = ThreadPoolExecutor(1)
        # Only the thread uses these two.
        self._plan: Plan | None = None
        self._planned_map: OccupancyGrid | None = None

    def plan(self, tag_ids: list[str]) -> 'Future[Drives]':
        """Plan the drives anew, and without a map."""
        return self._thread.submit(self._drives, tag_ids, None, is_new=True)

    def plan_mission(self, tag_ids: list[str], robot_m: Place | None) -> 'Future[Drives]':
        """Plan a mission from the robot to these tags, with the newest map."""
        return self._thread.submit(self._mission, tag_ids, self._usable_map(), robot_m)

    def close(self) -> None:
        """End the thread after its current work, without waiting for it."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _on_map(self, message: OccupancyGrid) -> None:
        self._newest_map = message

    def _usable_map(self) -> OccupancyGrid | None:
        """Return the newest map, if it is in the right frame, and log which one it is."""
        topic, message = self._maps.topic_name, self._newest_map
        if message is None or message.header.frame_id != self._settings.frame_id:
            found = 'no map' if message is None else f"a map in the frame '{message.header.frame_id}'"
            self._logger.info(
                f'the approach poses are planned around the tables of the layout alone: {topic} has {found}'
            )
            return None
        info = message.info
        self._logger.info(
            f'the approach poses are planned with the map of {topic}: {info.width} x {info.height} cells of'
            f' {info.resolution:g} m'
        )
        return message

    def _drives(self, tag_ids: list[str], message: OccupancyGrid | None, *, is_new: bool = False) -> Drives:
        """Return the drives in the given order, by the plan there is if it is of the same map."""
        warnings: list[str] = []
        if is_new or self._plan is None or message is not self._planned_map:
            occupancy = message and OccupancyMap(
                message.info.width,
                message.info.height,
                message.info.resolution,
                pose_in_plane(message.info.origin),
                message.data,
            )
            self._plan = Plan(self._tags.layout(), self._settings, self._tags.layout_in_map, occupancy)
            self._planned_map = message
            of_rooms = self._plan.room_warnings
            warnings = [*self._plan.warnings, *(of_rooms[each] for each in tag_ids if each in of_rooms)]
        return Drives(self._plan, tag_ids, warnings)

    def _mission(self, tag_ids: list[str], message: OccupancyGrid | None, robot_m: Place | None) -> Drives:
        """Return the drives in the order of the settings."""
        drives = self._drives(tag_ids, message)
        if self._settings.order != 'shortest':
            return drives
        dock = self._settings.dock
        try:
            order = drives.plan.shortest(tag_ids, robot_m, (dock[0], dock[1]) if dock else None)
        except StartUpError as error:
            return drives._replace(warnings=[*drives.warnings, f'the order is not the shortest: {error}'])
        return drives._replace(tag_ids=order)
