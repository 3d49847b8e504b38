# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Signals and exit codes: the bridge and read_tag end as documented at any moment."""

import io
import sys
from types import SimpleNamespace

import pytest
import rclpy
from conftest import Terminal, ended_process
from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.errors import OneLineError, escaped, pluralized
from lupin_greenhouse_bridge.reading import read_tag
from lupin_greenhouse_bridge.runtime import process, run
from lupin_greenhouse_bridge.runtime.output import Progress, ProgressLine
from lupin_greenhouse_bridge.testing.commands import SIGNALS, SPINS
from lupin_greenhouse_bridge.testing.helpers import (
    PATIENCE_SECONDS,
    ManualClock,
    spinning_node,
)
from rclpy.executors import SingleThreadedExecutor

NO_ANSWER, INTERRUPTED = 3, 130
STARTS = ('rclpy/__init__.py:init', 'rclpy/context.py:init', 'rclpy/node.py:__init__')
ENDS = ('rclpy/executors.py:shutdown', 'rclpy/context.py:try_shutdown')
RUN = (*STARTS, 'rclpy/executors.py:add_node', 'rclpy/node.py:destroy_node', *ENDS)
BOTH = SIGNALS['SIGTERM and Ctrl-C']
STUCK = """
import ctypes
from lupin_greenhouse_bridge.runtime import run

run.LONGEST_SHUTDOWN_SECONDS = 0.2
run._limit_shutdown()
ctypes.PyDLL(None).sleep(3600)  # with Python's lock, like a Fast DDS that waits for itself
"""
NOBODY = ('--service', '/nobody/get_tag_reading', '--timeout', str(PATIENCE_SECONDS))


@pytest.mark.parametrize('signals', SIGNALS.values(), ids=SIGNALS)
def test_the_process_of_a_bridge_that_is_ready_ends_with_exit_code_0(start_bridge, signals):
    bridge = start_bridge()
    bridge.wait_for_log('ready:')
    bridge.send(*signals)
    assert bridge.end() == 0


@pytest.mark.parametrize(
    ('moment', 'signals'),
    [*((moment, BOTH) for moment in RUN), *((SPINS, signals) for signals in SIGNALS.values())],
)
def test_the_bridge_ends_with_exit_code_0_at_any_moment(run_here, moment, signals):
    ended = run_here(bridge_node.main, signals_at={SPINS: SIGNALS['SIGTERM'], moment: signals})
    assert (ended.code, f'signalled in {moment}' in ended.out) == (0, True)


def test_a_process_that_cannot_end_is_ended_with_exit_code_1_and_without_a_traceback():
    assert ended_process([sys.executable, '-c', STUCK]) == (1, '', '')


@pytest.mark.parametrize('moment', [*STARTS, *ENDS])
def test_a_refusal_keeps_its_exit_code_and_its_line_whatever_signal_comes(run_here, moment):
    ended = run_here(bridge_node.main, '--ros-args', '-p', 'debug_seed:=-5', signals_at={moment: BOTH})
    assert 'debug_seed is -5' in ended.refusal
    assert f'signalled in {moment}' in ended.out


@pytest.mark.parametrize('moment', [*STARTS, 'rclpy/executors.py:add_node', SPINS])
@pytest.mark.parametrize('arguments', [['1'], ['1', '--watch', '9']])
def test_read_tag_that_waits_for_a_service_ends_as_documented(run_here, moment, arguments):
    ended = run_here(read_tag.main, *arguments, *NOBODY, signals_at={moment: BOTH})
    assert (ended.code, ended.out, ended.err) == (INTERRUPTED, f'signalled in {moment}\n', '')


