"""The real node confirm_tag, and a camera that the test commands."""

import contextlib
import importlib.util
import sys
from pathlib import Path

import pytest

# What the bridge's tests share, from beside this package: nodes as processes, on a domain of the run's own.
_path = Path(__file__).resolve().parents[2] / 'lupin_greenhouse_bridge/test/conftest.py'
_spec = importlib.util.spec_from_file_location('bridge_conftest', _path)
bridge = sys.modules['bridge_conftest'] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(bridge)
own_domain = bridge.own_domain


@pytest.fixture
def stack():
    with contextlib.ExitStack() as stack:
        yield stack
