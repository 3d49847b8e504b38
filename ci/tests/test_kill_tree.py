"""ci/kill_tree.py: an interrupted command leaves no process behind."""

import contextlib
import os
import signal
import sys
import time
import uuid
from pathlib import Path

import kill_tree
import pytest
from conftest import start

pytestmark = pytest.mark.heavy
PATIENCE_SECONDS = 60.0
# Background jobs: plain, under timeout, in a session of its own, deaf to SIGTERM, orphaned.
STUBBORN = """
sleep 600 &
timeout 600 sleep 600 &
setsid sleep 600 &
(trap '' TERM; sleep 600; true) &
(sleep 600 &)
echo started
wait
"""


def marked(mark: str) -> dict[int, str]:
    """Return the command lines of the living processes that have this word in their environment."""
    found = {}
    for folder in Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError):  # it has ended
            if mark.encode() in (folder / 'environ').read_bytes():
                found[int(folder.name)] = (folder / 'cmdline').read_text().replace('\0', ' ')
    return found


@pytest.fixture
def mark():
    """Return a word for the environment of what a test starts, and kill what is left of it."""
    word = uuid.uuid4().hex
    yield word
    for pid in marked(word):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_every_descendant(mark, number):
    process = start(sys.executable, kill_tree.__file__, 'bash', '-c', STUBBORN, LUPIN_TEST_MARK=mark)
    assert process.stdout.readline() == 'started\n'
    deadline = time.monotonic() + PATIENCE_SECONDS
    while [line[:5] for line in marked(mark).values()].count('sleep') < 5:  # each is what it becomes
        assert time.monotonic() < deadline, marked(mark)
    process.send_signal(number)
    assert process.wait(PATIENCE_SECONDS) == 128 + number
    assert not marked(mark)


@pytest.mark.parametrize(('script', 'code'), [('exit 0', 0), ('exit 7', 7), ('kill -9 $$', 137)])
def test_the_exit_code_is_that_of_the_command_and_nothing_is_left(mark, script, code):
    command = (sys.executable, kill_tree.__file__, 'bash', '-c', f'setsid sleep 600 & {script}')
    process = start(*command, LUPIN_TEST_MARK=mark)
    assert process.wait(PATIENCE_SECONDS) == code
    assert not marked(mark)


@pytest.mark.parametrize('target', ['test', 'soak'])
def test_ctrl_c_on_make_ends_all_that_it_started(mark, target):
    process = start('make', target, LUPIN_TEST_MARK=mark)
    deadline = time.monotonic() + 5 * PATIENCE_SECONDS
    while not any('--ros-args' in line for line in marked(mark).values()):  # a node
        assert process.poll() is None, process.stdout.read()
        assert time.monotonic() < deadline, marked(mark)
    os.killpg(process.pid, signal.SIGINT)
    process.communicate(timeout=PATIENCE_SECONDS)
    assert process.returncode != 0
    assert not marked(mark)
