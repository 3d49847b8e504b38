"""A whole inspection, in simulation and with a camera: the report and the picture that it writes."""

import importlib.util
import json
import math
import os
import signal
import subprocess
import sys
from argparse import Namespace
from pathlib import Path

import pytest
from lupin_greenhouse_bridge.display.places import read_route
from lupin_greenhouse_bridge.planning.approach import ViewingLimits, find_approaches
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.simulator.layout import find_layout
from lupin_greenhouse_bridge.testing import PATIENCE_SECONDS, executable, wait_until
from lupin_mission.settings import Settings as MissionSettings
from lupin_simulation import inspection
from lupin_tag_confirmation.settings import Settings as CameraSettings


def run_inspection(output: Path, *arguments: str, attempts: int = 1000) -> subprocess.CompletedProcess:
    """Run an inspection whose mission waits longer than by default: a node of it may start late."""
    command = [executable('lupin_simulation', 'inspection'), '--output', str(output), *arguments]
    patience = ['scan_timeout_s:=10', 'retry_delay_seconds:=0.1', f'max_attempts:={attempts}']
    return subprocess.run([*command, *patience], capture_output=True, text=True, check=False)


def options_of(output: Path, **options) -> Namespace:
    """Return the options of a command line."""
    return Namespace(
        **{'camera': None, 'world': False, 'drive': False, 'output': output, 'arguments': [], **options}
    )


