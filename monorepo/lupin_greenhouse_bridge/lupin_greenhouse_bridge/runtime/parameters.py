# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The parameters of a node, as fields of a dataclass. Imports ROS late, for planners that run without ROS."""

import re
from collections.abc import Collection
from dataclasses import Field, field, fields
from typing import TYPE_CHECKING, Any, TypeVar, cast

from lupin_greenhouse_bridge.errors import StartUpError, escaped

if TYPE_CHECKING:
    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.node import Node

SettingsT = TypeVar('SettingsT')
# A parameter whose name ends like this has the name of a topic, a service or an action as its value.
ROS_NAME_ENDINGS = '_topic', '_service', '_service_name', '_action_name'
ROS_NAME = re.compile(r'~|(~?/)?[A-Z_]\w*(/[A-Z_]\w*)*', re.ASCII | re.IGNORECASE)
TYPE_NAMES: dict[Any, str] = {
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
    for spec in fields(settings):
        if spec.metadata['of_any_type']:
            continue
        name, value, wanted = spec.name, getattr(settings, spec.name), TYPE_NAMES[spec.type]
        (smallest, largest), accepted = spec.metadata['limits'], spec.metadata['accepted']
        if smallest is not None and not accepted:
            wanted += f' from {smallest:g} to {largest:g}'
        if type(value) is not spec.type and not (type(value) is int and spec.type is float):
            raise invalid(name, value, f'{wanted}, {accepted}' if accepted else wanted)
        if smallest is not None and not smallest <= value <= largest:  # also refuses NaN
            raise invalid(name, value, accepted or wanted)
        is_unused_topic = value == '' and name.endswith('_topic')
        if name.endswith(ROS_NAME_ENDINGS) and not (is_unused_topic or ROS_NAME.fullmatch(value)):
            raise invalid(name, value, 'words of letters, digits and _, such as /front/image')


def invalid(name: str, value: object, accepted: str) -> StartUpError:
    """Return the error for a value that a parameter cannot have."""
    return StartUpError(f'parameter {name} is {escaped(repr(value), 100)}: must be {accepted}')


def declare_parameters(
    node: 'Node', settings_type: type[SettingsT], *, without_effect: Collection[str] = ()
) -> SettingsT:
    """
    Declare every field of a settings dataclass as a read-only parameter; return the settings.

    ROS silently ignores a parameter that is set but not declared: this logs a warning for each, and one line
    for those in `without_effect`. It refuses none, because several nodes may share a parameter file. Raises
    the StartUpError of the dataclass.
    """
    from rcl_interfaces.msg import ParameterDescriptor

    from lupin_greenhouse_bridge.runtime.rclpy_internals import parameter_overrides

    specs = fields(cast('Any', settings_type))
    values = {}
    for spec in specs:
        # The dataclass checks types and ranges. ROS would refuse 3600 for a double.
        unchecked = ParameterDescriptor(dynamic_typing=True)
        values[spec.name] = node.declare_parameter(spec.name, spec.default, unchecked).value
    undeclared = [name for name in parameter_overrides(node) if not node.has_parameter(name)]
    if unused := [name for name in without_effect if name in undeclared]:
        node.get_logger().info(f'without effect in this node: {", ".join(unused)}')
    for name in undeclared:
        if name not in without_effect:
            node.get_logger().warning(f'parameter {escaped(name, 64)} is unknown and ignored: see --help')
    settings = settings_type(**values)
    for spec in specs:
        node.set_descriptor(spec.name, _descriptor(spec))
    return settings


def _descriptor(spec: 'Field[Any]') -> 'ParameterDescriptor':
    """Return the ROS description of a parameter: read-only, with the range of a number."""
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    description = spec.metadata['description']
    descriptor = ParameterDescriptor(description=description, read_only=True, dynamic_typing=True)
    smallest, largest = spec.metadata['limits']
    if spec.type is int:
        descriptor.integer_range = [IntegerRange(from_value=smallest, to_value=largest, step=1)]
    elif spec.type is float:
        limits = FloatingPointRange(from_value=float(smallest), to_value=float(largest))
        descriptor.floating_point_range = [limits]
    return descriptor


def default_text(spec: 'Field[Any]') -> str:
    """Return the default of a parameter as launch files write it."""
    return str(spec.default).lower() if spec.type is bool else str(spec.default)
