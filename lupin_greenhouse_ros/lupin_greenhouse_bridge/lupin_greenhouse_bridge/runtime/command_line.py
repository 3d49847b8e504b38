# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The command line of a node: --help, and nothing else before --ros-args."""

import inspect
import itertools
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.runtime.output import aligned_table, print_line
from lupin_greenhouse_bridge.runtime.parameters import launch_arguments


def answer_help(create_node: Callable[[], Any], args: list[str] | None) -> bool:
    """
    Print what a node does, its parameters and an example if the command line asks for --help.

    Returns whether it did. `args` is the command line with the program's name; None stands for sys.argv.
    Raises StartUpError for any other argument before --ros-args.
    """
    command_line = sys.argv if args is None else args
    own = list(itertools.takewhile(lambda word: word != '--ros-args', command_line))[1:]
    if '--help' in own or '-h' in own:
        print_line(help_text(sys.modules[create_node.__module__]))
        return True
    if own:
        raise StartUpError(
            f"unknown argument '{escaped(own[0], 64)}': set parameters with --ros-args -p name:=value,"
            ' or ask for --help'
        )
    return False


def help_text(module: ModuleType) -> str:
    """Return the docstring of a node's module, then a table of the parameters in its `Settings`."""
    rows = [
        (name, repr(default) if kind is str else default, description)
        for name, default, kind, description in launch_arguments(module.Settings)
    ]
    table = [f'  {line}' for line in aligned_table(rows, numeric_columns=())]
    return '\n'.join([inspect.getdoc(module) or '', '', 'Parameters and their defaults:', *table])
