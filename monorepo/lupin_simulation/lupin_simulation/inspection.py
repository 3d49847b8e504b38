"""
`ros2 run lupin_simulation inspection`: run a whole mission on its own ROS domain.

Starts the bridge, the mission and, with --camera, a camera that confirms tags. With --drive, a navigator
moves a robot that has the camera on it. Writes a report, its picture and its page. Exit code: the mission's,
0 if all tags were read; 1 if another node ends first; 2 if it cannot start; 130 after Ctrl-C or SIGTERM.
"""

import argparse
import contextlib
import importlib.util
import os
import subprocess
import sys
import time
from dataclasses import fields
from pathlib import Path

import domain_coordinator
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError
from lupin_greenhouse_bridge.runtime.process import install_signal_handlers, is_asked_to_end
from lupin_mission import settings

from lupin_simulation import disc_robot

USAGE = 2
LONGEST_MISSION_SECONDS = 900
LOOK_EVERY_SECONDS = 0.2  # at the nodes
DRIVING_SPEEDUP = 20
PATIENCE_SECONDS = 10.0
SOURCES = ('image', 'compressed', 'detections')


def executable(package: str, name: str) -> str:
    """Return the path of the executable that `ros2 run` starts; raises StartUpError without the package."""
    try:
        return str(Path(get_package_prefix(package), 'lib', package, name))
    except PackageNotFoundError as error:
        raise StartUpError(f'the package {package} is not found: build it and source its setup') from error


def parameters(assignments: list[str]) -> list[str]:
    """Turn name:=value of `ros2 launch` into arguments of a node."""
    return ['--ros-args', *(word for each in assignments for word in ('-p', each))]


class NodeEnded(OneLineError):
    """A node ended before the mission."""


def share(assignments: list[str]) -> tuple[list[str], list[str]]:
    """Return the parameters of the mission, and those of the navigator; both have some of them."""
    of_navigator, of_mission = (
        {each.name for each in fields(settings_type)}
        for settings_type in (disc_robot.Settings, settings.Settings)
    )
    named = [(each.partition(':=')[0], each) for each in assignments]
    return (
        [each for name, each in named if name in of_mission or name not in of_navigator],
        [each for name, each in named if name in of_navigator],
    )


def raise_if_asked_to_end() -> None:
    """Raise KeyboardInterrupt after Ctrl-C or SIGTERM, here and not where a node has just been started."""
    if is_asked_to_end():
        raise KeyboardInterrupt


def run_to_end(command: list[str]) -> int:
    """Run a command and return its exit code; raises KeyboardInterrupt after Ctrl-C or SIGTERM."""
    exit_code = subprocess.run(command, check=False).returncode
    raise_if_asked_to_end()
    return exit_code


def nodes_of(options) -> tuple[list[list[str]], list[str]]:
    """Return the commands of the nodes around the mission, and the mission's parameters."""
    nodes = [[executable('lupin_greenhouse_bridge', 'bridge_node')]]
    mission, for_navigator = share(options.arguments) if options.drive else (options.arguments, [])
    suitable, seeing = [], []
    if options.drive:
        driving = [f'speedup:={DRIVING_SPEEDUP}', f'route_file:="{file_of(options, "-route.csv")}"']
        navigator = executable('lupin_simulation', 'fake_navigator')
        nodes.append([navigator, *parameters([*driving, *for_navigator])])
        suitable += ['drive:=nav2', 'order:=shortest']
        seeing = ['from_odometry:=true']
    if not options.camera:
        return nodes, [*suitable, *mission]
    suitable += ['require_visual_confirmation:=true', 'drive_seconds:=0.2']
    if options.world:
        folder = options.output / 'world'
        command = [
            executable('lupin_simulation', 'generate_world'),
            '--side',
            '0.04',
            '--output',
            str(folder),
        ]
        if not importlib.util.find_spec('pydrake'):
            raise StartUpError('Drake is missing, which renders the world: pip install drake')
        if run_to_end(command):
            raise StartUpError('the world cannot be made')
        world_file = f'world_file:="{folder / "greenhouse.sdf"}"'
        if not options.drive:  # a world does not name the tables that a robot drives around
            suitable.append(world_file)
        # Rendering an image takes a while.
        suitable.append(f'visual_confirmation_timeout_s:={PATIENCE_SECONDS}')
        listening = [f'timeout_seconds:={PATIENCE_SECONDS}', 'max_image_age_seconds:=5.0']
        camera = [executable('lupin_simulation', 'world_camera'), *parameters([world_file, *seeing])]
    else:
        listening = [f'source:={options.camera}']
        stand_in = executable('lupin_simulation', 'fake_camera')
        camera = [stand_in, *parameters([f'publishes:={options.camera}', *seeing])]
    confirm_tag = [executable('lupin_tag_confirmation', 'confirm_tag'), *parameters(listening)]
    return [*nodes, confirm_tag, camera], [*suitable, *mission]


