# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Parameters and files that the bridge accepts, and those that it refuses."""

import copy
import dataclasses
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
import yaml
from ament_index_python.packages import get_package_share_path
from conftest import TAKES_TAG_FILES
from greenhouse_sim.simulator import GreenhouseSimulator
from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.runtime.parameters import default_text
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation
from lupin_greenhouse_bridge.testing.helpers import check_settings, running

PACKAGE = Path(__file__).resolve().parent.parent
PARAMETER_FILE = PACKAGE / 'config/greenhouse_bridge.yaml'
LAUNCH_FILE = get_package_share_path('lupin_greenhouse_bridge') / 'launch/greenhouse_bridge.launch.py'


@pytest.mark.parametrize(
    ('argument', 'is_debugged'),
    [
        ({}, {}),
        ({'speedup_factor': 60.0}, {}),
        *(({'debug_time_of_day': hours}, {'debug_mode': True}) for hours in (0.0, 6.0)),
        *(({'debug_seed': seed}, {'debug_mode': True}) for seed in (0, 7)),
    ],
)
def test_each_argument_alone_changes_only_what_it_should(argument, is_debugged):
    greenhouse = simulation.load(Settings(**argument), None, None)
    expected = copy.deepcopy(GreenhouseSimulator().sim_config)
    expected['time'].update(argument | is_debugged)
    assert (greenhouse.sim.sim_config, greenhouse.warnings) == (expected, [])


def test_a_custom_tag_file_is_served_here_or_refused_there(ask_here, bridge_here, write_layout):
    """The one divergence of the two trees, as a user sees it."""
    tag_file = write_layout({'A7': (1.0, 2.0)})
    if TAKES_TAG_FILES:
        ask = ask_here(tag_file=tag_file)
        assert [each.name for each in ask('A7').reading.readings] == ['co2']
        assert ask('1').error_message == "Tag '1' is not in the loaded greenhouse (1 tag known)."
    else:
        fatal = bridge_here(tag_file=tag_file).refusal
        assert f"tag_file '{tag_file}'" in fatal
        assert "'str' object has no attribute 'exists'" in fatal
        assert 'leave tag_file empty' in fatal


def test_the_path_is_not_blamed_where_it_is_no_string(write_layout, monkeypatch):
    def fail(*_arguments):
        raise AttributeError('something else')

    monkeypatch.setattr(GreenhouseSimulator, '__init__', fail)
    with pytest.raises(StartUpError, match=r'cannot load .*: AttributeError: something else'):
        simulation.load(Settings(), Path(write_layout({'7': (1.0, 2.0)})), None)


@pytest.mark.parametrize(
    ('parameter', 'value', 'fragment'),
    [
        ('debug_time_of_day', '24.000001', 'is 24.000001: must be between 0 and 24 hours'),
        ('debug_time_of_day', '-0.5', 'is -0.5: must be between 0 and 24 hours'),
        ('debug_time_of_day', '12:30', "is '12:30': must be a number, between 0 and 24 hours, such as 12.5"),
        ('speedup_factor', '-1.0', 'finite and above 0'),
        ('debug_seed', '-2', 'must be 0 or above'),
        ('debug_seed', '1.5', 'is 1.5: must be a whole number'),
        ('tag_file', '7', 'is 7: must be text'),
        ('sim_config_file', '~/none.yaml', "/~/none.yaml'"),
        ('tag_file', '/none.json', 'cannot be read (No such file or directory)'),
        ('use_sim_time', 'perhaps', 'use_sim_time'),
    ],
)
def test_a_bad_parameter_is_refused_before_it_serves(bridge_here, monkeypatch, parameter, value, fragment):
    monkeypatch.delattr(bridge_node, 'SERVICE_QOS')  # without which the service cannot be created
    fatal = bridge_here(**{parameter: value}).refusal
    assert parameter in fatal
    assert fragment in fatal


