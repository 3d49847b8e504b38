"""The short forms of soak.py and network.py keep every promise; make has the long ones."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
FEWEST_PROMISES = {'soak.py': 15, 'network.py': 9}


@pytest.fixture(scope='module')
def runs():
    """Yield both runs by the script's name, at the same time: each of them waits more than it works."""
    script = 'source ci/ros_env.bash && exec "$0" tools/measure/"$1" --short'
    environment = {**os.environ, 'TREE': 'monorepo'}
    processes = {
        name: subprocess.Popen(
            ['bash', '-c', script, sys.executable, name],
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for name in FEWEST_PROMISES
    }
    yield processes
    for process in processes.values():
        process.terminate()
        process.wait()


@pytest.mark.parametrize('name', FEWEST_PROMISES)
def test_no_promise_is_broken(runs, name):
    output, _ = runs[name].communicate()
    print(output)
    if 'test-network: skipped:' in output:
        pytest.skip(output.strip())
    assert output.endswith('\n0 promises broken\n')
    assert runs[name].returncode == 0
    assert output.count('kept  ') >= FEWEST_PROMISES[name]
