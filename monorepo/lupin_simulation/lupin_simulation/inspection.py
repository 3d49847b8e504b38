"""
`ros2 run lupin_simulation inspection`: run a whole mission on its own ROS domain.

Starts the bridge, the mission and, with --camera, a camera that confirms tags. With --drive, a navigator
moves a robot that has the camera on it. With --record, a recorder keeps the readings. Writes a report, its
picture and its page, whose names start with the time. Exit code: the mission's, 0 if all tags were read; 1 if
another node ends first, or if a reading was not recorded; 2 if it cannot start; 130 after Ctrl-C or SIGTERM.
"""

import argparse
import contextlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import textwrap
import time
from dataclasses import fields
from pathlib import Path

import domain_coordinator
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from lupin_greenhouse_bridge import settings as bridge_settings
from lupin_greenhouse_bridge.display.drawing_command import COMPANION_ENDINGS
from lupin_greenhouse_bridge.display.input_file import read_file
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped, pluralized
from lupin_greenhouse_bridge.planning.walls import parse_numbers
from lupin_greenhouse_bridge.recording.reading_files import read_rows
from lupin_greenhouse_bridge.recording.store import key_of, open_store
from lupin_greenhouse_bridge.runtime.output import print_line
from lupin_greenhouse_bridge.runtime.process import install_signal_handlers, is_asked_to_end
from lupin_mission import settings as mission_settings
from lupin_tag_confirmation import settings as confirm_tag_settings

from lupin_simulation import disc_robot

USAGE = 2
LOOK_EVERY_SECONDS = 0.2  # at the nodes
DRIVING_SPEEDUP = 20
PATIENCE_SECONDS = 10.0
SOURCES = ('image', 'compressed', 'detections')
SET_HERE = {'report_file', 'wait_for_start', 'wait_for_subscriber', 'route_file'}
GREENHOUSE = ('tag_file', 'sim_config_file')
LAYOUT = (*GREENHOUSE, 'walls')


def executable(package: str, name: str) -> str:
    """Return the path of the executable that `ros2 run` starts; raises StartUpError without the package."""
    try:
        return str(Path(get_package_prefix(package), 'lib', package, name))
    except PackageNotFoundError as error:
        raise StartUpError(f'the package {package} is not found: build it and source its setup') from error


def node(package: str, name: str, *assignments: str) -> list[str]:
    """Return the command of a node with these parameters, each as name:=value."""
    words = (word for each in assignments for word in ('-p', each))
    return [executable(package, name), '--ros-args', *words]


class NodeEnded(OneLineError):
    """A node ended before the mission."""


class UnknownArgument(Exception):
    """No node of the run has such a parameter. The text lists all parameters, on more than one line."""

    def __init__(self, argument: str, names: set[str]):
        error = f"'{escaped(argument, 64)}' sets no parameter of this run: write name:=value, with one of"
        listed = textwrap.fill(', '.join(sorted(names)), 100, initial_indent='  ', subsequent_indent='  ')
        super().__init__(f'{error}\n{listed}')


def arguments_by_node(options) -> dict[str, list[str]]:
    """Return the arguments of each node: its parameters. Raises UnknownArgument for one that no node has."""
    types = {
        'bridge_node': bridge_settings.Settings,
        'mission_orchestrator': mission_settings.Settings,
        **({'confirm_tag': confirm_tag_settings.Settings} if options.camera else {}),
        **({'fake_navigator': disc_robot.Settings} if options.drive else {}),
    }
    names = {node: {each.name for each in fields(settings_type)} for node, settings_type in types.items()}
    settable = set().union(*names.values()) - SET_HERE
    names['mission_orchestrator'] |= set(mission_settings.WITHOUT_EFFECT)
    for each in options.arguments:
        name, is_assigned, _ = each.partition(':=')
        if not is_assigned or name not in settable | set(mission_settings.WITHOUT_EFFECT):
            raise UnknownArgument(each, settable)
    return {
        node: [each for each in options.arguments if each.partition(':=')[0] in own]
        for node, own in names.items()
    }


def value_of(arguments: list[str], name: str) -> str:
    """Return the last value of an argument, without quotes; '' if it is not set."""
    values = [each.partition(':=')[2] for each in arguments if each.startswith(f'{name}:=')]
    return values[-1].strip('"\'') if values else ''


def raise_if_asked_to_end() -> None:
    """Raise KeyboardInterrupt after Ctrl-C or SIGTERM, at a point where no node is being started."""
    if is_asked_to_end():
        raise KeyboardInterrupt


