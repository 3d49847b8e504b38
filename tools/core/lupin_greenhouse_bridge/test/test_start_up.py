"""Parameters and files that the bridge accepts, and those that it refuses."""

import copy
import dataclasses
import shlex
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
import yaml
from ament_index_python.packages import get_package_share_path
from conftest import TAKES_TAG_FILES
from greenhouse_sim.simulator import GreenhouseSimulator
from lupin_greenhouse_bridge import bridge_node, settings
from lupin_greenhouse_bridge.display import show_readings
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.reading import read_on_sight
from lupin_greenhouse_bridge.recording import record_readings
from lupin_greenhouse_bridge.runtime.parameters import default_text
from lupin_greenhouse_bridge.runtime.rclpy_internals import RCLError
from lupin_greenhouse_bridge.runtime.run import node_creation
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation
from lupin_greenhouse_bridge.testing._helpers import check_settings

SHARE = get_package_share_path('lupin_greenhouse_bridge')
PARAMETER_FILE = SHARE / 'config/greenhouse_bridge.yaml'
LAUNCH_FILE = SHARE / 'launch/greenhouse_bridge.launch.py'


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
        ('sim_config_file', '~/none.yaml', "/~/none.yaml' (~ is not expanded)"),
        ('tag_file', '/none.json', 'cannot be read (No such file or directory): name a file that you can'),
        ('use_sim_time', 'perhaps', 'use_sim_time'),
    ],
)
def test_a_bad_parameter_is_refused_before_it_serves(bridge_here, monkeypatch, parameter, value, fragment):
    monkeypatch.delattr(bridge_node, 'SERVICE_QOS')  # without which the service cannot be created
    fatal = bridge_here(**{parameter: value}).refusal
    assert parameter in fatal
    assert fragment in fatal


@pytest.mark.parametrize(
    ('main', 'name', 'value', 'fragment'),
    [
        (record_readings.main, 'file', 'r.csv', "file 'r.csv' does not end in .sqlite or .db: name it"),
        (record_readings.main, 'file', 'no/a.db', "no/a.db': unable to open database file: make the folder"),
        (record_readings.main, 'file', 'folder.db', "folder.db': not a regular file: name another file"),
        (record_readings.main, 'readings_topics', '/a no-name', 'readings_topics: Invalid topic name: '),
        *((record_readings.main, 'readings_topics', each, 'topics is ') for each in ("' '", '7', '[1, 2]')),
        (show_readings.main, 'sensor', 'ozone', "sensor is 'ozone': the greenhouse config has no"),
        (show_readings.main, 'map_frame', "' '", "is ' ': must be the name of a frame, such as map"),
        (show_readings.main, 'readings_topics', "''", "is '': must be the name of a topic"),
        (show_readings.main, 'layout_in_map', '/none.yaml', "'/none.yaml'"),
    ],
)
def test_a_bad_parameter_of_a_node_is_refused(run_here, tmp_path, monkeypatch, main, name, value, fragment):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'folder.db').mkdir()
    assert fragment in run_here(main, '--ros-args', '-p', f'{name}:={value}').refusal


def test_the_shipped_parameter_file_has_every_parameter_and_its_default():
    nodes = yaml.safe_load(PARAMETER_FILE.read_text(encoding='utf-8'))
    assert {node: parameters['ros__parameters'] for node, parameters in nodes.items()} == {
        '/**/greenhouse_bridge': dataclasses.asdict(Settings()),
        '/**/read_on_sight': dataclasses.asdict(read_on_sight.Settings()),
        '/**/record_readings': dataclasses.asdict(record_readings.Settings()),
        '/**/show_readings': dataclasses.asdict(show_readings.Settings()),
    }


