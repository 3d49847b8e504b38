"""The environments of both trees, a copy of the checkout, and the mark of the tests that need Drake."""

import os
import platform
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENTS = {
    'monorepo': Path(os.environ['VIRTUAL_ENV']),
    'lupin_greenhouse_ros': Path(os.environ.get('MIRROR_VENV') or os.environ['VIRTUAL_ENV']),
}

# Drake has a wheel for x86_64 only. There, a failed installation fails the tests.
needs_drake = pytest.mark.skipif(
    platform.machine() != 'x86_64', reason='Drake has no wheel for this processor'
)


@pytest.fixture
def copy(tmp_path):
    """Return a copy of the checkout, whose packages are those that are built already."""
    names = subprocess.run(
        ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'],
        cwd=ROOT,
        capture_output=True,
        check=True,
    ).stdout
    folder = tmp_path / 'copy'
    folder.mkdir()
    subprocess.run(['xargs', '-0', 'cp', '--parents', '-t', folder], cwd=ROOT, input=names, check=True)
    return folder
