"""
Measure the times that a person waits for, in a fresh clone, beside the same steps by hand.

    make bench                            ends with this table
    python tools/measure/user_latency.py    the table alone, five minutes

By hand means pip, a plain `colcon build` of the same two packages, and the executable. The two take turns.
Each figure is the median of its rounds. The first line is the yardstick: how long this machine takes to
compile a fixed file, so that the figures of two machines can be compared.
"""

import argparse
import contextlib
import os
import shlex
import signal
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import domain_coordinator

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_SECONDS = 600.0
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

    def __init__(self, folder: Path, domain_id: int):
        self.folder = folder / 'clone'
        subprocess.run(['git', 'clone', '--quiet', ROOT, self.folder], check=True)
        inside = os.environ.get('VIRTUAL_ENV', '/nowhere')
        paths = [path for path in os.environ['PATH'].split(':') if not path.startswith(inside)]
        kept = {key: os.environ[key] for key in ('HOME', 'LANG', 'CC', 'CXX') if key in os.environ}
        kept |= {key: value for key, value in os.environ.items() if key.startswith(('PIP_', 'UV_', 'SSL_'))}
        self._environment = kept | {
            'PATH': ':'.join(paths),
            'ROS_DOMAIN_ID': str(domain_id),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        }

    def start(self, command: str) -> subprocess.Popen:
        """Start a command in a process group of its own."""
        return subprocess.Popen(
            ['bash', '-eo', 'pipefail', '-c', command],
            cwd=self.folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def seconds_of(self, command: str) -> float:
        """Return how long a command takes; raises SystemExit if it fails."""
        started = time.monotonic()
        process = self.start(command)
        output, _ = process.communicate(timeout=PATIENCE_SECONDS)
        if process.returncode:
            raise SystemExit(f'user_latency: {command}: exit code {process.returncode}\n{output[-2000:]}')
        return time.monotonic() - started

    @contextlib.contextmanager
    def serving(self, command: str):
        """Run a command that serves; yield the seconds to its line `ready:`."""
        started = time.monotonic()
        process = self.start(command)
        try:
            shown = []
            for line in process.stdout:
                shown.append(line)
                if 'ready:' in line:
                    break
            else:
                raise SystemExit(f'user_latency: {command}: never ready\n{"".join(shown)[-2000:]}')
            yield time.monotonic() - started
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            process.communicate(timeout=PATIENCE_SECONDS)

    def seconds_to_ready(self, command: str) -> float:
        """Return how long a command takes to its line `ready:`, and end it."""
        with self.serving(command) as seconds:
            return seconds

    def edit(self) -> None:
        """Change a line of the bridge's node."""
        with (self.folder / BRIDGE_NODE).open('a', encoding='utf-8') as node:
            node.write(f'# {time.monotonic_ns()}\n')


def row(text: str, ours: list[float], by_hand: list[float], target_seconds: float) -> str:
    """Return one line of the table."""
    median, other = statistics.median(ours), statistics.median(by_hand)
    verdict = 'met' if median <= target_seconds else 'MISSED'
    ratio = f'{median / other:.2f}'
    return f'| {text} | {median:.1f} s | {other:.1f} s | {ratio} | <= {target_seconds} s {verdict} |'


def taking_turns(rounds: int, ours: Callable, by_hand: Callable) -> tuple[list[float], list[float]]:
    """Return what both return, called in turns."""
    pairs = [(ours(), by_hand()) for _ in range(rounds)]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def print_table(*, short: bool) -> None:
    """Measure, and print each row as soon as it is known."""
    rounds = 3 if short else 5
    read = f'{ENTER_BY_HAND} && {OVERLAY} && {EXECUTABLES}/read_tag 1'
    serve = f'{ENTER_BY_HAND} && {OVERLAY} && exec {EXECUTABLES}/bridge_node'
    print(f'yardstick, a fixed file compiled: {yardstick_seconds():.1f} s\n', flush=True)
    print('| | make | by hand | ratio | target |\n|---|---|---|---|---|')
    with tempfile.TemporaryDirectory() as folder, domain_coordinator.domain_id() as domain_id:
        clone = Clone(Path(folder), domain_id)
        smoke = clone.seconds_of('make smoke')
        by_hand = clone.seconds_of(f'{INSTALL_BY_HAND} && {BUILD_BY_HAND}')
        with clone.serving(serve):
            by_hand += clone.seconds_of(f'{read.removesuffix(" 1")} --all')
        print(row('`make smoke` in a fresh clone', [smoke], [by_hand], TARGETS_SECONDS['smoke']), flush=True)
        again = f'{BUILD_BY_HAND} && {serve}'
        text = '`make run` to `ready:`, nothing changed'
        figures = taking_turns(
            rounds, lambda: clone.seconds_to_ready('make run'), lambda: clone.seconds_to_ready(again)
        )
        print(row(text, *figures, TARGETS_SECONDS['run']), flush=True)
        with clone.serving('make run'):
            figures = taking_turns(
                2 * rounds, lambda: clone.seconds_of('make read TAG=1'), lambda: clone.seconds_of(read)
            )
        print(row('`make read TAG=1`', *figures, TARGETS_SECONDS['read']), flush=True)

        def after_an_edit(command: str) -> float:
            clone.edit()
            return clone.seconds_to_ready(command)

        figures = taking_turns(rounds, lambda: after_an_edit('make run'), lambda: after_an_edit(again))
        print(row('an edit of `bridge_node.py` to `ready:`', *figures, TARGETS_SECONDS['edit']), flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--short', action='store_true', help='fewer rounds')
    print_table(short=parser.parse_args().short)


if __name__ == '__main__':
    main()