def file_of(options, ending: str) -> Path:
    """Return the file of this kind of inspection with such an ending."""
    name = 'world' if options.world else 'camera' if options.camera else 'simulation'
    return options.output / f'{name}{ending}'


def stop(process: subprocess.Popen) -> None:
    """End a node."""
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def exit_code_of(mission: subprocess.Popen, others: list[subprocess.Popen]) -> int:
    """
    Return the exit code of the mission.

    Raises NodeEnded if another node ends first, TimeoutExpired, or KeyboardInterrupt after Ctrl-C or SIGTERM.
    """
    deadline = time.monotonic() + LONGEST_MISSION_SECONDS
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
        if time.monotonic() >= deadline:
            raise subprocess.TimeoutExpired(mission.args[0], LONGEST_MISSION_SECONDS)


def run_mission(options) -> int:
    """Run the nodes and the mission, and draw its report; return the exit code. Raises OneLineError."""
    if options.world and options.camera != 'image':
        raise StartUpError('WORLD=1 publishes images only: leave CAMERA out, or set CAMERA=1')
    mission_node = executable('lupin_mission', 'mission_orchestrator')
    commands, for_mission = nodes_of(options)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StartUpError(f"--output '{options.output}': {error.strerror}: name a folder") from error
    report, route = file_of(options, '.jsonl'), file_of(options, '-route.csv')
    report.unlink(missing_ok=True)
    route.unlink(missing_ok=True)
    own = [f'report_file:="{report}"', 'wait_for_start:=false']
    commands.append([mission_node, *parameters([*own, *for_mission])])
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
    drawing = [str(report), *(['--route', str(route)] if route.exists() else [])]
    plotted = run_to_end([executable('lupin_greenhouse_bridge', 'plot_report'), *drawing])
    run_to_end([executable('lupin_greenhouse_bridge', 'readings_page'), *drawing])
    print(f'report: {report}')
    return exit_code or plotted


def main(arguments: list[str] | None = None) -> int:
    """Run it and return the exit code."""
    parser = argparse.ArgumentParser(prog='inspection', description='Run a mission and all that it needs.')
    parser.add_argument(
        '--camera', choices=SOURCES, help='confirm each tag, from images, compressed images or detections'
    )
    parser.add_argument(
        '--world',
        action='store_true',
        help='confirm each tag, from images of the SDF world of lupin_simulation',
    )
    parser.add_argument(
        '--drive', action='store_true', help='drive to each tag with nav2, here a stand-in for it'
    )
    parser.add_argument('--output', type=Path, default=Path('.mission'), metavar='FOLDER', help='%(default)s')
    parser.add_argument(
        'arguments', nargs='*', metavar='name:=value', help='parameters of the mission, and of the navigator'
    )
    options = parser.parse_args(arguments)
    if options.world and options.camera is None:
        options.camera = 'image'
    install_signal_handlers()
    try:
        return run_mission(options)
    except (NodeEnded, subprocess.TimeoutExpired) as error:
        print(f'mission: {error}', file=sys.stderr)
        return 1
    except OneLineError as error:
        print(f'mission: {error}', file=sys.stderr)
        return USAGE
    except KeyboardInterrupt:
        return 130


if __name__ == '__main__':
    sys.exit(main())
