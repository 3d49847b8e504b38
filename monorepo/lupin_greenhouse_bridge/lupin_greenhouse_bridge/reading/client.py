# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""A client for scripts and tests: calls services one at a time, each with a timeout."""

import time
from collections.abc import Callable
from typing import Any

from rclpy.client import Client as ServiceClient
from rclpy.exceptions import InvalidServiceNameException
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.task import Future

from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.errors import Interrupted, OneLineError, UsageError
from lupin_greenhouse_bridge.runtime.process import LONGEST_WAIT_SECONDS, is_asked_to_end, security_problem
from lupin_greenhouse_bridge.runtime.rclpy_internals import RCLError

REPEAT_AFTER_SECONDS = 1.0


class NoAnswer(OneLineError):
    """The service is not available, or does not reply before the timeout."""


class Client:
    """Calls services one at a time, each with a timeout."""

    def __init__(self, executor: Executor, node: Node, timeout_seconds: float) -> None:
        """Only this client spins `executor`, which must hold `node`."""
        self._executor = executor
        self._node = node
        self._timeout_seconds = timeout_seconds

    def connect(
        self, service_type: Any, service_name: str, show: Callable[[str], None] = lambda _text: None
    ) -> 'ServiceClient[Any, Any]':
        """
        Wait until a service is available, and return its client.

        From time to time, `show` receives a line of progress. Raises NoAnswer, UsageError and Interrupted.
        """
        try:
            client: ServiceClient[Any, Any]
            client = self._node.create_client(service_type, service_name, qos_profile=SERVICE_QOS)
        except InvalidServiceNameException as error:
            raise UsageError(f'{service_name!r} is not a service name: {error}') from error
        except RCLError as error:
            problem = security_problem() or 'ROS cannot create the client'
            raise UsageError(f'{problem}: {error}') from error
        self.wait_for(client, show)
        return client

    def wait_for(
        self, client: 'ServiceClient[Any, Any]', show: Callable[[str], None] = lambda _text: None
    ) -> None:
        """Wait until the service of a client is available; raises NoAnswer and Interrupted."""
        deadline = time.monotonic() + self._timeout_seconds
        while not client.service_is_ready():
            left_seconds = self._left_until(deadline, f'no service {client.srv_name}')
            show(f'waiting for {client.srv_name}, {left_seconds:.0f} s more')
            self._executor.spin_once(timeout_sec=min(left_seconds, 0.02))

    def call(self, client: 'ServiceClient[Any, Any]', request: Any) -> Any:
        """
        Return the response to one request; raises NoAnswer and Interrupted.

        Repeats the request every second, because DDS drops the reply to a client that the service has not
        discovered yet.
        """
        futures: list[Future[Any]] = []
        deadline = time.monotonic() + self._timeout_seconds
        try:
            while not any(future.done() for future in futures):
                left_seconds = self._left_until(deadline, f'{client.srv_name} did not answer')
                if self._timeout_seconds - left_seconds >= len(futures) * REPEAT_AFTER_SECONDS:
                    futures.append(client.call_async(request))
                self._executor.spin_once(timeout_sec=min(left_seconds, LONGEST_WAIT_SECONDS))
            return next(future.result() for future in futures if future.done())
        finally:
            for future in futures:
                client.remove_pending_request(future)

    def _left_until(self, deadline: float, problem: str) -> float:
        if is_asked_to_end():
            raise Interrupted
        if (left_seconds := deadline - time.monotonic()) <= 0.0:
            raise NoAnswer(f'{problem} within {self._timeout_seconds:g} s')
        return left_seconds
