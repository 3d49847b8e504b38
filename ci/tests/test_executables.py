"""Every executable of every package answers --help, and starts nothing."""

import os
import subprocess
from pathlib import Path

import pytest

INSTALLED = Path(os.environ['LUPIN_WORKSPACE'], 'install')
EXECUTABLES = sorted(
    path for path in INSTALLED.glob('*/lib/lupin_*/*') if os.access(path, os.X_OK) and path.is_file()
)


def test_each_package_with_commands_is_here():
    packages = {path.parent.name for path in EXECUTABLES}
    assert packages == {
        'lupin_greenhouse_bridge',
        'lupin_mission',
        'lupin_simulation',
        'lupin_tag_confirmation',
    }


@pytest.mark.parametrize('executable', EXECUTABLES, ids=lambda path: path.name)
def test_help_says_what_it_does_and_how_with_exit_code_0_and_leaves_no_file(executable, tmp_path):
    ended = subprocess.run(
        [executable, '--help'], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
    )
    assert (ended.returncode, ended.stderr) == (0, '')
    is_node = f'ros2 run {executable.parent.name} ' in ended.stdout and 'Parameters and' in ended.stdout
    assert is_node or ended.stdout.startswith(f'usage: {executable.name} ')
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    'executable', [path for path in EXECUTABLES if path.name in ('bridge_node', 'record_readings')]
)
def test_a_node_refuses_an_argument_that_it_does_not_know(executable, tmp_path):
    ended = subprocess.run(
        [executable, 'readings.csv'], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
    )
    assert ended.returncode == 1
    assert "unknown argument 'readings.csv': set parameters with --ros-args -p name:=value" in ended.stderr
    assert not list(tmp_path.iterdir())
