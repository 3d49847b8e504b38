# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Run a node: start ROS, create the node, spin it, and close everything in the right order."""

import contextlib
import gc
import inspect
import itertools
import math
import os
import re
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from types import ModuleType
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.logging import get_logger, get_logger_effective_level, set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.graph import discovery_settings, namesake_warning
from lupin_greenhouse_bridge.runtime.output import aligned_table, print_line
from lupin_greenhouse_bridge.runtime.parameters import default_text, fault_of_rule
from lupin_greenhouse_bridge.runtime.process import security_problem
from lupin_greenhouse_bridge.runtime.rclpy_internals import LoggingSeverity, RCLError

LOOK_EVERY_SECONDS = 5.0  # for another node of the same name
# Errors of rclpy.init, which have these words from Humble to Lyrical, and what to change.
START_FAULTS = {
    r"params file: '--params-file (.*?)'\. Error: (.*?), at ": (
        "parameter file '{}' cannot be read ({}): name a YAML file with ros__parameters"
    ),
    r"remap rule: '-\S+ (\S+:=\S*?(?:[^\w/~{}:\s']|(?<=[/=])\d)\S*)'\. Error": (
        "ROS cannot rename by '{}': a name has letters, digits and _ only, and begins with no digit"
    ),
    r"remap rule: '-\S+ __ns:=([^/']+)'\. Error": "namespace '{0}' must begin with /: write -r __ns:=/{0}",
    r"remap rule: '-\S+ (.*?)'\. Error": "ROS cannot rename by '{}': write FROM:=TO, like -r __ns:=/robot1",
    r'trailing (\S+) flag': '{} has no value: write one after it, like -p name:=value or -r __ns:=/robot1',
    r"\['([\w.]+)(:?=)(.*?)'[,\]]": "'{0}{1}{2}' lacks its -p: write -p {0}:={2}",
    r"^[^']*\['(.*?)'[,\]]": (
        "'{}' is no ROS argument: write it before --ros-args, or a parameter as -p name:=value"
    ),
    r"log level: '--log-level (.*?)'": '--log-level {}: must be debug, info, warn, error or fatal',
    r"create log directory:? '?(.*?)'?(?:: \d+)?, at": (
        "ROS cannot make the folder '{}' for its logs: set ROS_LOG_DIR to a folder that you can write to"
    ),
    'logging directory|log directory': (
        'ROS cannot make a folder for its logs: set ROS_LOG_DIR to a folder that you can write to'
    ),
}
UNKNOWN_PEER = (
    "ROS_STATIC_PEERS has '{}', which is no host that is known: write host names or addresses, with ; between"
)


def run(
    name: str,
    create_node: Callable[[], Any],
    args: list[str] | None = None,
    *,
    is_done: Callable[[Any], bool] = lambda _node: False,
    conclude: Callable[[Any], int] = lambda _node: 0,
    refused: int = 1,
) -> int:
    """
    Run one node until it is done, or until Ctrl-C or SIGTERM; return the exit code.

    `create_node` is the node's class. With --help, this prints the help of its module and starts nothing.
    `args` is the command line with the program's name; None stands for sys.argv.
    `is_done(node)` is called after every callback. `conclude(node)` returns the exit code. A OneLineError
    becomes one FATAL line of the logger `name` and the exit code `refused`.
    """
    logger = get_logger(name)
    try:
        words = sys.argv if args is None else args
        own = list(itertools.takewhile(lambda word: word != '--ros-args', words))[1:]
        if '--help' in words or '-h' in words:
            print_line(help_text(sys.modules[create_node.__module__]))
            return 0
        if own:
            argument = escaped(own[0], 64)
            example = argument if ':=' in argument else 'name:=value'
            raise StartUpError(
                f"unknown argument '{argument}': set parameters with --ros-args -p {example},"
                ' or ask for --help'
            )
        with ros(args) as executor:
            try:
                with node_creation():
                    node = create_node()
                if os.environ.get('ROS_DISCOVERY_SERVER'):
                    node.get_logger().info(
                        f'nodes find it only while the discovery server runs: {discovery_settings()}'
                    )
                executor.add_node(node)
                _spin(executor, node, is_done)
                return conclude(node)
            except OneLineError as error:  # here, because it keeps alive a node that must go before ROS
                logger.fatal(str(error))
    except StartUpError as error:
        logger.fatal(str(error))
    return refused


