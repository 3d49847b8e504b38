"""Every executable of every package answers --help, and starts nothing."""

import os
import sys
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import rclpy
from checkout import ROOT, run

INSTALLED = Path(os.environ['LUPIN_WORKSPACE'], 'install')
EXECUTABLES = sorted(
    path for path in INSTALLED.glob('*/lib/lupin_*/*') if os.access(path, os.X_OK) and path.is_file()
)
MEASUREMENTS = [ROOT / f'tools/measure/{name}.py' for name in ('bench', 'soak')]


@pytest.mark.parametrize('executable', EXECUTABLES + MEASUREMENTS, ids=lambda path: path.name)
def test_help_says_what_it_does_and_how_with_exit_code_0_and_leaves_no_file(executable, tmp_path):
    ended = run(*[sys.executable] * (executable in MEASUREMENTS), executable, '--help', cwd=tmp_path)
    assert (ended.returncode, ended.stderr) == (0, '')
    is_node = f'ros2 run {executable.parent.name} ' in ended.stdout and 'Parameters and' in ended.stdout
    assert is_node or ended.stdout.startswith(f'usage: {executable.name} ')
    assert not list(tmp_path.iterdir())


# A command, an option with wrong values, and what its values must be.
NUMBERS = [
    *(('approach_poses', f'--{name} x', 'a number in metres, such as 0.5') for name in ('radius', 'start 1')),
    ('approach_poses', '--angle 1e999', 'a number of degrees, such as 30'),
    ('approach_poses', '--walls 0 0 1 nan', 'a number in metres, such as 0.5'),
    ('generate_world', '--side 4cm', 'a number in metres, such as 0.5'),
    ('register_discovered_tags', '--tags 4.0', 'a whole number, such as 4'),
    ('tag_sheet', '--side 4cm', 'a number in millimetres, such as 40'),
]


@pytest.fixture
def refusal(monkeypatch, capsys):
    """Return a function that runs a command in this process; it returns why the command line is refused."""

    def refused(command, *words):
        for entry in entry_points(group='console_scripts', name=command):
            command = entry.module
        monkeypatch.setattr(sys, 'argv', [command, *words])
        with pytest.raises(SystemExit) as ended:
            import_module(command).main()
        rclpy.try_shutdown()  # some take the arguments of ROS first
        assert ended.value.code == 2
        return capsys.readouterr().err.partition(': ')[2]

    return refused


@pytest.mark.parametrize(('command', 'option', 'accepted'), NUMBERS)
def test_an_option_says_which_number_it_takes(refusal, command, option, accepted):
    first, *_, wrong = words = option.split()
    assert refusal(command, *words) == f"error: argument {first}: '{wrong}': must be {accepted}\n"
