"""A whole inspection, in simulation and with a camera: the report and the page that it writes."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.simulator.layout import find_layout
from lupin_greenhouse_bridge.testing.helpers import executable
from lupin_mission.settings import Settings as MissionSettings
from lupin_planning.approach import find_approaches
from lupin_planning.viewpoints import ViewingLimits
from lupin_planning.walls import find_walls
from lupin_readings.reading_file import read_route
from lupin_readings.store import read_rows
from lupin_simulation import inspection, inspection_nodes
from lupin_tag_confirmation.settings import Settings as CameraSettings


def run_inspection(output: Path, *arguments: str) -> subprocess.CompletedProcess:
    """Run an inspection whose mission waits longer than by default: a node of it may start late."""
    command = [executable('lupin_simulation', 'inspection'), '--output', str(output), *arguments]
    patience = ['scan_timeout_s:=10', 'max_attempts:=1000']
    return subprocess.run([*command, *patience], capture_output=True, text=True, check=False)


def report_in(output: Path) -> tuple[Path, list[dict]]:
    """Return the path of the one report in a folder, and its observations."""
    (report,) = output.glob('*.jsonl')
    return report, list(map(json.loads, report.read_text(encoding='utf-8').splitlines()))


def commands(*arguments: str) -> dict[str, list[str]]:
    """Return the words of the command of each node of a run."""
    found = inspection_nodes.commands_of(inspection.parse([*arguments]), Path('out/report.jsonl'))
    return {name: words[1:] for name, words in found.items()}


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


def test_your_own_greenhouse_is_served_visited_with_a_camera_recorded_and_shown(tmp_path, monkeypatch):
    tags = {tag_id: {'x': x, 'y': 1.0, 'sensors': ['co2']} for tag_id, x in (('7', 1.0), ('586', 2.0))}
    content = json.dumps({'tags': tags, 'tables': {}})
    (tmp_path / 'my tags.json').write_text(content, encoding='utf-8')
    monkeypatch.chdir(tmp_path)  # paths are relative to the folder of the command
    monkeypatch.setenv('ROS_DISCOVERY_SERVER', '127.0.0.1:11811')  # of a robot that is off
    own = ['tag_file:=my tags.json', 'debug_time_of_day:=12', 'tag_sequence:="586 7"']
    result = run_inspection(tmp_path / 'out', '--camera', '--record', 'kept.sqlite', *own)
    assert result.returncode == 0, result.stdout + result.stderr
    report, lines = report_in(tmp_path / 'out')
    assert re.fullmatch(r'\d{4}-\d\d-\d\d-\d{6}-camera.jsonl', report.name)
    assert '2/2 tags read' in result.stdout
    assert 'Traceback' not in result.stderr
    assert [(line['tag_id'], line['outcome']) for line in lines] == [('586', 'OK'), ('7', 'OK')]
    assert {line['sim_time_of_day_seconds'] for line in lines} == {43200.0}
    assert result.stdout.splitlines()[-1] == f'report: {report}'
    rows = {(row.tag_id, row.x_m, row.value) for row in read_rows(tmp_path / 'kept.sqlite')}
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
    route = read_route(report.with_name(f'{report.stem}-route.csv'))
    assert min(math.dist(each, layout.tags['1'][:2]) for each in route) < 1.0
    assert route[-1] == (0.5, 0.5)  # the dock is where the robot started
    assert 'Traceback' not in result.stderr


@pytest.mark.parametrize(
    ('arguments', 'named'),
    [
        (['--output', '{folder}/file'], 'File exists'),
        (['--camera', 'compressed'], "'compressed'"),
        (['tag_file:=/none.json'], "'/none.json': No such file or directory"),
        (['tag_ids:=1,99'], 'tag_ids'),
        (['report_file:=x.jsonl'], 'report_file'),
        (['debug_seed:=', '3'], 'debug_seed:='),
        (['CAMERA=1'], 'CAMERA=1'),
        (['blocked:=0 0 1 1'], 'blocked without --camera or --drive'),
    ],
)
def test_what_cannot_run_is_refused_in_one_line_before_a_node_starts(
    tmp_path, capsys, stand_in, arguments, named
):
    stand_in('bridge_node', script=f'touch {tmp_path}/started')
    (tmp_path / 'file').touch()
    given = [each.format(folder=tmp_path) for each in arguments]
    try:
        exit_code = inspection.main(['--output', str(tmp_path / 'output'), *given])
    except SystemExit as ended:
        exit_code = ended.code
    (line,) = capsys.readouterr().err.splitlines()
    assert (exit_code, named in line) == (2, True), line
    assert not (tmp_path / 'started').exists()


def test_a_node_that_refuses_its_parameter_names_it_and_ends_the_run(tmp_path):
    result = run_inspection(tmp_path, '--drive', 'robot_radius_m:=0.6')
    assert result.returncode == 1
    assert '[FATAL]' in result.stderr
    assert 'start_pose' in result.stderr
    last = 'mission: fake_navigator ended before the mission, with exit code 1: its log is above'
    assert result.stderr.splitlines()[-1] == last


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
    (last,) = {'bridge_node', 'mission_orchestrator'} - {first}
    process_id = tmp_path / 'process_id'
    stand_in(last, script=f'echo $$ >{process_id}; exec sleep 600')
    stand_in(first, script=f'until [ -s {process_id} ]; do sleep 0.05; done; exit 1')
    assert inspection.main(['--output', str(tmp_path / 'output')]) == 1
    error = 'mission: bridge_node ended before the mission, with exit code 1: its log is above\n'
    assert capfd.readouterr().err == (error if first == 'bridge_node' else '')
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


def test_ctrl_c_in_a_terminal_ends_the_mission_before_its_recorder(tmp_path, stand_in):
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
    arguments = ['--output', str(tmp_path / 'out'), '--record', str(tmp_path / 'kept.sqlite')]
    assert inspection.main(arguments) == 130
    assert (tmp_path / 'order').read_text(encoding='utf-8').split() == names


def test_a_signal_ends_what_comes_after_a_mission(tmp_path, stand_in):
    stand_in('bridge_node')
    report = 'printf "%s\\n" "$@" | sed -n \'s/^report_file:="\\(.*\\)"$/\\1/p\''
    stand_in('mission_orchestrator', script=f'echo {{}} >"$({report})"')
    stand_in('readings_page', script='kill -INT $PPID; exit 1')
    assert inspection.main(['--output', str(tmp_path / 'output')]) == 130


def test_each_argument_reaches_each_node_that_has_such_a_parameter():
    given = ['robot_radius_m:=0.3', 'order:=numeric', 'blocked:=0 0 1 1', 'debug_seed:=3', 'min_frames:=4']
    found = commands(*given, 'tag_file:=a b.json', '--camera', '--drive', '--record', 'r.sqlite')
    tag_file = 'tag_file:="a b.json"'
    expected = {
        'record_readings': {tag_file},
        'bridge_node': {'debug_seed:=3', tag_file},
        'fake_navigator': {'robot_radius_m:=0.3', 'blocked:="0 0 1 1"', tag_file},
        'confirm_tag': {'min_frames:=4'},
        'fake_camera': {tag_file, 'from_odometry:=true'},
        'mission_orchestrator': {'robot_radius_m:=0.3', 'order:="numeric"', 'drive:="nav2"'},
    }
    assert list(found) == list(expected)  # the recorder starts first, and ends last
    for name, words in expected.items():
        assert words <= set(found[name])
    mission = found['mission_orchestrator']
    assert 'tag_locations_file:="a b.json"' in mission
    assert 'order:="shortest"' not in mission  # the user's value counts


def test_an_id_with_a_leading_zero_stays_that_id():
    assert 'tag_sequence:="010"' in commands('tag_sequence:=010')['mission_orchestrator']


def test_a_recorder_that_has_lost_readings_fails_the_run(tmp_path, stand_in):
    stand_in('mission_orchestrator', script='')
    stand_in('bridge_node')
    stand_in('record_readings', script='trap "exit 1" TERM; while true; do sleep 0.05; done')
    assert inspection.main(['--output', str(tmp_path), '--record', str(tmp_path / 'kept.sqlite')]) == 1


def test_the_camera_replies_before_the_missions_give_up():
    """Otherwise a tag that is not in view has no reason in the report."""
    camera_seconds = CameraSettings().timeout_seconds
    of_the_team = 3.0  # its visual_confirmation_timeout_s
    assert camera_seconds < min(of_the_team, MissionSettings().visual_confirmation_timeout_s)
