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
        return self._thread.submit(self._drives, tag_ids, is_new=True)

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

    def _drives(
        self,
        tag_ids: list[str],
        message: OccupancyGrid | None = None,
        robot_m: Place | None = None,
        *,
        is_new: bool = False,
    ) -> Drives:
        """Return the drives in the given order; plan again for another map, or a robot in another region."""
        plan, is_planned = self._plan, not is_new and message is self._planned_map
        if not (plan and is_planned):
            plan = self._new_plan(message)
        if not plan.is_for(robot_m):
            plan = self._new_plan(message, robot_m)
        warnings: list[str] = []
        if plan is not self._plan:
            of_rooms = plan.room_warnings
            warnings = [*plan.warnings, *(of_rooms[each] for each in tag_ids if each in of_rooms)]
        self._plan, self._planned_map = plan, message
        return Drives(plan, tag_ids, warnings)

    def _new_plan(self, message: OccupancyGrid | None, robot_m: Place | None = None) -> Plan:
        occupancy = message and OccupancyMap(
            message.info.width,
            message.info.height,
            message.info.resolution,
            pose_in_plane(message.info.origin),
            message.data,
        )
        return Plan(self._tags.layout(), self._settings, self._tags.layout_in_map, occupancy, robot_m)

    def _mission(self, tag_ids: list[str], message: OccupancyGrid | None, robot_m: Place | None) -> Drives:
        """Return the drives in the order of the settings."""
        drives = self._drives(tag_ids, message, robot_m)
        if self._settings.order != 'shortest':
            return drives
        dock = self._settings.dock
        try:
            order = drives.plan.shortest(tag_ids, robot_m, (dock[0], dock[1]) if dock else None)
        except StartUpError as error:
            return drives._replace(warnings=[*drives.warnings, f'the order is not the shortest: {error}'])
        return drives._replace(tag_ids=order)
