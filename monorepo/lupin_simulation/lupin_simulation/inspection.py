"""
`ros2 run lupin_simulation inspection`: run a whole mission on its own ROS domain.

Starts the bridge, the mission and, with --camera, a camera that confirms tags. With --drive, a navigator
moves a robot that has the camera on it. With --record, a recorder keeps the readings. Writes a report and
its page, whose names start with the time. Exit code: the mission's, 0 if all tags were read; 1 if
another node ends first, or if a reading was not recorded; 2 if it cannot start; 130 after Ctrl-C or SIGTERM.
"""

import argparse
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import domain_coordinator
from lupin_greenhouse_bridge.display.reading_file import COMPANION_ENDINGS, read_file
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped, pluralized, reason_of
from lupin_greenhouse_bridge.planning.overrides import read_overrides
from lupin_greenhouse_bridge.planning.registration import Transform, read_transform
from lupin_greenhouse_bridge.planning.walls import parse_numbers
from lupin_greenhouse_bridge.recording.reading_files import read_rows
from lupin_greenhouse_bridge.recording.rows import key_of
from lupin_greenhouse_bridge.recording.store import open_store
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.arguments import Parser, folder_type
from lupin_greenhouse_bridge.runtime.output import print_line
from lupin_tag_confirmation.confirmation import tag_number

from lupin_simulation.inspection_nodes import (
    LAYOUT,
    SETTABLE,
    check_values,
    commands_of,
    companion,
    executable,
    value_of,
)
from lupin_simulation.settings import LayoutSettings

USAGE, INTERRUPTED = 2, 130
LOOK_EVERY_SECONDS = 0.2


class NodeEnded(OneLineError):
    """A node ended before the mission."""


def raise_if_asked_to_end() -> None:
    """Raise KeyboardInterrupt after Ctrl-C or SIGTERM, at a point where no node is being started."""
    if process.is_asked_to_end():
        raise KeyboardInterrupt


def new_report(options: argparse.Namespace) -> Path:
    """Return the path of this run's report, whose name has the time and the kind of the inspection."""
    kind = 'camera' if options.camera else 'simulation'
    report: Path = options.output / f'{time.strftime("%Y-%m-%d-%H%M%S")}-{kind}.jsonl'
    return report.with_stem(f'{report.stem}-{os.getpid()}') if report.exists() else report


def check(options: argparse.Namespace, commands: list[list[str]]) -> None:
    """
    Check the arguments of a run, its greenhouse and the recorder's file.

    Raises OneLineError, also for a greenhouse that the bridge refuses, and tags that no camera can see.
    """
    settings = check_values(commands)
    given = LayoutSettings(**{name: value_of(options.arguments, name) for name in LAYOUT})
    layout, _ = given.read_layout()
    mission = settings['mission_orchestrator']
    if options.camera:
        for tag_id in mission.chosen_tag_ids or layout.tags:
            tag_number(tag_id)  # raises UnknownTagId
    if options.drive:
        settings['fake_navigator'].free_space()
        layout_in_map = Transform()
        if mission.layout_in_map:
            layout_in_map = read_transform(mission.layout_in_map, mission.frame_id)
        if mission.approach_overrides_file:
            read_overrides(mission.approach_overrides_file, layout.tags, layout_in_map)
    if options.record:
        open_store(options.record)


def prepare(options: argparse.Namespace, report: Path) -> None:
    """Make the output, before a node starts. Raises OneLineError."""
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        for name in ('tag_file', 'sim_config_file'):  # both have been read above
            if path := value_of(options.arguments, name):
                shutil.copyfile(path, companion(report, name))
    except OSError as error:
        raise StartUpError(f"--output '{options.output}': {reason_of(error)}: name a folder") from error


def run_mission(options: argparse.Namespace) -> int:
    """Run the nodes and the mission, and draw its report; return the exit code. Raises OneLineError."""
    report = new_report(options)
    commands = commands_of(options, report)
    check(options, commands)
    if options.check:
        return 0
    prepare(options, report)
    print_line(f'mission: starting {", ".join(Path(path).name for path, *_ in commands)}')
    try:
        exit_code = run_nodes(commands, report)
    except NodeEnded:
        if not has_lines(report):
            for each in (report, *(companion(report, name) for name in COMPANION_ENDINGS)):
                each.unlink(missing_ok=True)
        raise
    except KeyboardInterrupt:
        if options.record:
            check_record(options.record, report)
        raise
    if exit_code == USAGE:
        return USAGE
    drawn = draw(report, value_of(options.arguments, 'walls'))
    recorded = check_record(options.record, report) if options.record else 0
    if exit_code == 1 and (tags := not_read(report)):
        print(f'mission: not read: {tags}', file=sys.stderr)
    return exit_code or drawn or recorded


