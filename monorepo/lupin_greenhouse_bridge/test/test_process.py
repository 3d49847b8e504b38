# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Signals and exit codes: the bridge and read_tag end as documented at any moment."""

import importlib
import io
import os
import queue
import signal
import sys
from functools import partial
from types import SimpleNamespace

import pytest
import rclpy
from conftest import SPINS, Terminal, ended_process
from lupin_greenhouse_bridge import bridge_node, executables
from lupin_greenhouse_bridge.errors import OneLineError, escaped, pluralized, source_of_messages
from lupin_greenhouse_bridge.reading import read_tag
from lupin_greenhouse_bridge.runtime import process, run
from lupin_greenhouse_bridge.runtime.output import Progress, ProgressLine, said_if_slow
from lupin_greenhouse_bridge.testing._helpers import (
    PATIENCE_SECONDS,
    ManualClock,
    executable,
    spinning_node,
)
from lupin_greenhouse_bridge.testing._signals import SIGNALS, command
from rclpy.executors import SingleThreadedExecutor

NO_ANSWER, INTERRUPTED = 3, 130
PACKAGE = 'lupin_greenhouse_bridge'
IMPORT = 'rclpy/__init__.py:<module>'  # before main()
STARTS = ('rclpy/__init__.py:init', 'rclpy/context.py:init', 'rclpy/node.py:__init__')
ENDS = ('rclpy/executors.py:shutdown', 'rclpy/context.py:try_shutdown')
RUN = (*STARTS, 'rclpy/executors.py:add_node', 'rclpy/node.py:destroy_node', *ENDS)
EXITS = 'lupin_greenhouse_bridge/runtime/process.py:end'  # after main()
BOTH = SIGNALS['SIGTERM and Ctrl-C']
STUCK = """
import ctypes
import sys
import types
from lupin_greenhouse_bridge.runtime import process

def main():
    process.limit_the_end()
    ctypes.PyDLL(None).sleep(3600)  # with Python's lock, like a Fast DDS that waits for itself

process.LONGEST_END_SECONDS = 0.2
sys.modules['stuck'] = types.SimpleNamespace(main=main)
process.start('stuck')
"""
NOBODY = ('--service', '/nobody/get_tag_reading', '--timeout', str(PATIENCE_SECONDS))


@pytest.mark.parametrize(('moment', 'seed', 'code'), [(IMPORT, 1, 0), (IMPORT, -5, 1), (EXITS, -5, 1)])
def test_a_signal_before_or_after_the_node_keeps_the_exit_code(start_bridge, moment, seed, code):
    bridge = start_bridge(command(PACKAGE, 'bridge_node', moment, BOTH), debug_seed=seed)
    assert bridge.end() == code
    assert any(f'signalled in {moment}' in line for line in bridge.log)
    assert sum('debug_seed is -5' in line for line in bridge.log) == code


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


def test_the_process_of_read_tag_ends_as_documented():
    signalled = command(PACKAGE, 'read_tag', IMPORT, SIGNALS['Ctrl-C twice'])
    code, _, err = ended_process([*signalled, '1', '--watch', '9', *NOBODY])
    assert (code, 'Traceback' in err) == (INTERRUPTED, False)


@pytest.mark.parametrize('moment', [*STARTS, 'rclpy/executors.py:add_node', SPINS])
@pytest.mark.parametrize('arguments', [['1'], ['1', '--watch', '9']])
def test_read_tag_that_waits_for_a_service_ends_as_documented(run_here, moment, arguments):
    ended = run_here(read_tag.main, *arguments, *NOBODY, signals_at={moment: BOTH})
    assert ended == (INTERRUPTED, f'signalled in {moment}\n', '')


@pytest.mark.parametrize(
    ('words', 'code', 'variable', 'value', 'problem'),
    [
        (['read_tag', '1'], 2, 'RMW_IMPLEMENTATION', 'rmw_none', "'rmw_none', which is not installed: unset"),
        (['bridge_node'], 1, 'RCUTILS_COLORIZED_OUTPUT', '2', "'2': must be 0 or 1"),
    ],
)
def test_a_variable_that_ends_ros_is_named_in_one_line(monkeypatch, words, code, variable, value, problem):
    """With such an RMW rclpy exits with code 102, with such a log rcl logs 17 lines."""
    monkeypatch.setenv(variable, value)
    ended, _, err = ended_process([executable(PACKAGE, words[0]), *words[1:]])
    (line,) = err.splitlines()
    assert ended == code
    assert f'{variable} is {problem}' in line


