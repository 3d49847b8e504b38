"""
Repeat the contract tests of both trees beside busy loops, and count which tests fail.

    make steady                  20 runs beside 3 busy loops
    make steady RUNS=5 LOAD=0    5 runs with the machine to itself

Prints one line per run, then a table with each failed test and how often it failed. The output of a failed
run stays in .steady/. The exit code is 1 if a run failed.
"""

import argparse
import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from shared import print_head, print_row

ROOT = Path(__file__).resolve().parents[2]
LOGS = Path('.steady')
BOTH_TREES = [sys.executable, 'ci/run_tests.py', 'trees']


@contextlib.contextmanager
def busy_loops(number: int) -> Iterator[None]:
    """Keep the processor busy with this many processes."""
    loops = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(number)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def results() -> list[Path]:
    """Return the files that pytest wrote below colcon's build folders, of every environment of this one."""
    environment = Path(os.environ['VIRTUAL_ENV'])
    return sorted(environment.parent.glob(f'{environment.name}*/workspace/*/build/*/pytest.xml'))


def read_results(paths: list[Path]) -> tuple[int, list[str]]:
    """Return how many tests ran, and the names of those that failed."""
    ran, failed = 0, []
    for path in paths:
        tree = path.parents[2].name
        for case in ElementTree.parse(path).getroot().iter('testcase'):  # noqa: S314 - pytest wrote it
            ran += case.find('skipped') is None
            if case.find('failure') is not None or case.find('error') is not None:
                failed.append(f'{tree}: {case.get("classname", "")}::{case.get("name")}')
    return ran, failed


def run_once(command: list[str], log: Path) -> tuple[int, list[str]]:
    """Run the tests once; return how many ran, and what failed."""
    for path in results():
        path.unlink()
    with log.open('wb') as output:
        code = subprocess.run(
            command, cwd=ROOT, stdout=output, stderr=subprocess.STDOUT, check=False
        ).returncode
    ran, failed = read_results(results())
    if code and not failed:
        failed = [f'exit code {code} without a failed test, see {log}']
    return ran, failed


def main() -> int:
    """Run the tests as often as asked; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--runs', type=int, default=20, help='how often to run all tests')
    parser.add_argument('--load', type=int, default=3, help='busy loops beside them')
    parser.add_argument('command', nargs='*', default=BOTH_TREES, help='what runs the tests')
    options = parser.parse_args()
    if options.runs < 1 or options.load < 0:
        parser.error(f'RUNS is {options.runs} and LOAD is {options.load}: must be at least 1 and 0')
    shutil.rmtree(LOGS, ignore_errors=True)
    LOGS.mkdir()
    failures: Counter[str] = Counter()
    failed_runs = 0
    with busy_loops(options.load):
        for run in range(1, options.runs + 1):
            log, started = LOGS / f'run-{run}.log', time.monotonic()
            ran, failed = run_once(options.command, log)
            failures.update(failed)
            failed_runs += bool(failed)
            print(
                f'run {run}/{options.runs}: tests: {ran}, failed: {len(failed)},'
                f' {time.monotonic() - started:.0f} s',
                *failed,
                sep='\n  ',
                flush=True,
            )
            if not failed:
                log.unlink()
    print_head(f'runs: {options.runs}, busy loops: {options.load}', f'failed: {failed_runs}')
    for name, count in failures.most_common():
        print_row(name, str(count))
    return int(failed_runs > 0)


if __name__ == '__main__':
    sys.exit(main())
