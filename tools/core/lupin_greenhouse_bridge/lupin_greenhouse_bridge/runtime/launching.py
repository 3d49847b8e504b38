"""Start a node from a launch file, whose arguments are the node's parameters and those of every node."""

import os
from collections.abc import Collection
from typing import Any

from launch import LaunchContext
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from lupin_greenhouse_bridge.runtime.parameters import launch_arguments

_Argument = tuple[str, str, str, list[str] | None]  # name, default, description, choices
SWITCH = ['true', 'false']
ARGUMENTS: tuple[_Argument, ...] = (  # of every node
    ('namespace', '', 'Namespace of the node.', None),
    ('log_level', 'info', 'Least severe messages to log: debug, info, warn, error or fatal.', None),
    ('params_file', '', 'YAML file with parameters; an argument that is given here overrides it.', None),
    ('respawn', 'false', 'true: start the node again whenever it ends.', SWITCH),
)
SIM_TIME: _Argument = ('use_sim_time', 'false', 'true: take the time from /clock.', SWITCH)


def node_with_arguments(
    settings_type: type, *, has_sim_time: bool = False, without_effect: Collection[str] = (), **node: Any
) -> list[Any]:
    """
    Return the actions that declare the arguments of a node and start it.

    Each parameter of the settings dataclass is an argument of the same name and type. The launch file
    forwards only arguments that are set: the values of the others come from params_file or from the node's
    defaults. It also forwards the arguments in `without_effect`, and the node logs that they have no effect.
    """
    settings = launch_arguments(settings_type)
    kinds = {name: kind for name, _, kind, _ in settings} | dict.fromkeys(without_effect)
    declared: list[_Argument] = [
        (name, default, description, None) for name, default, _, description in settings
    ]
    if has_sim_time:
        kinds['use_sim_time'] = bool
        declared.append(SIM_TIME)
    given: set[str] = set()

    def note_given(context: LaunchContext) -> None:
        given.update(context.launch_configurations)

    def start(context: LaunchContext) -> list[Node]:
        values = {name: LaunchConfiguration(name).perform(context) for name, *_ in ARGUMENTS}
        params_file = values['params_file']
        if params_file and not os.path.isfile(params_file):
            raise FileNotFoundError(f"params_file '{params_file}' is not a file: name a YAML file")
        forwarded = {
            name: ParameterValue(LaunchConfiguration(name), value_type=kind)
            for name, kind in kinds.items()
            if name in given
        }
        return [
            Node(
                namespace=values['namespace'],
                arguments=['--ros-args', '--log-level', values['log_level']],
                parameters=[each for each in (params_file, forwarded) if each],
                respawn=values['respawn'] == 'true',
                **node,
            )
        ]

    declarations = [
        DeclareLaunchArgument(name, default_value=default, description=description, choices=choices)
        for name, default, description, choices in (*declared, *ARGUMENTS)
    ]
    return [OpaqueFunction(function=note_given), *declarations, OpaqueFunction(function=start)]