@pytest.mark.parametrize(
    ('arguments', 'fault'),
    [
        ('--params-file /missing.yaml', "parameter file '/missing.yaml' cannot be read (Error opening YAML"),
        ('--log-level loud', '--log-level loud: must be debug, info, warn, error or fatal'),
        ('-p debug_seed=42', "'debug_seed=42' sets no parameter: write debug_seed:=42"),
        ('debug_seed:=42', "'debug_seed:=42' lacks its -p: write -p debug_seed:=42"),
        ('debug_seed=42', "'debug_seed=42' lacks its -p: write -p debug_seed:=42"),
        ('-p debug_seed:= -p 42', "'debug_seed:=' sets no parameter: write debug_seed:=42"),
        ('-p debug-seed := 42', "'debug-seed' sets no parameter: write debug_seed:=42"),
        ('-p debug_seed:42', "'debug_seed:42' sets no parameter: write debug_seed:=42, without"),
        ('-p "debug_seed := 42"', "'debug_seed := 42' sets no parameter: write debug_seed:=42"),
        ('-p tag_file:=my -p tags.json', "quote a value with spaces, such as tag_file:='A B'"),
        ('-p 42 -p debug_seed:=1', "'42' sets no parameter: write NAME:=VALUE, without"),
        ('-p -p -p debug_seed:=1', "'-p' sets no parameter: write NAME:=VALUE in its place"),
        ('-p x:=[1, 2]', '-p "x:=\'[1,\'"; a list has no spaces'),
        ('-p', '-p has no value: write one after it, like -p name:=value'),
        ('-r __ns:=team7', "namespace 'team7' must begin with /: write -r __ns:=/team7"),
        ('-p --debug_seed:=42', "'--debug_seed:=42' sets no parameter: write debug_seed:=42 in its"),
        ('-r a/b:=/front/image-raw', "'a/b:=/front/image-raw': a name has letters, digits and _ only"),
        ('-r __ns:=7x', "'__ns:=7x': a name has letters, digits and _ only, and begins with no digit"),
        ('-r a b', "ROS cannot rename by 'a': write FROM:=TO, like -r __ns:=/robot1"),
        ('--seed 42', "'--seed' is no ROS argument: write it before --ros-args, or a parameter as -p"),
        ('-p tag_file:={id:03d}', 'such as -p "tag_file:=\'{id:03d}\'"'),
    ],
)
def test_what_ros_cannot_parse_is_told_apart(bridge_here, arguments, fault):
    ended = bridge_here(*shlex.split(arguments))
    assert fault in ended.refusal
    assert ended.err.count('\n') == 1


@pytest.mark.parametrize(
    ('name', 'value', 'fault'),
    [
        ('ROS_DOMAIN_ID', 'abc', "ROS_DOMAIN_ID is 'abc': must be a whole number from 0 to 232"),
        ('ROS_DOMAIN_ID', '233', "ROS_DOMAIN_ID is '233': must be a whole number from 0 to 232"),
        ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'subnet', "'subnet': must be one of SUBNET, LOCALHOST, OFF"),
        ('ROS_LOCALHOST_ONLY', 'yes', "ROS_LOCALHOST_ONLY is 'yes': must be one of 0, 1"),
        ('ROS_SECURITY_ENABLE', 'True', "ROS_SECURITY_ENABLE is 'True': must be one of true, false"),
        ('ROS_SECURITY_STRATEGY', 'enforce', "'enforce': must be one of Enforce, Permissive"),
        ('FASTDDS_DEFAULT_PROFILES_FILE', '/none.xml', "FASTDDS_DEFAULT_PROFILES_FILE names no file: '/none"),
        ('FASTRTPS_DEFAULT_PROFILES_FILE', '/none.xml', 'set it to the path of an XML file, or unset it'),
        ('ROS_LOG_DIR', '/dev/null/log', "the folder '/dev/null/log' for its logs: set ROS_LOG_DIR to"),
    ],
)
def test_a_variable_that_ros_cannot_use_is_named(bridge_here, monkeypatch, name, value, fault):
    monkeypatch.setenv(name, value)
    ended = bridge_here()
    assert fault in ended.refusal
    assert ended.err.count('\n') == 1


def test_a_static_peer_that_is_no_host_is_named():
    """With the words of rmw_fastrtps; Humble has no such variable."""
    message = "^ROS_STATIC_PEERS has 'abc', which is no host that is known: write host names or addresses"
    with pytest.raises(StartUpError, match=message), node_creation():
        raise RCLError('error creating node: Unable to resolve peer abc\n, at /src/participant.cpp:256')


@pytest.mark.parametrize('arguments', [('--ros-args', '-p', '--help'), ('--ros-args', '-h'), ('--help',)])
def test_help_may_come_after_the_ros_arguments(run_here, arguments):
    ended = run_here(bridge_node.main, *arguments)
    assert (ended.code, ended.err) == (0, '')
    assert '\n  debug_seed ' in ended.out


