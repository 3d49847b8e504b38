"""A whole inspection, in simulation and with a camera: the report and the page that it writes."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import textwrap
from argparse import Namespace
from pathlib import Path

import pytest
from lupin_greenhouse_bridge.display.reading_file import read_route
from lupin_greenhouse_bridge.display.report_line import Observation, Outcome, Reading
from lupin_greenhouse_bridge.planning.approach import find_approaches
from lupin_greenhouse_bridge.planning.viewpoints import ViewingLimits
from lupin_greenhouse_bridge.planning.walls import find_walls
from lupin_greenhouse_bridge.recording.reading_files import read_rows
from lupin_greenhouse_bridge.recording.rows import HEADER
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.simulator.layout import find_layout
from lupin_greenhouse_bridge.testing._helpers import executable
from lupin_mission.settings import Settings as MissionSettings
from lupin_simulation import inspection, inspection_nodes
from lupin_tag_confirmation.settings import Settings as CameraSettings


def run_inspection(output: Path, *arguments: str) -> subprocess.CompletedProcess:
    """Run an inspection whose mission waits longer than by default: a node of it may start late."""
    command = [executable('lupin_simulation', 'inspection'), '--output', str(output), *arguments]
    patience = ['scan_timeout_s:=10', 'retry_delay_seconds:=0.1', 'max_attempts:=1000']
    return subprocess.run([*command, *patience], capture_output=True, text=True, check=False)


def report_in(output: Path) -> tuple[Path, list[dict]]:
    """Return the path of the one report in a folder, and its observations."""
    (report,) = output.glob('*.jsonl')
    return report, list(map(json.loads, report.read_text(encoding='utf-8').splitlines()))


def commands(*arguments: str, **options) -> dict[str, list[str]]:
    """Return the command of each node of a run, by its executable."""
    defaults = {'camera': None, 'drive': False, 'record': None, 'output': Path('out')}
    options = Namespace(**{**defaults, 'arguments': list(arguments), **options})
    found = inspection_nodes.commands_of(options, Path('out/2026-11-22-camera.jsonl'))
    return {Path(command[0]).name: command[1:] for command in found}


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
    """
    Return a function that puts a shell script in the place of executables; by default they run for long.

    Those that come after the mission do nothing.
    """
    folder = tmp_path / 'bin'
    folder.mkdir()
    for module in (inspection, inspection_nodes):
        monkeypatch.setattr(module, 'executable', lambda _package, name: str(folder / name))

    def write(*names: str, script: str = 'exec sleep 600') -> None:
        for name in names:
            (folder / name).write_text(f'#!/bin/sh\n{script}\n', encoding='utf-8')
            (folder / name).chmod(0o755)

    write('readings_page', script='')
    return write


def test_your_own_greenhouse_is_served_visited_with_a_camera_recorded_and_drawn(tmp_path, monkeypatch):
    tags = {tag_id: {'x': x, 'y': 1.0, 'sensors': ['co2']} for tag_id, x in (('7', 1.0), ('586', 2.0))}
    content = json.dumps({'tags': tags, 'tables': {}})
    (tmp_path / 'my tags.json').write_text(content, encoding='utf-8')
    monkeypatch.chdir(tmp_path)  # paths are relative to the folder of the command
    monkeypatch.setenv('ROS_DISCOVERY_SERVER', '127.0.0.1:11811')  # of a robot that is off
    own = ['tag_file:=my tags.json', 'debug_time_of_day:=12', 'tag_sequence:="586 7"']
    result = run_inspection(tmp_path / 'out', '--camera', 'image', '--record', 'kept.csv', *own)
    assert result.returncode == 0, result.stdout + result.stderr
    report, lines = report_in(tmp_path / 'out')
    assert re.fullmatch(r'\d{4}-\d\d-\d\d-\d{6}-camera.jsonl', report.name)
    assert '2/2 tags read' in result.stdout
    assert 'Traceback' not in result.stderr
    assert [(line['tag_id'], line['outcome']) for line in lines] == [('586', 'OK'), ('7', 'OK')]
    assert {line['sim_time_of_day_seconds'] for line in lines} == {43200.0}
    assert result.stdout.splitlines()[-1] == '2 rows kept in kept.csv'
    rows = {(row.tag_id, row.x_m, row.value) for row in read_rows(tmp_path / 'kept.csv')}
    values = {line['tag_id']: line['readings']['co2'] for line in lines}
    assert rows == {('7', 1.0, values['7']), ('586', 2.0, values['586'])}
    assert report.with_name(f'{report.stem}-tag_locations.json').read_text() == content
    assert '"586"' in report.with_suffix('.html').read_text(encoding='utf-8')


def test_a_drive_goes_on_past_the_tags_that_its_robot_cannot_reach(tmp_path):
    """A large robot has no path to two tags; the navigator alone knows that tag 6 is blocked."""
    layout = find_layout('')
    x, y = find_approaches(layout, find_walls(layout), ViewingLimits(robot_radius_m=0.3)).poses['6'][:2]
    blocked = f'blocked:="{x - 0.1} {y - 0.1} {x + 0.1} {y + 0.1}"'
    arguments = ['robot_radius_m:=0.3', blocked, 'tag_sequence:="6 13 2 1"']
    result = run_inspection(tmp_path, '--drive', *arguments)
    assert result.returncode == 1, result.stdout + result.stderr
    report, lines = report_in(tmp_path)
    assert report.name.endswith('-simulation.jsonl')
    found = {each['tag_id']: (each['outcome'], each['detail']) for each in lines}
    assert found['1'] == ('OK', '')
    robot = 'no passage between is wide enough for a robot of radius 0.3 m'
    assert found['13'] == found['2'] == ('UNREACHABLE', f'cut off from the rest of the free space: {robot}')
    outcome, detail = found['6']
    assert outcome == 'UNREACHABLE'
    assert re.fullmatch(r'pose 1: .* is occupied.*; pose 2: .* is occupied.*', detail)
    assert '1/4 tags read' in result.stdout
    assert result.stderr.splitlines()[-1].startswith('mission: not read: ')
    route = read_route(report.with_name(f'{report.stem}-route.csv'))
    assert min(math.dist(each, layout.tags['1'][:2]) for each in route) < 1.0
    assert route[-1] == (0.5, 0.5)  # the dock is where the robot started
    assert 'Traceback' not in result.stderr


SEE_HELP = 'see make mission ARGS=--help (without make: --help)'


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        (['--output', '{folder}/file'], "--output '{folder}/file': File exists: name a folder"),
        (['max_attempts:=few'], "parameter max_attempts is 'few': must be a whole number from 1 to "),
        (['--record', 'kept.txt'], "file 'kept.txt' ends in none of .sqlite, .db, .csv"),
        (
            ['tag_locations_file:=/none.json'],
            "tag_file '/none.json': cannot be read (No such file or directory)",
        ),
        (['tag_ids:=1,99'], f'no node has a parameter tag_ids: {SEE_HELP}'),
        (['--drive', 'report_file:=x.jsonl'], f'no node has a parameter report_file: {SEE_HELP}'),
        (['fast'], f"'fast' sets no parameter: write name:=value: {SEE_HELP}"),
        (['debug_sed:=3'], 'parameter debug_sed is unknown: did you mean debug_seed?'),
        (['debug_seed:=', '3'], "'debug_seed:=' sets no parameter: write debug_seed:=3, without spaces"),
        (['CAMERA=1'], "'CAMERA=1' sets no parameter: write CAMERA=1 (without make: --camera)"),
        (['drive:=nav2'], "'drive:=nav2' sets no parameter: write DRIVE=1 (without make: --drive)"),
        (['blocked:=0 0 1 1'], "'blocked:=0 0 1 1' sets a parameter of a run with DRIVE=1 (without make: --"),
        (['min_frames:=1'], "'min_frames:=1' sets a parameter of a run with CAMERA=1 (without make: --cam"),
        (['--drive', 'layout_in_map:=/none.yaml'], "registration '/none.yaml': cannot be read"),
        (['--drive', 'approach_overrides_file:=/none.yaml'], "approach overrides '/none.yaml': cannot be"),
        (['--drive', 'robot_radius_m:=0.6'], 'parameter start_pose is 0.5 0.5 0.0: a robot of radius 0.6 m'),
        (['--camera', 'image', 'tag_file:={folder}/tags.json'], "tag 'seven' is not an id of tag36h11: must"),
    ],
)
def test_what_cannot_run_is_refused_in_one_line_before_a_node_starts(
    tmp_path, capsys, stand_in, arguments, error
):
    stand_in('bridge_node', script=f'touch {tmp_path}/started')
    (tmp_path / 'file').touch()
    tags = {'tags': {'seven': {'x': 1.0, 'y': 2.0, 'sensors': ['co2']}}, 'tables': {}}
    (tmp_path / 'tags.json').write_text(json.dumps(tags), encoding='utf-8')
    given = [each.format(folder=tmp_path) for each in arguments]
    assert inspection.main(['--output', str(tmp_path / 'output'), *given]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'mission: {error.format(folder=tmp_path)}')
    assert not (tmp_path / 'started').exists()
    assert not list(tmp_path.glob('output/*'))


@pytest.mark.parametrize('options', [[], ['--drive'], ['--camera', 'detections']])
def test_a_check_of_good_arguments_starts_and_makes_nothing(tmp_path, stand_in, capsys, options):
    stand_in('bridge_node', script=f'touch {tmp_path}/started')
    record = tmp_path / 'kept.csv'
    record.write_text(f'{HEADER}\n', encoding='utf-8')
    good = ['tag_sequence:="7 1"', 'speedup_factor:=1e3', 'walls:=[-1.0, -1, 9, 9]']
    arguments = ['--check', '--output', str(tmp_path / 'out'), '--record', str(record), *options, *good]
    assert inspection.main(arguments) == 0, capsys.readouterr().err
    assert {each.name for each in tmp_path.iterdir()} == {'bin', 'kept.csv'}


def test_the_help_names_each_parameter_that_a_run_takes(capsys):
    with pytest.raises(SystemExit):
        inspection.main(['--help'])
    names = set(re.findall(r'\w+', capsys.readouterr().out))
    assert {'debug_seed', 'tag_file', 'tag_sequence', 'blocked', 'min_frames'} <= names
    assert 'report_file' not in names


@pytest.mark.parametrize('first', ['bridge_node', 'mission_orchestrator'])
def test_the_first_node_that_ends_ends_the_run_and_is_named_unless_it_is_the_mission(
    tmp_path, capfd, stand_in, first
):
    """No file is left of a mission that has not begun."""
    (last,) = {'bridge_node', 'mission_orchestrator'} - {first}
    process_id = tmp_path / 'process_id'
    stand_in(last, script=f'echo $$ >{process_id}; exec sleep 600')
    stand_in(first, script=f'until [ -s {process_id} ]; do sleep 0.05; done; exit 1')
    assert inspection.main(['--output', str(tmp_path / 'output')]) == 1
    error = 'mission: bridge_node ended before the mission, with exit code 1: its log is above\n'
    assert capfd.readouterr().err == (error if first == 'bridge_node' else '')
    assert not list(tmp_path.glob('output/*'))
    with pytest.raises(ProcessLookupError):
        os.kill(int(process_id.read_text(encoding='utf-8')), 0)


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

    stand_in('bridge_node', 'mission_orchestrator')
    monkeypatch.setattr(inspection.subprocess, 'Popen', Popen)
    assert inspection.main(['--output', str(tmp_path / 'output')]) == 130
    assert started
    assert all(each.returncode == -signal.SIGTERM for each in started)


def test_ctrl_c_in_a_terminal_ends_the_mission_before_its_recorder(tmp_path, capfd, stand_in):
    """It reaches each process. The recorder keeps the rows that the mission publishes until its end."""
    (tmp_path / 'process_ids').touch()
    (tmp_path / 'node.py').write_text(
        textwrap.dedent("""
            import os, signal, sys, time
            from pathlib import Path

            def tell(file, word):
                with open(file, 'a') as text:
                    print(word, file=text)

            name = sys.argv[1]
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda *_: sys.exit(tell('order', name)))
            tell('process_ids', os.getpid())
            if name == 'mission_orchestrator':
                while len(nodes := set(map(int, Path('process_ids').read_text().split()))) < 3:
                    time.sleep(0.05)
                for process_id in (os.getppid(), *nodes - {os.getpid()}, os.getpid()):
                    os.kill(process_id, signal.SIGINT)
            while True:
                signal.pause()
        """),
        encoding='utf-8',
    )
    names = ['mission_orchestrator', 'bridge_node', 'record_readings']
    for name in names:
        stand_in(name, script=f'cd {tmp_path}; exec {sys.executable} node.py {name}')
    assert inspection.main(['--output', str(tmp_path / 'out'), '--record', str(tmp_path / 'kept.csv')]) == 130
    assert (tmp_path / 'order').read_text(encoding='utf-8').split() == names
    assert '0 rows kept' in capfd.readouterr().out


def test_a_signal_ends_what_comes_after_a_mission(tmp_path, stand_in):
    stand_in('bridge_node')
    stand_in('mission_orchestrator', script='')
    stand_in('readings_page', script='kill -INT $PPID; exit 1')
    assert inspection.main(['--output', str(tmp_path / 'output')]) == 130


def test_each_argument_reaches_each_node_that_has_such_a_parameter():
    given = ['robot_radius_m:=0.3', 'order:=numeric', 'blocked:=0 0 1 1', 'debug_seed:=3', 'min_frames:=4']
    found = commands(*given, 'tag_file:="a b.json"', camera='image', drive=True, record='r.sqlite')
    expected = {
        'record_readings': {'tag_file:="a b.json"'},
        'bridge_node': {'debug_seed:=3', 'tag_file:="a b.json"'},
        'fake_navigator': {'robot_radius_m:=0.3', 'blocked:=0 0 1 1', 'tag_file:="a b.json"'},
        'confirm_tag': {'min_frames:=4'},
        'fake_camera': {'tag_file:="a b.json"'},
        'mission_orchestrator': {'robot_radius_m:=0.3', 'order:=numeric'},
    }
    reached = {name: {*given, 'tag_file:="a b.json"'} & set(words) for name, words in found.items()}
    assert reached == expected
    assert list(found) == list(expected)  # the recorder starts first, and ends last
    assert 'from_odometry:=true' in found['fake_camera']
    mission = found['mission_orchestrator']
    assert {'drive:="nav2"', 'order:="shortest"', 'tag_locations_file:="a b.json"'} <= set(mission)
    assert mission.index('order:="shortest"') < mission.index('order:=numeric')  # the last assignment counts


@pytest.mark.parametrize(('then', 'code'), [('', 1), ('; kill -INT $PPID; exec sleep 600', 130)])
def test_a_reading_of_the_report_that_was_not_recorded_is_said(
    tmp_path, capfd, monkeypatch, stand_in, then, code
):
    """The recorder of this run keeps nothing; the mission ends, or Ctrl-C ends it."""
    report = tmp_path / 'output/now.jsonl'
    monkeypatch.setattr(inspection, 'new_report', lambda _options: report)
    reading = Reading('7', (1795190000, 0), 0.0, {'co2': 400.0, 'humidity': 0.5})
    line = Observation('7', Outcome.OK, '', 1, reading).to_line()
    (tmp_path / 'report.jsonl').write_text(f'{line}\n', encoding='utf-8')
    stand_in('mission_orchestrator', script=f'cp {tmp_path}/report.jsonl {report}{then}')
    stand_in('bridge_node', 'record_readings')
    assert inspection.main(['--output', str(report.parent), '--record', str(tmp_path / 'kept.csv')]) == code
    assert capfd.readouterr().err == f'mission: 2 rows of {report} were not recorded: see the log above\n'


def test_two_runs_in_one_second_have_a_report_each(tmp_path):
    options = Namespace(output=tmp_path, camera=None)
    first = inspection.new_report(options)
    first.touch()
    assert inspection.new_report(options) != first


def test_the_camera_replies_before_the_missions_give_up():
    """Otherwise a tag that is not in view has no reason in the report."""
    camera_seconds = CameraSettings().timeout_seconds
    of_the_team = 3.0  # its visual_confirmation_timeout_s
    assert camera_seconds < min(of_the_team, MissionSettings().visual_confirmation_timeout_s)
