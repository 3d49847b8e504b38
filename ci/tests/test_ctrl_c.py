"""Ctrl-C while a program of make starts ends it without a traceback."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

pytestmark = pytest.mark.heavy
READ_TAG = f'{os.environ["LUPIN_EXECUTABLES"]}/read_tag'
# The command, and the module in whose import it is held.
HELD = {
    'environment': ([sys.executable, '-ES', 'ci/environment.py'], 'ci/jobs.py'),
    'build': ([sys.executable, '-ES', 'ci/build.py'], 'ci/jobs.py'),
    'within': ([sys.executable, '-ES', 'ci/within.py'], 'ci/build.py'),
    'tests': ([sys.executable, 'ci/run_tests.py'], 'ci/jobs.py'),
    'tool': ([sys.executable, 'tools/generate.py'], 'argparse.py'),
    'python': ([READ_TAG], '_distutils_hack.py'),  # which it reads before any program
    'command': ([READ_TAG], 'lupin_greenhouse_bridge.py'),
}


def interrupt(folder: Path, command: list[str], module: str) -> tuple[int, str]:
    """Interrupt a command while it imports a module; return its exit code and its standard error."""
    (folder / module).write_text('import os, signal\nos.write(1, b"held")\nsignal.pause()\n')
    path = os.pathsep.join([str(folder), os.environ.get('PYTHONPATH', '')])
    environment = os.environ | {'PYTHONPATH': path}
    pipes = {'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE}
    with subprocess.Popen(command, cwd=folder, env=environment, **pipes) as process:
        assert process.stdout.read(4) == b'held', process.stderr.read()
        process.send_signal(signal.SIGINT)
        _, printed = process.communicate()
    return process.returncode, printed.decode()


@pytest.mark.parametrize('name', HELD)
def test_a_program_of_make_that_still_starts_says_nothing(tmp_path, name):
    for each in ('ci', 'tools'):
        shutil.copytree(ROOT / each, tmp_path / each, ignore=shutil.ignore_patterns('core', 'tests'))
    assert interrupt(tmp_path, *HELD[name]) == (-signal.SIGINT, '')


def test_a_program_of_a_person_shows_where_it_was(tmp_path):
    (tmp_path / 'client.py').write_text('import waiting')
    code, printed = interrupt(tmp_path, [sys.executable, 'client.py'], 'waiting.py')
    assert code == -signal.SIGINT
    assert 'client.py", line 1' in printed