def test_where_nothing_tells_which_rmw_is_installed_none_is_refused(monkeypatch):
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_other')
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    process.hide_fatal_values()
    assert process.environment_problem() == ''
    assert os.environ['RMW_IMPLEMENTATION'] == 'rmw_other'


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
    assert (ended.code, ended.said) == (0, '')
    assert ended.out.startswith('tag')


def test_a_command_without_a_node_is_ended_by_ctrl_c_at_once():
    moment = 'display/readings_page.py:main'
    ended = ended_process(command(PACKAGE, 'readings_page', moment, SIGNALS['Ctrl-C']))
    assert ended == (-signal.SIGINT, f'signalled in {moment}\n', '')


def test_each_executable_starts_its_module_and_those_without_a_node_handle_no_signal():
    starts = {name: each for name, each in vars(executables).items() if isinstance(each, partial)}
    for name, start in starts.items():
        assert start.args[0].rpartition('.')[2] == name
        assert importlib.import_module(*start.args).main
    without_a_node = [name for name, start in starts.items() if start.keywords == {'has_node': False}]
    assert without_a_node == ['readings_page', 'approach_poses']


def test_the_end_of_a_node_is_limited(bridge_here, monkeypatch):
    """Humble's executor waits without a limit for a coroutine that is suspended, and Fast DDS for itself."""
    shutdown, limits = SingleThreadedExecutor.shutdown, []

    def record(executor, timeout_sec=None):
        limits.append(timeout_sec)
        return shutdown(executor, timeout_sec)

    monkeypatch.setattr(SingleThreadedExecutor, 'shutdown', record)
    monkeypatch.setattr(process, 'limit_the_end', lambda: limits.append('the end'))
    assert bridge_here().code == 0
    assert limits == [0, 'the end']


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


@pytest.mark.parametrize(
    ('is_venv', 'has_ros', 'source'),
    [
        (True, True, 'write `python3 ci/within.py --stand-ins` before the command'),
        (True, False, 'sudo apt install ros-$ROS_DISTRO-nav2-msgs'),  # /opt/ros is seen from a venv
        (False, True, 'sudo apt install ros-$ROS_DISTRO-nav2-msgs'),  # a prefix of conda
    ],
)
def test_messages_come_from_apt_only_where_ros_does(tmp_path, monkeypatch, is_venv, has_ros, source):
    monkeypatch.setattr(sys, 'prefix', str(tmp_path))
    monkeypatch.setattr(sys, 'base_prefix', '/usr' if is_venv else str(tmp_path))
    if has_ros:
        (tmp_path / 'local_setup.bash').touch()
    assert source_of_messages('nav2_msgs') == source


def test_a_progress_line_takes_the_position_of_the_last_at_a_terminal_and_is_silent_in_a_pipe():
    with Terminal(columns=20) as terminal:
        for line in (ProgressLine(terminal.stream), ProgressLine(io.StringIO()), ProgressLine(None)):
            for text in ('1/29', '1/29', 'x' * 50):
                line.show(text)
            line.clear()
            line.clear()
    assert terminal.text == f'\r\x1b[K1/29\r\r\x1b[K{"x" * 19}\r\r\x1b[K\r'


@pytest.mark.parametrize('is_terminal', [False, True])
def test_a_line_tells_of_work_that_takes_more_than_3_seconds(monkeypatch, is_terminal):
    clock = iter([0.0, 2.9, 3.0, 10.0, 18.0])
    monkeypatch.setattr('time.monotonic', lambda: next(clock))
    pipe = io.StringIO()
    with Terminal() as terminal:
        monkeypatch.setattr(sys, 'stderr', terminal.stream if is_terminal else pipe)
        progress = Progress('approach_poses')
        for done in range(4):
            progress('tags with a pose', done, 99)
        progress.clear()
    lines = [f'approach_poses: tags with a pose: {done} of 99' for done in (1, 2, 3)]
    wiped = ''.join(f'\r\x1b[K{line}\r' for line in (*lines, ''))
    shown = (wiped, '') if is_terminal else ('', f'{lines[0]}\n{lines[2]}\n')
    assert (terminal.text, pipe.getvalue()) == shown


def test_work_without_steps_is_told_of_only_if_it_is_slow(monkeypatch):
    written = queue.SimpleQueue()
    monkeypatch.setattr(sys, 'stderr', SimpleNamespace(write=written.put, flush=bool, isatty=bool))
    with said_if_slow('approach_poses', 'drawing', seconds=3600.0):
        pass
    assert written.empty()
    with said_if_slow('approach_poses', 'drawing', seconds=0.0):
        assert written.get(timeout=60.0) == 'approach_poses: drawing'


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
    assert ended.err.count('stop one of them, or give one a namespace or a ROS_DOMAIN_ID of') == warnings
