"""The parameters of a node, as fields of a dataclass. Imports ROS late, for launch files."""

from dataclasses import field, fields

from lupin_greenhouse_bridge.errors import StartUpError, escaped


def parameter(
    default, description: str, *, smallest=None, largest=None, accepted: str = '', of_any_type=False
):
    """
    Return a dataclass field for one parameter.

    A number may have inclusive limits. If `accepted` is set, the error message has this text instead of the
    limits. The dataclass itself checks a parameter `of_any_type`, such as one that takes a text or an array.
    """
    metadata = {
        'description': description,
        'limits': (smallest, largest),
        'accepted': accepted,
        'of_any_type': of_any_type,
    }
    return field(default=default, metadata=metadata)


_KINDS = {
    str: (str, 'text (put quotes around a number)'),
    bool: (bool, 'true or false'),
    float: ((int, float), 'a number'),
    int: (int, 'a whole number'),
}


def check_parameters(settings) -> None:
    """Raise StartUpError for the first parameter with a wrong type or a value outside its limits."""
    for each in fields(settings):
        if each.metadata['of_any_type']:
            continue
        value, (kind, wanted) = getattr(settings, each.name), _KINDS[each.type]
        smallest, largest = each.metadata['limits']
        if smallest is not None and not each.metadata['accepted']:
            wanted += f' from {smallest:g} to {largest:g}'
        if not isinstance(value, kind) or isinstance(value, bool) != (kind is bool):
            raise invalid(each.name, value, wanted)
        if smallest is not None and not smallest <= value <= largest:  # also rejects NaN
            raise invalid(each.name, value, each.metadata['accepted'] or wanted)


def invalid(name: str, value, accepted: str) -> StartUpError:
    """Return the error for a value that a parameter cannot have."""
    return StartUpError(f'parameter {name} is {escaped(repr(value), 100)}: must be {accepted}')


def declare_parameters(node, settings_type, *, without_effect: tuple[str, ...] = ()):
    """
    Declare every field of a settings dataclass as a read-only parameter; return the settings.

    Logs a warning for each parameter that the node does not have, because ROS ignores them silently. Logs one
    line with the parameters that are known to have no effect.
    """
    values = {
        each.name: node.declare_parameter(each.name, each.default, descriptor_of(each, read_only=False)).value
        for each in fields(settings_type)
    }
    if unused := [name for name in without_effect if _override(node, name) is not None]:
        node.get_logger().info(f'without effect in this node: {", ".join(unused)}')
    warn_of_unknown_parameters(node, besides=without_effect)
    settings = settings_type(**values)
    for each in fields(settings_type):
        # Not earlier: ROS would refuse a value outside its range, and not say which would be right.
        node.set_descriptor(each.name, descriptor_of(each, read_only=True))
    return settings


def _override(node, name: str):
    """Return the value that a parameter was set to; None if it was not set."""
    from rcl_interfaces.msg import ParameterDescriptor

    value = node.declare_parameter(name, None, ParameterDescriptor(dynamic_typing=True)).value
    node.undeclare_parameter(name)
    return value


def descriptor_of(field, *, read_only: bool):
    """Return the ROS description of a parameter; that of a read-only parameter includes the range."""
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    # The dataclass checks the types. ROS would refuse 3600 for a double.
    descriptor = ParameterDescriptor(
        description=field.metadata['description'], read_only=read_only, dynamic_typing=True
    )
    smallest, largest = field.metadata['limits']
    if read_only and smallest is not None:
        if field.type is int:
            descriptor.integer_range = [IntegerRange(from_value=smallest, to_value=largest, step=1)]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(smallest), to_value=float(largest))
            ]
    return descriptor


def warn_of_unknown_parameters(node, *, besides=()) -> None:
    """Log a warning for each parameter that was set, but that neither the node nor `besides` has."""
    from lupin_greenhouse_bridge.runtime.rclpy_internals import parameter_overrides

    for name in parameter_overrides(node):
        if not node.has_parameter(name) and name not in besides:
            node.get_logger().warning(f'parameter {escaped(name, 64)} is unknown and ignored')


def launch_arguments(settings_type) -> list[tuple[str, str, type, str]]:
    """Return (name, default, type, description) of each parameter, with the default as launch writes it."""
    arguments = []
    for each in fields(settings_type):
        default = str(each.default).lower() if each.type is bool else str(each.default)
        arguments.append((each.name, default, each.type, each.metadata['description']))
    return arguments
