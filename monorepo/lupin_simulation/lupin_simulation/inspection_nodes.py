"""The commands of the nodes of an inspection, with their parameters. Does not import ROS."""

import argparse
import json
from dataclasses import fields
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from lupin_greenhouse_bridge import settings as bridge_settings
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_mission import settings as mission_settings
from lupin_readings.reading_file import COMPANION_ENDINGS
from lupin_tag_confirmation import settings as confirm_tag_settings

from lupin_simulation import settings as navigator_settings
from lupin_simulation.settings import LayoutSettings

DRIVING_SPEEDUP = 20
SETTINGS = {
    'bridge_node': bridge_settings.Settings,
    'mission_orchestrator': mission_settings.Settings,
    'confirm_tag': confirm_tag_settings.Settings,
    'fake_camera': LayoutSettings,
    'fake_navigator': navigator_settings.Settings,
}
# The inspection itself sets these; tag_locations_file is the mission's name for tag_file.
SET_HERE = {'report_file', 'wait_for_start', 'wait_for_subscriber', 'route_file', 'tag_locations_file'}
PARAMETERS = {
    node: {field.name: field for field in fields(kind) if field.name not in SET_HERE}
    for node, kind in SETTINGS.items()
}
PARAMETERS['record_readings'] = {'tag_file': PARAMETERS['bridge_node']['tag_file']}
SETTABLE = sorted(set().union(*PARAMETERS.values()))


def executable(package: str, name: str) -> str:
    """Return the path of the executable that `ros2 run` starts; raises StartUpError without the package."""
    try:
        return str(Path(get_package_prefix(package), 'lib', package, name))
    except PackageNotFoundError as error:
        raise StartUpError(f'the package {package} is not found: build it and source its setup') from error


def companion(report: Path, name: str) -> Path:
    """Return the path of a file that a run keeps beside its report: the route, or a copy of an input."""
    return report.with_name(report.stem + COMPANION_ENDINGS[name])


def command(package: str, node: str, given: dict[str, str], **parameters: Any) -> list[str]:
    """Return the command of a node. The parameters of the user override the others."""
    rules = {name: json.dumps(value, ensure_ascii=False) for name, value in parameters.items()}
    for name, value in given.items():
        if field := PARAMETERS[node].get(name):
            # ROS parses a value as YAML, which reads the id 010 as the number 8.
            rules[name] = json.dumps(value, ensure_ascii=False) if field.type is str else value
    words = [word for name, value in rules.items() for word in ('-p', f'{name}:={value}')]
    return [executable(package, node), '--ros-args', *words]


def commands_of(options: argparse.Namespace, report: Path) -> dict[str, list[str]]:
    """Return the commands by node name. The mission is the last one. The first one ends last."""
    given: dict[str, str] = options.parameters
    nodes = {}
    mission: dict[str, Any] = {'report_file': str(report), 'wait_for_start': False, 'drive': 'simulated'}
    if options.record:
        recorded = {'file': options.record, 'readings_topics': '/mission/readings'}
        nodes['record_readings'] = command('lupin_readings', 'record_readings', given, **recorded)
        mission['wait_for_subscriber'] = True
    nodes['bridge_node'] = command('lupin_greenhouse_bridge', 'bridge_node', given)
    if options.drive:
        driving = {'speedup': DRIVING_SPEEDUP, 'route_file': str(companion(report, 'route'))}
        nodes['fake_navigator'] = command('lupin_simulation', 'fake_navigator', given, **driving)
        dock = given.get('start_pose', navigator_settings.Settings.start_pose)
        mission |= {'drive': 'nav2', 'order': 'shortest', 'dock_pose': dock}
    if options.camera:
        mission |= {'require_visual_confirmation': True, 'drive_seconds': 0.2}
        nodes['confirm_tag'] = command('lupin_tag_confirmation', 'confirm_tag', given)
        nodes['fake_camera'] = command('lupin_simulation', 'fake_camera', given, from_odometry=options.drive)
    if tag_file := given.get('tag_file'):
        mission['tag_locations_file'] = tag_file
    nodes['mission_orchestrator'] = command('lupin_mission', 'mission_orchestrator', given, **mission)
    return nodes
