"""Plan the drives in a separate thread, so that a large greenhouse does not block any callback."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.occupancy import OccupancyMap
from lupin_greenhouse_bridge.runtime.poses import PoseInPlane, pose_in_plane
from nav_msgs.msg import OccupancyGrid
from rclpy.task import Future

from lupin_mission.plan import Plan
from lupin_mission.settings import Settings
from lupin_mission.tags import Tags


class Drives(NamedTuple):
    """A plan: the goals by tag id, the reason why a tag has none, and the tags in the order of visits."""

    goals: dict[str, list[PoseInPlane]]
    unreachable: dict[str, str]
    tag_ids: list[str]
    warnings: list[str]  # of poses that no drives before these had


class Planner:
    """Handles one request for a plan after the other. Call poll() often, which completes the futures."""

    def __init__(self, node, settings: Settings, tags: Tags):
        """Subscribe to the map."""
        self._settings, self._tags = settings, tags
        self._logger = node.get_logger()
        self._newest_map: OccupancyGrid | None = None
        self._maps = node.create_subscription(OccupancyGrid, settings.map_topic, self._on_map, latched())
        self._plan: Plan | None = None  # it and its map belong to the thread
        self._map: OccupancyGrid | None = None
        self._thread = ThreadPoolExecutor(1)
        self._expected: deque = deque()  # (what the thread works on, the future of its caller)

    def plan(self, tag_ids: list[str]) -> Future:
        """Plan the drives without a map. The result of the future is Drives; it can raise StartUpError."""
        return self._expect(lambda: self._drives(tag_ids, None, is_new=True))

    def plan_mission(self, tag_ids: list[str], robot_m: tuple[float, float] | None) -> Future:
        """Plan a mission from the robot to these tags, with the current map; otherwise like plan()."""
        message = self._usable_map()

        def drives() -> Drives:
            found = self._drives(tag_ids, message, is_new=message is not self._map)
            return found if self._settings.order != 'shortest' else self._in_order(found, robot_m)

        return self._expect(drives)

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

    def poll(self) -> None:
        """Complete the futures of the finished plans."""
        while self._expected and self._expected[0][0].done():
            work, future = self._expected.popleft()
            if error := work.exception():
                future.set_exception(error)
            else:
                future.set_result(work.result())

    def close(self) -> None:
        """End the thread after its current work, without waiting for it."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _expect(self, work: Callable[[], Drives]) -> Future:
        future = Future()
        self._expected.append((self._thread.submit(work), future))
        return future

    def _drives(self, tag_ids: list[str], message: OccupancyGrid | None, *, is_new: bool) -> Drives:
        warnings = []
        if is_new or self._plan is None:
            occupancy = message and OccupancyMap(
                message.info.width,
                message.info.height,
                message.info.resolution,
                pose_in_plane(message.info.origin),
                message.data,
            )
            plan = Plan(self._tags.layout(), self._settings, self._tags.layout_in_map, occupancy)
            self._plan, self._map = plan, message
            of_rooms = plan.room_warnings
            warnings = [*plan.warnings, *(of_rooms[each] for each in tag_ids if each in of_rooms)]
        return Drives(self._plan.goals, self._plan.unreachable, tag_ids, warnings)

    def _in_order(self, drives: Drives, robot_m: tuple[float, float] | None) -> Drives:
        dock = self._settings.dock
        try:
            order = self._plan.shortest(drives.tag_ids, robot_m, dock and tuple(dock[:2]))
        except StartUpError as error:
            warning = f'the order is not the shortest: {error}'
            return drives._replace(warnings=[*drives.warnings, warning])
        return drives._replace(tag_ids=order)
