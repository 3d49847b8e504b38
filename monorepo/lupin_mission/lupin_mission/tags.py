"""Find the tags of the greenhouse and their positions: from the settings, or from the bridge."""

import time
from collections.abc import Callable
from pathlib import Path

from lupin_greenhouse_bridge.contract import (
    has_tag_file,
    parameter_service_of,
    tag_ids_of,
    tag_ids_request,
)
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.registration import Transform, read_transform
from lupin_greenhouse_bridge.simulator.files import shipped_file
from lupin_greenhouse_bridge.simulator.layout import Layout, read_layout
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock, ClockType

from lupin_mission.settings import Settings
from lupin_mission.transport import create_client
from lupin_mission.world import read_world

ASK_EVERY_SECONDS = 0.1
LONGEST_WITHOUT_PARAMETERS_SECONDS = 5.0  # while the service itself is there


class Tags:
    """The tags of the greenhouse, and their positions in the map, once they are known."""

    def __init__(self, settings: Settings):
        """Read the files of the settings; raises StartUpError."""
        self.ids: list[str] = []  # of the greenhouse; empty until they are known
        self.positions_m: dict[str, tuple[float, float]] = {}  # in the map
        self._tag_file: str | Path | None = None  # once the tags are known
        self.layout_in_map = Transform()
        if settings.layout_in_map:
            self.layout_in_map = read_transform(settings.layout_in_map, settings.frame_id)
        self._client = None  # of the bridge's parameters
        self._is_settled = False  # the bridge has replied, or has no parameters
        self._reply_deadline: float | None = None  # once the bridge is there
        self._parameters_deadline: float | None = None  # once the service is there without them
        self._settings = settings
        self._world = read_world(settings.world_file) if settings.world_file else {}
        if self._world:
            self.ids = list(self._world)
        elif settings.tag_locations_file:
            self.ids = list(read_layout(settings.tag_locations_file, has_tables=False).tags)

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
        node,
        has_service: Callable[[], bool],
        on_found: Callable[[], None],
        on_positions_lost: Callable[[], None],
    ) -> None:
        """
        Call on_found() as soon as there are tags to visit: now, or when the bridge has replied.

        Call on_positions_lost() if the bridge later replies that it has its own tag file. `has_service()`
        returns whether the bridge's service is available.
        """
        if is_given := self.has_tags_to_visit():
            self._find_positions(is_custom_file=False)
            on_found()
        if self.ids:
            return

        def on_tags(tag_ids: list[str], *, is_custom_file: bool) -> None:
            self.ids, self._is_settled = tag_ids, True
            if is_custom_file or not is_given:
                self._find_positions(is_custom_file=is_custom_file)
                (on_positions_lost if is_given else on_found)()

        self._ask_the_bridge(node, has_service, on_tags)

    def is_waiting_for_tags(self) -> bool:
        """Return whether the bridge is available, and may still reply that it has its own tag file."""
        if self._is_settled or not self._client or not self._client.service_is_ready():
            return False
        if self._reply_deadline is None:
            self._reply_deadline = time.monotonic() + self._settings.dependency_timeout_s
        return time.monotonic() < self._reply_deadline

    def _ask_the_bridge(self, node, has_service, on_tags) -> None:
        """Ask the bridge for its tags. Repeat the request, because DDS can drop an early one."""
        service = parameter_service_of(node.resolve_service_name(self._settings.bridge_service_name))
        self._client = client = create_client(node, GetParameters, service)
        timeout_seconds = self._settings.dependency_timeout_s
        deadline = time.monotonic() + timeout_seconds

        def ask():
            if self._is_settled:
                timer.cancel()
            elif not (self.has_tags_to_visit() or self._settings.wait_for_start) and is_over(deadline):
                raise StartUpError(
                    f'{client.srv_name} did not return the tags within {timeout_seconds:g} s:'
                    ' start the bridge, or set tag_sequence or tag_locations_file'
                )
            elif client.service_is_ready():
                client.call_async(tag_ids_request()).add_done_callback(
                    lambda future: self._on_reply(node, future.result(), on_tags)
                )
            elif self._has_no_parameters(has_service):
                self._take_shipped(f'no node offers {client.srv_name}', node.get_logger().warning, on_tags)

        if not self.has_tags_to_visit():
            node.get_logger().info(f'waiting for the tags of {client.srv_name}')
        # Monotonic: use_sim_time does not affect it.
        timer = node.create_timer(ASK_EVERY_SECONDS, ask, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_reply(self, node, response, on_tags) -> None:
        if self._is_settled:
            return
        if tag_ids := tag_ids_of(response):
            on_tags(tag_ids, is_custom_file=has_tag_file(response))
        else:
            reason = f'the node of {self._settings.bridge_service_name} does not list its tags'
            self._take_shipped(reason, node.get_logger().info, on_tags)

    def _take_shipped(self, reason: str, log: Callable[[str], None], on_tags) -> None:
        """Take the tags that mdp-greenhouse ships, if it is installed."""
        if shipped := shipped_file('tag_locations.json'):
            log(f'{reason}: using those of {shipped}')
            on_tags(list(read_layout(shipped, has_tables=False).tags), is_custom_file=False)

    def _has_no_parameters(self, has_service: Callable[[], bool]) -> bool:
        """Return whether the service has been there for a while without the parameters of a bridge."""
        if self._parameters_deadline is None and has_service():
            self._parameters_deadline = time.monotonic() + LONGEST_WITHOUT_PARAMETERS_SECONDS
        return self._parameters_deadline is not None and is_over(self._parameters_deadline)

    def _find_positions(self, *, is_custom_file: bool) -> None:
        # The shipped positions are wrong for a bridge with a custom tag file.
        shipped = None if is_custom_file else shipped_file('tag_locations.json')
        self._tag_file = self._settings.tag_locations_file or shipped
        self.positions_m = {}
        if not self._settings.has_poses_in_map:
            return
        layout = self._world
        if not layout and self._tag_file:
            layout = read_layout(self._tag_file, has_tables=False).tags
        self.positions_m = {tag_id: self.layout_in_map.point(*tag[:2]) for tag_id, tag in layout.items()}


def is_over(deadline: float) -> bool:
    """Return whether a time of the monotonic clock has come."""
    return time.monotonic() >= deadline
