"""
The parameters of a node, declared as fields of a dataclass.

Does not import ROS at the top, so that a launch file can read a node's parameters.
"""

from dataclasses import field, fields

from lupin_greenhouse_bridge.errors import StartUpError, printable


def parameter(default, description: str, *, smallest=None, largest=None):
    """Return a dataclass field for one parameter; a number may have inclusive limits."""
    return field(default=default, metadata={'description': description, 'limits': (smallest, largest)})


_KINDS = {
    str: (str, 'text (put quotes around a number)'),
    bool: (bool, 'true or false'),
    float: ((int, float), 'a number'),
    int: (int, 'a whole number'),
}


def check_parameters(settings, *, of_any_type: tuple[str, ...] = ()) -> None:
    """Raise StartUpError for the first parameter with a wrong type or a value outside its limits."""
    for each in fields(settings):
        if each.name in of_any_type:
            continue
        value, (kind, wanted) = getattr(settings, each.name), _KINDS[each.type]
        smallest, largest = each.metadata['limits']
        if smallest is not None:
            wanted += f' from {smallest:g} to {largest:g}'
        is_right = isinstance(value, kind) and isinstance(value, bool) == (kind is bool)
        if not is_right or not (smallest is None or smallest <= value <= largest):  # also rejects NaN
            raise StartUpError(f'parameter {each.name} is {_shown(value)}: must be {wanted}')


def _shown(value) -> str:
    return printable(repr(value), 100)


def declare_parameters(node, settings_type):
    """
    Declare every field of a settings dataclass as a read-only parameter; return the settings.

    Logs a warning for each parameter that the node does not have. ROS would ignore it silently.
    """
    from rcl_interfaces.msg import ParameterDescriptor

    values = {}
    for each in fields(settings_type):
        # The dataclass checks the types. ROS would refuse 3600 for a double.
        descriptor = ParameterDescriptor(
            description=each.metadata['description'], read_only=True, dynamic_typing=True
        )
        values[each.name] = node.declare_parameter(each.name, each.default, descriptor).value
    warn_of_unknown_parameters(node)
    return settings_type(**values)


def warn_of_unknown_parameters(node) -> None:
    """Log a warning for each parameter that was set and that the node does not have."""
    for name in getattr(node, '_parameter_overrides', ()):  # private to rclpy: it may disappear
        if not node.has_parameter(name):
            node.get_logger().warning(f'parameter {printable(name, 64)} is unknown and ignored')


def launch_arguments(settings_type) -> list[tuple[str, str, type, str]]:
    """Return (name, default, type, description) of each parameter, with the default as launch writes it."""
    arguments = []
    for each in fields(settings_type):
        default = str(each.default).lower() if each.type is bool else str(each.default)
        arguments.append((each.name, default, each.type, each.metadata['description']))
    return arguments
