"""Without its optional modules, a package's tests are collected all the same; those that need them skip."""

import os
import sys
from pathlib import Path

import pytest
from conftest import NEED_LAUNCH, ROOT, run, succeed

HIDE = """
import sys
class Without:
    def __init__(self, finder):
        self.finder = finder
    def find_spec(self, name, *arguments):
        return None if name.split('.')[0] in {modules!r} else self.finder.find_spec(name, *arguments)
    def __getattr__(self, name):
        return getattr(self.finder, name)
sys.meta_path[:] = map(Without, sys.meta_path)
"""


@pytest.mark.parametrize(
    ('package', 'modules'),
    [
        ('lupin_greenhouse_bridge', ['matplotlib', 'apriltag_msgs']),
        ('lupin_mission', ['nav2_msgs']),
        ('lupin_simulation', ['nav2_msgs']),
    ],
)
def test_every_test_module_is_collected_without_optional_modules(tmp_path, package, modules):
    """launch_testing imports each test module in the same way."""
    (tmp_path / 'sitecustomize.py').write_text(HIDE.format(modules=modules), encoding='utf-8')
    path = {'PYTHONPATH': os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')])}
    for module in modules:
        hidden = run(sys.executable, '-c', f'import {module}', env=os.environ | path)
        assert f"No module named '{module}'" in hidden.stderr
    collect = (sys.executable, '-m', 'pytest', '--collect-only', '-q', '-p', 'no:cacheprovider', 'test')
    folder = ROOT / 'monorepo' / package
    listed = succeed(*collect, cwd=folder, env=os.environ | path)
    collected = {Path(line.partition('::')[0]).stem for line in listed.splitlines() if '::' in line}
    written = {path.stem for path in folder.glob('test/test_*.py')}
    assert collected | NEED_LAUNCH == written | NEED_LAUNCH
