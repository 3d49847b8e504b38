"""Real bridge processes, on a ROS domain of this test run's own, each with a client."""

import os

# Before the messages are imported: a field of a wrong type is an exception, here and in the bridge.
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'

import contextlib
import importlib.util
import itertools
import json
import queue
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import domain_coordinator
import greenhouse_sim
import pytest
import rclpy
import yaml
from ament_index_python.packages import get_package_prefix
from lupin_msgs.srv import GetTagReading
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile

CONFIGS = Path(greenhouse_sim.__file__).parent / 'configs'
EXECUTABLES = Path(get_package_prefix('lupin_greenhouse_bridge'), 'lib/lupin_greenhouse_bridge')
ALTERED_BRIDGE = Path(__file__).parent / 'altered_bridge.py'
NAMESPACES = (f'/test{number}' for number in itertools.count())  # two bridges of one name are one service
# Without launch the launch file is compared with the node in test_package.py.
collect_ignore = [] if importlib.util.find_spec('launch_testing') else ['test_launch.py']
CLIENT_QOS = QoSProfile(depth=1000)  # why: read_tag.py
PATIENCE_SECONDS = 30.0  # for a busy machine; nothing waits this long when all is well


@pytest.fixture(scope='session', autouse=True)
def own_domain(tmp_path_factory):
    """Give this test run a domain that no other run on this machine uses, visible on this machine only."""
    with domain_coordinator.domain_id() as domain_id, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain_id))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        if os.environ.get('ROS_DISTRO') == 'humble':
            patch.setenv('ROS_LOCALHOST_ONLY', '1')
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('log')))
        yield


@pytest.fixture(scope='session')
def shipped_tags():
    return json.loads((CONFIGS / 'tag_locations.json').read_text(encoding='utf-8'))['tags']


@pytest.fixture(scope='session')
def warm_tag_id(shipped_tags):
    """Return a tag that has the temperature, which is free of noise."""
    return next(tag_id for tag_id, tag in shipped_tags.items() if 'temperature' in tag['sensors'])


@pytest.fixture(scope='session')
def shipped_config():
    return yaml.safe_load((CONFIGS / 'greenhouse_config.yaml').read_text(encoding='utf-8'))


def is_open_source_tree() -> bool:
    """Tell the two trees apart, for the one thing that they do differently."""
    return 'greenhouse' in GetTagReading.__module__.split('.')[0]


@contextlib.contextmanager
def spinning_node(name: str):
    """Yield a node of a context of its own, which a thread spins."""
    context = Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node(name, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    spinner = threading.Thread(target=executor.spin, daemon=True)
    spinner.start()
    try:
        yield node
    finally:
        executor.shutdown()
        spinner.join(PATIENCE_SECONDS)
        node.destroy_node()
        rclpy.shutdown(context=context)


def call(client, request):
    """Call a service and return the response; fail when none comes."""
    answered = threading.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _future: answered.set())
    assert answered.wait(PATIENCE_SECONDS), 'no answer'
    return future.result()


def wait_until(is_so):
    """Look again until it is so; fail when that takes too long. For the graph, which notifies nobody."""
    pause = threading.Event()
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not is_so():
        assert time.monotonic() < deadline, 'it did not come to be'
        pause.wait(0.002)


class NodeProcess:
    """One real node process in a namespace of its own, and its log."""

    def __init__(self, stack: contextlib.ExitStack, command: list[str], parameters: dict, environment: dict):
        self._stack = stack
        self.namespace = next(NAMESPACES)
        overrides = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
        self.process = subprocess.Popen(
            [*command, '--ros-args', '-r', f'__ns:={self.namespace}', *overrides],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={**os.environ, **environment},
            text=True,
        )
        stack.callback(self._end)
        self.log = []
        self._lines = queue.SimpleQueue()
        threading.Thread(target=self._read_log, daemon=True).start()

    def _read_log(self):
        for line in self.process.stdout:
            self._lines.put(line.rstrip('\n'))
        self._lines.put(None)

    def _end(self):
        self.process.kill()
        self.process.wait()

    def wait_for_log(self, fragment: str) -> str:
        """Return the next log line that holds the fragment; fail when the process ends without it."""
        while True:
            line = self._lines.get(timeout=PATIENCE_SECONDS)
            assert line is not None, f'no {fragment!r} in the log:\n' + '\n'.join(self.log)
            self.log.append(line)
            if fragment in line:
                return line

    def rest_of_log(self) -> list[str]:
        """Return the whole log of a process that ends."""
        while (line := self._lines.get(timeout=PATIENCE_SECONDS)) is not None:
            self.log.append(line)
        return self.log

    def refusal(self, exit_code: int = 1) -> str:
        """Return the one FATAL line of a node that refuses to start, with its exit code and no traceback."""
        log = self.rest_of_log()
        assert self.process.wait(PATIENCE_SECONDS) == exit_code, log
        assert 'Traceback' not in '\n'.join(log)
        (fatal,) = [line for line in log if '[FATAL]' in line]
        return fatal

    def stop(self, number=signal.SIGTERM) -> int:
        """Send a signal, and return the exit code."""
        self.process.send_signal(number)
        return self.process.wait(PATIENCE_SECONDS)


class Bridge(NodeProcess):
    """One real bridge and, once connected, a client of its service."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.service_name = f'{self.namespace}/greenhouse_bridge/get_tag_reading'
        self.node = None
        self._client = None

    def connect(self):
        """Wait until the service is there, and return its client."""
        if self._client is None:
            self.wait_for_log('ready:')
            # A participant that is younger than the bridge: an older one may take 3 s to discover it.
            self.node = self._stack.enter_context(spinning_node('contract_test'))
            self._client = self.node.create_client(GetTagReading, self.service_name, qos_profile=CLIENT_QOS)
            assert self._client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
        return self._client

    def call(self, tag_id: str) -> GetTagReading.Response:
        """Ask over ROS for the reading at a tag."""
        return call(self.connect(), GetTagReading.Request(tag_id=tag_id))

    def values(self, tag_id: str) -> dict[str, float]:
        """Return the readings at a tag by sensor name; fail on any other status than OK."""
        response = self.call(tag_id)
        assert (response.status, response.error_message) == (GetTagReading.Response.STATUS_OK, '')
        return {each.name: each.value for each in response.reading.readings}


class BridgeStarter:
    """Starts bridges one after the other: each ends when the next one starts."""

    def __init__(self, stack: contextlib.ExitStack):
        self._stack = stack

    def __call__(
        self, alteration: str | None = None, environment: dict | None = None, **parameters
    ) -> Bridge:
        """Start a bridge with these parameters; `alteration` names a function of altered_bridge.py."""
        self._stack.close()
        command = [str(EXECUTABLES / 'bridge_node')]
        if alteration:
            command = [sys.executable, str(ALTERED_BRIDGE), alteration]
        return Bridge(self._stack, command, parameters, environment or {})


@pytest.fixture
def start_bridge():
    """Return a function that starts a bridge for this test; it ends with the test."""
    with contextlib.ExitStack() as stack:
        yield BridgeStarter(stack)


@pytest.fixture(scope='module')
def noon_bridge():
    """Return a bridge on the shipped greenhouse, frozen at noon."""
    with contextlib.ExitStack() as stack:
        yield BridgeStarter(stack)(debug_time_of_day=12.0)
