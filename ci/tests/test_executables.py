"""Every executable of every package answers --help, and starts nothing."""

import json
import os
import pty
import subprocess
import sys
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import rclpy
from checkout import ROOT, run
from lupin_greenhouse_bridge.recording.rows import make_rows
from lupin_greenhouse_bridge.recording.store import Store

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
            command = entry.load().args[0]  # the module that process.start() would import
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


@pytest.mark.parametrize('command', ['generate_world', 'inspection', 'tag_sheet', 'figure'])
def test_a_folder_to_write_to_is_not_the_name_of_a_file(refusal, command, tmp_path):
    told = refusal(command, '--output', str(tmp_path / 'new/x.pdf'))
    assert told.endswith("x.pdf' is the name of a file: name a folder\n")
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope='module')
def inputs(tmp_path_factory):
    """Return a folder with what the commands read."""
    folder = tmp_path_factory.mktemp('inputs')
    Store(str(folder / 'readings.sqlite')).keep(
        make_rows(1, '1', [('co2', 600.0)], 43200.0, 'test', (1.6, 1.3))
    )
    tags = {'tags': {'1': {'x': 1.0, 'y': 0.0, 'sensors': ['co2']}}, 'tables': {}}
    (folder / 'tags.json').write_text(json.dumps(tags), encoding='utf-8')
    return folder


WORK = {
    'bridge_node': ('--help', ''),
    'readings_page': ('{}/readings.sqlite -o page.html', 'page.html'),
    'inspection': ('--output mission tag_sequence:=1', 'mission'),
}


# A closed output is None in Python; a pipe that nobody reads is written to like a file.
CASES = [
    ('bridge_node', '>/dev/full'),
    ('readings_page', '>/dev/full'),
    ('readings_page', '>&-'),
    ('readings_page', '>&3'),
    pytest.param('inspection', '>/dev/full', marks=pytest.mark.heavy),  # a whole mission
]


@pytest.mark.parametrize(('name', 'output'), CASES)
def test_an_output_that_takes_nothing_is_one_line_with_an_exit_code_of_its_own(
    inputs, tmp_path, name, output
):
    (path,) = (each for each in EXECUTABLES if each.name == name)
    words, written = WORK[name]
    closed_pipe = 'exec 3> >(true); wait $!'
    command = f'{closed_pipe}; exec "$0" {words.format(inputs)} {output}'
    ended = run('bash', '-c', command, path, cwd=tmp_path)
    assert ended.returncode == 4, ended.stderr
    assert f'{name}: standard output cannot be written: ' in ended.stderr
    assert 'Traceback' not in ended.stderr
    assert (tmp_path / written).exists()


@pytest.mark.parametrize('encoding', ['ascii', 'latin-1'])
def test_an_output_is_utf_8_but_a_terminal_keeps_its_encoding(inputs, monkeypatch, encoding):
    monkeypatch.setenv('PYTHONIOENCODING', encoding)
    monkeypatch.setenv('PYTHONUTF8', '0')
    (path,) = (each for each in EXECUTABLES if each.name == 'approach_poses')
    command = [str(path), '--tag-file', str(inputs / 'tags.json')]
    ended = subprocess.run(command, capture_output=True, check=True)
    assert 'yaw (°)'.encode() in ended.stdout
    printed = []

    def read(terminal):
        printed.append(os.read(terminal, 65536))
        return printed[-1]

    assert pty.spawn(command, read) == 0
    assert 'yaw (°)'.encode(encoding, 'replace') in b''.join(printed)
