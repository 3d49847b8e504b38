"""The short forms of the measurements."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import soak

FOLDER = Path(soak.__file__).parent


def short_form(name):
    """Return the output of the short form of a measurement, which has ended with exit code 0."""
    command = [sys.executable, FOLDER / name, '--short']
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


@pytest.mark.heavy
def test_no_promise_is_broken():
    output = short_form('soak.py')
    assert output.endswith('\n0 promises broken\n')
    kept = re.findall(r'^kept +(\w+): ', output, re.MULTILINE)
    assert list(dict.fromkeys(kept)) == [scenario.__name__ for scenario in soak.SCENARIOS]


@pytest.mark.heavy
def test_the_bridge_answers_every_call_of_a_burst():
    (bridge,) = re.findall(r'^\| a burst of 200 .*? \| (\S+) \|', short_form('bench.py'), re.MULTILINE)
    assert bridge == '200'
