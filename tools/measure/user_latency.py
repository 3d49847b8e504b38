"""
Measure the times that a person waits for, in a fresh clone, beside the same steps by hand.

    make bench                            ends with this table
    python tools/measure/user_latency.py    the table alone, five minutes

By hand means pip, a plain `colcon build` of the same two packages, and the executable. The two take turns.
Each figure is the median of its rounds. The first line is the yardstick: how long this machine takes to
compile a fixed file, so that the figures of two machines can be compared.
"""

import contextlib
import os
import re
import shlex
import signal
import statistics
import subprocess
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from shared import PATIENCE_SECONDS, Server, in_turns, own_domain, parser_of, print_head, print_row

ROOT = Path(__file__).resolve().parents[2]
SHELL = ('bash', '-eo', 'pipefail', '-c')
PACKAGES = 'monorepo/lupin_msgs monorepo/lupin_greenhouse_bridge'
BRIDGE_NODE = 'monorepo/lupin_greenhouse_bridge/lupin_greenhouse_bridge/bridge_node.py'
# In a shell of the fresh clone. `by-hand` is an environment of its own, and so is its workspace.
ENTER_BY_HAND = 'export VENV=$PWD/by-hand && source ci/ros_env.bash without-overlay'
INSTALL_BY_HAND = (
    'python3 -m venv by-hand && by-hand/bin/pip install -q -r ci/requirements/kilted.txt'
    ' && PYTHONPATH=ci python3 -c \'import environment as e; e.repair_cmake(e.Path("by-hand").absolute())\''
    ' && cp .venv/local_setup.bash by-hand/'
    ' && sed -i "s|/.venv|/by-hand|g" by-hand/local_setup.bash'
)
BUILD_BY_HAND = (
    f'{ENTER_BY_HAND} && python -m colcon --log-base by-hand/log build --paths {PACKAGES}'
    ' --build-base by-hand/build --install-base by-hand/install'
    ' --cmake-args -DPython3_EXECUTABLE=$VIRTUAL_ENV/bin/python -DBUILD_TESTING=OFF >by-hand/build.log 2>&1'
)
OVERLAY = 'source by-hand/install/local_setup.bash'
EXECUTABLES = 'by-hand/install/lupin_greenhouse_bridge/lib/lupin_greenhouse_bridge'
KEPT_VARIABLES = re.compile(
    '(HOME|LANG|CC|CXX|ROS_DOMAIN_ID|ROS_AUTOMATIC_DISCOVERY_RANGE)$|PIP_|UV_|SSL_'
)  # variables
TARGETS_SECONDS = {'smoke': 45.0, 'run': 2.0, 'read': 1.2, 'edit': 4.0}
# Of the standard library alone, which differs little between compilers.
YARDSTICK = """
#include <map>
#include <regex>
int main() { return std::regex_match("a", std::regex("a")) + std::map<std::string, int>{{"a", 1}}.size(); }
"""
YARDSTICK_ROUNDS = 5


def yardstick_seconds() -> float:
    """Return the median time to compile the fixed file."""
    command = [*shlex.split(os.environ.get('CXX', 'c++')), '-O2', '-x', 'c++', '-c', '-', '-o', os.devnull]
    seconds = []
    for _ in range(YARDSTICK_ROUNDS):
        started = time.monotonic()
        subprocess.run(command, input=YARDSTICK, text=True, check=True)
        seconds.append(time.monotonic() - started)
    return statistics.median(seconds)