def test_the_shipped_parameter_file_has_every_parameter_and_its_default():
    nodes = yaml.safe_load(PARAMETER_FILE.read_text(encoding='utf-8'))
    assert {node: parameters['ros__parameters'] for node, parameters in nodes.items()} == {
        '/**/greenhouse_bridge': dataclasses.asdict(Settings()),
    }


@pytest.mark.parametrize(
    'arguments',
    [
        '--params-file /missing.yaml',
        '--log-level loud',
        '-p debug_seed=42',
        '-p x:=[',
        '-r __ns:=7x',
        '--seed 42',
    ],
)
def test_what_ros_cannot_parse_is_one_fatal_line_with_the_words_of_ros(bridge_here, arguments):
    fatal = bridge_here(*arguments.split()).refusal
    assert 'ROS cannot start: ' in fatal
    assert arguments.split()[-1] in fatal


@pytest.mark.parametrize(('domain_id', 'is_refused'), [('233', True), ('101', False)])
def test_a_domain_that_dds_does_not_have_is_refused(bridge_here, monkeypatch, domain_id, is_refused):
    monkeypatch.setenv('ROS_DOMAIN_ID', domain_id)
    ended = bridge_here()
    assert ended.code == is_refused
    assert ('ROS_DOMAIN_ID is 233: must be from 0 to 232' in ended.err) == is_refused


@pytest.mark.parametrize('arguments', [('--ros-args', '-p', '--help'), ('--ros-args', '-h'), ('--help',)])
def test_help_may_come_after_the_ros_arguments(run_here, arguments):
    ended = run_here(bridge_node.main, *arguments)
    assert (ended.code, ended.err) == (0, '')
    assert '\n  debug_seed ' in ended.out


def test_a_parameter_without_ros_args_is_shown_with_them(run_here):
    fatal = run_here(bridge_node.main, 'debug_seed:=42').refusal
    assert "unknown argument 'debug_seed:=42': set parameters with --ros-args -p name:=value" in fatal


@pytest.fixture
def description(launch):
    return launch.launch_description_sources.PythonLaunchDescriptionSource(str(LAUNCH_FILE))


@pytest.fixture
def launched(launch, description):
    """Return a function that launches the bridge until it is ready; it returns exit code and log."""
    log = []

    def stop_when_ready(event):
        log.append(event.text.decode())
        return launch.actions.Shutdown() if 'ready: ' in log[-1] else None

    def run(**arguments):
        given = [(name, str(value)) for name, value in arguments.items()]
        bridge = launch.actions.IncludeLaunchDescription(description, launch_arguments=given)
        on_output = launch.event_handlers.OnProcessIO(on_stderr=stop_when_ready)
        service = launch.LaunchService()
        service.include_launch_description(
            launch.LaunchDescription([bridge, launch.actions.RegisterEventHandler(on_output)])
        )
        return service.run(), ''.join(log)

    return run


def test_launch_forwards_only_what_is_set(launched, tmp_path):
    """Whole numbers, as people type them; they override the parameter file, which sets the others."""
    file = tmp_path / 'parameters.yaml'
    parameters = {'debug_time_of_day': 6.0, 'speedup_factor': -1.0}
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters}}), encoding='utf-8')
    given = {'speedup_factor': 3600, 'debug_seed': 7}
    code, log = launched(**given, params_file=file, namespace='robot1', log_level='debug')
    assert code == 0
    for part in ('clock frozen at 6.0 h', '[robot1.greenhouse_bridge]', '[DEBUG]'):
        assert part in log


@pytest.mark.parametrize(
    ('argument', 'value', 'fault'),
    [
        ('params_file', '/missing.yaml', "params_file '/missing.yaml' is not a file"),
        ('speedup_factor', 'abc', "speedup_factor is 'abc': must be a number"),
        ('debug_seed', '1.0', "debug_seed is '1.0': must be a whole number"),
        ('respawn', 'maybe', "respawn is 'maybe': must be true or false"),
    ],
)
def test_launch_names_an_argument_that_cannot_be_used(launched, caplog, argument, value, fault):
    assert launched(**{argument: value}) == (1, '')
    (line,) = [record.message for record in caplog.records if record.levelname == 'ERROR']
    assert fault in line


