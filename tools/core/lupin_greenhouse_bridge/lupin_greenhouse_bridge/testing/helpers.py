"""Run nodes, call services and wait in a test; a clock that only the test advances."""

import contextlib
import dataclasses
import json
import math
import re
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.runtime.graph import nodes_with
from lupin_greenhouse_bridge.runtime.run import spin_once

PATIENCE_SECONDS = 30.0  # for a busy machine; a passing test never waits this long


def require(condition: bool, problem: object) -> None:
    """Fail the test with this problem unless the condition holds. Also works with python -O."""
    if not condition:
        raise AssertionError(problem)


def wait_until(condition: Callable[[], Any]) -> None:
    """Poll until condition() is true; fail after 30 s."""
    pause = threading.Event()
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not condition():
        require(time.monotonic() < deadline, 'the condition did not become true')
        pause.wait(0.002)


def executable(package: str, name: str) -> str:
    """Return the path of the executable that `ros2 run PACKAGE NAME` starts."""
    return str(Path(get_package_prefix(package), 'lib', package, name))


@contextlib.contextmanager
def running(
    *create: Callable[[], Node],
    context: Context | None = None,
    arguments: Sequence[str] = (),
    **parameters: Any,
) -> Iterator[list[Any]]:
    """Create nodes with these ROS arguments and parameters, and yield them, spun by one thread."""
    # ROS reads values as YAML, in which an unquoted 7 is no text.
    values = {
        name: json.dumps(value) if isinstance(value, str) else value for name, value in parameters.items()
    }
    ros_arguments = ['--ros-args', *arguments, *overrides(values)]
    rclpy.init(args=ros_arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor(context=context)
    ended = threading.Event()

    def spin() -> None:
        while not ended.is_set():
            spin_once(executor, nodes[0])

    def end_spinner() -> None:
        executor.create_task(ended.set)
        spinner.join(PATIENCE_SECONDS)
        require(not spinner.is_alive(), 'a callback did not end')

    with contextlib.ExitStack() as stack:
        stack.callback(rclpy.try_shutdown, context=context)
        nodes = []
        for create_node in create:
            nodes.append(create_node())
            stack.callback(nodes[-1].destroy_node)
            executor.add_node(nodes[-1])
        spinner = threading.Thread(target=spin, daemon=True)
        spinner.start()
        # In reverse order, because rclpy raises in a thread that spins an executor while another closes it.
        # Without the timeout, Humble would wait for the task that ends the thread.
        stack.callback(executor.shutdown, timeout_sec=0)
        stack.callback(end_spinner)
        yield nodes


@contextlib.contextmanager
def spinning_node(name: str, namespace: str = '') -> Iterator[Node]:
    """Yield a node with its own context, spun by a thread."""
    context = Context()
    create_node = partial(rclpy.create_node, name, namespace=namespace, context=context)
    with running(create_node, context=context) as (node,):
        yield node


def overrides(parameters: dict[str, Any]) -> list[str]:
    """Return the ROS arguments that set these parameters."""
    return [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]


def call(client: 'Client[Any, Any]', request: Any) -> Any:
    """Call a service whose node another thread spins, and return the response; fail if none arrives."""
    future = client.call_async(request)
    wait_until(future.done)
    return future.result()


def greet(client: 'Client[Any, Any]', request: Any) -> None:
    """Call a service until it answers: DDS drops its replies until it has discovered the client."""
    repeat_until_answered(lambda: client.call_async(request), client.srv_name)


def repeat_until_answered(send: Callable[[], Any], name: str) -> None:
    """Call send() once a second until one of its futures is done; fail after PATIENCE_SECONDS."""
    answered = threading.Event()
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not answered.is_set():
        require(time.monotonic() < deadline, f'{name} did not answer')
        send().add_done_callback(lambda _future: answered.set())
        answered.wait(1.0)


def has_found_a_client(node: Node, service_name: str) -> bool:
    """Return whether a service of this node has discovered a client; until then, DDS drops its replies."""
    return bool(nodes_with(service_name, node, node.get_client_names_and_types_by_node))


class ManualClock:
    """A clock in seconds that only the test advances, as a substitute for time.monotonic."""

    seconds = 1000.0

    def __call__(self) -> float:
        """Return the time in seconds."""
        return self.seconds

    def pass_seconds(self, seconds: float) -> None:
        """Advance the clock by this time."""
        self.seconds += seconds


def check_settings(settings_type: type) -> None:
    """
    Fail unless each parameter of a settings dataclass takes its default and its limits, and nothing else.

    A value of another type or beyond a limit has to be refused with an error that names the parameter.
    """
    settings_type()
    wrong_types: dict[Any, tuple[Any, ...]]
    wrong_types = {str: (5, True), bool: (1, 'true'), int: (1.5, True, '1'), float: (True, '1')}
    for spec in dataclasses.fields(settings_type):
        refused = [] if spec.metadata['of_any_type'] else [*wrong_types[spec.type], None]
        smallest, largest = spec.metadata['limits']
        if spec.type is int:
            refused += [smallest - 1, largest + 1]
        elif spec.type is float:
            refused += [math.nextafter(smallest, -math.inf), math.nextafter(largest, math.inf), math.nan]
        for limit in (smallest, largest) if spec.type in (int, float) else ():
            require(getattr(settings_type(**{spec.name: limit}), spec.name) == limit, spec.name)
        for value in refused:
            start = f'parameter {spec.name} is {escaped(repr(value), 100)}: must be '
            with pytest.raises(StartUpError, match=f'^{re.escape(start)}'):
                settings_type(**{spec.name: value})
