"""The environments of both trees, and the mark of the tests that need Drake."""

import os
import platform
from pathlib import Path

import pytest

ENVIRONMENTS = {
    'monorepo': Path(os.environ['VIRTUAL_ENV']),
    'lupin_greenhouse_ros': Path(os.environ.get('MIRROR_VENV') or os.environ['VIRTUAL_ENV']),
}

# Drake has a wheel for x86_64 only. There, a failed installation fails the tests.
needs_drake = pytest.mark.skipif(
    platform.machine() != 'x86_64', reason='Drake has no wheel for this processor'
)
