"""The nodes of an inspection as commands, with the parameters that each of them gets. Does not import ROS."""

import argparse
import contextlib
import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from lupin_greenhouse_bridge import settings as bridge_settings
from lupin_greenhouse_bridge.display.reading_file import COMPANION_ENDINGS
from lupin_greenhouse_bridge.errors import StartUpError, escaped, refuse_typo
from lupin_greenhouse_bridge.runtime.parameters import fault_of_rule
from lupin_mission import settings as mission_settings
from lupin_tag_confirmation import settings as confirm_tag_settings

from lupin_simulation import settings as navigator_settings
from lupin_simulation.settings import LayoutSettings

DRIVING_SPEEDUP = 20
# The inspection itself sets these parameters of the nodes.
SET_HERE = {'report_file', 'wait_for_start', 'wait_for_subscriber', 'route_file'}
SETTINGS = {
    'bridge_node': bridge_settings.Settings,
    'mission_orchestrator': mission_settings.Settings,
    'confirm_tag': confirm_tag_settings.Settings,
    'fake_navigator': navigator_settings.Settings,
}
OPTIONS = ('camera', 'drive', 'record')  # of make too, which writes them in capitals
LAYOUT = {each.name for each in fields(LayoutSettings)}
NAMES = {node: {each.name for each in fields(kind)} for node, kind in SETTINGS.items()}
SETTABLE = sorted(set().union(*NAMES.values()) - SET_HERE)  # with --camera and --drive


def executable(package: str, name: str) -> str:
    """Return the path of the executable that `ros2 run` starts; raises StartUpError without the package."""
    try:
        return str(Path(get_package_prefix(package), 'lib', package, name))
    except PackageNotFoundError as error:
        raise StartUpError(f'the package {package} is not found: build it and source its setup') from error


def companion(report: Path, name: str) -> Path:
    """Return the path of a file that a run keeps beside its report: the route, or a copy of an input."""
    return report.with_name(report.stem + COMPANION_ENDINGS[name])


def value_of(arguments: list[str], name: str) -> str:
    """Return the last value of an argument, without quotes; '' if it is not set."""
    values = [each.partition(':=')[2] for each in arguments if each.startswith(f'{name}:=')]
    return values[-1].strip('"\'') if values else ''


def arguments_by_node(options: argparse.Namespace) -> dict[str, list[str]]:
    """Return the arguments of each node: its parameters. Raises StartUpError."""
    names = {node: set(own) for node, own in NAMES.items()}
    needed: dict[str, str] = {}  # by the name of a parameter: the option for its node, which is left out
    for option, node in (('camera', 'confirm_tag'), ('drive', 'fake_navigator')):
        if not getattr(options, option):
            needed |= dict.fromkeys(names.pop(node) - SET_HERE, option)
    settable = set().union(*names.values()) - SET_HERE
    names['mission_orchestrator'] |= set(mission_settings.WITHOUT_EFFECT)
    names |= {'record_readings': {'tag_file'}, 'fake_camera': LAYOUT}
    for each in options.arguments:
        name = re.split('[:=]', each)[0]
        if name.lower() in OPTIONS:
            value = each[len(name) :].lstrip(':=') if name.lower() in ('camera', 'record') else '1'
            told = f'{name.upper()}={escaped(value, 64)} (without make: --{name.lower()})'
            raise StartUpError(f"'{escaped(each, 64)}' sets no parameter: write {told}")
        if name not in settable | set(mission_settings.WITHOUT_EFFECT):
            if option := needed.get(name, ''):
                told = f'{option.upper()}=1 (without make: --{option})'
                raise StartUpError(f"'{escaped(each, 64)}' sets a parameter of a run with {told}: add it")
            refuse_typo(name, settable, 'parameter')
            wrong = f'no node has a parameter {escaped(name, 64)}'
            if ':=' not in each:
                wrong = f"'{escaped(each, 64)}' sets no parameter: write name:=value"
            raise StartUpError(f'{wrong}: see make mission ARGS=--help (without make: --help)')
        if not each.partition(':=')[2]:
            raise StartUpError(fault_of_rule(each, options.arguments))
    return {
        node: [each for each in options.arguments if each.partition(':=')[0] in own]
        for node, own in names.items()
    }


def commands_of(options: argparse.Namespace, report: Path) -> list[list[str]]:
    """Return the commands of the nodes. The last one is the mission; the first one ends last."""
    arguments = arguments_by_node(options)

    def node(package: str, name: str, **parameters: Any) -> list[str]:
        """Return the command of a node with these parameters, before those of the user, which count."""
        own = [f'{key}:={json.dumps(value, ensure_ascii=False)}' for key, value in parameters.items()]
        words = [word for each in (*own, *arguments[name]) for word in ('-p', each)]
        return [executable(package, name), '--ros-args', *words]

    nodes = [node('lupin_greenhouse_bridge', 'bridge_node')]
    mission: dict[str, Any] = {'report_file': str(report), 'wait_for_start': False, 'drive': 'simulated'}
    if options.record:
        recorded = {'file': options.record, 'readings_topics': '/mission/readings'}
        nodes.insert(0, node('lupin_greenhouse_bridge', 'record_readings', **recorded))
        mission['wait_for_subscriber'] = True
    if options.drive:
        route = str(companion(report, 'route'))
        nodes.append(node('lupin_simulation', 'fake_navigator', speedup=DRIVING_SPEEDUP, route_file=route))
        dock = value_of(options.arguments, 'start_pose') or navigator_settings.Settings.start_pose
        mission |= {'drive': 'nav2', 'order': 'shortest', 'dock_pose': dock}
    if tag_file := value_of(options.arguments, 'tag_file'):
        mission['tag_locations_file'] = tag_file
    if options.camera:
        mission |= {'require_visual_confirmation': True, 'drive_seconds': 0.2}
        nodes.append(node('lupin_tag_confirmation', 'confirm_tag', source=options.camera))
        camera = {'publishes': options.camera, 'from_odometry': options.drive}
        nodes.append(node('lupin_simulation', 'fake_camera', **camera))
    return [*nodes, node('lupin_mission', 'mission_orchestrator', **mission)]


def check_values(commands: list[list[str]]) -> dict[str, Any]:
    """Return the settings by the name of their node; raises StartUpError for a value that it will refuse."""
    settings = {}
    for path, *words in commands:
        if kind := SETTINGS.get(Path(path).name):
            given = dict(each.split(':=', 1) for each in words if ':=' in each)
            values = {each.name: parsed(given[each.name]) for each in fields(kind) if each.name in given}
            settings[Path(path).name] = kind(**values)
    return settings


def parsed(text: str) -> Any:
    """Return what ROS makes of a value: true or false, a number, an array, or else a text."""
    with contextlib.suppress(ValueError):  # YAML takes 1e3 for a text
        return int(text) if text.strip().isdecimal() else float(text)
    with contextlib.suppress(yaml.YAMLError):
        value = yaml.safe_load(text)
        if isinstance(value, bool | int | list | str):
            return value
    return text