def has_lines(report: Path) -> bool:
    """Return whether the mission has recorded anything."""
    return report.exists() and report.stat().st_size > 0


def run_nodes(commands: list[list[str]], report: Path) -> int:
    """
    Run these commands on a ROS domain of their own until the last one, the mission, ends; end the last first.

    Returns the exit code of the mission. Raises NodeEnded if another node ends before, and KeyboardInterrupt
    after Ctrl-C or SIGTERM.
    """
    with contextlib.ExitStack() as stack:
        domain_id = stack.enter_context(domain_coordinator.domain_id(process.private_domains()))
        environment = os.environ | process.variables_of_private_domain(domain_id)
        processes = []
        for command in commands:
            # A terminal sends Ctrl-C to the nodes too, but the recorder has to end after the mission.
            signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
            processes.append(subprocess.Popen(command, env=environment))
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
            stack.callback(stop, processes[-1])
        *others, mission = processes
        while mission.poll() is None:
            raise_if_asked_to_end()
            for each, (path, *_) in zip(others, commands, strict=False):
                if each.poll() is not None:
                    if not has_lines(report):  # nobody needs the table of a mission that has not begun
                        mission.kill()
                    ended = f'ended before the mission, with exit code {each.returncode}'
                    raise NodeEnded(f'{Path(path).name} {ended}: its log is above')
            process.sleep(LOOK_EVERY_SECONDS)
        raise_if_asked_to_end()
        return mission.returncode


def stop(process: subprocess.Popen[bytes]) -> None:
    """End a node."""
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def draw(report: Path, walls: str) -> int:
    """Make the page of a report; return the exit code of its command, which finds the files beside it."""
    arguments = [str(report), *(['--walls', *map(str, parse_numbers(walls))] if walls else [])]
    command = [executable('lupin_greenhouse_bridge', 'readings_page'), *arguments]
    exit_code = subprocess.run(command, check=False).returncode
    raise_if_asked_to_end()
    print_line(f'report: {report}')
    return exit_code


def not_read(report: Path) -> str:
    """Return which tags of the report have no reading, and why; '' if there is none."""
    visits = read_file(report).visits if has_lines(report) else []
    is_read = {each.tag_id for each in visits if each.reading}
    missing = {each.tag_id: each.outcome.value for each in visits if each.tag_id not in is_read}
    return ', '.join(f'{escaped(tag_id, 40)} ({outcome})' for tag_id, outcome in missing.items())


def check_record(file: str, report: Path) -> int:
    """Print how many readings of the report were recorded; return 1 if one is missing, else 0."""
    in_report = {key_of(row) for row in read_file(report).rows} if has_lines(report) else set()
    lost = len(in_report - {key_of(row) for row in read_rows(file)})
    print_line(f'{pluralized(len(in_report) - lost, "row")} kept in {file}')
    if lost:
        rows, verb = pluralized(lost, 'row'), 'was' if lost == 1 else 'were'
        print(f'mission: {rows} of {report} {verb} not recorded: see the log above', file=sys.stderr)
    return int(lost > 0)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options of the command line."""
    names = f'The names: {", ".join(SETTABLE)}.'
    parser = Parser(prog='inspection', description='Run a mission and all that it needs.', epilog=names)
    add = parser.add_argument
    camera = 'confirm each tag with the camera, which publishes images, compressed images or detections'
    add('--camera', choices=('image', 'compressed', 'detections'), help=camera)
    drive = 'drive a simulated robot to each tag, with fake_navigator in place of Nav2'
    add('--drive', action='store_true', help=drive)
    record = 'add the readings to this .sqlite, .db or .csv file, which need not exist'
    add('--record', metavar='FILE', help=record)
    output = 'folder for the report and its page; default: %(default)s'
    add('--output', type=folder_type, default=Path('.mission'), metavar='FOLDER', help=output)
    add('--check', action='store_true', help='check the arguments and the file to record to, and end')
    add('arguments', nargs='*', metavar='name:=value', help='parameters of the nodes')
    options = parser.parse_args(arguments)
    # The mission has another name for the tag file, but a run has one greenhouse.
    options.arguments = [re.sub('^tag_locations_file:=', 'tag_file:=', each) for each in options.arguments]
    return options


def main(arguments: list[str] | None = None) -> int:
    """Run it and return the exit code."""
    options = parse(arguments)
    process.install_signal_handlers()
    try:
        return run_mission(options)
    except OneLineError as error:
        print(f'mission: {error}', file=sys.stderr)
        return 1 if isinstance(error, NodeEnded) else USAGE
    except KeyboardInterrupt:
        return INTERRUPTED
