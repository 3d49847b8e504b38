"""The benchmark cannot flatter, and the short forms of soak.py and network.py keep every promise."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import bench
import network
import pytest
import soak

ROOT = Path(__file__).resolve().parents[3]
CANNED = f'{sys.executable} {ROOT / "tools/measure/canned_replies.py"}'
SCENARIOS = {'soak.py': soak.SCENARIOS, 'network.py': network.SCENARIOS}


def figures(output: Path, part: str, *arguments: str) -> dict[str, dict]:
    script = 'source ci/ros_env.bash && exec "$0" tools/measure/bench.py "$@"'
    options = ['--short', '--only', part, '--output', str(output), *arguments]
    result = subprocess.run(
        ['bash', '-c', script, sys.executable, *options],
        cwd=ROOT,
        env={**os.environ, 'TREE': 'monorepo'},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    rows = json.loads((output / 'bench.json').read_text())['figures']
    missed = [row['figure'] for row in rows if row.get('verdict') == 'MISSED']
    assert (f'missed: {", ".join(missed)}\n' in result.stdout) == bool(missed)
    return {row['figure']: row for row in rows}


def test_swapping_the_sides_inverts_the_ratios(tmp_path):
    """One side sleeps 2 ms in each call; how much that is beside a reply depends on the machine's load."""
    slow = f'{CANNED} 0.002'
    as_subject = figures(tmp_path, 'latency', '--subject', slow, '--baseline', CANNED)
    as_baseline = figures(tmp_path, 'latency', '--subject', CANNED, '--baseline', slow)
    assert as_subject['round trip p50']['ratio'] > 1.0
    assert as_baseline['round trip p50']['ratio'] < 1.0


@pytest.mark.parametrize(('side', 'sign'), [(max, 1), (min, -1)])
def test_a_target_is_missed_only_if_the_middle_half_lies_beyond_it(side, sign):
    for above, near, expected in ((0.0, -0.1, 'met'), (0.01, 0.0, 'within noise'), (0.02, 0.01, 'MISSED')):
        low, high = sorted((1 + sign * near, 1 + sign * 0.1))
        assert bench.verdict(1 + sign * above, low, high, 1.0, side) == expected


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