class Clone:
    """A fresh clone, and a shell in it without this environment."""

    def __init__(self, folder: Path):
        self.folder = folder / 'clone'
        subprocess.run(['git', 'clone', '--quiet', ROOT, self.folder], check=True)
        inside = os.environ.get('VIRTUAL_ENV', '/nowhere')
        paths = [path for path in os.environ['PATH'].split(':') if not path.startswith(inside)]
        kept = {key: value for key, value in os.environ.items() if KEPT_VARIABLES.match(key)}
        self._inside = {'cwd': self.folder, 'env': kept | {'PATH': ':'.join(paths)}}

    def seconds_of(self, command: str) -> float:
        """Return how long a command takes; raises SystemExit if it fails."""
        started = time.monotonic()
        result = subprocess.run(
            [*SHELL, command], **self._inside, capture_output=True, text=True, timeout=600.0, check=False
        )
        if result.returncode:
            shown = (result.stdout + result.stderr)[-2000:]
            raise SystemExit(f'user_latency: {command}: exit code {result.returncode}\n{shown}')
        return time.monotonic() - started

    @contextlib.contextmanager
    def serving(self, command: str) -> Iterator[float]:
        """Run a command that serves; yield the seconds to its line `ready:`."""
        started = time.monotonic()
        server = Server([*SHELL, command], **self._inside, start_new_session=True)
        try:
            yield time.monotonic() - started
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(server.process.pid, signal.SIGTERM)
            server.process.communicate(timeout=PATIENCE_SECONDS)

    def seconds_to_ready(self, command: str) -> float:
        """Return how long a command takes to its line `ready:`, and end it."""
        with self.serving(command) as seconds:
            return seconds

    def edit(self) -> None:
        """Change a line of the bridge's node."""
        with (self.folder / BRIDGE_NODE).open('a', encoding='utf-8') as node:
            node.write(f'# {time.monotonic_ns()}\n')


def print_figure(text: str, rounds: list[tuple[float, float]], target_seconds: float) -> None:
    """Print one line of the table: the medians of ours and of by hand."""
    ours, by_hand = (statistics.median(side) for side in zip(*rounds, strict=True))
    verdict = 'met' if ours <= target_seconds else 'MISSED'
    target = f'<= {target_seconds} s {verdict}'
    print_row(text, f'{ours:.1f} s', f'{by_hand:.1f} s', f'{ours / by_hand:.2f}', target)


def print_table(*, short: bool) -> None:
    """Measure, and print each row as soon as it is known."""
    rounds = 3 if short else 5
    read = f'{ENTER_BY_HAND} && {OVERLAY} && {EXECUTABLES}/read_tag 1'
    serve = f'{ENTER_BY_HAND} && {OVERLAY} && exec {EXECUTABLES}/bridge_node'
    print(f'yardstick, a fixed file compiled: {yardstick_seconds():.1f} s\n', flush=True)
    print_head('', 'make', 'by hand', 'ratio', 'target')
    with tempfile.TemporaryDirectory() as folder, own_domain():
        clone = Clone(Path(folder))
        smoke = clone.seconds_of('make smoke')
        by_hand = clone.seconds_of(f'{INSTALL_BY_HAND} && {BUILD_BY_HAND}')
        with clone.serving(serve):
            by_hand += clone.seconds_of(f'{read.removesuffix(" 1")} --all')
        print_figure('`make smoke` in a fresh clone', [(smoke, by_hand)], TARGETS_SECONDS['smoke'])
        commands = ('make run', f'{BUILD_BY_HAND} && {serve}')
        starts = [partial(clone.seconds_to_ready, command) for command in commands]
        text = '`make run` to `ready:`, nothing changed'
        print_figure(text, in_turns(starts, rounds), TARGETS_SECONDS['run'])
        with clone.serving('make run'):
            reads = [partial(clone.seconds_of, command) for command in ('make read TAG=1', read)]
            print_figure('`make read TAG=1`', in_turns(reads, 2 * rounds), TARGETS_SECONDS['read'])

        def after_an_edit(command: str) -> float:
            clone.edit()
            return clone.seconds_to_ready(command)

        starts = [partial(after_an_edit, command) for command in commands]
        text = 'an edit of `bridge_node.py` to `ready:`'
        print_figure(text, in_turns(starts, rounds), TARGETS_SECONDS['edit'])


def main() -> None:
    """Print the table."""
    print_table(short=parser_of(__doc__, 'fewer rounds').parse_args().short)


if __name__ == '__main__':
    main()
