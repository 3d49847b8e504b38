"""
Test your own consumer against a real bridge: pytest fixtures, installed with the package.

In the conftest.py of your tests:

    pytest_plugins = ['lupin_greenhouse_bridge.testing']

and in a test:

    def test_my_consumer(start_bridge):
        bridge = start_bridge(debug_time_of_day=12.0)
        my_consumer.ask(bridge.service_name)
        assert bridge.values('1')['temperature'] > 15.0

Every process is a real one, on a ROS domain that no other test run on this machine uses. The fixtures need
pytest and domain_coordinator (ros-DISTRO-domain-coordinator): name both, and this package, as test_depend.
"""

import contextlib
import dataclasses
import json
import math
import os
import queue
import signal
import subprocess
import threading
import time
import uuid
from contextlib import closing
from pathlib import Path

import domain_coordinator
import pytest
import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import NodeNameNonExistentError
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_rmw_implementation_identifier

from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.runtime.parameters import descriptor_of
from lupin_greenhouse_bridge.runtime.run import spin_once
from lupin_greenhouse_bridge.simulator import simulation

PATIENCE_SECONDS = 30.0  # for a busy machine; a passing test never waits this long
# Fast DDS on this machine only, by UDP. All domains share its ports in shared memory: if a process is killed
# while it creates one, every process that opens this port later waits for ever.
# Fast DDS repeats a lost announcement of a participant only every 3 s, for which a test would wait. Not more
# often than once a second: in a process with two participants, a timer of one can deadlock with the removal
# of the other's endpoints (Fast DDS 2.14 and 3.2).
FAST_DDS = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com">
  <transport_descriptors>
    <transport_descriptor>
      <transport_id>loopback</transport_id>
      <type>UDPv4</type>
      <maxInitialPeersRange>32</maxInitialPeersRange>
      <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
    </transport_descriptor>
  </transport_descriptors>
  <participant profile_name="for_tests" is_default_profile="true">
    <rtps>
      <useBuiltinTransports>false</useBuiltinTransports>
      <userTransports><transport_id>loopback</transport_id></userTransports>
      <builtin>
        <discovery_config><leaseAnnouncement><sec>1</sec></leaseAnnouncement></discovery_config>
        <initialPeersList>
          <locator><udpv4><address>127.0.0.1</address></udpv4></locator>
        </initialPeersList>
      </builtin>
    </rtps>
  </participant>
