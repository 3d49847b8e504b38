"""ci/jobs.py: how far a build and the tests are, and what failed, as soon as it is known."""

import io
import itertools
import queue
import re
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import jobs
import pytest
from conftest import run as run_command
from run_tests import PYTEST

pytestmark = pytest.mark.heavy
TESTS = """
import pytest
@pytest.mark.parametrize('number', range(5), ids=lambda number: f'{number}{90 * "a"}')  # as wide as a line
def test_each(number):
    if number == 3:
        pytest.skip('three')
    assert number != 1, 'one is wrong'
"""


@pytest.mark.parametrize('options', [[], ['-n', '2']])
def test_the_tests_are_counted_as_they_end_and_a_failure_is_shown(tmp_path, options):
    (tmp_path / 'test_five.py').write_text(TESTS, encoding='utf-8')
    result = run_command(*PYTEST, *options, '-c', '/dev/null', '--rootdir', tmp_path, tmp_path)
    job = jobs.Tests('five', [], tmp_path / 'log')
    read = [(line, job.read(line) or '', job.state()) for line in result.stdout.splitlines()]
    (failure,) = job.failures
    assert failure.endswith(f'test_five.py::test_each[1{90 * "a"}]')
    states = list(dict.fromkeys(state for _, _, state in read))
    assert states[0] == 'five starts'
    assert [int(state.split()[1]) for state in states[1:]] == list(range(6))
    assert states[-1] == 'five 5 of 5, 1 failed'
    assert '1 failed, 3 passed, 1 skipped' in job.summary

    lines, shown = [line for line, *_ in read], [each for _, each, _ in read]
    (reported,) = (
        number for number, each in enumerate(shown) if each.startswith('E ') and 'one is wrong' in each
    )
    later = next(number for number, line in enumerate(lines) if 'test_each[2a' in line)
    assert options or reported < later
    assert 'SKIPPED [1]' in '\n'.join(shown)
    assert not any('PASSED' in each or 'test_each[0a' in each for each in shown)


def test_a_build_names_the_package_and_the_share_of_it_that_is_built(tmp_path):
    job = jobs.Build([], tmp_path / 'log', count=2)
    assert job.state() == 'build'
    job.read('Starting >>> team_msgs')
    job.read('[ 42%] Building C object CMakeFiles/x.dir/rosidl_generator_c/team_msgs/msg/detail/other.c.o')
    assert job.state() == 'build: package 1 of 2, team_msgs, 42 %'
    job.read('Starting >>> team_node')
    assert job.state() == 'build: package 2 of 2, team_node'


@pytest.mark.parametrize(('is_terminal', 'after'), [(True, 0.0), (False, 3.0)])
def test_a_wait_of_three_seconds_shows_that_it_lives(monkeypatch, is_terminal, after):
    now_s, stream = 100.0, io.StringIO()
    stream.isatty = lambda: is_terminal
    monkeypatch.setattr(jobs.time, 'monotonic', lambda: now_s)
    status = jobs.Status(stream)
    for tenths in range(300):
        now_s = 100.0 + tenths / 10
        status.show(f'{tenths / 10} s')
    shown = [float(each) for each in re.findall(r'([\d.]+) s', stream.getvalue())]
    assert shown[0] == after
    gaps = [later - earlier for earlier, later in itertools.pairwise(shown)]
    assert max(gaps) <= (0.5 if is_terminal else 15.0)
    assert ('\n' in stream.getvalue()) != is_terminal


def make_job(name, script, folder: Path, kind=jobs.Job) -> jobs.Job:
    return kind(name, [sys.executable, '-c', script], folder / f'{name}.log')


def test_jobs_end_in_failure_if_one_fails_and_all_run(tmp_path, capsys):
    summary = '===== 3 passed in 0.10s ====='
    each = [
        make_job('three', f'print("{summary}")', tmp_path, jobs.Tests),
        make_job('bad', 'print("from bad"); exit(3)', tmp_path),
        make_job('good', 'print("yes")', tmp_path),
        make_job('nested', 'print("failed: one: test_a\\nfailed: two"); exit(1)', tmp_path),
    ]
    assert not jobs.run(each, at_once=2)
    assert [job.exit_code for job in each] == [0, 3, 0, 1]
    printed = capsys.readouterr().out
    assert 'bad: from bad\n' in printed
    assert 'good: yes\n' in printed
    failures = 'failed: bad\nfailed: nested: one: test_a\nfailed: nested: two\n'
    assert printed.endswith(f'{failures}== three\n{summary}\n')
    assert jobs.run([make_job('good', 'print("yes")', tmp_path)])


def test_jobs_without_a_failed_test_or_a_log_fail_with_their_reason(tmp_path, capsys):
    none = make_job('none', 'exit("cannot import rclpy")', tmp_path, jobs.Tests)
    full = jobs.Job('full', [sys.executable, '-c', 'print("more")'], Path('/dev/full'))
    assert not jobs.run([none, full])
    printed = capsys.readouterr().out
    assert 'cannot import rclpy' in printed
    assert printed.endswith('failed: full: /dev/full: No space left on device\n')


def test_who_waits_for_a_lock_says_so_and_goes_on(tmp_path, monkeypatch):
    path, entered, written = tmp_path / 'lock', threading.Event(), queue.SimpleQueue()
    monkeypatch.setattr('sys.stderr', SimpleNamespace(write=written.put, flush=lambda: None))

    def enter():
        with jobs.locked(path, 'build'):
            entered.set()

    with jobs.locked(path, 'build'):
        (waiting := threading.Thread(target=enter)).start()
        assert written.get(timeout=60.0) == 'build: waiting for another make, which is at work here'
    waiting.join()
    assert entered.is_set()