@pytest.mark.parametrize(
    ('distro', 'hidden'),
    [('humble', ('ROS_LOCALHOST_ONLY', '1')), ('kilted', ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST'))],
)
def test_a_private_domain_is_of_no_team_and_hidden_from_other_machines(monkeypatch, distro, hidden):
    monkeypatch.setenv('ROS_DISTRO', distro)
    try_next = process.private_domains()
    assert [try_next() for _ in range(32)] == [*range(71, 102), 71]
    others = {('ROS_DOMAIN_ID', '71'), ('ROS_DISCOVERY_SERVER', '')}
    assert set(process.variables_of_private_domain(71).items()) == {hidden, *others}


@pytest.mark.parametrize('moment', ENDS)
def test_read_tag_that_has_failed_keeps_its_exit_code_whatever_signal_comes(run_here, moment):
    ended = run_here(read_tag.main, '1', *NOBODY[:2], '--timeout', '0.01', signals_at={moment: BOTH})
    assert (ended.code, f'signalled in {moment}' in ended.out) == (NO_ANSWER, True)


@pytest.mark.parametrize('signals', SIGNALS.values(), ids=SIGNALS)
def test_read_tag_that_watches_ends_with_exit_code_0(noon_bridge, read_tag_here, signals):
    ask = ('1', '--watch', '100', '--service', noon_bridge.service_name)
    between = 'lupin_greenhouse_bridge/runtime/process.py:sleep'
    ended = read_tag_here(*ask, signals_at={between: signals})
    assert (ended.code, ended.messages) == (0, '')
    assert ended.out.startswith('tag')


def test_the_end_of_a_node_is_limited(bridge_here, monkeypatch):
    """Humble's executor waits without a limit for a coroutine that is suspended, and Fast DDS for itself."""
    shutdown, limits = SingleThreadedExecutor.shutdown, []

    def record(executor, timeout_sec=None):
        limits.append(timeout_sec)
        return shutdown(executor, timeout_sec)

    monkeypatch.setattr(SingleThreadedExecutor, 'shutdown', record)
    monkeypatch.setattr(run, '_limit_shutdown', lambda: limits.append('shutdown'))
    assert bridge_here().code == 0
    assert limits == [0, 'shutdown']


def test_a_sleep_is_a_row_of_naps_that_a_signal_ends(monkeypatch):
    """Python resumes a sleep after a signal."""
    clock, naps = ManualClock(), []

    def nap(seconds):
        naps.append(seconds)
        clock.pass_seconds(seconds)

    monkeypatch.setattr(process, 'time', SimpleNamespace(monotonic=clock, sleep=nap))
    process.sleep(1.25)
    monkeypatch.setattr(process, '_is_asked_to_end', True)
    process.sleep(1.25)
    assert naps == [0.5, 0.5, 0.25]


def test_an_error_is_one_line_that_keeps_the_spaces_of_a_name_and_a_long_text_is_cut():
    assert str(OneLineError("'two  spaces': one\r\n  two\x1b[2J")) == "'two  spaces': one two\\x1b[2J"
    assert [escaped('x' * length, 64) for length in (64, 65)] == ['x' * 64, 'x' * 64 + '...']
    assert [pluralized(count, 'tag') for count in (0, 1, 2)] == ['0 tags', '1 tag', '2 tags']


def test_a_progress_line_takes_the_position_of_the_last_at_a_terminal_and_is_silent_in_a_pipe():
    with Terminal(columns=20) as terminal:
        for line in (ProgressLine(terminal.stream), ProgressLine(io.StringIO()), ProgressLine(None)):
            for text in ('1/29', '1/29', 'x' * 50):
                line.show(text)
            line.clear()
            line.clear()
    assert terminal.text == f'\r\x1b[K1/29\r\r\x1b[K{"x" * 19}\r\r\x1b[K\r'


def test_progress_is_shown_on_standard_error(monkeypatch):
    with Terminal() as terminal:
        monkeypatch.setattr(sys, 'stderr', terminal.stream)
        progress = Progress('approach_poses')
        progress('tags with a pose', 7, 99)
        progress.clear()
    assert terminal.text == '\r\x1b[Kapproach_poses: tags with a pose: 7 of 99\r\r\x1b[K\r'


@pytest.mark.parametrize(('namespace', 'warnings'), [('/', 1), ('/other', 0)])
def test_a_node_warns_once_of_another_with_its_full_name(run_here, monkeypatch, namespace, warnings):
    monkeypatch.setattr(run, 'LOOK_EVERY_SECONDS', 0.0)
    looks = []

    def has_looked_often(node):
        looks.append(node.get_node_names_and_namespaces().count(('named', namespace)))
        return looks.count(1 + warnings) > 3

    def main(arguments):
        return run.run('named', lambda: rclpy.create_node('named'), arguments, is_done=has_looked_often)

    with spinning_node('named', namespace=namespace):
        ended = run_here(main)
    assert ended.code == 0
    assert ended.err.count('another node named /named is on domain') == warnings
    assert ended.err.count('stop one of them, or start one with its own namespace') == warnings
