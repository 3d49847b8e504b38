# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Fixtures of the contract tests."""
# ruff: noqa: E402 (pytest has to know of the package testing before it is imported here)

import contextlib
import fcntl
import importlib.util
import json
import os
import pty
import signal
import struct
import subprocess
import termios
import threading
from pathlib import Path
from typing import ClassVar, NamedTuple

# Set before the messages are imported: a wrong type in a field raises, here and in the bridge.
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'

import hypothesis
import pytest
import yaml

pytest.register_assert_rewrite('lupin_greenhouse_bridge.testing')
from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.interfaces import GetTagReading, SensorReading, TagReading
from lupin_greenhouse_bridge.reading import read_tag
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.simulator import simulation
from lupin_greenhouse_bridge.testing import Bridge
from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS, call, spinning_node
from lupin_greenhouse_bridge.testing._signals import raising
from rclpy.qos import QoSProfile
from rclpy.utilities import get_default_context

pytest_plugins = ['lupin_greenhouse_bridge.testing']
# No test may depend on the speed of the machine.
hypothesis.settings.register_profile(
    'unhurried', deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile('unhurried')
# The mirror serves a custom tag file only with custom_tag_file.patch.
TAKES_TAG_FILES = isinstance(bridge_node._config_path('x'), Path)
SPINS = 'rclpy/executors.py:spin_once'  # the moment at which a node is ready
NO_DETECTIONS = 'apriltag_msgs is missing'
START_S = 1795190000
LONGEST_HOLD_SECONDS = 30.0


def pytest_collection_modifyitems(items):
    """Leave out the tests of launch files where launch is missing. No test is ever skipped."""
    if not importlib.util.find_spec('launch_ros'):
        items[:] = [item for item in items if 'launch' not in item.fixturenames]


@pytest.fixture(scope='session')
def launch():
    """Return the package launch, with the modules that the tests use."""
    import launch.event_handlers

    return launch


@pytest.fixture
def write_layout(tmp_path):
    """Return a function that writes a tag file of places and tables (x0, y0, x1, y1); it returns the path."""

    def write(places_m, **tables):
        path, edges = tmp_path / 'tags.json', ('x0', 'y0', 'x1', 'y1')
        tags = {tag_id: {'x': x, 'y': y, 'sensors': ['co2']} for tag_id, (x, y) in places_m.items()}
        tables = {name: dict(zip(edges, each, strict=True)) for name, each in tables.items()}
        path.write_text(json.dumps({'tags': tags, 'tables': tables}), encoding='utf-8')
        return str(path)

    return write


@pytest.fixture(scope='session')
def warm_tag_id(shipped_tags):
    """Return a tag with a temperature, which has no noise."""
    return next(tag_id for tag_id, tag in shipped_tags.items() if 'temperature' in tag['sensors'])


@pytest.fixture(scope='session')
def shipped_config():
    return yaml.safe_load(simulation.shipped_file('greenhouse_config.yaml').read_text(encoding='utf-8'))


@pytest.fixture(scope='session')
def noon_process(own_domain):  # noqa: ARG001 (the domain comes first)
    """Return a bridge with the shipped greenhouse, frozen at noon, for the tests of a whole run."""
    with contextlib.closing(Bridge(debug_time_of_day=12.0)) as bridge:
        bridge.wait_for_log('ready:')
        yield bridge


@pytest.fixture
def noon_bridge(noon_process):
    """
    Return the bridge that is frozen at noon. Its client ends with the test.

    In the tests after it, a main() that is refused would end soon after its discovery by this client. The
    timer of one participant can then deadlock with the end of another (see testing/fast_dds.xml).
    """
    yield noon_process
    noon_process.disconnect()


class Ended(NamedTuple):
    """What is left of a command that ran in the test's process."""

    code: int
    out: str
    err: str

    @property
    def said(self) -> str:
        """Return the messages of read_tag, without the lines of the middleware."""
        return '\n'.join(line for line in self.err.splitlines() if line.startswith(('read_tag: ', 'usage: ')))

    @property
    def refusal(self) -> str:
        assert self.code == 1, self
        fatal = [line for line in self.err.splitlines() if '[FATAL]' in line]
        assert len(fatal) == 1, self
        return fatal[0]


def ended_process(command):
    ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_SECONDS, check=False)
    return ended.returncode, ended.stdout, ended.stderr


class Terminal:
    """A terminal of this size: its `stream` to print to, and the `text` that was printed."""

    def __init__(self, rows=24, columns=60):
        self._screen, terminal = pty.openpty()
        fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack('HHHH', rows, columns, 0, 0))
        self.stream = os.fdopen(terminal, 'w', encoding='utf-8')
        self.text = ''
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        with contextlib.suppress(OSError):  # of a terminal that nobody has open any more
            while part := os.read(self._screen, 4096):
                self.text += part.decode(errors='replace')

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stream.close()
        self._reader.join()
        os.close(self._screen)


