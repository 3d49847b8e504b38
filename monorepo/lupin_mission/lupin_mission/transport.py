"""Carry the mission's requests to its two services, and the replies back. No call blocks."""

from collections.abc import Callable
from typing import Any

from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.runtime.graph import domain_id, duplicate_server_warning
from lupin_msgs.srv import ConfirmTag, GetTagReading
from lupin_readings.report_line import Outcome
from rclpy.node import Node

from lupin_mission.settings import Settings
from lupin_mission.visit import Request, Service


def create_client(node: Node, service_type: Any, name: str) -> Any:
    """Return a client for a service with many callers."""
    return node.create_client(service_type, name, qos_profile=SERVICE_QOS)


class Transport:
    """Sends one request at a time."""

    def __init__(self, node: Node, settings: Settings):
        """Create the clients."""
        self._node = node
        self._logged_warnings: set[str] = set()
        self._clients = {
            Service.CONFIRM: create_client(node, ConfirmTag, settings.visual_confirmation_service),
            Service.READ: create_client(node, GetTagReading, settings.bridge_service_name),
        }
        self._unsent: tuple[Request, Callable[[Any], None]] | None = None
        self._future: Any = None

    def is_available(self, service: Service) -> bool:
        """Return whether a service is available."""
        return bool(self._clients[service].service_is_ready())

    def send(self, request: Request, on_response: Callable[[Any], None]) -> None:
        """Send a request as soon as its service is available. The mission handles the timeout."""
        self._unsent = request, on_response
        self.send_when_ready()

    def send_when_ready(self) -> None:
        """Send the waiting request if its service is available now."""
        if not self._unsent or not self.is_available(self._unsent[0].service):
            return
        (request, on_response), self._unsent = self._unsent, None
        if request.service is Service.CONFIRM:
            message = ConfirmTag.Request(expected_tag_id=request.tag_id)
        else:
            message = GetTagReading.Request(tag_id=request.tag_id)
        client = self._clients[request.service]
        self._warn_once(duplicate_server_warning(self._node, client.srv_name))
        self._future = client.call_async(message)
        self._future.add_done_callback(lambda future: on_response(future.result()))

    def abandon(self, request: Request) -> Outcome:
        """Forget a request, so that its late reply is ignored; return TIMEOUT or NO_SERVICE."""
        if self._unsent and self._unsent[0] is request:
            self._unsent = None
            name = self._clients[request.service].srv_name
            self._warn_once(
                f'{name} is not found on domain {domain_id()}:'
                ' start its node, or set ROS_DOMAIN_ID to its domain'
            )
            return Outcome.NO_SERVICE
        self._clients[request.service].remove_pending_request(self._future)
        return Outcome.TIMEOUT

    def _warn_once(self, warning: str) -> None:
        if warning and warning not in self._logged_warnings:
            self._logged_warnings.add(warning)
            self._node.get_logger().warning(warning)
