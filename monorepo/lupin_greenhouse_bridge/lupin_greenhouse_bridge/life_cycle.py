"""
The life cycle of a node: signals, parameters, spinning, start-up errors, and a clean shutdown.

Imports only the standard library. An executable can thus handle signals before it imports rclpy, and a launch
file can read a node's parameters without ROS.
"""

import contextlib
import gc
import importlib
import os
import signal
import sys
import time
import warnings
from dataclasses import field, fields
from typing import NoReturn

from .errors import OneLineError, StartUpError, printable

LONGEST_WAIT_SECONDS = 0.5  # rclpy waits in C, and Python handles a signal only after the wait
# ROS's default depth is 10, and DDS silently drops requests and replies beyond it. Each service receives the
# requests of all its clients, and each client the replies to all of them.
SERVICE_DEPTH = 1000

SIGNALS = (signal.SIGINT, signal.SIGTERM)

_is_asked_to_end = False


def take_signals() -> None:
    """
    Record Ctrl-C and SIGTERM from now on, instead of letting them interrupt the code.

    rclpy's own handlers shut the context down while other code uses it. Python's raise KeyboardInterrupt
    anywhere. Either can turn a signal into a traceback.
    """

    def note(_number, _frame):
        global _is_asked_to_end  # noqa: PLW0603 - a signal belongs to the process
        _is_asked_to_end = True

    for number in SIGNALS:
        signal.signal(number, note)


def is_asked_to_end() -> bool:
    """Return True once Ctrl-C or SIGTERM has arrived."""
    return _is_asked_to_end


def sleep(seconds: float) -> None:
    """Sleep for this time, or until a signal asks the process to end."""
    end = time.monotonic() + seconds
    while not _is_asked_to_end and (left := end - time.monotonic()) > 0.0:
        time.sleep(min(left, LONGEST_WAIT_SECONDS))


def start(module: str) -> NoReturn:
    """Handle signals, import the module, run its main(), and end the process with its exit code."""
    take_signals()
    try:
        end(importlib.import_module(module).main())
    except SystemExit as error:  # of argparse
        end(error.code or 0)


def end(exit_code: int) -> NoReturn:
    """End the process without unloading its libraries, whose threads may still run."""
    with contextlib.suppress(BrokenPipeError):
        sys.stdout.flush()
    sys.stderr.flush()
    os._exit(exit_code)


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
    for name in getattr(node, '_parameter_overrides', ()):  # private to rclpy: it may disappear
        if not node.has_parameter(name):
            node.get_logger().warning(f'parameter {printable(name, 64)} is unknown and ignored')
    return settings_type(**values)


def launch_arguments(settings_type) -> list[tuple[str, str, type, str]]:
    """Return (name, default, type, description) of each parameter, with the default as launch writes it."""
    arguments = []
    for each in fields(settings_type):
        default = str(each.default).lower() if each.type is bool else str(each.default)
        arguments.append((each.name, default, each.type, each.metadata['description']))
    return arguments


@contextlib.contextmanager
def ros(args=None):
    """
    Start ROS and yield an executor; at the end, close the executor, its nodes and ROS, in that order.

    Raises StartUpError for ROS arguments that cannot be parsed.
    """
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    take_signals()
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, UnicodeEncodeError) as error:  # the latter: bytes that are not UTF-8
        problem = security_problem() or 'the ROS arguments cannot be parsed'
        raise StartUpError(f'{problem}: {error}') from error
    try:
        executor = SingleThreadedExecutor()
        try:
            yield executor
        finally:
            nodes = executor.get_nodes()
            executor.shutdown()
            for node in nodes:
                node.destroy_node()
            gc.collect()  # a node whose constructor raised must be destroyed before ROS shuts down
    finally:
        rclpy.get_default_context().try_shutdown()
        for number in SIGNALS:  # Python resets its own handlers before DDS has ended
            signal.signal(number, signal.SIG_IGN)


def security_problem() -> str:
    """Return what may be wrong with the security settings; '' if SROS2 is not enabled."""
    if os.environ.get('ROS_SECURITY_ENABLE') != 'true':
        return ''
    if not os.environ.get('ROS_SECURITY_KEYSTORE'):
        return 'security is enabled, but ROS_SECURITY_KEYSTORE is not set: set it to the path of the keystore'
    return (
        'security is enabled (ROS_SECURITY_ENABLE): check the enclave (--enclave or'
        ' ROS_SECURITY_ENCLAVE_OVERRIDE) in the keystore, and that the RMW was built with security'
    )


@contextlib.contextmanager
def node_creation():
    """Wrap the creation of a node; raises StartUpError if ROS refuses it."""
    from rclpy.exceptions import NameValidationException, ParameterException
    from rclpy.impl.implementation_singleton import rclpy_implementation

    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', RuntimeWarning)  # rclpy's, of a node that it could not create
            yield
    except (NameValidationException, ParameterException) as error:
        raise StartUpError(f'the ROS arguments do not fit the node: {error}') from error
    except rclpy_implementation.RCLError as error:
        raise StartUpError(f'{security_problem() or "ROS cannot create the node"}: {error}') from error


def run(name: str, create_node, args=None, *, is_done=None, conclude=None, refused: int = 1) -> int:
    """
    Run one node until it is done, or until Ctrl-C or SIGTERM; return the exit code.

    `is_done(node)` is called after every callback. `conclude(node)` returns the exit code, 0 by default. A
    OneLineError becomes one FATAL line of the logger `name` and the exit code `refused`.
    """
    from rclpy.logging import get_logger

    def refuse(error: OneLineError) -> int:
        get_logger(name).fatal(str(error))
        return refused

    try:
        with ros(args) as executor:
            try:
                with node_creation():
                    node = create_node()
                executor.add_node(node)
                while not (is_asked_to_end() or (is_done and is_done(node))):
                    _spin_once(executor, node)
                return conclude(node) if conclude else 0
            except OneLineError as error:  # here, because it keeps alive a node that must go before ROS
                return refuse(error)
    except StartUpError as error:
        return refuse(error)


def _spin_once(executor, node) -> None:
    """Run one callback. Humble raises if a reply cannot be sent: log a warning and continue."""
    from rclpy.impl.implementation_singleton import rclpy_implementation

    try:
        executor.spin_once(timeout_sec=LONGEST_WAIT_SECONDS)
    except rclpy_implementation.RCLError as error:
        reason = printable(str(error), 300)
        node.get_logger().warning(f'continued after: {reason}', throttle_duration_sec=1.0)