def test_a_parameter_without_ros_args_is_shown_with_them(run_here):
    fatal = run_here(bridge_node.main, 'debug_seed:=42').refusal
    assert "unknown argument 'debug_seed:=42': set parameters with --ros-args -p debug_seed:=42, or" in fatal


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


def test_launch_forwards_what_is_set_and_warns_of_a_name_that_resembles_an_argument(launched, caplog):
    """
    Whole numbers, as people type them; they override the parameter file.

    The other name is no error, because it may be an argument of a launch file that includes this one.
    """
    given = {'debug_time_of_day': 6, 'speedup_factor': 3600, 'debug_seed': 7, 'tag_fle': 42}
    code, log = launched(**given, params_file=PARAMETER_FILE, namespace='robot1', log_level='debug')
    assert code == 0
    for part in ('clock frozen at 6.0 h', '[robot1.greenhouse_bridge]', '[DEBUG]'):
        assert part in log
    warnings = [record.message for record in caplog.records if record.levelname == 'WARNING']
    assert 'argument tag_fle is unknown: did you mean tag_file?' in warnings


@pytest.mark.parametrize(
    ('argument', 'value', 'fault'),
    [
        ('params_file', '/missing.yaml', "params_file '/missing.yaml' is not a file: name a YAML file"),
        ('speedup_factor', 'abc', 'abc cannot be used: must be a number, such as speedup_factor:=0.0'),
        ('debug_seed', '1.0', '1.0 cannot be used: must be a whole number, such as debug_seed:=-1'),
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


@pytest.mark.parametrize('node', [settings, read_on_sight, record_readings, show_readings])
def test_each_parameter_has_its_type_and_its_limits(node):
    check_settings(node.Settings)


def test_an_unknown_parameter_is_named_and_changes_nothing(bridge_here):
    """It is not refused, because it may be meant for another node that shares the parameter file."""
    settings = {'debug_seed': 42, 'debug_time_of_day': 6, 'speedup_factor': 60}
    ended = bridge_here(seed=42, use_sim_time='false', debug_sed=7, **settings)
    assert ended.code == 0
    assert '; clock frozen at 6 h; ' in ended.err
    assert [line.partition(': ')[2][:60] for line in ended.err.splitlines() if '[WARN]' in line] == [
        'parameter seed is unknown and ignored: its parameters are de',
        'parameter debug_sed is unknown and ignored: its parameters a',
        'speedup_factor has no effect: debug mode freezes the simulat',
    ]
    # It resembles one that is not set.
    warning = 'parameter debug_sed is unknown and ignored: did you mean debug_seed?'
    assert warning in bridge_here(debug_sed=7).err


SIMULATOR = 'greenhouse_sim.simulator.GreenhouseSimulator'
TOO_OLD = r"is installed, 1\.0\.7 or newer is needed: pip install --upgrade 'mdp-greenhouse>=1\.0\.7'$"


@pytest.mark.parametrize(
    ('called', 'answer', 'message'),
    [
        ('importlib.metadata.version', '1.0.7rc1', f'^mdp-greenhouse 1.0.7rc1 {TOO_OLD}'),
        ('importlib.metadata.version', 'not a version', f'^mdp-greenhouse not a version {TOO_OLD}'),
        ('importlib.metadata.version', PackageNotFoundError(), 'is not installed: pip install --upgrade'),
        ('importlib.import_module', ImportError('no yaml'), r'be imported \(no yaml\): sudo apt install'),
        (f'{simulation.__name__}.shipped_file', None, r'lacks its file tag_locations\.json: pip install'),
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


def test_a_bridge_that_needs_a_discovery_server_says_so(bridge_here, monkeypatch):
    load = bridge_node.simulation.load

    def load_later(*arguments, **keywords):  # after ROS, which would keep the variable for the whole process
        monkeypatch.setenv('ROS_DISCOVERY_SERVER', '127.0.0.1:11811')
        return load(*arguments, **keywords)

    monkeypatch.setattr(bridge_node.simulation, 'load', load_later)
    log = bridge_here().err
    assert 'only while the discovery server runs: ROS_DOMAIN_ID=' in log
    assert 'ROS_DISCOVERY_SERVER=127.0.0.1:11811' in log
