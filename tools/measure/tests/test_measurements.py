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
SLOW = """
import runpy, time
from greenhouse_sim.simulator import GreenhouseSimulator
read = GreenhouseSimulator.get_sensor_data
GreenhouseSimulator.get_sensor_data = lambda *arguments: time.sleep(0.002) or read(*arguments)
runpy.run_path({!r}, run_name='__main__')
"""
SCENARIOS = {'soak.py': soak.SCENARIOS, 'network.py': network.SCENARIOS}


def start(name: str, *options: str) -> subprocess.Popen:
    """Start the short form of a measurement."""
    command = [sys.executable, 'ci/within.py', '--stand-ins', 'python', f'tools/measure/{name}', '--short']
    environment = {**os.environ, 'TREE': 'monorepo'}
    output = {'stdout': subprocess.PIPE, 'stderr': subprocess.STDOUT, 'text': True}
    return subprocess.Popen([*command, *options], cwd=ROOT, env=environment, **output)


def test_a_slow_baseline_makes_the_ratio_small(tmp_path):
    """It sleeps 2 ms in each call; how much that is beside a reply depends on the machine's load."""
    wrapper, script = bench.PLAIN_WRAPPER, tmp_path / 'slow.py'
    script.write_text(SLOW.format(wrapper.split()[-1]))
    sides = ('--subject', wrapper, '--baseline', f'{sys.executable} {script}')
    process = start('bench.py', '--only', 'latency', '--output', str(tmp_path), *sides)
    printed, _ = process.communicate()
    assert process.returncode == 0, printed
    p50, *_ = json.loads((tmp_path / 'bench.json').read_text())['figures']
    assert (p50['figure'], p50['ratio'] < 1.0) == ('round trip p50', True)


@pytest.fixture(scope='module')
def runs():
    """Yield both runs by the name of the script. They run in parallel, because they mostly wait."""
    processes = {name: start(name) for name in SCENARIOS}
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


@pytest.mark.parametrize('main', [bench.main, network.main, soak.main])
def test_a_wrong_option_is_one_line(monkeypatch, capsys, main):
    monkeypatch.setattr(sys, 'argv', ['measure', '--shrot'])
    with pytest.raises(SystemExit):
        main()
    assert capsys.readouterr().err == 'measure: error: unrecognized arguments: --shrot: see --help\n'
