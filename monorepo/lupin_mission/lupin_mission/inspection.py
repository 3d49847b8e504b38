"""
`ros2 run lupin_mission inspection`: run a whole mission on its own ROS domain.

Starts the bridge, the mission and, with --camera, a camera that confirms tags. Writes a report, its
picture and its page. Exit code: the mission's, 0 if all tags were read; 1 if another node ends first; 2 if it
cannot start.
"""

import argparse
import contextlib
import importlib.util
import os
import subprocess
import sys
import time
from pathlib import Path

import domain_coordinator
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError

USAGE = 2
LONGEST_MISSION_SECONDS = 900
LOOK_EVERY_SECONDS = 0.2  # at the nodes
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


def nodes_of(options) -> tuple[list[list[str]], list[str]]:
    """Return the commands of the nodes around the mission, and the mission's parameters that suit them."""
    nodes = [[executable('lupin_greenhouse_bridge', 'bridge_node')]]
    if not options.camera:
        return nodes, []
    mission = ['require_visual_confirmation:=true', 'drive_seconds:=0.2']
    if options.world:
        folder = options.output / 'world'
        command = [executable('lupin_world', 'generate_world'), '--side', '0.04', '--output', str(folder)]
        if not importlib.util.find_spec('pydrake'):
            raise StartUpError('Drake is missing, which renders the world: pip install drake')
        if subprocess.run(command, check=False).returncode:
            raise StartUpError('the world cannot be made')
        world_file = f'world_file:="{folder / "greenhouse.sdf"}"'
        # Rendering an image takes a while.
        mission += [world_file, f'visual_confirmation_timeout_s:={PATIENCE_SECONDS}']
        listening = [f'timeout_seconds:={PATIENCE_SECONDS}', 'max_image_age_seconds:=5.0']
        camera = [executable('lupin_world', 'world_camera'), *parameters([world_file])]
    else:
        listening = [f'source:={options.camera}']
        stand_in = executable('lupin_perception', 'camera_stand_in')
        camera = [stand_in, *parameters([f'publishes:={options.camera}'])]
    confirm_tag = [executable('lupin_perception', 'confirm_tag'), *parameters(listening)]
    return [*nodes, confirm_tag, camera], mission


def stop(process: subprocess.Popen) -> None:
    """End a node."""
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def exit_code_of(mission: subprocess.Popen, others: list[subprocess.Popen]) -> int:
    """Return the exit code of the mission; raises NodeEnded if another node ends first, or TimeoutExpired."""
    deadline = time.monotonic() + LONGEST_MISSION_SECONDS
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return mission.wait(LOOK_EVERY_SECONDS)
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
        raise StartUpError('WORLD=1 needs CAMERA=1, and publishes images only')
    mission_node = executable('lupin_mission', 'mission_orchestrator')
    nodes, suitable = nodes_of(options)
    options.output.mkdir(parents=True, exist_ok=True)
    name = 'world' if options.world else 'camera' if options.camera else 'simulation'
    report = options.output / f'{name}.jsonl'
    report.unlink(missing_ok=True)
    with domain_coordinator.domain_id() as domain_id, contextlib.ExitStack() as stack:
        alone = {'ROS_DOMAIN_ID': str(domain_id), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        environment = os.environ | alone
        own = [f'report_file:="{report}"', 'wait_for_start:=false']
        processes = []
        for command in [*nodes, [mission_node, *parameters([*own, *suitable, *options.arguments])]]:
            processes.append(subprocess.Popen(command, env=environment))
            stack.callback(stop, processes[-1])
        *others, mission = processes
        exit_code = exit_code_of(mission, others)
    if exit_code == USAGE:
        return USAGE
    plotting = subprocess.run([executable('lupin_mission', 'plot_report'), str(report)], check=False)
    # Plotly is optional: without it, this prints how to install it.
    subprocess.run([executable('lupin_greenhouse_bridge', 'readings_page'), str(report)], check=False)
    print(f'report: {report}')
    return exit_code or plotting.returncode


def main(arguments: list[str] | None = None) -> int:
    """Run it and return the exit code."""
    parser = argparse.ArgumentParser(prog='inspection', description='Run a mission and all that it needs.')
    parser.add_argument(
        '--camera', choices=SOURCES, help='confirm each tag, from images, compressed images or detections'
    )
    parser.add_argument('--world', action='store_true', help='the camera is in the SDF world of lupin_world')
    parser.add_argument('--output', type=Path, default=Path('.mission'), metavar='FOLDER', help='%(default)s')
    parser.add_argument('arguments', nargs='*', metavar='name:=value', help='parameters of the mission')
    try:
        return run_mission(parser.parse_args(arguments))
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
