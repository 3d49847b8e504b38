"""Without an optional module, a package's tests are collected all the same, and those that need it skip."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

MONOREPO = Path(__file__).resolve().parents[2] / 'monorepo'
HIDE = """
import sys
class Without:
    def __init__(self, finder):
        self.finder = finder
    def find_spec(self, name, *arguments):
        return None if name.split('.')[0] == {module!r} else self.finder.find_spec(name, *arguments)
    def __getattr__(self, name):
        return getattr(self.finder, name)
sys.meta_path[:] = map(Without, sys.meta_path)
"""


def collected(package, path='') -> set[str]:
    """Return the test modules that pytest collects; launch_testing imports each of them in the same way."""
    command = [sys.executable, '-m', 'pytest', '--collect-only', '-q', '-p', 'no:cacheprovider', 'test']
    environment = os.environ | {'PYTHONPATH': os.pathsep.join([path, os.environ.get('PYTHONPATH', '')])}
    run = subprocess.run(
        command, cwd=MONOREPO / package, env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stdout
    return {line.partition('::')[0] for line in run.stdout.splitlines() if '::' in line}


@pytest.mark.parametrize(
    ('package', 'module'),
    [
        ('lupin_greenhouse_bridge', 'matplotlib'),
        ('lupin_greenhouse_bridge', 'apriltag_msgs'),
        ('lupin_mission', 'nav2_msgs'),
        ('lupin_simulation', 'nav2_msgs'),
    ],
)
def test_every_test_module_is_collected_without_an_optional_module(tmp_path, package, module):
    (tmp_path / 'sitecustomize.py').write_text(HIDE.format(module=module), encoding='utf-8')
    hidden = subprocess.run(
        [sys.executable, '-c', f'import {module}'],
        env=os.environ | {'PYTHONPATH': str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert f"No module named '{module}'" in hidden.stderr
    assert collected(package, str(tmp_path)) == collected(package) != set()
