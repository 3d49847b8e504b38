"""steady.py counts the runs and the tests that fail."""

import os
import subprocess
import sys

import steady

TESTS = """
import pathlib

def test_good():
    pass

def test_flaky():
    runs = pathlib.Path(__file__).with_name('runs')
    runs.write_text(runs.read_text() + '.' if runs.exists() else '.')
    assert runs.read_text() != '..'
"""


def run(tmp_path, *arguments):
    environment = {**os.environ, 'VIRTUAL_ENV': str(tmp_path / 'env')}
    return subprocess.run(
        [sys.executable, steady.__file__, *arguments],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_test_that_fails_once_in_three_runs_is_named(tmp_path):
    tests = tmp_path / 'test_it.py'
    tests.write_text(TESTS)
    results = tmp_path / 'env/workspace/monorepo/build/package/pytest.xml'
    options = ['-p', 'no:cacheprovider', f'--rootdir={tmp_path}', f'--junit-xml={results}']
    command = [sys.executable, '-m', 'pytest', *options, str(tests)]
    result = run(tmp_path, '--runs', '3', '--load', '1', '--', *command)
    assert result.returncode == 1
    lines = result.stdout.splitlines()
    assert lines[0].startswith('run 1/3: tests: 2, failed: 0')
    assert lines[-3:] == [
        '| runs: 3, busy loops: 1 | failed: 1 |',
        '|---|---|',
        '| monorepo: test_it::test_flaky | 1 |',
    ]
    assert (tmp_path / '.steady/run-2.log').exists()
    assert not (tmp_path / '.steady/run-1.log').exists()


def test_a_run_that_ends_early_is_a_failure(tmp_path):
    result = run(tmp_path, '--runs', '1', '--load', '0', '--', 'false')
    assert result.returncode == 1
    assert '| exit code 1 without a failed test, see .steady/run-1.log | 1 |' in result.stdout


def test_a_command_that_passes_is_no_failure(tmp_path):
    assert run(tmp_path, '--runs', '2', '--load', '0', '--', 'true').returncode == 0