def run_to_end(command: list[str]) -> int:
    """Run a command and return its exit code; raises KeyboardInterrupt after Ctrl-C or SIGTERM."""
    exit_code = subprocess.run(command, check=False).returncode
    raise_if_asked_to_end()
    return exit_code


def report_of(options) -> Path:
    """Return the path of this run's report, whose name has the time and the kind of the inspection."""
    kind = 'world' if options.world else 'camera' if options.camera else 'simulation'
    report = options.output / f'{time.strftime("%Y-%m-%d-%H%M%S")}-{kind}.jsonl'
    return beside(report, f'-{os.getpid()}.jsonl') if report.exists() else report


def beside(report: Path, ending: str) -> Path:
    """Return the path of another file of the same run."""
    return report.with_name(report.stem + ending)


def commands_of(options, report: Path) -> list[list[str]]:
    """Return the commands of the nodes. The last one is the mission; the first one ends last."""
    given = arguments_by_node(options)
    tag_file = value_of(options.arguments, 'tag_file')
    world = [f'world_file:="{options.output / "world/greenhouse.sdf"}"'] if options.world else []
    nodes = [node('lupin_greenhouse_bridge', 'bridge_node', *given['bridge_node'])]
    own = [f'report_file:="{report}"', 'wait_for_start:=false']
    if options.record:
        own.append('wait_for_subscriber:=true')
        kept = [f'file:="{options.record}"', *([f'tag_file:="{tag_file}"'] if tag_file else [])]
        nodes.insert(0, node('lupin_greenhouse_bridge', 'record_readings', *kept))
    if options.drive:
        route = beside(report, COMPANION_ENDINGS['route'])
        driving = [f'speedup:={DRIVING_SPEEDUP}', f'route_file:="{route}"']
        nodes.append(node('lupin_simulation', 'fake_navigator', *driving, *given['fake_navigator']))
        start_pose = value_of(options.arguments, 'start_pose') or disc_robot.Settings.start_pose
        own += ['drive:=nav2', 'order:=shortest', f'dock_pose:="{start_pose}"']
    else:
        own.append('drive:=simulated')
    if world and not options.drive:  # it does not name the tables to drive around
        own += world
    elif tag_file:
        own.append(f'tag_locations_file:="{tag_file}"')
    if options.camera:
        own += ['require_visual_confirmation:=true', 'drive_seconds:=0.2']
        showing = ['from_odometry:=true'] if options.drive else []
        if world:
            # Rendering an image takes a while.
            own.append(f'visual_confirmation_timeout_s:={PATIENCE_SECONDS}')
            listening = [f'timeout_seconds:={PATIENCE_SECONDS}', 'max_image_age_seconds:=5.0']
            camera = node('lupin_simulation', 'world_camera', *world, *showing)
        else:
            listening = [f'source:={options.camera}']
            layout = {name: value_of(options.arguments, name) for name in LAYOUT}
            showing += [f'{name}:="{value}"' for name, value in layout.items() if value]
            camera = node('lupin_simulation', 'fake_camera', f'publishes:={options.camera}', *showing)
        nodes += [node('lupin_tag_confirmation', 'confirm_tag', *listening, *given['confirm_tag']), camera]
    return [*nodes, node('lupin_mission', 'mission_orchestrator', *own, *given['mission_orchestrator'])]


def make_world(options) -> None:
    """Write the SDF world into the output; raises StartUpError."""
    command = [executable('lupin_simulation', 'generate_world'), '--side', '0.04']
    command += ['--output', str(options.output / 'world'), *walls_option(options)]
    for name in GREENHOUSE:
        if path := value_of(options.arguments, name):
            command += [f'--{name.replace("_", "-")}', path]
    if not importlib.util.find_spec('pydrake'):
        raise StartUpError('Drake is missing, which renders the world: pip install drake')
    if run_to_end(command):
        raise StartUpError('the world cannot be made')


def walls_option(options) -> list[str]:
    """Return the option for walls that are set."""
    walls = value_of(options.arguments, 'walls')
    return ['--walls', *map(str, parse_numbers(walls))] if walls else []


