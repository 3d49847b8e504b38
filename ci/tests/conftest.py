"""The environments of both trees, make as a user runs it, and a copy of the checkout."""

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


def of_a_user(**variables: str) -> dict[str, str]:
    """Return the variables of a shell that is not started by make, with the environment of the monorepo."""
    own = {name: value for name, value in os.environ.items() if not name.startswith('MAKE')}
    return own | {'VENV': os.environ['VIRTUAL_ENV'], 'TREE': 'monorepo'} | variables


def make(*words: str, cwd: Path = ROOT, **variables: str) -> subprocess.CompletedProcess:
    """Run make with what is built already."""
    return subprocess.run(
        ['make', '-f', ROOT / 'Makefile', '-o', 'bridge', '-o', 'build', *words],
        cwd=cwd,
        env=of_a_user(**variables),
        capture_output=True,
        text=True,
        check=False,
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