def test_the_arguments_of_launch_are_described_and_default_to_the_parameters(launch, description):
    declared = {
        action.name: (''.join(part.text for part in action.default_value), action.description)
        for action in description.get_launch_description(launch.LaunchContext()).entities
        if isinstance(action, launch.actions.DeclareLaunchArgument)
    }
    for field in dataclasses.fields(Settings):
        assert declared.pop(field.name) == (default_text(field), field.metadata['description'])
    assert list(declared) == ['namespace', 'log_level', 'params_file', 'respawn']


def test_each_parameter_has_its_type_and_its_limits():
    check_settings(Settings)


def test_an_unknown_parameter_is_named_and_changes_nothing(bridge_here):
    """It is not refused, because it may be meant for another node that shares the parameter file."""
    settings = {'debug_seed': 42, 'debug_time_of_day': 6, 'speedup_factor': 60}
    ended = bridge_here(seed=42, use_sim_time='false', debug_sed=7, **settings)
    assert ended.code == 0
    assert '; clock frozen at 6 h; ' in ended.err
    assert [line.partition(': ')[2][:45] for line in ended.err.splitlines() if '[WARN]' in line] == [
        'parameter seed is unknown and ignored: see --',
        'parameter debug_sed is unknown and ignored: s',
        'speedup_factor has no effect: debug mode free',
    ]


def test_a_dump_of_the_parameters_of_a_running_bridge_can_be_given_back(bridge_here, tmp_path):
    """`ros2 param dump` writes such a file."""
    with running(bridge_node.GreenhouseBridgeNode, debug_time_of_day=6.0) as (bridge,):
        parameters = {name: each.value for name, each in bridge.get_parameters_by_prefix('').items()}
    assert parameters['loaded_tag_ids']
    file = tmp_path / 'dump.yaml'
    file.write_text(yaml.safe_dump({'/greenhouse_bridge': {'ros__parameters': parameters}}), encoding='utf-8')
    ended = bridge_here('--params-file', str(file))
    assert ended.code == 0
    assert 'clock frozen at 6.0 h' in ended.err
    assert '[WARN]' not in ended.err


SIMULATOR = 'greenhouse_sim.simulator.GreenhouseSimulator'
TOO_OLD = r"is installed, 1\.0\.7 or newer is needed: pip install --upgrade 'mdp-greenhouse>=1\.0\.7'$"


@pytest.mark.parametrize(
    ('called', 'answer', 'message'),
    [
        ('importlib.metadata.version', '1.0.7rc1', f'^mdp-greenhouse 1.0.7rc1 {TOO_OLD}'),
        ('importlib.metadata.version', 'not a version', f'^mdp-greenhouse not a version {TOO_OLD}'),
        ('importlib.metadata.version', PackageNotFoundError(), 'is not installed: pip install --upgrade'),
        ('importlib.import_module', ImportError('no yaml'), r'be imported \(no yaml\): sudo apt install'),
        # The simulator opens the file with the encoding of the locale.
        (f'{SIMULATOR}.tags', ['Ã©'], r"tag_file '.*tag_locations.json': .* set PYTHONUTF8=1"),
        (f'{SIMULATOR}.get_sensor_data', {}, r"tag '\d+' is loaded but cannot be read: .* KeyError"),
    ],
)
def test_a_simulator_that_is_old_missing_or_broken_is_refused(monkeypatch, called, answer, message):
    def answered(*_arguments):
        if isinstance(answer, Exception):
            raise answer
        return answer

    monkeypatch.setattr(called, answered)
    with pytest.raises(StartUpError, match=message):
        simulation.load(Settings(), None, None)
