# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""A client for scripts and tests: calls services one at a time, each with a timeout."""

import time
from typing import Any

from rclpy.client import Client as ServiceClient
from rclpy.exceptions import InvalidServiceNameException
from rclpy.executors import Executor
from rclpy.node import Node

from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.errors import Interrupted, OneLineError, UsageError
from lupin_greenhouse_bridge.runtime.graph import domain_id
from lupin_greenhouse_bridge.runtime.process import LONGEST_WAIT_SECONDS, is_asked_to_end


class NoAnswer(OneLineError):
    """The service is not available, or it does not reply before the timeout."""


class Client:
    """Calls services one at a time, each with a timeout."""

    def __init__(self, executor: Executor, node: Node, timeout_seconds: float) -> None:
        """Only this client spins `executor`, which must hold `node`."""
        self._executor = executor
        self._node = node
        self._timeout_seconds = timeout_seconds

    def connect(self, service_type: Any, service_name: str) -> 'ServiceClient[Any, Any]':
        """Return the client of a service that is available; raises NoAnswer, UsageError and Interrupted."""
        try:
            client: ServiceClient[Any, Any]
            client = self._node.create_client(service_type, service_name, qos_profile=SERVICE_QOS)
        except InvalidServiceNameException as error:
            raise UsageError(f'{service_name!r} is not a service name: {error}') from error
        self.wait_for(client)
        return client

    def wait_for(self, client: 'ServiceClient[Any, Any]') -> None:
        """Wait until the service of a client is available; raises NoAnswer and Interrupted."""
        problem = (
            f'no bridge on domain {domain_id()} offers {client.srv_name}:'
            ' start one, or set --service and ROS_DOMAIN_ID'
        )
        deadline = time.monotonic() + self._timeout_seconds
        while not client.service_is_ready():
            left_seconds = self._left_until(deadline, problem)
            self._executor.spin_once(timeout_sec=min(left_seconds, 0.02))

    def call(self, client: 'ServiceClient[Any, Any]', request: Any) -> Any:
        """
        Return the response to one request; raises NoAnswer and Interrupted.

        Sends the request once: each one that a seeded bridge handles takes the next noise.
        """
        future = client.call_async(request)
        problem = f'{client.srv_name} did not answer within {self._timeout_seconds:g} s'
        deadline = time.monotonic() + self._timeout_seconds
        try:
            while not future.done():
                left_seconds = self._left_until(deadline, problem)
                self._executor.spin_once(timeout_sec=min(left_seconds, LONGEST_WAIT_SECONDS))
            return future.result()
        finally:
            client.remove_pending_request(future)

    def _left_until(self, deadline: float, problem: str) -> float:
        if is_asked_to_end():
            raise Interrupted
        if (left_seconds := deadline - time.monotonic()) <= 0.0:
            raise NoAnswer(problem)
        return left_seconds
