"""
Run a command in the project's environment, in the folder where you are, with what it needs beside TREE.

    python ci/within.py [--stand-ins] COMMAND [ARGUMENT...]

--stand-ins: apriltag_msgs and nav2_msgs, built from ci/stand_ins where ROS does not have them.
"""

import ctrl_c  # noqa: F401

# isort: split
import argparse
import functools
import os
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

from build import ROOT, Workspace, build, here
from jobs import Word, end

MESSAGES = ('apriltag_msgs', 'nav2_msgs')
# Before a command: ros_env.bash has said so of a tree that is not built.
IS_THERE = """
type -P "$0" >/dev/null || {
    [ ! -e "$LUPIN_WORKSPACE/install/local_setup.bash" ] || echo "there is no command '$0'" >&2; exit 127; }
exec "$0" "$@"
"""


def pip(venv: Path, *arguments: Word) -> None:
    """Run the pip of an environment; end the process with its output if it fails."""
    command = (venv / 'bin/python', '-m', 'pip', '--disable-pip-version-check', '--quiet', *arguments)
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if result.returncode:
        sys.exit(result.stdout)


@functools.cache
def stand_ins(workspace: Workspace) -> tuple[Workspace, ...]:
    """Build the stand-ins that this environment needs; return their workspace, or none."""
    find = f'import importlib.util as i; print(*(each for each in {MESSAGES} if not i.find_spec(each)))'
    command = workspace.inside('python', '-c', find)
    missing = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout.split()
    if not missing:
        return ()
    built = workspace._replace(tree='stand_ins')
    build(built, [ROOT / 'ci/stand_ins' / name for name in missing])
    return (built,)


def within(workspace: Workspace, *command: Word, has_stand_ins: bool = False) -> list[str]:
    """Return what runs a command with the packages of a workspace, and with the stand-ins."""
    return workspace.inside(*command, above=stand_ins(workspace) if has_stand_ins else ())


def main() -> NoReturn:
    """Replace this process by the command."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__.strip().splitlines()[0])
    parser.add_argument('--stand-ins', action='store_true', help='with apriltag_msgs and nav2_msgs')
    parser.add_argument('command', nargs=argparse.REMAINDER, help='what to run')
    options = parser.parse_args()
    if not options.command:
        parser.error('name the COMMAND to run, such as bash')
    asked = ('bash', '-c', IS_THERE, *options.command)
    command = within(here(), *asked, has_stand_ins=options.stand_ins)
    os.execvp(command[0], command)  # noqa: S606 - no shell is wanted


if __name__ == '__main__':
    end(main, 'within')
