"""Run commands in parallel, each with its output in a log, and show their progress."""

from __future__ import annotations

import contextlib
import fcntl
import queue
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NoReturn, TextIO, TypeAlias

Word: TypeAlias = 'str | Path'  # of a command
Events: TypeAlias = 'queue.SimpleQueue[tuple[Job, str | None]]'  # each line of a job, and None at its end
ROOT = Path(__file__).resolve().parents[1]
TICK_SECONDS = 0.2
LINE_SECONDS = 15.0  # where no terminal can rewrite a line
FIRST_SECONDS = 3.0  # a shorter wait needs no line
FAILED = 'failed: '  # begins each line at the end that names a failure


@contextlib.contextmanager
def locked(path: str | Path, name: str) -> Iterator[None]:
    """Hold a lock file; say so before waiting for another process that holds it, in a line with this name."""
    with open(path, 'w', encoding='utf-8') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(f'{name}: waiting for another make, which is at work here', file=sys.stderr, flush=True)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def lack_of_space(folder: Path, needed_mb: int) -> str:
    """Return what to do if the disk of a folder has less room than this, or ''."""
    free_mb = shutil.disk_usage(folder).free / 1e6
    return '' if free_mb >= needed_mb else f'{folder} has {free_mb:.0f} MB free: make room for {needed_mb} MB'


def end(main: Callable[[], int | None], name: str) -> NoReturn:
    """End this process with the exit code of its main function, or after Ctrl-C with one line and 130."""
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print(f'{name}: interrupted', file=sys.stderr)
        sys.exit(130)


class Job:
    """A command whose output is shown line by line."""

    shown_at_failure = 0  # lines of the output, unless it has named what failed

    def __init__(self, name: str, command: Sequence[Word], log: Path):
        self.name = name
        self.command = [str(word) for word in command]
        self.log = log
        self.exit_code: int | None = None
        self.failures: list[str] = []  # the names of what failed, if the output tells them
        self.summary = ''

    def read(self, line: str) -> str | None:
        """Process a line of the output; return the text to show immediately."""
        if line.startswith(FAILED):
            self.failures.append(line.removeprefix(FAILED))
        return f'{self.name}: {line}'

    def state(self) -> str:
        """Return the progress of the command."""
        return self.name

    def output(self) -> str:
        """Return the whole output so far."""
        return self.log.read_text(encoding='utf-8', errors='replace')


class Build(Job):
    """A build by colcon: reads the packages that colcon reports, and the share of each that make reports."""

    shown_at_failure = 100_000
    PACKAGE = re.compile(r'^Starting >>> (\S+)')
    SHARE = re.compile(r'^\[ *(\d+)%\] ')

    def __init__(self, command: Sequence[Word], log: Path, count: int):
        super().__init__('build', command, log)
        self._count = count  # of packages
        self._started: list[str] = []
        self._share = 0  # in percent

    def read(self, line: str) -> None:
        """Note the package, or the share of it that is built."""
        if package := self.PACKAGE.match(line):
            self._started.append(package[1])
            self._share = 0
        elif share := self.SHARE.match(line):
            self._share = max(self._share, int(share[1]))  # make works in parallel, and reports out of order

    def state(self) -> str:
        """Return the package, its place among the packages, and how far it is."""
        if not self._started:
            return 'build'
        share = f', {self._share} %' if self._share else ''
        return f'build: package {len(self._started)} of {self._count}, {self._started[-1]}{share}'


