# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The parameters of a node, as fields of a dataclass. Imports ROS late, for launch files and planners."""

import re
from collections.abc import Collection
from dataclasses import Field, field, fields
from typing import TYPE_CHECKING, Any, TypeVar, cast

from lupin_greenhouse_bridge.errors import StartUpError, escaped

if TYPE_CHECKING:
    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.node import Node

SettingsT = TypeVar('SettingsT')
OF_ROS_NAMES = '_topic', '_service', '_service_name', '_action_name'  # endings of such parameters
ROS_NAME = re.compile(r'~|(~?/)?[A-Z_]\w*(/[A-Z_]\w*)*', re.ASCII | re.IGNORECASE)
OF_EVERY_NODE = ('use_sim_time', 'start_type_description_service')
WANTED: dict[Any, str] = {
    str: 'text (put quotes around a number)',
    bool: 'true or false',
    float: 'a number',
    int: 'a whole number',
}


def parameter(
    default: Any,
    description: str,
    *,
    smallest: float | None = None,
    largest: float | None = None,
    accepted: str = '',
    of_any_type: bool = False,
) -> Any:
    """
    Return a dataclass field for one parameter.

    A number may have inclusive limits. If `accepted` is set, the error message has this text instead of the
    limits. The dataclass itself checks a parameter `of_any_type`, such as one that takes a text or an array.
    """
    metadata = {'description': description, 'limits': (smallest, largest)}
    return field(default=default, metadata={**metadata, 'accepted': accepted, 'of_any_type': of_any_type})


def check_parameters(settings: Any) -> None:
    """Raise StartUpError for the first parameter with a wrong type or a value outside its limits."""
    for each in fields(settings):
        if each.metadata['of_any_type']:
            continue
        value, wanted = getattr(settings, each.name), WANTED[each.type]
        (smallest, largest), accepted = each.metadata['limits'], each.metadata['accepted']
        if smallest is not None and not accepted:
            wanted += f' from {smallest:g} to {largest:g}'
        if type(value) is not each.type and not (type(value) is int and each.type is float):
            raise invalid(each.name, value, f'{wanted}, {accepted}' if accepted else wanted)
        if smallest is not None and not smallest <= value <= largest:  # also refuses NaN
            raise invalid(each.name, value, accepted or wanted)
        is_left_out = value == '' and each.name.endswith('_topic')
        if each.name.endswith(OF_ROS_NAMES) and not (is_left_out or ROS_NAME.fullmatch(value)):
            raise invalid(each.name, value, 'words of letters, digits and _, such as /front/image')


def invalid(name: str, value: object, accepted: str) -> StartUpError:
    """Return the error for a value that a parameter cannot have."""
    return StartUpError(f'parameter {name} is {escaped(repr(value), 100)}: must be {accepted}')


def declare_parameters(
    node: 'Node', settings_type: type[SettingsT], *, without_effect: Collection[str] = ()
) -> SettingsT:
    """
    Declare every field of a settings dataclass as a read-only parameter; return the settings.

    Logs one line with the parameters that are known to have no effect. Raises the StartUpError of the
    dataclass.
    """
    from rcl_interfaces.msg import ParameterDescriptor

    parameters = fields(cast('Any', settings_type))
    values = {}
    for each in parameters:
        # The dataclass checks types and ranges. ROS would refuse 3600 for a double.
        unchecked = ParameterDescriptor(dynamic_typing=True)
        values[each.name] = node.declare_parameter(each.name, each.default, unchecked).value
    check_names(node, without_effect)
    settings = settings_type(**values)
    for each in parameters:
        node.set_descriptor(each.name, _descriptor(each))
    return settings


def _descriptor(parameter: 'Field[Any]') -> 'ParameterDescriptor':
    """Return the ROS description of a parameter: read-only, with the range of a number."""
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    description = parameter.metadata['description']
    descriptor = ParameterDescriptor(description=description, read_only=True, dynamic_typing=True)
    smallest, largest = parameter.metadata['limits']
    if parameter.type is int:
        descriptor.integer_range = [IntegerRange(from_value=smallest, to_value=largest, step=1)]
    elif parameter.type is float:
        limits = FloatingPointRange(from_value=float(smallest), to_value=float(largest))
        descriptor.floating_point_range = [limits]
    return descriptor


def check_names(node: 'Node', without_effect: Collection[str] = ()) -> None:
    """
    Warn of each parameter that is set but unknown, because ROS ignores it silently.

    No name is refused, because other nodes may share the parameter file. Logs one line for those
    `without_effect`.
    """
    from lupin_greenhouse_bridge.runtime.rclpy_internals import parameter_overrides

    given = parameter_overrides(node)
    unknown = [name for name in given if not node.has_parameter(name)]
    if unused := [name for name in without_effect if name in unknown]:
        node.get_logger().info(f'without effect in this node: {", ".join(unused)}')
    for name in unknown:
        if name not in without_effect:
            node.get_logger().warning(f'parameter {escaped(name, 64)} is unknown and ignored: see --help')


def default_text(parameter: 'Field[Any]') -> str:
    """Return the default of a parameter as launch files write it."""
    return str(parameter.default).lower() if parameter.type is bool else str(parameter.default)
