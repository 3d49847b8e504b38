# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Run a node: start ROS, create the node, spin it, and close everything in the right order."""

import contextlib
import faulthandler
import gc
import inspect
import itertools
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import fields
from types import ModuleType
from typing import Any

import rclpy
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.graph import namesake_warning
from lupin_greenhouse_bridge.runtime.output import aligned_table, print_line
from lupin_greenhouse_bridge.runtime.parameters import default_text
from lupin_greenhouse_bridge.runtime.rclpy_internals import RCLError

LOOK_EVERY_SECONDS = 5.0  # for another node with the same name
LONGEST_SHUTDOWN_SECONDS = 30.0
LARGEST_DOMAIN_ID = 232


def run(
    name: str,
    create_node: Callable[[], Any],
    args: list[str] | None = None,
    *,
    is_done: Callable[[Any], bool] = lambda _node: False,
    conclude: Callable[[Any], int] = lambda _node: 0,
    refusal_code: int = 1,
) -> int:
    """
    Run one node until it is done, or until Ctrl-C or SIGTERM; return the exit code.

    `create_node` is the node's class. With --help, this prints the help of its module and starts nothing.
    `args` is the command line with the program's name; None means sys.argv.
    `is_done(node)` is called after every callback. `conclude(node)` returns the exit code. A OneLineError
    becomes one FATAL line of the logger `name`, and the exit code is `refusal_code`.
    """
    logger = get_logger(name)
    words = sys.argv if args is None else args
    if '--help' in words or '-h' in words:
        print_line(_help_text(sys.modules[create_node.__module__]))
        return 0
    try:
        _refuse_own_arguments(words)
        with ros(args) as executor:
            try:
                with node_creation():
                    node = create_node()
                executor.add_node(node)
                _spin(executor, node, is_done)
                return conclude(node)
            except OneLineError as error:  # its traceback keeps the node alive, which must end before ROS
                logger.fatal(str(error))
    except StartUpError as error:
        logger.fatal(str(error))
    return refusal_code


def _refuse_own_arguments(words: list[str]) -> None:
    """Raise StartUpError for a word before --ros-args, which ROS would ignore silently."""
    own = list(itertools.takewhile(lambda word: word != '--ros-args', words))[1:]
    if own:
        raise StartUpError(
            f"unknown argument '{escaped(own[0], 64)}': set parameters with --ros-args -p name:=value"
        )


@contextlib.contextmanager
def ros(args: list[str] | None = None) -> Iterator[SingleThreadedExecutor]:
    """
    Start ROS and yield an executor; at the end, close the executor, its nodes and ROS, in that order.

    Raises StartUpError.
    """
    process.install_signal_handlers()
    domain_id = os.environ.get('ROS_DOMAIN_ID', '')
    if domain_id.isdecimal() and int(domain_id) > LARGEST_DOMAIN_ID:  # Fast DDS would end the process
        raise StartUpError(f'ROS_DOMAIN_ID is {domain_id}: must be from 0 to {LARGEST_DOMAIN_ID}')
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, UnicodeEncodeError) as error:  # the latter: bytes that are not UTF-8
        raise StartUpError(f'ROS cannot start: {error}') from error
    try:
        executor = SingleThreadedExecutor()
        try:
            yield executor
        finally:
            nodes = executor.get_nodes()
            executor.shutdown(timeout_sec=0)  # Humble would wait for callbacks that never end
            _limit_shutdown()
            for node in nodes:
                node.destroy_node()
            gc.collect()  # a node whose constructor raised must be destroyed before ROS shuts down
    finally:
        rclpy.get_default_context().try_shutdown()
        faulthandler.cancel_dump_traceback_later()
        for number in process.SIGNALS:  # Python resets its own handlers before DDS has ended
            signal.signal(number, signal.SIG_IGN)


def _limit_shutdown() -> None:
    """
    End the process with exit code 1 if it still runs after LONGEST_SHUTDOWN_SECONDS.

    If another node ends at the same time, Fast DDS can deadlock while it destroys a participant. It then
    holds Python's lock, so no signal is handled.
    """
    no_output = os.open(os.devnull, os.O_WRONLY)
    faulthandler.dump_traceback_later(LONGEST_SHUTDOWN_SECONDS, exit=True, file=no_output)


@contextlib.contextmanager
def node_creation() -> Iterator[None]:
    """Turn any error during the creation of a node, except a OneLineError, into a StartUpError."""
    try:
        yield
    except OneLineError:
        raise
    except Exception as error:
        raise StartUpError(f'the node cannot start: {type(error).__name__}: {error}') from error


def _spin(executor: Executor, node: Node, is_done: Callable[[Any], bool]) -> None:
    """Run callbacks until the node is done or a signal arrives. Warn once of a node with the same name."""
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
    Let every signal wake up an executor, because Python handles no signal while rclpy waits in C code.

    Short waits instead would more than double the processor time at idle (make bench).
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
    """Run one callback, if one comes soon. Humble raises RCLError if it cannot send a reply: log it."""
    try:
        executor.spin_once(timeout_sec=LOOK_EVERY_SECONDS)
    except RCLError as error:
        reason = escaped(str(error), 300)
        node.get_logger().warning(f'continued after: {reason}', throttle_duration_sec=1.0)


def _help_text(module: ModuleType) -> str:
    """Return the docstring of a node's module, then a table of the parameters in its `Settings`."""
    rows = []
    for spec in fields(module.Settings):
        default = repr(spec.default) if spec.type is str else default_text(spec)
        rows.append((spec.name, default, spec.metadata['description']))
    table = [f'  {line}' for line in aligned_table(rows, numeric_columns=())]
    return '\n'.join([inspect.getdoc(module) or '', '', 'Parameters and their defaults:', *table])
