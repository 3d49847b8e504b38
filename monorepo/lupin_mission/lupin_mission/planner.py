"""Plan the drives in a separate thread, so that a large greenhouse does not block any callback."""

import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import StartUpError, escaped, pluralized
from lupin_planning.occupancy import OccupancyMap
from lupin_planning.poses import pose_in_plane
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node

from lupin_mission.plan import Place, Plan
from lupin_mission.settings import Settings
from lupin_mission.tags import Tags

DISCOVERY_SECONDS = 2.0  # The node may find a publisher of the map that late.
LONGEST_MAP_SECONDS = 5.0
LOOK_EVERY_SECONDS = 0.05


class Drives(NamedTuple):
    """A plan, the tags in the order of visits, and the new warnings."""

    plan: Plan
    tag_ids: list[str]
    warnings: list[str]


class Planner:
    """Makes one plan at a time. The futures can raise StartUpError."""

    def __init__(self, node: Node, settings: Settings, tags: Tags):
        """Subscribe to the map, unless map_topic is empty."""
        self._node, self._settings, self._tags = node, settings, tags
        self._topic = node.resolve_topic_name(settings.map_topic) if settings.map_topic else ''
        self._newest_map: OccupancyGrid | None = None
        self._need_not_wait = threading.Event()  # a map has arrived, or the node ends
        self._discovery_end = time.monotonic() + DISCOVERY_SECONDS
        if self._topic:
            node.create_subscription(OccupancyGrid, self._topic, self._on_map, latched())
        self._thread = ThreadPoolExecutor(1)
        # Only the thread uses these three.
        self._plan: Plan | None = None
        self._planned_map: OccupancyGrid | None = None
        self._logged_plan: Plan | None = None

    def plan(self, tag_ids: list[str]) -> 'Future[Drives]':
        """Plan the drives anew, and without a map."""
        return self._thread.submit(self._drives, tag_ids, is_new=True)

    def plan_mission(self, tag_ids: list[str], robot_m: Place | None) -> 'Future[Drives]':
        """Plan a mission from the robot to these tags, with the newest map; wait for the first map."""
        return self._thread.submit(self._mission, tag_ids, robot_m)

    def close(self) -> None:
        """End the thread after its current work, without waiting for it."""
        self._need_not_wait.set()
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _on_map(self, message: OccupancyGrid) -> None:
        self._newest_map = message
        self._need_not_wait.set()

    def _await_map(self) -> None:
        """Wait for the first map, until a timeout; stop early if its topic has no publisher."""
        deadline = time.monotonic() + LONGEST_MAP_SECONDS
        while not self._need_not_wait.wait(LOOK_EVERY_SECONDS) and time.monotonic() < deadline:
            if time.monotonic() >= self._discovery_end and not self._node.count_publishers(self._topic):
                return

    def _usable_map(self) -> tuple[OccupancyGrid | None, list[str]]:
        """Return the newest map in the right frame, and a warning if there is a map that cannot be used."""
        if not self._topic:
            return None, []
        self._await_map()
        message, frame_id = self._newest_map, self._settings.frame_id
        without = f'the approach poses are planned around the tables of the layout alone: {self._topic}'
        if message and message.header.frame_id == frame_id:
            info = message.info
            self._node.get_logger().info(
                f'the approach poses are planned with the map of {self._topic}: {info.width} x {info.height}'
                f' cells of {info.resolution:g} m'
            )
            return message, []
        if message:
            return None, [f"{without} has a map in the frame '{escaped(message.header.frame_id, 64)}'"]
        if self._node.count_publishers(self._topic):
            late = f'sent no map within {LONGEST_MAP_SECONDS:g} s: activate its publisher, or set map_topic'
            return None, [f'{without} {late}']
        self._node.get_logger().info(
            f'no map is published on {self._topic}, and none is needed: the approach poses are planned around'
            ' the tables of the layout'
        )
        return None, []

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
            warnings = plan.warnings
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

    def _mission(self, tag_ids: list[str], robot_m: Place | None) -> Drives:
        """Return the drives in the order of the settings."""
        message, warnings = self._usable_map()
        self._node.get_logger().info(f'planning the drives to {pluralized(len(tag_ids), "tag")}')
        drives = self._drives(tag_ids, message, robot_m)
        drives.warnings.extend(warnings)
        if drives.plan is not self._logged_plan:
            self._logged_plan = drives.plan
            for tag_id in drives.plan.room_warnings.keys() & set(tag_ids):
                self._node.get_logger().info(drives.plan.room_warnings[tag_id])
        if self._settings.order != 'shortest':
            return drives
        dock = self._settings.dock
        try:
            order = drives.plan.shortest(tag_ids, robot_m, (dock[0], dock[1]) if dock else None)
        except StartUpError as error:
            return drives._replace(warnings=[*drives.warnings, f'the order is not the shortest: {error}'])
        return drives._replace(tag_ids=order)
