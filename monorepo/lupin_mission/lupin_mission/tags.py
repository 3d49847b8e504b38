"""Find the tags of the greenhouse and their positions: from the settings, or from the bridge."""

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lupin_greenhouse_bridge.contract import (
    info_of,
    info_request,
    parameter_service_of,
)
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.runtime.rclpy_internals import steady_timer
from lupin_greenhouse_bridge.simulator.layout import Layout, read_layout, shipped_file
from lupin_planning.registration import Transform, read_transform
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.task import Future

from lupin_mission.settings import Settings
from lupin_mission.transport import create_client
from lupin_mission.world import read_world

ASK_EVERY_SECONDS = 0.1
MOST_PENDING_REQUESTS = 50  # A busy bridge replies late, and DDS drops some requests.
LONGEST_WITHOUT_PARAMETERS_SECONDS = 5.0


class Tags:
    """The ids of the tags, and their x and y in the map by tag id; both are empty until they are known."""

    def __init__(self, settings: Settings):
        """Read the files of the settings; raises StartUpError."""
        self.ids: list[str] = []
        self.positions_m: dict[str, tuple[float, float]] = {}
        self.layout_in_map = Transform()
        if settings.layout_in_map:
            self.layout_in_map = read_transform(settings.layout_in_map, settings.frame_id)
        self._settings = settings
        self._tag_file: str | Path | None = None
        self._world = read_world(settings.world_file) if settings.world_file else {}
        if self._world:
            self.ids = list(self._world)
        elif settings.tag_locations_file:
            self.ids = list(read_layout(settings.tag_locations_file).tags)
        self._is_settled = bool(self.ids)  # by a file, or by the bridge
        self._bridge_found_at: float | None = None
        self._service_found_at: float | None = None
        self._requests: deque[Any] = deque()

    def layout(self) -> Layout:
        """Return the layout, once the tags are known; raises StartUpError."""
        if not self._tag_file:
            raise StartUpError("the layout is unknown: set tag_locations_file to the bridge's tag_file")
        return read_layout(self._tag_file)

    def has_tags_to_visit(self) -> bool:
        """Return whether a mission can start: tag_sequence is set, or the tags are known."""
        return bool(self.ids or self._settings.chosen_tag_ids)

    def find(
        self,
        node: Node,
        has_service: Callable[[], bool],
        on_found: Callable[[], None],
        on_custom_file: Callable[[], None],
    ) -> None:
        """
        Call on_found() as soon as there are tags to visit: now, or when the bridge has replied.

        Call on_custom_file() if the bridge later replies that it has its own tag file. `has_service()`
        returns whether the bridge's service is available.
        """
        is_given = self.has_tags_to_visit()
        if is_given:
            self._find_positions(is_custom_file=False)
            on_found()
        if self._is_settled:
            return
        self._node, self._has_service = node, has_service
        self._on_found, self._on_custom_file = on_found, on_custom_file
        service = parameter_service_of(node.resolve_service_name(self._settings.bridge_service_name))
        self._client = create_client(node, GetParameters, service)
        self._deadline = time.monotonic() + self._settings.dependency_timeout_s
        if not is_given:
            node.get_logger().info(
                f'waiting for the list of tags of the bridge, from {self._client.srv_name}'
            )
        self._timer = steady_timer(node, ASK_EVERY_SECONDS, self._ask_the_bridge)

    def is_waiting_for_tags(self) -> bool:
        """Return whether the bridge was available, and may still reply that it has its own tag file."""
        if self._is_settled:
            return False
        if self._bridge_found_at is None and self._client.service_is_ready():
            self._bridge_found_at = time.monotonic()
        found_at = self._bridge_found_at
        return found_at is not None and time.monotonic() < found_at + self._settings.dependency_timeout_s

    def _ask_the_bridge(self) -> None:
        """Ask the bridge for its tags. Repeat the request, because DDS can drop an early one."""
        now, service = time.monotonic(), self._client.srv_name
        if now >= self._deadline and not (self.has_tags_to_visit() or self._settings.wait_for_start):
            raise StartUpError(
                f'{service} did not return the tags within {self._settings.dependency_timeout_s:g} s:'
                ' start the bridge, or set tag_sequence or tag_locations_file'
            )
        if self._client.service_is_ready():
            if len(self._requests) == MOST_PENDING_REQUESTS:
                self._client.remove_pending_request(self._requests.popleft())
            self._requests.append(self._client.call_async(info_request()))
            self._requests[-1].add_done_callback(self._on_reply)
        elif self._has_service():
            self._service_found_at = self._service_found_at or now
            if now >= self._service_found_at + LONGEST_WITHOUT_PARAMETERS_SECONDS:
                self._take_shipped(f'no node offers {service}', self._node.get_logger().warning)

    def _on_reply(self, future: 'Future[Any]') -> None:
        if self._is_settled:
            return
        info = info_of(future.result())
        if info.tag_ids:
            self._settle(info.tag_ids, is_custom_file=bool(info.tag_file))
        else:
            reason = f'the node of {self._settings.bridge_service_name} does not list its tags'
            self._take_shipped(reason, self._node.get_logger().info)

    def _take_shipped(self, reason: str, log: Callable[[str], Any]) -> None:
        """Take the tags that mdp-greenhouse ships, if it is installed."""
        if shipped := shipped_file('tag_locations.json'):
            log(f'{reason}: using those of {shipped}')
            self._settle(list(read_layout(shipped).tags), is_custom_file=False)

    def _settle(self, tag_ids: list[str], *, is_custom_file: bool) -> None:
        self._timer.cancel()
        for request in self._requests:
            self._client.remove_pending_request(request)
        is_given = self.has_tags_to_visit()
        self.ids, self._is_settled = tag_ids, True
        if not is_given:
            self._find_positions(is_custom_file=is_custom_file)
            self._on_found()
        elif is_custom_file:
            self._find_positions(is_custom_file=True)
            self._on_custom_file()

    def _find_positions(self, *, is_custom_file: bool) -> None:
        # The shipped positions are wrong for a bridge with a custom tag file.
        shipped = None if is_custom_file else shipped_file('tag_locations.json')
        self._tag_file = self._settings.tag_locations_file or shipped
        in_layout = self._world
        if not in_layout and self._tag_file:
            tags = read_layout(self._tag_file).tags
            in_layout = {tag_id: (tag.x, tag.y) for tag_id, tag in tags.items()}
        self.positions_m = {}
        if self._settings.has_poses_in_map:
            self.positions_m = {
                tag_id: self.layout_in_map.point(*place) for tag_id, place in in_layout.items()
            }
