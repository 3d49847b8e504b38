# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Start a node from a launch file, whose arguments are the node's parameters and those of every node."""

import os
from collections.abc import Collection
from dataclasses import Field, dataclass, fields
from typing import Any

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.launch_context import LaunchContext
from launch.substitutions import LaunchConfiguration
from launch.utilities.type_utils import coerce_to_type
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from lupin_greenhouse_bridge.runtime.parameters import TYPE_NAMES, default_text, parameter


@dataclass
class CommonArguments:
    """The arguments of every node, besides its parameters."""

    namespace: str = parameter('', 'Namespace of the node.')
    log_level: str = parameter('info', 'Least severe messages to log: debug, info, warn, error or fatal.')
    params_file: str = parameter('', 'YAML file with parameters; a launch argument overrides it.')
    respawn: bool = parameter(False, 'true: start the node again whenever it ends.')


@dataclass
class SimTime:
    """The argument of a node that can follow a simulated clock."""

    use_sim_time: bool = parameter(False, 'true: take the time from /clock.')


def _value_of(argument: 'Field[Any]', text: str) -> Any:
    """Return the value of an argument; raises ValueError, which names the argument."""
    try:
        return coerce_to_type(text, argument.type)
    except ValueError as error:
        example = f'{argument.name}:={default_text(argument)}'
        wanted = f'must be {TYPE_NAMES[argument.type]}, such as {example}'
        raise ValueError(f'argument {argument.name} is {text!r}: {wanted}') from error


def node_with_arguments(
    settings_type: type, *, has_sim_time: bool = False, without_effect: Collection[str] = (), **node: Any
) -> list[Any]:
    """
    Return the actions that declare the arguments of a node and start it.

    Each parameter of the settings dataclass is an argument of the same name and type. The launch file
    forwards only arguments that are set: the values of the others come from params_file or from the node's
    defaults. It also forwards the arguments in `without_effect`, and the node logs that they have no effect.
    """
    parameters = [*fields(settings_type), *(fields(SimTime) if has_sim_time else ())]
    arguments = [*parameters, *fields(CommonArguments)]
    types = {spec.name: spec.type for spec in parameters} | dict.fromkeys(without_effect)
    set_names: set[str] = set()

    def record_set_names(context: LaunchContext) -> None:
        set_names.update(context.launch_configurations)

    def start(context: LaunchContext) -> list[Node]:
        texts = context.launch_configurations
        values = {argument.name: _value_of(argument, texts[argument.name]) for argument in arguments}
        params_file = values['params_file']
        if params_file and not os.path.isfile(params_file):
            raise FileNotFoundError(f"params_file '{params_file}' is not a file: name a YAML file")
        forwarded = {
            name: ParameterValue(LaunchConfiguration(name), value_type=types[name])
            for name in set_names.intersection(types)
        }
        return [
            Node(
                namespace=values['namespace'],
                arguments=['--ros-args', '--log-level', values['log_level']],
                parameters=[source for source in (params_file, forwarded) if source],
                respawn=values['respawn'],
                **node,
            )
        ]

    declarations = [
        DeclareLaunchArgument(
            argument.name,
            default_value=default_text(argument),
            description=argument.metadata['description'],
        )
        for argument in arguments
    ]
    # Before the declarations, only the arguments that the user has set have values.
    return [OpaqueFunction(function=record_set_names), *declarations, OpaqueFunction(function=start)]