def reading_of(tag_id, seconds=100, nanoseconds=0, time_of_day=0.0, **values) -> TagReading:
    readings = [SensorReading(name=name, value=value) for name, value in values.items()]
    reading = TagReading(tag_id=tag_id, sim_time_of_day_seconds=time_of_day, readings=readings)
    reading.stamp.sec, reading.stamp.nanosec = seconds, nanoseconds
    return reading


class HeldService:
    """A service of readings that replies only when the test lets it; `requests` are the tag ids."""

    name = '/held/get_tag_reading'
    status, error_message = GetTagReading.Response.STATUS_OK, ''
    fields: ClassVar = {}  # of the reading, in place of right ones

    def __init__(self, node):
        self.node, self.requests = node, []
        self._replies = threading.Semaphore(0)
        # Deep enough for the requests of many clients at once.
        node.create_service(GetTagReading, self.name, self._reply, qos_profile=QoSProfile(depth=1000))

    def _reply(self, request, response):
        if request.tag_id:  # no greeting
            self.requests.append(request.tag_id)
            self._replies.acquire(timeout=LONGEST_HOLD_SECONDS)
        response.status, response.error_message = self.status, self.error_message
        right = {
            'tag_id': request.tag_id,
            'sim_time_of_day_seconds': float(len(self.requests)),
            'readings': [SensorReading(name='co2', value=400.0)],
        }
        response.reading = TagReading(**{**right, **self.fields})
        return response

    def reply(self, times: int = 1) -> None:
        for _ in range(times):
            self._replies.release()


@contextlib.contextmanager
def running_held_service():
    with spinning_node('held') as node:
        service = HeldService(node)
        try:
            yield service
        finally:
            service.reply(1000)  # else its node could end only after LONGEST_HOLD_SECONDS


@pytest.fixture
def robot():
    """Return a node with its own context."""
    with spinning_node('robot') as node:
        yield node


@pytest.fixture
def held_service():
    with running_held_service() as service:
        yield service


@pytest.fixture
def run_here(capfd, monkeypatch):
    """
    Return a function that runs a main() in the test's process, and raises signals at these moments.

    A main() takes the process for its own: it leaves signals ignored, and ROS's default context used up.
    """
    not_taken = []
    before = {number: signal.getsignal(number) for number in process.SIGNALS}

    def run(main, *arguments, signals_at=None):
        for number in process.SIGNALS:
            signal.signal(number, lambda number, _frame: not_taken.append(number))
        monkeypatch.setattr(process, '_is_asked_to_end', False)
        monkeypatch.setattr(process, 'LONGEST_WAIT_SECONDS', 0.01)  # of a node that was just signalled
        threads = threading.enumerate()
        capfd.readouterr()
        try:
            with raising(signals_at or {}):
                code = main([main.__module__, *arguments])
        except SystemExit as end:  # of argparse
            code = end.code
        finally:
            get_default_context(shutting_down=True).try_shutdown()
        # A thread that is left would log into the next test, and could overwrite what pytest reads then.
        assert not (left := set(threading.enumerate()).difference(threads)), left
        ended = Ended(code, *capfd.readouterr())
        assert 'Traceback' not in ended.err, ended.err
        assert not not_taken
        return ended

    yield run
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def bridge_here(run_here):
    """Return a function that runs the bridge in the test's process until it is ready."""

    def run(*arguments, **parameters):
        overrides = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
        ros_arguments = ['--ros-args', *arguments, *overrides]
        return run_here(bridge_node.main, *ros_arguments, signals_at={SPINS: (signal.SIGTERM,)})

    return run


@pytest.fixture
def ask_here(run_nodes):
    """Return a function that runs the bridge in the test's process, and returns the client of its service."""

    def ask(**parameters):
        _, node = run_nodes(bridge_node.GreenhouseBridgeNode, **parameters)
        client = node.create_client(GetTagReading, '/greenhouse_bridge/get_tag_reading')
        return lambda tag_id: call(client, GetTagReading.Request(tag_id=tag_id))

    return ask


@pytest.fixture
def read_tag_here(run_here):
    patience = ('--timeout', str(PATIENCE_SECONDS))
    return lambda *arguments, **keywords: run_here(read_tag.main, *patience, *arguments, **keywords)


def visit(tag_id, outcome='OK', detail='', second=0, **values):
    """Return one visit of a tag, as a line of a mission's report has it."""
    is_read = outcome == 'OK'
    return {
        'tag_id': tag_id,
        'outcome': outcome,
        'detail': detail,
        'attempts': 1 if is_read else 3,
        'stamp': {'sec': START_S + second, 'nanosec': 0} if is_read else None,
        'sim_time_of_day_seconds': 43200.0 if is_read else None,
        'readings': values if is_read else None,
    }


def write_report(path: Path, *visits: dict) -> Path:
    path.write_text(''.join(f'{json.dumps(each)}\n' for each in visits), encoding='utf-8')
    return path
