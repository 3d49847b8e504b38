"""Make the scripts of ci/ importable, and name the environments of both trees."""

import os
import platform
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))


def pytest_configure(config):
    """Register the marker of the tests that only ci/test_heavy runs."""
    config.addinivalue_line('markers', 'heavy: takes a minute or more')


ENVIRONMENTS = {
    'monorepo': Path(os.environ['VIRTUAL_ENV']),
    'lupin_greenhouse_ros': Path(os.environ.get('MIRROR_VENV') or os.environ['VIRTUAL_ENV']),
}

# Drake has a wheel for x86_64 only. There, a failed installation fails the tests.
needs_drake = pytest.mark.skipif(
    platform.machine() != 'x86_64', reason='Drake has no wheel for this processor'
)