class Tests(Job):
    """A run of pytest, --verbose and --instafail: counts the tests, shows what failed or was skipped."""

    shown_at_failure = 60
    TOTAL = re.compile(r'\b(\d+) items?\b(?:.* (\d+) selected)?')
    RESULT = re.compile(
        r'^(?:\[gw\d+\] \[ *\d+%\] |(.*::.*) )(PASSED|FAILED|ERROR|SKIPPED|XFAIL|XPASS)\b *(.*::.*)?'
    )
    STARTED = re.compile(r'^\S+\.py::')
    REPORT = re.compile(r'^_+ .+ _+$|^=+ (?:FAILURES|ERRORS|short test summary info) =+$')
    SUMMARY = re.compile(r'^=+ .*(?:passed|failed|skipped|errors?|no tests ran).* in [\d.]+s.* =+$')

    def __init__(self, name: str, command: Sequence[Word], log: Path):
        super().__init__(name, command, log)
        self.total, self.done = 0, 0
        self._is_report = False

    def read(self, line: str) -> str | None:
        """Count a result; return a line of a report."""
        if not self.total and (total := self.TOTAL.search(line)):
            self.total = int(total[2] or total[1])
        elif result := self.RESULT.match(line):
            self._is_report = False
            self.done += 1
            if result[2] in ('FAILED', 'ERROR'):
                self.failures.append((result[1] or result[3]).strip())
        elif self.SUMMARY.match(line):
            self._is_report = False
            self.summary = line
        elif self.REPORT.match(line):
            self._is_report = True
            return f'{self.name}: {line}'
        return line if self._is_report and not self.STARTED.match(line) else None

    def state(self) -> str:
        """Return how many tests are done and failed."""
        if not self.total:
            return f'{self.name} starts'
        failed = f', {len(self.failures)} failed' if self.failures else ''
        return f'{self.name} {self.done} of {self.total}{failed}'


class Status:
    """A line on a stream: rewritten on a terminal, written every 15 s elsewhere."""

    def __init__(self, stream: TextIO = sys.stderr):
        self._stream = stream
        self._is_terminal = stream.isatty()
        self._next_s = time.monotonic() + (0 if self._is_terminal else FIRST_SECONDS)

    def show(self, text: str) -> None:
        """Show the text, unless the last one is too fresh."""
        if time.monotonic() < self._next_s:
            return
        if self._is_terminal:
            text = '\r\033[K' + text[: shutil.get_terminal_size().columns - 1]
        print(text, end='' if self._is_terminal else '\n', file=self._stream, flush=True)
        self._next_s = time.monotonic() + (TICK_SECONDS if self._is_terminal else LINE_SECONDS)

    def clear(self) -> None:
        """Remove the line from a terminal."""
        if self._is_terminal:
            print('\r\033[K', end='', file=self._stream, flush=True)


def start(job: Job, events: Events) -> None:
    """Run a job; put each line of its output, and None at its end."""
    try:
        job.log.parent.mkdir(parents=True, exist_ok=True)
        with job.log.open('w', encoding='utf-8') as log, subprocess.Popen(
            job.command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            errors='replace',
        ) as process:  # fmt: skip
            for line in process.stdout or ():
                log.write(line)
                log.flush()
                events.put((job, line.rstrip('\n')))
            job.exit_code = process.wait()
    except OSError as error:  # such as a full disk
        job.exit_code = 1
        job.failures.append(f'{job.log}: {error.strerror}')
    events.put((job, None))


def follow(jobs: Sequence[Job], at_once: int = 1) -> None:
    """Run jobs, some of them in parallel, and show their progress."""
    waiting, status, started_s = list(jobs), Status(), time.monotonic()
    running: list[Job] = []
    events: Events = queue.SimpleQueue()
    while waiting or running:
        while waiting and len(running) < at_once:
            running.append(waiting.pop(0))
            threading.Thread(target=start, args=(running[-1], events), daemon=True).start()
        with contextlib.suppress(queue.Empty):
            job, line = events.get(timeout=TICK_SECONDS)
            shown = job.read(line) if line is not None else None
            if line is None:
                running.remove(job)
                if job.exit_code and job.shown_at_failure and not job.failures:
                    shown = '\n'.join([f'== {job.name}', *job.output().splitlines()[-job.shown_at_failure :]])
            if shown is not None:
                status.clear()
                print(shown, flush=True)
        states = ' | '.join(each.state() for each in running)
        status.show(f'{states} ({time.monotonic() - started_s:.0f} s so far)')
    status.clear()


def run(jobs: Sequence[Job], at_once: int = 1) -> bool:
    """
    Run jobs, some of them in parallel; return whether all ended with exit code 0.

    Prints a line for each failure, and then the summary of each run of pytest.
    """
    follow(jobs, at_once)
    for job in jobs:
        for failure in (job.failures or ['']) if job.exit_code else []:
            print(f'{FAILED}{job.name}: {failure}'.removesuffix(': '), flush=True)
    for job in jobs:
        if job.summary:
            print(f'== {job.name}', job.summary, sep='\n', flush=True)
    return not any(job.exit_code for job in jobs)
