"""Fixtures of the contract tests."""

import importlib.util
import inspect
import os
import sys
from pathlib import Path

# Set before the messages are imported: a wrong type in a field raises, here and in the bridge.
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'

import pytest
import yaml
from lupin_greenhouse_bridge import simulation
from lupin_greenhouse_bridge.bridge_node import _config_path
from lupin_greenhouse_bridge.client import GetTagReading

pytest_plugins = ['lupin_greenhouse_bridge.testing']
# Without launch, the test of the launch file cannot run.
collect_ignore = [] if importlib.util.find_spec('launch_testing') else ['test_launch.py']
ALTERED_BRIDGE = Path(__file__).parent / 'altered_bridge.py'


@pytest.fixture(scope='session')
def warm_tag_id(shipped_tags):
    """Return a tag with a temperature, which has no noise."""
    return next(tag_id for tag_id, tag in shipped_tags.items() if 'temperature' in tag['sensors'])


@pytest.fixture(scope='session')
def shipped_config():
    """Return the config of the installed simulator."""
    return yaml.safe_load(simulation.shipped_file('greenhouse_config.yaml').read_text(encoding='utf-8'))


@pytest.fixture(scope='session')
def takes_tag_files():
    """Return whether this tree serves a custom tag file; the mirror only with custom_tag_file.patch."""
    is_open_source = 'greenhouse' in GetTagReading.__module__.split('.')[0]
    return not is_open_source or 'Path(value)' in inspect.getsource(_config_path)


@pytest.fixture(scope='session')
def altered():
    """Return a function that returns the command of an altered bridge."""
    return lambda alteration: [sys.executable, str(ALTERED_BRIDGE), alteration]


@pytest.fixture(scope='module')
def noon_bridge():
    """Return a bridge with the shipped greenhouse, frozen at noon."""
    from lupin_greenhouse_bridge.testing import (
        Bridge,
        closing_all,
    )  # imported here, so that pytest rewrites its assertions

    with closing_all() as closed_at_the_end:
        yield closed_at_the_end(Bridge(debug_time_of_day=12.0))