@pytest.fixture(autouse=True)
def signals(monkeypatch):
    """Give the process its signals back: inspection.main() takes it for its own."""
    monkeypatch.setattr(process, '_is_asked_to_end', False)
    before = {number: signal.getsignal(number) for number in process.SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Return a function that puts a shell script in the place of an executable."""
    monkeypatch.setattr(inspection, 'executable', lambda _package, name: str(tmp_path / name))

    def write(name: str, script: str) -> None:
        (tmp_path / name).write_text(f'#!/bin/sh\n{script}\n', encoding='utf-8')
        (tmp_path / name).chmod(0o755)

    return write


@pytest.mark.parametrize(
    ('arguments', 'name', 'tag_ids'),
    [([], 'simulation', None), (['--camera', 'image', 'tag_sequence:="1 5 7"'], 'camera', ['1', '5', '7'])],
    ids=['simulation', 'images'],
)
def test_the_mission_reads_every_tag_and_leaves_a_report_and_a_picture(tmp_path, arguments, name, tag_ids):
    result = run_inspection(tmp_path, *arguments)
    assert result.returncode == 0, result.stdout + result.stderr
    lines = [
        json.loads(line) for line in (tmp_path / f'{name}.jsonl').read_text(encoding='utf-8').splitlines()
    ]
    assert {line['outcome'] for line in lines} == {'OK'}
    assert len(lines) == len({line['tag_id'] for line in lines})
    assert tag_ids in (None, [line['tag_id'] for line in lines])
    assert f'{len(lines)}/{len(lines)} tags read' in result.stdout
    assert (tmp_path / f'{name}.png').read_bytes().startswith(b'\x89PNG')
    assert (tmp_path / f'{name}.html').exists()
    assert 'Traceback' not in result.stderr


def test_a_drive_goes_on_past_the_tags_that_its_robot_cannot_reach(tmp_path):
    """A large robot has no way to tag 13; the navigator alone knows that the place before tag 7 is taken."""
    layout = find_layout('')
    x, y = find_approaches(layout, ViewingLimits(robot_radius_m=0.3)).poses['7'][:2]
    blocked = f'blocked:="{x - 0.1} {y - 0.1} {x + 0.1} {y + 0.1}"'
    result = run_inspection(tmp_path, '--drive', 'robot_radius_m:=0.3', blocked, 'tag_sequence:="7 13 1"')
    assert result.returncode == 1, result.stdout + result.stderr
    lines = (tmp_path / 'simulation.jsonl').read_text(encoding='utf-8').splitlines()
    found = {each['tag_id']: (each['outcome'], each['detail']) for each in map(json.loads, lines)}
    assert found.pop('1') == ('OK', '')
    assert found.pop('13') == ('UNREACHABLE', 'cut off from the rest of the floor')
    outcome, detail = found.pop('7')
    assert outcome == 'UNREACHABLE'
    assert detail.startswith('navigate_to_pose aborted the drive')
    assert '1/3 tags read' in result.stdout
    route = read_route(tmp_path / 'simulation-route.csv')
    assert min(math.dist(each, layout.tags['1'][:2]) for each in route) < 1.0
    assert route[-1] == (0.5, 0.5)  # the dock is where the robot started
    assert 'Traceback' not in result.stderr


def test_a_tag_that_is_none_of_the_cameras_family_is_not_read(tmp_path):
    result = run_inspection(tmp_path, '--camera', 'image', 'tag_sequence:="600"', attempts=5)
    assert result.returncode == 1
    (line,) = (tmp_path / 'camera.jsonl').read_text(encoding='utf-8').splitlines()
    observation = json.loads(line)
    assert observation['outcome'] == 'NOT_CONFIRMED'
    assert 'tag36h11' in observation['detail']


def test_a_world_with_another_camera_is_refused_in_one_line(tmp_path, capsys):
    assert inspection.main(['--camera', 'detections', '--world', '--output', str(tmp_path)]) == 2
    assert (
        capsys.readouterr().err
        == 'mission: WORLD=1 publishes images only: leave CAMERA out, or set CAMERA=1\n'
    )


@pytest.mark.usefixtures('stand_in')
def test_an_output_that_is_no_folder_is_refused_in_one_line(tmp_path, capsys):
    (tmp_path / 'file').touch()
    assert inspection.main(['--output', str(tmp_path / 'file')]) == 2
    assert capsys.readouterr().err == f"mission: --output '{tmp_path}/file': File exists: name a folder\n"


@pytest.mark.parametrize('camera', [(), ('--camera', 'image')])
def test_a_world_without_drake_is_refused_before_anything_starts(tmp_path, monkeypatch, capsys, camera):
    monkeypatch.setattr(inspection, 'executable', lambda *names: str(tmp_path.joinpath(*names)))
    monkeypatch.setattr(importlib.util, 'find_spec', lambda _name: None)
    assert inspection.main([*camera, '--world', '--output', str(tmp_path)]) == 2
    assert capsys.readouterr().err == (
        'mission: Drake is missing, which renders the world: pip install drake\n'
    )


@pytest.mark.parametrize(
    ('first', 'last', 'error'),
    [
        (
            'bridge_node',
            'mission_orchestrator',
            'mission: bridge_node ended before the mission, with exit code 1: its log is above\n',
        ),
        ('mission_orchestrator', 'bridge_node', ''),
    ],
)
def test_the_first_node_that_ends_ends_the_run_and_is_named_unless_it_is_the_mission(
    tmp_path, capfd, stand_in, first, last, error
):
    process_id = tmp_path / 'process_id'
    stand_in(last, f'echo $$ >{process_id}; exec sleep 600')
    stand_in(first, f'until [ -s {process_id} ]; do sleep 0.05; done; exit 1')
    for name in ('plot_report', 'readings_page'):
        stand_in(name, '')
    assert inspection.main(['--output', str(tmp_path / 'output')]) == 1
    assert capfd.readouterr().err == error
    with pytest.raises(ProcessLookupError):
        os.kill(int(process_id.read_text(encoding='utf-8')), 0)


def test_sigterm_ends_all_that_an_inspection_started(tmp_path, stand_in):
    nodes = ['bridge_node', 'mission_orchestrator']
    for name in nodes:
        stand_in(name, f'echo $$ >{tmp_path / name}.id; exec sleep 600')
    program = f"""
import sys
from lupin_mission.settings import Settings as MissionSettings
from lupin_simulation import inspection
from lupin_tag_confirmation.settings import Settings as CameraSettings
inspection.executable = lambda _package, name: f'{tmp_path}/{{name}}'
sys.exit(inspection.main(['--output', '{tmp_path}/output']))
"""
    process_ids = [tmp_path / f'{name}.id' for name in nodes]
    with subprocess.Popen([sys.executable, '-c', program], stderr=subprocess.PIPE, text=True) as running:
        wait_until(lambda: all(each.exists() and each.read_text(encoding='utf-8') for each in process_ids))
        running.terminate()
        assert running.wait(PATIENCE_SECONDS) == 130
        assert running.stderr.read() == ''
    for each in process_ids:
        with pytest.raises(ProcessLookupError):
            os.kill(int(each.read_text(encoding='utf-8')), signal.SIGTERM)


@pytest.mark.parametrize('number', process.SIGNALS)
@pytest.mark.parametrize('last', ['bridge_node', 'mission_orchestrator'])
def test_a_signal_ends_a_node_that_has_just_been_started(tmp_path, monkeypatch, stand_in, last, number):
    started = []

    class Popen(subprocess.Popen):
        def __init__(self, command, **keywords):
            super().__init__(command, **keywords)
            started.append(self)
            if Path(command[0]).name == last:
                signal.raise_signal(number)

    for name in ('bridge_node', 'mission_orchestrator'):
        stand_in(name, 'exec sleep 600')
    monkeypatch.setattr(inspection.subprocess, 'Popen', Popen)
    assert inspection.main(['--output', str(tmp_path / 'output')]) == 130
    assert started
    assert all(each.returncode == -signal.SIGTERM for each in started)


@pytest.mark.parametrize('script', ['kill -TERM $PPID', 'kill -INT $PPID; exit 1'])
@pytest.mark.parametrize('name', ['generate_world', 'plot_report', 'readings_page'])
def test_a_signal_ends_what_comes_before_or_after_a_mission(tmp_path, monkeypatch, stand_in, name, script):
    """Ctrl-C in a terminal ends the command too, which is no fault of the world."""
    monkeypatch.setattr(importlib.util, 'find_spec', lambda _name: True)
    for node in ('bridge_node', 'confirm_tag', 'world_camera'):
        stand_in(node, 'exec sleep 600')
    for command in ('generate_world', 'mission_orchestrator', 'plot_report', 'readings_page'):
        stand_in(command, '')
    stand_in(name, script)
    assert inspection.main(['--world', '--output', str(tmp_path / 'output')]) == 130


def test_each_argument_reaches_the_node_that_has_such_a_parameter():
    of_both, of_mission, of_navigator, unknown = (
        'robot_radius_m:=0.3',
        'order:=numeric',
        'blocked:=0 0 1 1',
        'a:=1',
    )
    assert inspection.share([of_both, of_mission, of_navigator, unknown]) == (
        [of_both, of_mission, unknown],
        [of_both, of_navigator],
    )


@pytest.mark.usefixtures('stand_in')
def test_a_camera_of_a_drive_is_on_the_robot(tmp_path):
    (_, navigator, _, camera), mission = inspection.nodes_of(
        options_of(tmp_path, camera='image', drive=True, arguments=['blocked:=0 0 1 1', 'order:=given'])
    )
    assert Path(navigator[0]).name == 'fake_navigator'
    assert 'blocked:=0 0 1 1' in navigator
    assert 'from_odometry:=true' in camera
    assert mission[:2] == ['drive:=nav2', 'order:=shortest']
    assert mission[-1] == 'order:=given'  # the last assignment counts


def test_the_camera_replies_before_the_missions_give_up():
    """Otherwise a tag that is not in view has no reason in the report."""
    camera_seconds = CameraSettings().timeout_seconds
    of_the_team = 3.0  # its visual_confirmation_timeout_s
    assert camera_seconds < min(of_the_team, MissionSettings().visual_confirmation_timeout_s)
