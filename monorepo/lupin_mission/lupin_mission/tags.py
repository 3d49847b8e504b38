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
from lupin_greenhouse_bridge.simulator.layout import Layout, read_layout, read_tags_with_sensors
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock, ClockType

from lupin_mission.settings import Settings
from lupin_mission.transport import create_client
from lupin_mission.world import read_world

ASK_EVERY_SECONDS = 0.1


class Tags:
    """The tags that a mission may visit, and their positions in the map, once they are known."""

    def __init__(self, settings: Settings):
        """Read the files of the settings; raises StartUpError."""
        self.ids: list[str] = []  # empty until they are known
        self.positions_m: dict[str, tuple[float, float]] = {}  # in the map
        self._tag_file: str | Path | None = None  # once the tags are known
        self.layout_in_map = Transform()
        if settings.layout_in_map:
            self.layout_in_map = read_transform(settings.layout_in_map, settings.frame_id)
        self._client = None  # of the bridge's parameters
        self._is_settled = False  # the bridge has replied
        self._reply_deadline: float | None = None  # of its reply, once the bridge is there
        self._settings = settings
        self._world = read_world(settings.world_file) if settings.world_file else {}
        self._given_ids = settings.chosen_tag_ids or list(self._world)
        if not self._given_ids and settings.tag_locations_file:
            self._given_ids = list(read_tags_with_sensors(settings.tag_locations_file))

    def layout(self) -> Layout:
        """Return the layout of the tags, which are known; raises StartUpError."""
        if not self._tag_file:
            raise StartUpError("the layout is unknown: set tag_locations_file to the bridge's tag_file")
        return read_layout(self._tag_file)

    def find(self, node, on_found: Callable[[], None], on_positions_lost: Callable[[], None]) -> None:
        """
        Call on_found() once the tags are known: now, or when the bridge has replied.

        Call on_positions_lost() if the bridge then replies that it has a tag file of its own.
        """
        if self._given_ids:
            self._set(self._given_ids, is_custom_file=False)
            on_found()
            if self._world or self._settings.tag_locations_file:
                return
        self._ask_the_bridge(node, on_found, on_positions_lost)

    def is_waiting_for_tags(self) -> bool:
        """Return whether the bridge is there, and may still tell that it has a tag file of its own."""
        if self._is_settled or not self._client or not self._client.service_is_ready():
            return False
        if self._reply_deadline is None:
            self._reply_deadline = time.monotonic() + self._settings.dependency_timeout_s
        return time.monotonic() < self._reply_deadline

    def _ask_the_bridge(self, node, on_found, on_positions_lost) -> None:
        """Ask the bridge for its tags. Repeat the request, because DDS can drop an early one."""
        service = parameter_service_of(node.resolve_service_name(self._settings.bridge_service_name))
        self._client = client = create_client(node, GetParameters, service)
        timeout_seconds = self._settings.dependency_timeout_s
        deadline = time.monotonic() + timeout_seconds

        def ask():
            if self._is_settled:
                timer.cancel()
            elif not (self.ids or self._settings.wait_for_start) and time.monotonic() >= deadline:
                raise StartUpError(
                    f'{client.srv_name} did not return the tags within {timeout_seconds:g} s:'
                    ' start the bridge, or set tag_sequence or tag_locations_file'
                )
            elif client.service_is_ready():
                client.call_async(tag_ids_request()).add_done_callback(on_reply)

        def on_reply(future):
            self._on_reply(node, future.result(), on_found, on_positions_lost)

        if not self.ids:
            node.get_logger().info(f'waiting for the tags of {client.srv_name}')
        # Monotonic: use_sim_time does not affect it.
        timer = node.create_timer(ASK_EVERY_SECONDS, ask, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_reply(self, node, response, on_found, on_positions_lost) -> None:
        if self._is_settled:
            return
        if self.ids:
            self._is_settled = True
            if response.values and has_tag_file(response):
                self._set(self.ids, is_custom_file=True)
                on_positions_lost()
        elif self._take_tags(node, response):
            self._is_settled = True
            on_found()

    def _take_tags(self, node, response) -> bool:
        """Take the tags of a reply, or those that are shipped; return whether there are any."""
        if tag_ids := tag_ids_of(response):
            self._set(tag_ids, is_custom_file=has_tag_file(response))
        elif shipped := shipped_file('tag_locations.json'):
            service_name = self._settings.bridge_service_name
            node.get_logger().info(
                f'the node of {service_name} does not list its tags: using those of {shipped}'
            )
            self._set(list(read_tags_with_sensors(shipped)), is_custom_file=False)
        return bool(self.ids)

    def _set(self, tag_ids: list[str], *, is_custom_file: bool) -> None:
        self.ids = tag_ids
        # The shipped positions are wrong for a bridge with a custom tag file.
        shipped = None if is_custom_file else shipped_file('tag_locations.json')
        self._tag_file = self._settings.tag_locations_file or shipped
        if not self._settings.has_poses_in_map:
            return
        layout = self._world
        if not layout and self._tag_file:
            layout = read_tags_with_sensors(self._tag_file)
        self.positions_m = {tag_id: self.layout_in_map.point(*tag[:2]) for tag_id, tag in layout.items()}
