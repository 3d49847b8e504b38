"""
Run an executable that sends itself signals at a chosen moment, for tests.

    python -m lupin_greenhouse_bridge.signalled PACKAGE EXECUTABLE MOMENT SIGNAL[,SIGNAL] [ARGUMENT...]

MOMENT is the end of a file's path and a function in it, such as rclpy/node.py:create_service. The signals
arrive at the first call of the function. The function <module> is the import of the file.
"""

import importlib
import os
import signal
import sys

MOMENTS = (
    'rclpy/__init__.py:<module>',
    'rclpy/executors.py:<module>',
    'rclpy/__init__.py:init',
    'rclpy/context.py:init',
    'rclpy/node.py:__init__',
    'rclpy/executors.py:add_node',
    'rclpy/executors.py:spin_once',
    'rclpy/executors.py:shutdown',
    'rclpy/node.py:destroy_node',
    'rclpy/context.py:try_shutdown',
)
SIGNALS = {
    'Ctrl-C': (signal.SIGINT,),
    'Ctrl-C twice': (signal.SIGINT, signal.SIGINT),
    'SIGTERM': (signal.SIGTERM,),
    'SIGTERM and Ctrl-C': (signal.SIGTERM, signal.SIGINT),
}


def command(package: str, executable: str, moment: str, signals) -> list[str]:
    """Return the command line."""
    numbers = ','.join(str(int(number)) for number in signals)
    return [sys.executable, '-m', __name__, package, executable, moment, numbers]


def main() -> None:
    """Run the executable, which ends the process."""
    package, executable, moment, numbers = sys.argv[1:5]
    del sys.argv[1:5]
    file, _, function = moment.rpartition(':')

    def watch(frame, event, _argument):
        code = frame.f_code
        if event == 'call' and code.co_name == function and code.co_filename.endswith(file):
            sys.setprofile(None)
            print(f'signalled in {moment}', flush=True)
            for number in numbers.split(','):
                os.kill(os.getpid(), int(number))

    run = getattr(importlib.import_module(f'{package}.executables'), executable)
    sys.setprofile(watch)
    run()


if __name__ == '__main__':
    main()
