"""
`ros2 run lupin_mission inspection`: run a whole mission on its own ROS domain.

Starts the bridge, the mission and, with --camera, a camera that confirms tags. Writes a report and its
picture. Exit code: the mission's, 0 if all tags were read; 2 if it cannot start.
"""

import argparse
import contextlib
import os
import subprocess
import sys
from pathlib import Path

import domain_coordinator
from ament_index_python.packages import get_package_prefix

LONGEST_MISSION_SECONDS = 900
PATIENCE_SECONDS = 10.0
# What the camera publishes, and the matching parameters of confirm_tag.
SOURCES = {
    'image': [],
    'compressed': ['compressed_image_topic:=/camera/color/image_raw/compressed'],
    'detections': ['detections_topic:=/detections'],
}


def executable(package: str, name: str) -> str:
    """Return the path of the executable that `ros2 run` starts."""
    return str(Path(get_package_prefix(package), 'lib', package, name))


def parameters(assignments: list[str]) -> list[str]:
    """Turn name:=value of `ros2 launch` into arguments of a node."""
    return ['--ros-args', *(word for each in assignments for word in ('-p', each))]


def make_world(folder: Path) -> Path:
    """Make the SDF world of the shipped layout, with 4 cm tags, and return its file."""
    command = [executable('lupin_world', 'generate_world'), '--side', '0.04', '--output', str(folder)]
    subprocess.run(command, check=True)
    return folder / 'greenhouse.sdf'


@contextlib.contextmanager
def running(command: list[str], environment: dict[str, str]):
    """Run a command in the background until the block ends."""
    process = subprocess.Popen(command, env=environment)
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def main(arguments: list[str] | None = None) -> int:
    """Run it and return the exit code."""
    parser = argparse.ArgumentParser(
        prog='inspection', description='Run a whole mission on its own ROS domain.'
    )
    parser.add_argument(
        '--camera', choices=SOURCES, help='confirm each tag, from images, compressed images or detections'
    )
    parser.add_argument('--world', action='store_true', help='the camera is in the SDF world of lupin_world')
    parser.add_argument(
        '--output', type=Path, default=Path('.mission'), metavar='FOLDER', help='default: %(default)s'
    )
    parser.add_argument('arguments', nargs='*', metavar='name:=value', help='parameters of the mission')
    options = parser.parse_args(arguments)
    if options.world and options.camera != 'image':
        print('mission: WORLD=1 needs CAMERA=1, and publishes images only', file=sys.stderr)
        return 2
    mission_node = executable('lupin_mission', 'mission_node')
    options.output.mkdir(parents=True, exist_ok=True)
    name = 'world' if options.world else 'camera' if options.camera else 'simulation'
    report = options.output / f'{name}.jsonl'
    report.unlink(missing_ok=True)

    with domain_coordinator.domain_id() as domain_id, contextlib.ExitStack() as stack:
        environment = {
            **os.environ,
            'ROS_DOMAIN_ID': str(domain_id),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        }
        stack.enter_context(running([executable('lupin_greenhouse_bridge', 'bridge_node')], environment))
        suitable = [f'report_file:="{report}"']
        if options.camera:
            if options.world:
                world_file = make_world(options.output / 'world')
                # Rendering an image takes a while.
                suitable += [
                    f'world_file:="{world_file}"',
                    f'request_timeout_seconds:={PATIENCE_SECONDS + 1.0}',
                ]
                listening = [f'timeout_seconds:={PATIENCE_SECONDS}', 'max_image_age_seconds:=5.0']
                camera = [executable('lupin_world', 'world_camera')]
                publishing = [f'world_file:="{world_file}"']
            else:
                listening = SOURCES[options.camera]
                camera = [executable('lupin_perception', 'camera_stand_in')]
                publishing = [f'publishes:={options.camera}']
            for command in (
                [executable('lupin_perception', 'confirm_tag'), *parameters(listening)],
                [*camera, *parameters(publishing)],
            ):
                stack.enter_context(running(command, environment))
            # One call is enough: confirm_tag looks until the tag appears.
            suitable += ['require_visual_confirmation:=true', 'drive_seconds:=0.2', 'max_attempts:=1']
        else:
            suitable += ['dwell_seconds:=0.1']
        try:
            mission = subprocess.run(
                [mission_node, *parameters([*suitable, *options.arguments])],
                env=environment,
                timeout=LONGEST_MISSION_SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            print(f'mission: {error}', file=sys.stderr)
            return 1
        except KeyboardInterrupt:
            return 130
    if mission.returncode == 2:
        return 2
    plotting = subprocess.run([executable('lupin_mission', 'plot_report'), str(report)], check=False)
    print(f'report: {report}')
    return mission.returncode or plotting.returncode


if __name__ == '__main__':
    sys.exit(main())
