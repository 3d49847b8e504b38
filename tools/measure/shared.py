"""The code that the measurements share: options, domains, server processes, turns, percentiles, tables."""

import argparse
import atexit
import contextlib
import os
import shlex
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import domain_coordinator

PATIENCE_SECONDS = 60.0


def parser_of(document: str, short: str) -> argparse.ArgumentParser:
    """Return a parser with the first line of a module's docstring, and the option --short."""
    parser = argparse.ArgumentParser(description=document.strip().splitlines()[0])
    parser.add_argument('--short', action='store_true', help=short)
    return parser


@contextlib.contextmanager
def own_domain() -> Iterator[None]:
    """Use a free domain of this host, here and in each process started from here."""
    with domain_coordinator.domain_id() as domain_id:
        os.environ.update(ROS_DOMAIN_ID=str(domain_id), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
        yield


class Server:
    """A process that has printed `ready:`. It does not outlive this one."""

    def __init__(self, command: list[str], **keywords):
        """Start it; raises SystemExit if it ends before it is ready."""
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **keywords
        )
        atexit.register(self.process.kill)
        shown = ''
        for line in self.process.stdout:
            shown += line
            if 'ready:' in line:
                return
        exit_code = self.process.wait()
        raise SystemExit(f'{shlex.join(command)}: exit code {exit_code} before ready\n{shown[-2000:]}')

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.kill()

    def status(self, key: str) -> int:
        """Return a number of /proc/PID/status, such as VmRSS (kB) or Threads."""
        text = Path(f'/proc/{self.process.pid}/status').read_text()
        return int(next(line for line in text.splitlines() if line.startswith(f'{key}:')).split()[1])

    def open_files(self) -> int:
        """Return the number of open file descriptors."""
        return len(list(Path(f'/proc/{self.process.pid}/fd').iterdir()))

    def kill(self) -> None:
        """Kill it without warning."""
        self.process.kill()
        self.process.wait()

    def stop(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, str]:
        """End it with a signal; return the exit code, and what it printed after `ready:`."""
        self.process.send_signal(number)
        output, _ = self.process.communicate(timeout=PATIENCE_SECONDS)
        return self.process.returncode, output


def in_turns(measures: list[Callable], rounds: int) -> list[tuple]:
    """
    Call the measures in turns, and return what they returned in each round.

    Other work of the machine then slows down all of them alike. Each comes first as often as the others.
    """
    results = []
    for number in range(rounds):
        first = number % len(measures)
        measured = [measure() for measure in measures[first:] + measures[:first]]
        results.append(tuple(measured[len(measures) - first :] + measured[: len(measures) - first]))
    return results


def percentile(ordered: list[float], share: float) -> float:
    """Return the value that this share of an ordered list does not exceed."""
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)]


def print_row(*cells: str) -> None:
    """Print a row of a table."""
    print('|', ' | '.join(cells), '|', flush=True)


def print_head(*cells: str) -> None:
    """Print the head of a table."""
    print_row(*cells)
    print('|' + '---|' * len(cells))
