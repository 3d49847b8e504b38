# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
The process of a node: it ends on a signal at any moment, with its exit code.

Imports only the standard library, so that an executable can handle signals before it imports rclpy.
"""

import contextlib
import importlib
import os
import signal
import sys
import time
from typing import NoReturn

LONGEST_WAIT_SECONDS = 0.5  # rclpy waits in C, and Python handles a signal only after the wait
SIGNALS = (signal.SIGINT, signal.SIGTERM)

_is_asked_to_end = False


def install_signal_handlers() -> None:
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


def start(module: str, *, has_node: bool = True) -> NoReturn:
    """
    Import a module, run its main(), and end the process with its exit code.

    A node looks at signals from the first moment on. Without one, a signal kills the process at once.
    """
    if has_node:
        install_signal_handlers()
    else:
        for number in SIGNALS:
            signal.signal(number, signal.SIG_DFL)
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
