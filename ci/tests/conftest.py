"""Make the environment's scripts importable, and say where `ci/test` has built which tree."""

import os
import platform
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))


def pytest_configure(config):
    """Name the marker of what `ci/test` leaves to `ci/test_heavy`."""
    config.addinivalue_line('markers', 'heavy: takes a minute or more')


ENVIRONMENTS = {
    'monorepo': Path(os.environ['VIRTUAL_ENV']),
    'lupin_greenhouse_ros': Path(os.environ.get('MIRROR_VENV') or os.environ['VIRTUAL_ENV']),
}

# On this processor its wheel exists: a Drake that cannot be had there fails.
needs_drake = pytest.mark.skipif(
    platform.machine() != 'x86_64', reason='Drake has no wheel for this processor'
)
