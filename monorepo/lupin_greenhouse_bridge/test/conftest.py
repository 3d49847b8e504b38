# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Fixtures of the contract tests."""
# ruff: noqa: E402 (pytest has to know of the package testing before it is imported here)

import contextlib
import fcntl
import importlib.util
import os
import pty
import signal
import struct
import subprocess
import termios
import threading
from pathlib import Path

# Set before the messages are imported: a wrong type in a field raises, here and in the bridge.
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'

import hypothesis
import pytest
import yaml

pytest.register_assert_rewrite('lupin_greenhouse_bridge.testing')
from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.reading import read_tag
from lupin_greenhouse_bridge.simulator.layout import shipped_file
from lupin_greenhouse_bridge.testing.commands import SPINS
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS, call

pytest_plugins = ['lupin_greenhouse_bridge.testing']
# No test may depend on the speed of the machine.
hypothesis.settings.register_profile(
    'unhurried', deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile('unhurried')
# The mirror serves a custom tag file only with custom_tag_file.patch.
TAKES_TAG_FILES = isinstance(bridge_node._config_path('x'), Path)
HAS_LAUNCH = bool(importlib.util.find_spec('launch_ros'))


def pytest_report_header():
    return None if HAS_LAUNCH else 'launch_ros is not installed: the tests of the launch file are left out'


def pytest_collection_modifyitems(items):
    if not HAS_LAUNCH:
        items[:] = [item for item in items if 'launch' not in item.fixturenames]


@pytest.fixture(scope='session')
def launch():
    """Return the package launch, with the modules that the tests use."""
    import launch.event_handlers

    return launch


@pytest.fixture(scope='session')
def warm_tag_id(shipped_tags):
    """Return a tag with a temperature, which has no noise."""
    return next(tag_id for tag_id, tag in shipped_tags.items() if 'temperature' in tag['sensors'])


@pytest.fixture(scope='session')
def shipped_config():
    return yaml.safe_load(shipped_file('greenhouse_config.yaml').read_text(encoding='utf-8'))


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
