# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
Test your own consumer against a real bridge: pytest fixtures, installed with the package.

In the conftest.py of your tests:

    pytest_plugins = ['lupin_greenhouse_bridge.testing']

and in a test:

    def test_my_consumer(start_bridge):
        bridge = start_bridge(debug_time_of_day=12.0)
        my_consumer.ask(bridge.service_name)
        assert bridge.values('1')['temperature'] > 15.0

| fixture | gives |
|---|---|
| start_bridge | a function that starts a real bridge with parameters, such as debug_seed=42 |
| noon_bridge | a real bridge with a frozen clock, which all tests share |
| slow_bridge | a service that replies when the test says so |
| robot, run_nodes | a node of the test; a function that runs nodes in a thread of the test |
| start_node, run_here | functions that run an executable as a process, or a main() in the test's process |
| write_layout, shipped_tags | a function that writes a tag file; the tags of mdp-greenhouse |

Every process is a real one, on a ROS domain that no other test run on this machine uses. The fixtures need
pytest and domain_coordinator (ros-DISTRO-domain-coordinator): name both, and this package, as test_depend.
"""

import contextlib
import json
import os
import signal
import subprocess
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import domain_coordinator
import pytest
import rclpy
from rclpy.client import Client
from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier

from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.runtime.process import private_domains
from lupin_greenhouse_bridge.simulator.layout import shipped_file
from lupin_greenhouse_bridge.testing.commands import run_here
from lupin_greenhouse_bridge.testing.helpers import (
    PATIENCE_SECONDS,
    call,
    executable,
    greet,
    overrides,
    require,
    running,
    spinning_node,
    wait_until,
)
from lupin_greenhouse_bridge.testing.slow_bridge import slow_bridge

__all__ = ['Bridge', 'NodeProcess', 'run_here', 'slow_bridge', 'wait_until']


class NodeProcess:
    """A node as a process with its own namespace, and its log."""

    def __init__(
        self,
        command: list[str],
        *,
        environment: dict[str, str] | None = None,
        namespace: str = '',
        **parameters: Any,
    ) -> None:
        """Start the command with these parameters of the node, by default in a random namespace."""
        self.namespace = namespace or f'/test_{uuid.uuid4().hex[:8]}'
        self.process = subprocess.Popen(
            [*command, '--ros-args', '-r', f'__ns:={self.namespace}', *overrides(parameters)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={**os.environ, **(environment or {})},
            text=True,
        )
        self.log: list[str] = []
        self._searched_lines = 0
        self._reader = threading.Thread(target=self._read_log, daemon=True)
        self._reader.start()

    def _read_log(self) -> None:
        for line in self.process.stdout or ():
            self.log.append(line.rstrip('\n'))

    def close(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.wait()

    def wait_for_log(self, fragment: str) -> str:
        """Return the next log line that contains the fragment; fail if the process ends without it."""
        while True:
            wait_until(lambda: self._searched_lines < len(self.log) or not self._reader.is_alive())
            require(self._searched_lines < len(self.log), f'no {fragment!r} in the log: {self.log}')
            line = self.log[self._searched_lines]
            self._searched_lines += 1
            if fragment in line:
                return line

    def rest_of_log(self) -> list[str]:
        """Return the whole log of a process that ends."""
        self._reader.join(PATIENCE_SECONDS)
        require(not self._reader.is_alive(), f'the process did not end: {self.log}')
        return self.log

    def send(self, *numbers: signal.Signals) -> None:
        """Send signals, one right after the other, to a process that may be about to end."""
        for number in numbers:
            self.process.send_signal(number)  # has no effect after the process was waited for

    def end(self) -> int:
        """Return the exit code of a process that ends; fail for a traceback in its log."""
        log = '\n'.join(self.rest_of_log())
        require('Traceback' not in log, log)
        return self.process.wait(PATIENCE_SECONDS)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Send a signal, and return the exit code."""
        self.send(number)
        return self.end()

    def refusal(self, exit_code: int = 1) -> str:
        """Return the one FATAL line of a node that refuses to start with this exit code."""
        require(self.end() == exit_code, self.log)
        (fatal,) = [line for line in self.log if '[FATAL]' in line]
        return fatal


