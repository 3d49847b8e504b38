"""Signals and exit codes: the bridge and read_tag end as documented at any moment."""

import subprocess

import pytest
from lupin_greenhouse_bridge import life_cycle
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, printable
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.signalled import MOMENTS, SIGNALS, command
from lupin_greenhouse_bridge.testing import PATIENCE_SECONDS, executable

INTERRUPTED = 130
PACKAGE = 'lupin_greenhouse_bridge'


@pytest.mark.parametrize('signals', SIGNALS.values(), ids=SIGNALS)
def test_the_bridge_ends_with_exit_code_0(start_bridge, signals):
    bridge = start_bridge()
    assert bridge.values('1')
    bridge.send(*signals)
    assert bridge.end() == 0


@pytest.mark.parametrize('moment', MOMENTS)
def test_the_bridge_ends_with_exit_code_0_at_any_moment(start_bridge, moment):
    """`ros2 launch` adds a second signal to the terminal's."""
    bridge = start_bridge(command(PACKAGE, 'bridge_node', moment, SIGNALS['Ctrl-C twice']))
    bridge.wait_for_log('signalled in') if moment in MOMENTS[:7] else bridge.wait_for_log('ready:')
    bridge.send(*SIGNALS['SIGTERM and Ctrl-C'])
    assert bridge.end() == 0
    assert any(f'signalled in {moment}' in line for line in bridge.log)


@pytest.mark.parametrize('moment', MOMENTS)
def test_a_refusal_keeps_its_exit_code_and_its_line_whatever_signal_comes(start_bridge, moment):
    if moment in (
        'rclpy/executors.py:add_node',
        'rclpy/executors.py:spin_once',
        'rclpy/node.py:destroy_node',
    ):
        return  # a refused node does not get that far
    bridge = start_bridge(
        command(PACKAGE, 'bridge_node', moment, SIGNALS['SIGTERM and Ctrl-C']), debug_seed=-5
    )
    assert 'debug_seed is -5' in bridge.refusal()


def read_tag(moment, signals, *arguments):
    """Return the result of a read_tag without a bridge."""
    ask = [*arguments, '--service', '/nobody/get_tag_reading', '--timeout', str(PATIENCE_SECONDS)]
    return subprocess.run(
        [*command(PACKAGE, 'read_tag', moment, signals), *ask],
        capture_output=True,
        text=True,
        timeout=PATIENCE_SECONDS,
        check=False,
    )


@pytest.mark.parametrize('signals', SIGNALS.values(), ids=SIGNALS)
@pytest.mark.parametrize('moment', ['rclpy/__init__.py:<module>', 'rclpy/executors.py:spin_once'])
@pytest.mark.parametrize(('arguments', 'code'), [(['1'], INTERRUPTED), (['1', '--watch', '9'], 0)])
def test_read_tag_that_waits_for_a_service_ends_as_documented(moment, signals, arguments, code):
    result = read_tag(moment, signals, *arguments)
    assert result.returncode == code
    assert 'Traceback' not in result.stderr


@pytest.mark.parametrize('signals', SIGNALS.values(), ids=SIGNALS)
def test_read_tag_that_watches_ends_with_exit_code_0(noon_bridge, signals):
    noon_bridge.connect()
    ask = [executable(PACKAGE, 'read_tag'), '1', '--watch', '100', '--service', noon_bridge.service_name]
    with subprocess.Popen(ask, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith('tag')
        for number in signals:
            process.send_signal(number)
        assert process.wait(PATIENCE_SECONDS) == 0
        assert 'Traceback' not in process.stderr.read()


def test_a_long_text_is_cut_and_one_of_that_length_is_not():
    assert printable('x' * 64, 64) == 'x' * 64
    assert printable('x' * 65, 64) == 'x' * 64 + '...'


def test_an_error_is_one_line_that_keeps_the_spaces_of_a_name():
    assert str(OneLineError("'two  spaces': one\r\n  two\x1b[2J")) == "'two  spaces': one two\\x1b[2J"


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        ('tag_file', 7, 'parameter tag_file is 7: must be text (put quotes around a number)'),
        ('debug_seed', 1.5, 'parameter debug_seed is 1.5: must be a whole number'),
        ('debug_seed', True, 'parameter debug_seed is True: must be a whole number'),
        ('speedup_factor', 'fast', "parameter speedup_factor is 'fast': must be a number"),
        ('speedup_factor', True, 'parameter speedup_factor is True: must be a number'),
    ],
)
def test_a_parameter_of_another_type_is_refused(name, value, message):
    with pytest.raises(StartUpError) as refusal:
        Settings(**{name: value})
    assert str(refusal.value) == message


def test_launch_gets_every_parameter_as_it_writes_defaults():
    rows = {name: (default, kind) for name, default, kind, _ in life_cycle.launch_arguments(Settings)}
    assert rows == {
        'tag_file': ('', str),
        'sim_config_file': ('', str),
        'debug_time_of_day': ('-1.0', float),
        'speedup_factor': ('0.0', float),
        'debug_seed': ('-1', int),
    }
