"""
`ros2 run lupin_simulation inspection`: run a whole mission on its own ROS domain.

Starts the bridge, the mission and, with --camera, a camera that confirms tags. With --drive, a navigator
moves a robot that has the camera on it. With --record, a recorder keeps the readings. Writes a report and its
page, whose names start with the time. Exit code: the mission's, 0 if all tags were read; 1 if another node
ends first, or if a reading was not recorded; 2 if it cannot start; 130 after Ctrl-C or SIGTERM.
"""

import argparse
import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import domain_coordinator
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.arguments import Parser
from lupin_greenhouse_bridge.runtime.output import print_line
from lupin_planning.walls import parse_numbers

from lupin_simulation.inspection_nodes import PARAMETERS, SETTABLE, commands_of, companion, executable

USAGE, INTERRUPTED = 2, 130
LOOK_EVERY_SECONDS = 0.2
COPIED = ('tag_file', 'sim_config_file')


class NodeEnded(OneLineError):
    """A node ended before the mission."""


def raise_if_asked_to_end() -> None:
    """Raise KeyboardInterrupt after Ctrl-C or SIGTERM, at a point where no node is being started."""
    if process.is_asked_to_end():
        raise KeyboardInterrupt


def run_mission(options: argparse.Namespace, report: Path, commands: dict[str, list[str]]) -> int:
    """Run the nodes and the mission, and make the page; return the exit code. Raises OneLineError."""
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        for name in COPIED:  # the page finds them beside the report
            if path := options.parameters.get(name):
                shutil.copyfile(path, companion(report, name))
    except OSError as error:
        raise StartUpError(f"'{error.filename}': {error.strerror}") from error
    print_line(f'mission: starting {", ".join(commands)}')
    exit_code = run_nodes(commands, report)
    if not has_lines(report):
        return exit_code
    arguments = [str(report)]
    if walls := options.parameters.get('walls'):
        arguments += ['--walls', *map(str, parse_numbers(walls))]
    page = [executable('lupin_readings', 'readings_page'), *arguments]
    page_exit_code = subprocess.run(page, check=False).returncode
    raise_if_asked_to_end()
    print_line(f'report: {report}')
    return exit_code or page_exit_code


def has_lines(report: Path) -> bool:
    """Return whether the mission has recorded anything."""
    return report.exists() and report.stat().st_size > 0


def run_nodes(commands: dict[str, list[str]], report: Path) -> int:
    """
    Run these commands on their own ROS domain until the last one, the mission, ends. Then end the others.

    Returns the exit code of the mission, or else of the recorder. Raises NodeEnded if another node ends
    first, and KeyboardInterrupt after Ctrl-C or SIGTERM.
    """
    processes: dict[str, subprocess.Popen[bytes]] = {}
    with contextlib.ExitStack() as stack:
        domain_id = stack.enter_context(domain_coordinator.domain_id(process.private_domains()))
        environment = os.environ | process.variables_of_private_domain(domain_id)
        for name, command in commands.items():
            # A terminal sends Ctrl-C to the nodes too, but the recorder has to end after the mission.
            signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
            processes[name] = subprocess.Popen(command, env=environment)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
            stack.callback(stop, processes[name])
        mission = processes['mission_orchestrator']
        while mission.poll() is None:
            raise_if_asked_to_end()
            for name, node in processes.items():
                if node is not mission and node.poll() is not None:
                    if not has_lines(report):  # a mission that has not begun needs no table
                        mission.kill()
                    ended = f'ended before the mission, with exit code {node.returncode}'
                    raise NodeEnded(f'{name} {ended}: its log is above')
            process.sleep(LOOK_EVERY_SECONDS)
        raise_if_asked_to_end()
    recorder = processes.get('record_readings')
    return mission.returncode or (recorder.returncode if recorder else 0)


def stop(process: subprocess.Popen[bytes]) -> None:
    """End a node."""
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options of the command line, with the parameters by name."""
    names = f'The names: {", ".join(SETTABLE)}.'
    parser = Parser(prog='inspection', description='Run a mission and the nodes that it needs.', epilog=names)
    add = parser.add_argument
    add('--camera', action='store_true', help='confirm each tag with the camera')
    drive = 'drive a simulated robot to each tag, with fake_navigator in place of Nav2'
    add('--drive', action='store_true', help=drive)
    add('--record', metavar='FILE', help='add the readings to this SQLite file, which need not exist')
    output = 'folder for the report and its page; default: %(default)s'
    add('--output', type=Path, default=Path('.mission'), metavar='FOLDER', help=output)
    add('arguments', nargs='*', metavar='name:=value', help='parameters of the nodes')
    options = parser.parse_args(arguments)
    left_out = set() if options.camera else {'confirm_tag', 'fake_camera'}
    left_out |= set() if options.drive else {'fake_navigator'}
    known = set().union(*(names for node, names in PARAMETERS.items() if node not in left_out))
    options.parameters = {}
    for argument in options.arguments:
        name, _, value = argument.partition(':=')
        if not value:
            parser.error(f"'{escaped(argument, 64)}' sets no parameter: write name:=value")
        if name not in known:
            needed = ' without --camera or --drive' if name in SETTABLE else ''
            parser.error(f'no node has a parameter {escaped(name, 64)}{needed}')
        options.parameters[name] = value.strip('"\'')
    return options


def main(arguments: list[str] | None = None) -> int:
    """Run it and return the exit code."""
    options = parse(arguments)
    process.install_signal_handlers()
    kind = 'camera' if options.camera else 'simulation'
    report: Path = options.output / f'{time.strftime("%Y-%m-%d-%H%M%S")}-{kind}.jsonl'
    try:
        return run_mission(options, report, commands_of(options, report))
    except OneLineError as error:
        print(f'mission: {error}', file=sys.stderr)
        return 1 if isinstance(error, NodeEnded) else USAGE
    except KeyboardInterrupt:
        return INTERRUPTED