def prepare(options, report: Path) -> None:
    """Make the folder, and copy the files of your own greenhouse beside the report; raises StartUpError."""
    try:
        options.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StartUpError(f"--output '{options.output}': {error.strerror}: name a folder") from error
    for name in GREENHOUSE:
        if path := value_of(options.arguments, name):
            try:
                shutil.copyfile(path, beside(report, COMPANION_ENDINGS[name]))
            except OSError as error:
                reason = error.strerror or error
                raise StartUpError(f"{name} '{path}': {reason}: name a file that can be read") from error
    if options.record:  # here, because nothing shall start if it cannot be written
        open_store(options.record).close()


def check_record(options, report: Path) -> int:
    """Print how many readings of the report were recorded; return 1 if one is missing, else 0."""
    in_report = {key_of(row) for row in read_file(report).rows} if report.stat().st_size else set()
    lost = len(in_report - {key_of(row) for row in read_rows(options.record)})
    print_line(f'{pluralized(len(in_report) - lost, "row")} kept in {options.record}')
    if lost:
        verb = 'was' if lost == 1 else 'were'
        rows = pluralized(lost, 'row')
        print(f'mission: {rows} of {report} {verb} not recorded: see the log above', file=sys.stderr)
    return 1 if lost else 0


def stop(process: subprocess.Popen) -> None:
    """End a node."""
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def exit_code_of(mission: subprocess.Popen, others: list[subprocess.Popen]) -> int:
    """Return the mission's exit code; raises NodeEnded for another node, KeyboardInterrupt for a signal."""
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            mission.wait(LOOK_EVERY_SECONDS)
        raise_if_asked_to_end()
        if mission.returncode is not None:
            return mission.returncode
        for each in others:
            if each.poll() is not None:
                name = Path(each.args[0]).name
                raise NodeEnded(
                    f'{name} ended before the mission, with exit code {each.returncode}: its log is above'
                )


def run_mission(options) -> int:
    """Run the nodes and the mission, and draw its report; return the exit code. Raises OneLineError."""
    if options.world and options.camera != 'image':
        raise StartUpError('--world publishes images only: leave --camera out, or name image')
    report = report_of(options)
    commands = commands_of(options, report)
    prepare(options, report)
    if options.world:
        make_world(options)
    with domain_coordinator.domain_id() as domain_id, contextlib.ExitStack() as stack:
        alone = {'ROS_DOMAIN_ID': str(domain_id), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        processes = []
        for command in commands:
            processes.append(subprocess.Popen(command, env=os.environ | alone))
            stack.callback(stop, processes[-1])
        *others, mission = processes
        exit_code = exit_code_of(mission, others)
    if exit_code == USAGE:
        return USAGE
    print_line('drawing the picture and the page ...')
    drawing = [str(report), *walls_option(options)]  # they find what is beside the report themselves
    plotted = run_to_end([executable('lupin_greenhouse_bridge', 'plot_report'), *drawing])
    run_to_end([executable('lupin_greenhouse_bridge', 'readings_page'), *drawing])
    print_line(f'report: {report}')
    recorded = check_record(options, report) if options.record else 0
    return exit_code or plotted or recorded


def main(arguments: list[str] | None = None) -> int:
    """Run it and return the exit code."""
    parser = argparse.ArgumentParser(prog='inspection', description='Run a mission and all that it needs.')
    parser.add_argument(
        '--camera',
        choices=SOURCES,
        help='confirm each tag with the camera, which publishes images, compressed images or detections',
    )
    parser.add_argument(
        '--world',
        action='store_true',
        help='confirm each tag with the camera, which renders images of the SDF world of lupin_simulation',
    )
    parser.add_argument(
        '--drive',
        action='store_true',
        help='drive a simulated robot to each tag, with fake_navigator in place of Nav2',
    )
    parser.add_argument(
        '--record',
        metavar='FILE',
        help='add the readings to this .sqlite, .db or .csv file, which need not exist',
    )
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('.mission'),
        metavar='FOLDER',
        help='folder for the report, its picture and its page; default: %(default)s',
    )
    parser.add_argument('arguments', nargs='*', metavar='name:=value', help='parameters of the nodes')
    options = parser.parse_args(arguments)
    # The mission's name for the tag file: a run has one greenhouse.
    options.arguments = [re.sub('^tag_locations_file:=', 'tag_file:=', each) for each in options.arguments]
    if options.world and options.camera is None:
        options.camera = 'image'
    install_signal_handlers()
    try:
        return run_mission(options)
    except NodeEnded as error:
        print(f'mission: {error}', file=sys.stderr)
        return 1
    except (OneLineError, UnknownArgument) as error:
        print(f'mission: {error}', file=sys.stderr)
        return USAGE
    except KeyboardInterrupt:
        return 130