class Bridge(NodeProcess):
    """A bridge as a process and, after connect(), a client of its service."""

    def __init__(self, command: list[str] | None = None, **keywords: Any) -> None:
        super().__init__(command or [executable('lupin_greenhouse_bridge', 'bridge_node')], **keywords)
        self.service_name = f'{self.namespace}/greenhouse_bridge/get_tag_reading'
        self.node: Node | None = None  # of the client
        self._client: Client[Any, Any] | None = None
        self._stack = contextlib.ExitStack()

    def close(self) -> None:
        """Kill the process, and close the client."""
        super().close()
        self.disconnect()

    def disconnect(self) -> None:
        """Close the client, if there is one. The next call makes another."""
        self._client = self.node = None
        self._stack.close()

    def connect(self, greeting: str = '') -> 'Client[Any, Any]':
        """Return a client that the service has discovered: it has answered the greeting, which is no tag."""
        if self._client is None:
            if not any('ready:' in line for line in self.log):
                self.wait_for_log('ready:')
            self.node = self._stack.enter_context(spinning_node('bridge_test'))
            self._client = self.node.create_client(GetTagReading, self.service_name, qos_profile=SERVICE_QOS)
            has_service = self._client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
            require(has_service, f'no service {self.service_name}')
            greet(self._client, GetTagReading.Request(tag_id=greeting))
        return self._client

    def call(self, tag_id: str) -> GetTagReading.Response:
        """Return the response for a tag."""
        return call(self.connect(), GetTagReading.Request(tag_id=tag_id))

    def values(self, tag_id: str) -> dict[str, float]:
        """Return the readings at a tag by sensor name; fail for any status but OK."""
        response = self.call(tag_id)
        is_read = (response.status, response.error_message) == (GetTagReading.Response.STATUS_OK, '')
        require(is_read, response)
        return {sensor.name: sensor.value for sensor in response.reading.readings}


@pytest.fixture(scope='session', autouse=True)
def own_domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Give this test run its own domain, visible on this machine only."""
    distro = os.environ.get('ROS_DISTRO')
    # With Fast DDS, the profile is what hides it. LOCALHOST would add shared memory to its transports.
    is_fast_dds = get_rmw_implementation_identifier().startswith('rmw_fastrtps')
    profiles_file = 'FASTRTPS' if distro in ('humble', 'jazzy') else 'FASTDDS'
    with domain_coordinator.domain_id(private_domains()) as domain_id, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain_id))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SYSTEM_DEFAULT' if is_fast_dds else 'LOCALHOST')
        if distro == 'humble':
            patch.setenv('ROS_LOCALHOST_ONLY', '0' if is_fast_dds else '1')
        patch.setenv(f'{profiles_file}_DEFAULT_PROFILES_FILE', str(Path(__file__).with_name('fast_dds.xml')))
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('log')))
        yield


@pytest.fixture(scope='session')
def shipped_tags() -> Any:
    """Return the tags of the installed simulator: id -> x, y, sensors."""
    return json.loads(Path(shipped_file('tag_locations.json') or '').read_text(encoding='utf-8'))['tags']


@pytest.fixture
def run_nodes() -> Iterator[Callable[..., list[Any]]]:
    """
    Return a function that runs nodes of these types with these parameters, until the test ends.

    It returns them, and a node of the test. They share a participant, so all nodes discover each other
    immediately.
    """

    def run(*node_types: Callable[[], Node], **keywords: Any) -> list[Any]:
        return stack.enter_context(running(*node_types, partial(rclpy.create_node, 'test'), **keywords))

    with contextlib.ExitStack() as stack:
        yield run


@pytest.fixture
def start_node() -> Iterator[Callable[..., NodeProcess]]:
    """Return a function that starts a NodeProcess; each one ends with the test."""
    with contextlib.ExitStack() as stack:
        yield lambda *words, **keywords: stack.enter_context(closing(NodeProcess(*words, **keywords)))


@pytest.fixture
def start_bridge() -> Iterator[Callable[..., Bridge]]:
    """Return a function that starts a Bridge with these parameters; each one ends with the test."""
    with contextlib.ExitStack() as stack:
        yield lambda *words, **keywords: stack.enter_context(closing(Bridge(*words, **keywords)))


@pytest.fixture(scope='session')
def _noon_process(own_domain: None) -> Iterator[Bridge]:  # noqa: ARG001 (the domain comes first)
    with closing(Bridge(debug_time_of_day=12.0)) as bridge:
        bridge.wait_for_log('ready:')
        yield bridge


@pytest.fixture
def noon_bridge(_noon_process: Bridge) -> Iterator[Bridge]:
    """
    Return a bridge with the shipped greenhouse, frozen at noon. Its client ends with the test.

    In the tests after it, a main() that is refused would end soon after its discovery by this client. The
    timer of one participant can then deadlock with the end of another (see fast_dds.xml).
    """
    yield _noon_process
    _noon_process.disconnect()


@pytest.fixture
def robot() -> Iterator[Node]:
    """Return a node of the test with its own context, spun by a thread."""
    with spinning_node('robot') as node:
        yield node


@pytest.fixture
def write_layout(tmp_path: Path) -> Callable[..., str]:
    """Return a function that writes a tag file of places and tables (x0, y0, x1, y1); it returns the path."""

    def write(places_m: dict[str, tuple[float, float]], **tables: tuple[float, float, float, float]) -> str:
        path, edges = tmp_path / 'tags.json', ('x0', 'y0', 'x1', 'y1')
        tags = {tag_id: {'x': x, 'y': y, 'sensors': ['co2']} for tag_id, (x, y) in places_m.items()}
        boxes = {name: dict(zip(edges, table, strict=True)) for name, table in tables.items()}
        path.write_text(json.dumps({'tags': tags, 'tables': boxes}), encoding='utf-8')
        return str(path)

    return write
