# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Start a node from a launch file, whose arguments are the node's parameters and those of every node."""

import os

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from lupin_greenhouse_bridge.runtime.parameters import launch_arguments

ARGUMENTS = {  # of every node: default, description, choices
    'namespace': ('', 'Namespace of the node.', None),
    'log_level': ('info', 'Least severe messages to log: debug, info, warn, error or fatal.', None),
    'params_file': ('', 'YAML file with parameters; an argument that is given here overrides it.', None),
    'respawn': ('false', 'true: start the node again whenever it ends.', ['true', 'false']),
}
SIM_TIME = ('false', 'true: take the time from /clock.', ['true', 'false'])


def node_with_arguments(
    settings_type, *, has_sim_time: bool = False, without_effect: tuple[str, ...] = (), **node
) -> list:
    """
    Return the actions that declare the arguments of a node and start it.

    Each parameter of the settings dataclass is an argument of the same name and type. The launch file
    forwards only arguments that are set: the values of the others come from params_file or from the node's
    defaults. It also forwards the arguments in `without_effect`, and the node logs that they have no effect.
    """
    parameters = launch_arguments(settings_type)
    declared = {name: (default, description, None) for name, default, _, description in parameters}
    kinds = {name: kind for name, _, kind, _ in parameters} | dict.fromkeys(without_effect)
    if has_sim_time:
        declared['use_sim_time'], kinds['use_sim_time'] = SIM_TIME, bool
    declared.update(ARGUMENTS)
    given = set()

    def start(context):
        values = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
        sources = []
        if params_file := values['params_file']:
            if not os.path.isfile(params_file):
                raise FileNotFoundError(f"params_file '{params_file}' is not a file: name a YAML file")
            sources.append(params_file)
        if forwarded := {
            name: ParameterValue(LaunchConfiguration(name), value_type=kind)
            for name, kind in kinds.items()
            if name in given
        }:
            sources.append(forwarded)
        return [
            Node(
                namespace=values['namespace'],
                arguments=['--ros-args', '--log-level', values['log_level']],
                parameters=sources,
                respawn=values['respawn'] == 'true',
                **node,
            )
        ]

    return [
        OpaqueFunction(function=lambda context: given.update(context.launch_configurations)),
        *(
            DeclareLaunchArgument(name, default_value=default, description=description, choices=choices)
            for name, (default, description, choices) in declared.items()
        ),
        OpaqueFunction(function=start),
    ]