@contextlib.contextmanager
def ros(args: list[str] | None = None) -> Iterator[SingleThreadedExecutor]:
    """
    Start ROS and yield an executor; at the end, close the executor, its nodes and ROS, in that order.

    Raises StartUpError, which says what to change, if ROS cannot start.
    """
    process.install_signal_handlers()
    _init(args)
    try:
        executor = SingleThreadedExecutor()
        try:
            yield executor
        finally:
            nodes = executor.get_nodes()
            executor.shutdown(timeout_sec=0)  # Humble would wait for callbacks that never end
            process.limit_the_end()
            for node in nodes:
                node.destroy_node()
            gc.collect()  # a node whose constructor raised must be destroyed before ROS shuts down
    finally:
        rclpy.get_default_context().try_shutdown()
        for number in process.SIGNALS:  # Python resets its own handlers before DDS has ended
            signal.signal(number, signal.SIG_IGN)


def check_arguments(args: list[str]) -> None:
    """Raise the StartUpError of ros() for these words of a command line, before a long computation."""
    _init(args, context := Context())
    context.try_shutdown()


def _init(args: list[str] | None, context: Context | None = None) -> None:
    if problem := process.environment_problem():
        raise StartUpError(problem)
    try:
        with _without_log_of_rcl():
            rclpy.init(args=args, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, UnicodeEncodeError) as error:  # the latter: bytes that are not UTF-8
        raise StartUpError(_cause(str(error), sys.argv if args is None else args)) from error


@contextlib.contextmanager
def _without_log_of_rcl() -> Iterator[None]:
    """Hide what rcl logs while ROS starts, because the exception says it too."""
    set_logger_level('rcl', LoggingSeverity.FATAL)
    try:
        yield
    finally:
        if get_logger_effective_level('rcl') == LoggingSeverity.FATAL:  # else --log-level has set another
            set_logger_level('rcl', LoggingSeverity.UNSET)


def _cause(error: str, words: Sequence[str]) -> str:
    """Return what to change in the words of the command line after an error of rclpy.init."""
    if found := re.search(r"override rule: '-\S+ (.*?)'\. Error", error):
        return fault_of_rule(found[1], words)
    for pattern, cause in START_FAULTS.items():
        if found := re.search(pattern, error):
            return cause.format(*found.groups())
    problem = 'the ROS arguments cannot be parsed (put other arguments before --ros-args)'
    return f'{security_problem() or problem}: {error}'


@contextlib.contextmanager
def node_creation() -> Iterator[None]:
    """Turn any error during the creation of a node, except a OneLineError, into a StartUpError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', RuntimeWarning)  # rclpy's, of a node that it could not create
            yield
    except OneLineError:
        raise
    except (NameValidationException, ParameterException) as error:
        raise StartUpError(f'the ROS arguments do not fit the node: {error}') from error
    except RCLError as error:
        if found := re.search(r'resolve peer (.*?)\s*, at ', str(error)):
            raise StartUpError(UNKNOWN_PEER.format(found[1])) from error
        raise StartUpError(f'{security_problem() or "ROS cannot create the node"}: {error}') from error
    except Exception as error:
        raise StartUpError(f'the node cannot start ({type(error).__name__}: {error})') from error


def _spin(executor: Executor, node: Node, is_done: Callable[[Any], bool]) -> None:
    """Run callbacks until the node is done, or a signal arrives. Warn once of another node of its name."""
    next_look = -math.inf
    with _woken_by_signals(executor):
        while not (process.is_asked_to_end() or is_done(node)):
            if time.monotonic() >= next_look:
                next_look = time.monotonic() + LOOK_EVERY_SECONDS
                if warning := namesake_warning(node):
                    next_look = math.inf
                    node.get_logger().warning(warning)
            spin_once(executor, node)


@contextlib.contextmanager
def _woken_by_signals(executor: Executor) -> Iterator[None]:
    """
    Let every signal wake up an executor, which waits in C code, where Python cannot handle the signal.

    Short waits in its place would more than double the processor time at idle (make bench).
    """
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    before = signal.set_wakeup_fd(write_end, warn_on_full_buffer=False)

    def wake() -> None:
        while os.read(read_end, 1):
            executor.create_task(int)

    thread = threading.Thread(target=wake, name='signals')
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(write_end)
        thread.join()
        os.close(read_end)


def spin_once(executor: Executor, node: Node) -> None:
    """Run one callback, if one comes soon. Humble raises if a reply cannot be sent: log and continue."""
    try:
        executor.spin_once(timeout_sec=LOOK_EVERY_SECONDS)
    except RCLError as error:
        reason = escaped(str(error), 300)
        node.get_logger().warning(f'continued after: {reason}', throttle_duration_sec=1.0)


def help_text(module: ModuleType) -> str:
    """Return the docstring of a node's module, then a table of the parameters in its `Settings`."""
    rows = []
    for each in fields(module.Settings):
        default = repr(each.default) if each.type is str else default_text(each)
        rows.append((each.name, default, each.metadata['description']))
    table = [f'  {line}' for line in aligned_table(rows, numeric_columns=())]
    return '\n'.join([inspect.getdoc(module) or '', '', 'Parameters and their defaults:', *table])
