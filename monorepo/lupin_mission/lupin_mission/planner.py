"""Plan the drives in a separate thread, so that a large greenhouse does not block any callback."""

import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError
from nav_msgs.msg import OccupancyGrid
from rclpy.task import Future

from lupin_mission.drive import Goal
from lupin_mission.plan import Plan
from lupin_mission.room_map import RoomMap, occupancy_of
from lupin_mission.settings import Settings
from lupin_mission.tags import Tags


class Drives(NamedTuple):
    """A plan: the goals by tag id, the reason why a tag has none, and the tags in the order of visits."""

    goals: dict[str, list[Goal]]
    unreachable: dict[str, str]
    tag_ids: list[str]
    warnings: list[str]  # of poses that no drives before these had


class Planner:
    """Handles one request for a plan after the other. Call poll() often, which completes the futures."""

    def __init__(self, node, settings: Settings, tags: Tags):
        """Subscribe to the map, and start the thread."""
        self._settings, self._tags = settings, tags
        self._room_map = RoomMap(node, settings.map_topic, settings.frame_id)
        self._plan: Plan | None = None  # it and the map belong to the thread
        self._map: OccupancyGrid | None = None  # of that plan
        self._work: SimpleQueue = SimpleQueue()
        self._done: SimpleQueue = SimpleQueue()
        threading.Thread(target=self._run, daemon=True).start()  # a signal ends the mission while it plans

    def plan(self, tag_ids: list[str]) -> Future:
        """Plan the drives without a map. The result of the future is Drives; it can raise StartUpError."""
        return self._expect(lambda: self._drives(tag_ids, None, is_new=True))

    def plan_mission(self, tag_ids: list[str], robot_m: tuple[float, float] | None) -> Future:
        """Plan a mission from the robot to these tags, with the current map; otherwise like plan()."""
        message = self._room_map.take()

        def drives() -> Drives:
            found = self._drives(tag_ids, message, is_new=message is not self._map)
            return found if self._settings.order != 'shortest' else self._in_order(found, robot_m)

        return self._expect(drives)

    def poll(self) -> None:
        """Complete the futures of the finished plans."""
        while not self._done.empty():
            future, drives, error = self._done.get()
            if error:
                future.set_exception(error)
            else:
                future.set_result(drives)

    def close(self) -> None:
        """End the thread after its current work."""
        self._work.put(None)

    def _expect(self, work: Callable[[], Drives]) -> Future:
        future = Future()
        self._work.put((future, work))
        return future

    def _run(self) -> None:
        while item := self._work.get():
            future, work = item
            try:
                self._done.put((future, work(), None))
            except Exception as error:
                self._done.put((future, None, error))

    def _drives(self, tag_ids: list[str], message: OccupancyGrid | None, *, is_new: bool) -> Drives:
        warnings = []
        if is_new or self._plan is None:
            occupancy = None if message is None else occupancy_of(message)
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
