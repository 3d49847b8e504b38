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

from lupin_greenhouse_bridge.runtime.parameters import WANTED, default_text, parameter


@dataclass
class EveryNode:
    """The arguments that every node takes beside its parameters."""

    namespace: str = parameter('', 'Namespace of the node.')
    log_level: str = parameter('info', 'Least severe messages to log: debug, info, warn, error or fatal.')
    params_file: str = parameter(
        '', 'YAML file with parameters; an argument that is given here overrides it.'
    )
    respawn: bool = parameter(False, 'true: start the node again whenever it ends.')


@dataclass
class SimTime:
    """The argument of a node that can follow a simulated clock."""

    use_sim_time: bool = parameter(False, 'true: take the time from /clock.')


def _check_type(parameter: 'Field[Any]', value: str) -> None:
    """Raise ValueError, which names the argument, for a value that launch cannot convert."""
    try:
        coerce_to_type(value, parameter.type)
    except ValueError as error:
        example = f'such as {parameter.name}:={default_text(parameter)}'
        raise ValueError(
            f'{parameter.name}:={value} cannot be used: must be {WANTED[parameter.type]}, {example}'
        ) from error


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
    kinds = {each.name: each.type for each in parameters} | dict.fromkeys(without_effect)
    given: set[str] = set()

    def note_given(context: LaunchContext) -> None:
        given.update(context.launch_configurations)

    def start(context: LaunchContext) -> list[Node]:
        own = {each.name: LaunchConfiguration(each.name).perform(context) for each in fields(EveryNode)}
        params_file = own['params_file']
        if params_file and not os.path.isfile(params_file):
            raise FileNotFoundError(f"params_file '{params_file}' is not a file: name a YAML file")
        for each in parameters:
            _check_type(each, LaunchConfiguration(each.name).perform(context))
        forwarded = {
            name: ParameterValue(LaunchConfiguration(name), value_type=kind)
            for name, kind in kinds.items()
            if name in given
        }
        return [
            Node(
                namespace=own['namespace'],
                arguments=['--ros-args', '--log-level', own['log_level']],
                parameters=[each for each in (params_file, forwarded) if each],
                respawn=own['respawn'] == 'true',
                **node,
            )
        ]

    declarations = [
        DeclareLaunchArgument(
            each.name,
            default_value=default_text(each),
            description=each.metadata['description'],
            choices=['true', 'false'] if each.name in ('respawn', 'use_sim_time') else None,
        )
        for each in (*parameters, *fields(EveryNode))
    ]
    return [OpaqueFunction(function=note_given), *declarations, OpaqueFunction(function=start)]
