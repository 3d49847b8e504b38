"""The code that the measurements share: options, domains, server processes, turns, promises."""

import argparse
import atexit
import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeAlias, TypeVar

import domain_coordinator
import psutil
from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.runtime.arguments import Parser
from lupin_greenhouse_bridge.runtime.process import private_domains, variables_of_private_domain
from lupin_greenhouse_bridge.testing import NodeProcess

T = TypeVar('T')
Promises: TypeAlias = Iterator[tuple[str, bool]]  # what was counted, and whether that is as promised
PATIENCE_SECONDS = 60.0


def parser_of(document: str | None, short: str) -> argparse.ArgumentParser:
    """Return a parser with the first line of a module's docstring, and the option --short."""
    parser = Parser(description=(document or '').strip().splitlines()[0])
    parser.add_argument('--short', action='store_true', help=short)
    return parser


@contextlib.contextmanager
def own_domain() -> Iterator[None]:
    """Use a free domain of this host, here and in each process started from here."""
    with domain_coordinator.domain_id(private_domains()) as domain_id:
        os.environ.update(variables_of_private_domain(domain_id))
        yield


class Server(NodeProcess):
    """A node as a process that has printed `ready:`. It does not outlive this one."""

    def __init__(self, *command: str, namespace: str = '/', **parameters: Any):
        """Start it with these parameters of the node; fails if it ends before it is ready."""
        super().__init__(list(command), namespace=namespace, **parameters)
        atexit.register(self.process.kill)
        self.wait_for_log('ready:')

    def resources(self) -> dict[str, int]:
        """Return what may grow."""
        process = psutil.Process(self.process.pid)
        rss_kb = process.memory_info().rss // 1024
        return {'RSS in kB': rss_kb, 'open files': process.num_fds(), 'threads': process.num_threads()}


def in_turns(measures: Sequence[Callable[[], T]], rounds: int) -> list[tuple[T, ...]]:
    """
    Call the measures in turns, and return what they returned in each round.

    Other work of the machine then slows down all of them alike. Each comes first as often as the others.
    """
    results = []
    for number in range(rounds):
        turns = [(number + turn) % len(measures) for turn in range(len(measures))]
        measured = {turn: measures[turn]() for turn in turns}
        results.append(tuple(measured[turn] for turn in sorted(turns)))
    return results


def check_promises(scenarios: Iterable[Callable[[T], Promises]], load: T) -> int:
    """Run scenarios and print a line per promise; return the exit code."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # ends all that was started
    broken = 0
    for scenario in scenarios:
        for text, is_kept in scenario(load):
            broken += not is_kept
            print(f'{"kept  " if is_kept else "BROKEN"}  {scenario.__name__}: {text}', flush=True)
    print(f'{pluralized(broken, "promise")} broken')
    return int(broken > 0)
