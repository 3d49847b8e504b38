"""The short forms of soak.py and network.py keep every promise."""

import os
import re
import subprocess
import sys
from pathlib import Path

import network
import pytest
import soak

ROOT = Path(__file__).resolve().parents[3]
SCENARIOS = {'soak.py': soak.SCENARIOS, 'network.py': network.SCENARIOS}


@pytest.fixture(scope='module')
def runs():
    """Yield both runs by the name of the script. They run in parallel, because they mostly wait."""
    environment = {**os.environ, 'TREE': 'monorepo'}
    processes = {
        name: subprocess.Popen(
            [sys.executable, 'ci/within.py', '--stand-ins', 'python', f'tools/measure/{name}', '--short'],
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for name in SCENARIOS
    }
    yield processes
    for process in processes.values():
        process.terminate()
        process.wait()


@pytest.mark.parametrize('name', SCENARIOS)
def test_no_promise_is_broken(runs, name):
    output, _ = runs[name].communicate()
    print(output)
    if name == 'network.py' and runs[name].returncode == network.CANNOT_RUN:
        pytest.skip(output.strip())
    assert output.endswith('\n0 promises broken\n')
    assert runs[name].returncode == 0
    kept = re.findall(r'^kept +(\w+): ', output, re.MULTILINE)
    assert list(dict.fromkeys(kept)) == [scenario.__name__ for scenario in SCENARIOS[name]]


def test_the_network_test_does_not_pass_where_it_cannot_run(monkeypatch, capsys):
    monkeypatch.setattr(os, 'geteuid', lambda: 1000)
    monkeypatch.setattr(sys, 'argv', ['network.py'])
    assert network.main() == network.CANNOT_RUN
    assert 'cannot run here: it needs root' in capsys.readouterr().out
