"""The short form of tools/soak.py keeps every promise; `make soak` is the long one."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_no_promise_is_broken_under_faults_and_load():
    script = 'source ci/ros_env.bash && exec "$0" tools/soak.py --short'
    environment = {**os.environ, 'TREE': 'monorepo'}
    result = subprocess.run(
        ['bash', '-c', script, sys.executable],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    print(result.stdout)
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.count('kept') >= 16
    assert result.stdout.endswith('0 promises broken\n')