</profiles>
"""


def require(is_so: bool, problem) -> None:
    """Fail the test with this problem unless it is so. Unlike assert, this also works with python -O."""
    if not is_so:
        raise AssertionError(problem)


def executable(package: str, name: str) -> str:
    """Return the path of the executable that `ros2 run PACKAGE NAME` starts."""
    return str(Path(get_package_prefix(package), 'lib', package, name))


@contextlib.contextmanager
def running(*node_types, arguments=(), **parameters):
    """Yield nodes of these types with these ROS arguments and parameters, spun by one thread."""
    # ROS reads values as YAML, in which an unquoted 7 is no text.
    values = {name: json.dumps(each) if isinstance(each, str) else each for name, each in parameters.items()}
    overrides = [word for name, value in values.items() for word in ('-p', f'{name}:={value}')]
    rclpy.init(args=['--ros-args', *arguments, *overrides], signal_handler_options=SignalHandlerOptions.NO)
    with contextlib.ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        nodes = []
        for node_type in node_types:
            nodes.append(node_type())
            stack.callback(nodes[-1].destroy_node)
        with _spun(*nodes):
            yield nodes


@contextlib.contextmanager
def spinning_node(name: str, namespace: str = ''):
    """Yield a node with its own context, spun by a thread."""
    context = Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node(name, namespace=namespace, context=context)
    try:
        with _spun(node, context=context):
            yield node
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


@contextlib.contextmanager
def _spun(*nodes, context=None):
    """Spin nodes in a thread, which survives what a node survives."""
    executor = SingleThreadedExecutor(context=context)
    for node in nodes:
        executor.add_node(node)
    ended = threading.Event()

    def spin():
        while not ended.is_set():
            spin_once(executor, nodes[0])

    spinner = threading.Thread(target=spin, daemon=True)
    spinner.start()
    try:
        yield
    finally:
        # rclpy raises in a thread that spins an executor while another closes it.
        executor.create_task(ended.set)
        spinner.join(PATIENCE_SECONDS)
        executor.shutdown(timeout_sec=0)  # nothing spins; Humble would wait for the task


def check_settings(settings_type) -> None:
    """
    Fail unless each parameter of a settings dataclass takes its default and its limits, and nothing else.

    A value of another type or beyond a limit has to be refused with an error that names the parameter.
    """
    settings_type()
    wrong_types = {str: (5, True), bool: (1, 'true'), int: (1.5, True, '1'), float: (True, '1')}
    for each in dataclasses.fields(settings_type):
        refused = [] if each.metadata['of_any_type'] else [*wrong_types[each.type], None]
        smallest, largest = limits = each.metadata['limits']
        if each.type in (int, float):
            refused += [*beyond(smallest, largest), math.nan, math.inf]
            for value in limits:
                require(getattr(settings_type(**{each.name: value}), each.name) == value, each.name)
            descriptor = descriptor_of(each, read_only=True)
            (found,) = (*descriptor.integer_range, *descriptor.floating_point_range)
            require((found.from_value, found.to_value) == limits, each.name)
        for value in refused:
            with pytest.raises(StartUpError) as refusal:
                settings_type(**{each.name: value})
            start = f'parameter {each.name} is {escaped(repr(value), 100)}: must be '
            require(str(refusal.value).startswith(start), refusal.value)


def beyond(smallest: float, largest: float) -> tuple[float, float]:
    """Return the nearest numbers outside two limits."""
    if isinstance(smallest, int):
        return smallest - 1, largest + 1
    return math.nextafter(smallest, -math.inf), math.nextafter(largest, math.inf)


class ManualClock:
    """A clock in seconds that only the test advances, as a substitute for time.monotonic."""

    def __init__(self):
        self._seconds = 1000.0

    def __call__(self) -> float:
        """Return the time in seconds."""
        return self._seconds

    def pass_seconds(self, seconds: float) -> None:
        """Advance the clock by this time."""
        self._seconds += seconds


def call(client, request):
    """Call a service whose node another thread spins, and return the response; fail if none arrives."""
    answered = threading.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _future: answered.set())
    require(answered.wait(PATIENCE_SECONDS), f'{client.srv_name} did not answer')
    return future.result()


def greet(client, request) -> None:
    """Call a service until it answers: DDS drops its replies until it has discovered the client."""
    repeat_until_answered(lambda: client.call_async(request), client.srv_name)


def repeat_until_answered(send, name: str) -> None:
    """Call send() once a second until one of its futures is done; fail after PATIENCE_SECONDS."""
    answered = threading.Event()
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not answered.is_set():
        require(time.monotonic() < deadline, f'{name} did not answer')
        send().add_done_callback(lambda _future: answered.set())
        answered.wait(1.0)


def has_found_a_client(node, service_name: str) -> bool:
    """Return whether a service of this node has discovered a client; until then, DDS drops its replies."""
    with contextlib.suppress(NodeNameNonExistentError):  # of a node that has just ended
        return any(
            service_name in dict(node.get_client_names_and_types_by_node(*name))
            for name in node.get_node_names_and_namespaces()
        )
    return False


def wait_until(is_so) -> None:
    """Poll until is_so() is true; fail after PATIENCE_SECONDS."""
    pause = threading.Event()
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not is_so():
        require(time.monotonic() < deadline, 'the condition did not become true')
        pause.wait(0.002)


class NodeProcess:
    """A node as a process with its own namespace, and its log."""

    def __init__(
        self, command: list[str], *, environment: dict | None = None, namespace: str = '', **parameters
    ):
        """Start the command with these parameters of the node, by default in a random namespace."""
        self.namespace = namespace or f'/test_{uuid.uuid4().hex[:8]}'
        overrides = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
        self.process = subprocess.Popen(
            [*command, '--ros-args', '-r', f'__ns:={self.namespace}', *overrides],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={**os.environ, **(environment or {})},
            text=True,
        )
        self.log: list[str] = []
        self._lines = queue.SimpleQueue()
        threading.Thread(target=self._read_log, daemon=True).start()

    def _read_log(self):
        for line in self.process.stdout:
            self._lines.put(line.rstrip('\n'))
        self._lines.put(None)

    def close(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.wait()

    def _next_lines(self):
        while (line := self._lines.get(timeout=PATIENCE_SECONDS)) is not None:
            self.log.append(line)
            yield line
        self._lines.put(None)

    def wait_for_log(self, fragment: str) -> str:
        """Return the next log line that contains the fragment; fail if the process ends without it."""
        for line in self._next_lines():
            if fragment in line:
                return line
        raise AssertionError(f'no {fragment!r} in the log:\n' + '\n'.join(self.log))

    def rest_of_log(self) -> list[str]:
        """Return the whole log of a process that ends."""
        list(self._next_lines())
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

    def __init__(self, command: list[str] | None = None, **keywords):
        super().__init__(command or [executable('lupin_greenhouse_bridge', 'bridge_node')], **keywords)
        self.service_name = f'{self.namespace}/greenhouse_bridge/get_tag_reading'
        self._stack = contextlib.ExitStack()
        self.node = None  # of the client
        self._client = None

    def close(self) -> None:
        """Kill the process, and close the client."""
        super().close()
        self.disconnect()

    def disconnect(self) -> None:
        """Close the client, if there is one. The next call makes another."""
        self._client = self.node = None
        self._stack.close()

    def connect(self, greeting: str = ''):
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
        return {each.name: each.value for each in response.reading.readings}


@pytest.fixture(scope='session', autouse=True)
def own_domain(tmp_path_factory):
    """Give this test run its own domain, visible on this machine only."""
    with domain_coordinator.domain_id() as domain_id, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain_id))
        # With Fast DDS the profile does this. LOCALHOST would add shared memory to its transports.
        is_fast_dds = get_rmw_implementation_identifier().startswith('rmw_fastrtps')
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SYSTEM_DEFAULT' if is_fast_dds else 'LOCALHOST')
        if os.environ.get('ROS_DISTRO') == 'humble':
            patch.setenv('ROS_LOCALHOST_ONLY', '0' if is_fast_dds else '1')
        profiles = tmp_path_factory.mktemp('dds') / 'profiles.xml'
        profiles.write_text(FAST_DDS, encoding='utf-8')
        is_fast_dds_2 = os.environ.get('ROS_DISTRO') in ('humble', 'jazzy')
        patch.setenv(f'FAST{"RTPS" if is_fast_dds_2 else "DDS"}_DEFAULT_PROFILES_FILE', str(profiles))
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('log')))
        yield


@pytest.fixture(scope='session')
def shipped_tags() -> dict[str, dict]:
    """Return the tags of the installed simulator: id -> x, y, sensors."""
    return json.loads(simulation.shipped_file('tag_locations.json').read_text(encoding='utf-8'))['tags']


@pytest.fixture
def run_nodes():
    """
    Return a function that runs nodes like running(), until the test ends.

    It returns them, and a node of the test. They share a participant, so all nodes discover each other
    immediately.
    """

    def beside():
        return rclpy.create_node('test')

    with contextlib.ExitStack() as stack:
        yield lambda *node_types, **keywords: stack.enter_context(running(*node_types, beside, **keywords))


@pytest.fixture
def start_node():
    """Return a function that starts a NodeProcess; each one ends with the test."""
    with contextlib.ExitStack() as stack:
        yield lambda *words, **keywords: stack.enter_context(closing(NodeProcess(*words, **keywords)))


@pytest.fixture
def start_bridge():
    """Return a function that starts a Bridge with these parameters; each one ends with the test."""
    with contextlib.ExitStack() as stack:
        yield lambda *words, **keywords: stack.enter_context(closing(Bridge(*words, **keywords)))
