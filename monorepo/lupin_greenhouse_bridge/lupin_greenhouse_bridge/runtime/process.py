# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
The process of a node, which a signal can end at any moment with the right exit code.

Imports only the standard library, so that an executable can handle signals before it imports rclpy.
"""

import contextlib
import faulthandler
import importlib
import io
import itertools
import os
import signal
import sys
import time
from collections.abc import Callable
from types import FrameType
from typing import NoReturn

LONGEST_WAIT_SECONDS = 0.5  # rclpy waits in C, and Python handles a signal only after the wait
LONGEST_END_SECONDS = 30.0  # for DDS to destroy the nodes of a process that ends
SIGNALS = (signal.SIGINT, signal.SIGTERM)
LARGEST_DOMAIN_ID = 232  # for a larger one, Fast DDS ends the process
# ROS takes any other value for one of these, and logs nothing, or only a warning of rcl.
VALUES_OF_VARIABLES = {
    'ROS_AUTOMATIC_DISCOVERY_RANGE': ('SUBNET', 'LOCALHOST', 'OFF', 'SYSTEM_DEFAULT'),
    'ROS_LOCALHOST_ONLY': ('0', '1'),
    'ROS_SECURITY_ENABLE': ('true', 'false'),
    'ROS_SECURITY_STRATEGY': ('Enforce', 'Permissive'),
}
# Any value but 0 and 1 for one of these ends the logging of ROS.
VARIABLES_OF_LOGGING = [
    f'RCUTILS_{each}' for each in ('COLORIZED_OUTPUT', 'LOGGING_USE_STDOUT', 'LOGGING_BUFFERED_STREAM')
]
# Fast DDS starts without a file that is missing, and logs a line of its own.
VARIABLES_OF_FILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
NO_OUTPUT = 4  # exit code of every command whose standard output cannot be written


_is_asked_to_end = False
_has_lost_output = False
_is_started = False  # by start(): this process ends after its main()
_hidden_problem = ''


def install_signal_handlers() -> None:
    """
    Record Ctrl-C and SIGTERM from now on, instead of letting them interrupt the code.

    rclpy's own handlers shut the context down while other code uses it. Python's raise KeyboardInterrupt
    anywhere. Either can turn a signal into a traceback.
    """

    def note(_number: int, _frame: FrameType | None) -> None:
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


def start(module: str, *, has_node: bool = True) -> NoReturn:
    """
    Import a module, run its main(), and end the process with its exit code.

    With `has_node`, the process handles signals from the start. Without it, a signal kills the process
    immediately.
    """
    global _is_started  # noqa: PLW0603 - it belongs to the process
    _is_started = True
    if sys.stdout is None:  # closed by the shell: a descriptor that refuses what is printed
        sys.stdout = os.fdopen(os.open(os.devnull, os.O_RDONLY), 'w')
    if sys.stderr is None:  # print() would write to standard output
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), 'w')
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal keeps its encoding, and gets ? for a ° it lacks
            stream.reconfigure(encoding=None if stream.isatty() else 'utf-8', errors='replace')
    if has_node:
        install_signal_handlers()
        hide_fatal_values()
    else:
        for number in SIGNALS:
            signal.signal(number, signal.SIG_DFL)
    try:
        end(importlib.import_module(module).main())
    except SystemExit as error:  # of argparse
        end(int(error.code or 0))


def end(exit_code: int) -> NoReturn:
    """End the process without unloading its libraries, whose threads may still run."""
    try:
        sys.stdout.flush()
    except OSError as error:
        lose_output(error)
    with contextlib.suppress(OSError):
        sys.stderr.flush()
    os._exit(NO_OUTPUT if _has_lost_output else exit_code)


def limit_the_end() -> None:
    """
    End the process with exit code 1 if it still runs after LONGEST_END_SECONDS.

    While Fast DDS destroys a participant, it can wait forever for its own callback, which another node that
    ends has caused. It then holds Python's lock, so no signal is handled. Does nothing in a test's process.
    """
    if _is_started:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        faulthandler.dump_traceback_later(LONGEST_END_SECONDS, exit=True, file=nowhere)


def lose_output(error: OSError) -> None:
    """Report once that standard output cannot be written, and continue without it; exit code NO_OUTPUT."""
    global _has_lost_output  # noqa: PLW0603 - it belongs to the process
    if not _has_lost_output:
        _has_lost_output = True
        name, reason = os.path.basename(sys.argv[0]), error.strerror
        with contextlib.suppress(OSError):
            print(f'{name}: standard output cannot be written: {reason}', file=sys.stderr, flush=True)
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def has_lost_output() -> bool:
    """Return True once standard output could not be written."""
    return _has_lost_output


def hide_fatal_values() -> None:
    """
    Take values out of the environment that end the process or its log; environment_problem() returns one.

    These are an RMW that is not installed, with which rclpy ends the process, and those of the log.
    """
    global _hidden_problem  # noqa: PLW0603 - it belongs to the process
    for each in VARIABLES_OF_LOGGING:
        if (value := os.environ.get(each, '')) not in ('', '0', '1'):
            del os.environ[each]
            _hidden_problem = f'{each} is {value!r}: must be 0 or 1'
    if not (name := os.environ.get('RMW_IMPLEMENTATION')):
        return
    from ament_index_python.resources import get_resources  # only here, because it takes a moment

    installed: set[str] = set()
    with contextlib.suppress(OSError):  # no AMENT_PREFIX_PATH: nothing is known of what is installed
        installed = get_resources('rmw_typesupport').keys() - {'rmw_implementation'}
    if installed and name not in installed:
        del os.environ['RMW_IMPLEMENTATION']
        others = ' or '.join(sorted(installed))
        _hidden_problem = f"RMW_IMPLEMENTATION is '{name}', which is not installed: unset it, or set {others}"


def environment_problem() -> str:
    """Return which variable of ROS has a value that ROS cannot use, and what to set; '' if none has."""
    domain_id = os.environ.get('ROS_DOMAIN_ID') or '0'
    if not domain_id.strip().isdecimal() or int(domain_id) > LARGEST_DOMAIN_ID:
        return f'ROS_DOMAIN_ID is {domain_id!r}: must be a whole number from 0 to {LARGEST_DOMAIN_ID}'
    for name, accepted in VALUES_OF_VARIABLES.items():
        if (value := os.environ.get(name)) and value not in accepted:
            return f'{name} is {value!r}: must be one of {", ".join(accepted)}'
    for name in VARIABLES_OF_FILES:
        if (path := os.environ.get(name)) and not os.path.isfile(path):
            return f'{name} names no file: {path!r}: set it to the path of an XML file, or unset it'
    if _is_secure() and not os.path.isdir(keystore := os.environ.get('ROS_SECURITY_KEYSTORE', '')):
        shown = f'is no folder: {keystore!r}' if keystore else 'is not set'
        return f'security is enabled, but ROS_SECURITY_KEYSTORE {shown}: set it to the path of the keystore'
    return _hidden_problem


def private_domains() -> Callable[[], int]:
    """Return what domain_coordinator.domain_id() tries: the domains that doc/course.md gives to nobody."""
    return itertools.cycle(range(71, 102)).__next__


def variables_of_private_domain(domain_id: int) -> dict[str, str]:
    """Return the environment variables of a domain whose nodes communicate on this machine only."""
    is_humble = os.environ.get('ROS_DISTRO') == 'humble'
    visible = {'ROS_LOCALHOST_ONLY': '1'} if is_humble else {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    # A discovery server may be off, and nobody else is needed.
    return {'ROS_DOMAIN_ID': str(domain_id), 'ROS_DISCOVERY_SERVER': '', **visible}


def _is_secure() -> bool:
    return os.environ.get('ROS_SECURITY_ENABLE') == 'true'


def security_problem() -> str:
    """Return what may be wrong with the security settings; '' if SROS2 is not enabled."""
    if not _is_secure():
        return ''
    return (
        'security is enabled (ROS_SECURITY_ENABLE): check the enclave (--enclave or'
        ' ROS_SECURITY_ENCLAVE_OVERRIDE) in the keystore, and that the RMW was built with security'
    )
