"""The packages build without a warning, both ways that colcon installs."""

import os
import subprocess
from pathlib import Path

import pytest
from conftest import ENVIRONMENTS

ROOT = Path(__file__).resolve().parents[2]


def colcon_build_of_the_bridge(tree, base, *arguments):
    """Build the bridge over the tree's messages, in a folder of its own; return what colcon printed."""
    script = (
        'source ci/ros_env.bash && unset PYTHONDONTWRITEBYTECODE && exec python -m colcon'
        ' --log-base "$0/log" build --build-base "$0/build" --install-base "$0/install" "$@"'
    )
    result = subprocess.run(
        ['bash', '-c', script, str(base), '--paths', f'{tree}/lupin_greenhouse_bridge', *arguments],
        cwd=ROOT,
        env={**os.environ, 'TREE': tree, 'VENV': str(ENVIRONMENTS[tree])},
        capture_output=True,
        text=True,
        check=True,
    )
    return result.stdout + result.stderr


@pytest.mark.parametrize('tree', ENVIRONMENTS)
@pytest.mark.parametrize('is_symlinked', [False, True], ids=['copied', 'symlinked'])
def test_the_bridge_builds_without_a_warning(tmp_path, tree, is_symlinked):
    arguments = ['--symlink-install'] if is_symlinked else []
    printed = colcon_build_of_the_bridge(tree, tmp_path, *arguments)
    assert 'Finished <<< lupin_greenhouse_bridge' in printed
    assert 'warning' not in printed.lower()
    assert 'stderr' not in printed
    share = tmp_path / 'install/lupin_greenhouse_bridge/share/lupin_greenhouse_bridge'
    launch_file = share / 'launch/greenhouse_bridge.launch.py'
    assert launch_file.exists()
    source = ROOT / tree / 'lupin_greenhouse_bridge/launch/greenhouse_bridge.launch.py'
    assert (launch_file.resolve() == source) == is_symlinked


@pytest.mark.parametrize('tree', ENVIRONMENTS)
def test_the_whole_tree_was_built_without_a_warning(tree):
    """What the last `make build` of the tree printed."""
    log = (ENVIRONMENTS[tree] / 'workspace' / tree / 'build.log').read_text()
    assert 'Finished <<< lupin_greenhouse_bridge' in log
    assert 'warning' not in log.lower()
    assert 'stderr' not in log
