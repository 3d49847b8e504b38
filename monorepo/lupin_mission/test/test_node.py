"""The real mission node over real services, between processes."""

import json
import os
import sys

import pytest
import rclpy
from lupin_greenhouse_bridge.signalled import MOMENTS, SIGNALS, command
from lupin_greenhouse_bridge.testing import PATIENCE_SECONDS, call, spinning_node
from lupin_mission import mission_node
from lupin_mission.mission import State
from lupin_mission.report import Outcome, read_report
from lupin_msgs.srv import GetTagReading
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

READER = {'bridge_service_name': '/commanded/get_tag_reading'}
CAMERA = {**READER, 'confirm_service_name': '/commanded/confirm_tag', 'require_visual_confirmation': True}
OK = Outcome.OK
REAL = '/real/get_tag_reading'


def trigger(node, mission, name: str) -> Trigger.Response:
    client = node.create_client(Trigger, f'{mission.namespace}/mission/{name}')
    assert client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
    return call(client, Trigger.Request())


@pytest.fixture
def start_real(start_bridge):
    """Return a function that starts the real bridge with the service name REAL."""
    from lupin_greenhouse_bridge.testing import executable

    command = [executable('lupin_greenhouse_bridge', 'bridge_node'), '--ros-args']
    return lambda: start_bridge([*command, '-r', f'~/get_tag_reading:={REAL}'])


@pytest.fixture
def all_tags(shipped_tags):
    """Return the parameter with every tag: the bridge's parameters are not beside REAL."""
    return {'tag_ids': json.dumps(list(shipped_tags))}


def test_every_tag_that_the_bridge_has_loaded_is_read(start_mission, start_bridge, shipped_tags):
    bridge = start_bridge()
    mission = start_mission(bridge_service_name=bridge.service_name)
    assert mission.end() == 0
    assert mission.outcomes() == [(tag_id, OK) for tag_id in shipped_tags]
    assert mission.log[-1] == f'{len(shipped_tags)}/{len(shipped_tags)} tags read'


def test_the_tags_of_a_tag_file_are_visited_in_its_order(start_mission, reader, tmp_path):
    tag_file = tmp_path / 'tags.json'
    tag = {'x': 1.0, 'y': 2.0, 'sensors': ['co2']}
    tag_file.write_text(json.dumps({'tags': {'9': tag, '7': tag, '8': {**tag, 'sensors': []}}}))
    mission = start_mission(**READER, tag_file=f'"{tag_file}"')
    reader.answer_ok('9', co2=1.0)
    reader.answer_ok('7', co2=1.0)
    assert mission.end() == 0
    assert reader.tag_ids == ['9', '7']


def test_without_tags_and_without_a_bridge_the_mission_is_refused(start_mission):
    """After 30 s, which this test shortens."""
    alter = 'from lupin_mission import mission_node; mission_node.LONGEST_WAIT_FOR_TAGS_SECONDS = 0.1;'
    run = [sys.executable, '-c', f'{alter} import sys; sys.exit(mission_node.main())']
    mission = start_mission(run, bridge_service_name='/nobody/get_tag_reading')
    fatal = mission.refusal(exit_code=2)
    assert (
        '/nobody/get_parameters did not return the tags within 0.1 s: start the bridge, or set tag_ids'
        in fatal
    )


@pytest.fixture
def without_simulator(tmp_path):
    """Return the environment of a process that cannot import mdp-greenhouse."""
    (tmp_path / 'sitecustomize.py').write_text(
        'import sys\n'
        'class Without:\n'
        '    def __init__(self, finder):\n'
        '        self.finder = finder\n'
        '    def find_spec(self, name, *arguments):\n'
        "        is_hidden = name.split('.')[0] in ('greenhouse_sim', 'lupin_greenhouse_bridge')\n"
        '        return None if is_hidden else self.finder.find_spec(name, *arguments)\n'
        '    def __getattr__(self, name):\n'
        '        return getattr(self.finder, name)\n'
        'sys.meta_path[:] = map(Without, sys.meta_path)\n'
    )
    return {'PYTHONPATH': os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')])}


def test_the_mission_needs_neither_simulator_nor_bridge_on_its_machine(
    start_mission, reader, without_simulator
):
    mission = start_mission(**READER, tag_ids='1', environment=without_simulator)
    reader.answer_ok('1', co2=1.0)
    assert mission.end() == 0
    command = [sys.executable, '-c', 'import greenhouse_sim']  # shows that the check above can fail
    assert (
        "ModuleNotFoundError: No module named 'greenhouse_sim'"
        in start_mission(command, without_simulator).rest_of_log()
    )


def test_a_bridge_that_starts_after_the_mission_is_waited_for(start_mission, start_real):
    mission = start_mission(bridge_service_name=REAL, tag_ids='1', request_timeout_seconds=PATIENCE_SECONDS)
    mission.wait_for_log('1 tags to visit')
    start_real()
    assert mission.end() == 0
    assert mission.outcomes() == [('1', OK)]


def test_a_bridge_killed_and_started_again_costs_no_reading(
    start_mission, start_real, all_tags, shipped_tags
):
    first = start_real()
    mission = start_mission(
        bridge_service_name=REAL, dwell_seconds=0.1, request_timeout_seconds=1, max_attempts=10, **all_tags
    )
    mission.wait_for_log("tag '9': ")
    first.close()
    start_real()
    assert mission.end() == 0
    assert mission.outcomes() == [(tag_id, OK) for tag_id in shipped_tags]


def test_a_mission_that_is_killed_goes_on_where_it_was(start_mission, start_bridge, shipped_tags):
    service = {'bridge_service_name': start_bridge().service_name}
    mission = start_mission(**service, dwell_seconds=0.1)
    mission.wait_for_log("tag '9': ")
    mission.close()
    again = start_mission(**service)
    assert again.end() == 0
    assert again.outcomes() == [(tag_id, OK) for tag_id in shipped_tags]


def test_a_bridge_that_never_comes_fails_every_scan_and_ends_the_mission(start_mission):
    mission = start_mission(bridge_service_name=REAL, tag_ids='1 2', request_timeout_seconds=0.1)
    assert mission.end() == 1
    assert mission.outcomes() == [('1', Outcome.NO_SERVICE), ('2', Outcome.NO_SERVICE)]


def test_the_answers_of_the_bridge_become_outcomes(start_mission, reader):
    patient = {'request_timeout_seconds': PATIENCE_SECONDS}
    mission = start_mission(**READER, **patient, tag_ids='1 2 3 4', max_attempts=1)
    reader.answer(status=GetTagReading.Response.STATUS_UNKNOWN_TAG, error_message='who?')
    reader.answer(status=GetTagReading.Response.STATUS_SIMULATOR_ERROR, error_message='broken')
    reader.answer_ok('1', co2=600.0)
    reader.answer_ok('4')
    assert mission.end() == 1
    assert mission.outcomes() == [
        ('1', Outcome.UNKNOWN_TAG),
        ('2', Outcome.SIMULATOR_ERROR),
        ('3', Outcome.WRONG_TAG),
        ('4', Outcome.BAD_READING),
    ]
    assert 'who?' in '\n'.join(mission.log)


def test_a_late_answer_is_not_taken_for_the_next_ones(start_mission, reader):
    mission = start_mission(**READER, tag_ids='1', request_timeout_seconds=1, max_attempts=10)
    assert reader.wait_for_request() == '1'
    mission.wait_for_log('TIMEOUT read: no reply before the timeout: trying again')
    reader.answer_ok('1', co2=1.0)  # of the first attempt, after its timeout
    for value in range(2, 10):
        reader.answer_ok('1', co2=float(value))
    assert mission.end() == 0
    (observation,) = read_report(mission.report_file)
    assert observation.outcome is OK
    assert observation.reading.values['co2'] > 1.0


def test_a_tag_is_read_once_it_is_confirmed(start_mission, reader, confirmer):
    mission = start_mission(**CAMERA, tag_ids='7')
    assert confirmer.wait_for_request() == '7'
    confirmer.answer(detected=False, error_message='other tags in view: 8')
    assert confirmer.wait_for_request() == '7'
    assert reader.tag_ids == []
    confirmer.answer(detected=True, detection_confidence=1.0)
    reader.answer_ok('7', temperature=21.0)
    assert mission.end() == 0
    assert reader.tag_ids == ['7']


def test_a_pause_in_the_dwell_does_not_scan_the_tag_again(start_mission, reader, node):
    mission = start_mission(**READER, tag_ids='1 2', dwell_seconds=2)
    reader.answer_ok('1', co2=1.0)
    mission.wait_for_log("tag '1': co2")
    assert trigger(node, mission, 'pause').success
    assert not trigger(node, mission, 'pause').success
    assert trigger(node, mission, 'resume').success
    reader.answer_ok('2', co2=2.0)
    assert mission.end() == 0
    assert reader.tag_ids == ['1', '2']


def test_a_pause_is_answered_while_a_reply_is_withheld(start_mission, reader):
    mission = start_mission(**READER, tag_ids='1', request_timeout_seconds=PATIENCE_SECONDS)
    reader.wait_for_request()
    with spinning_node('operator') as operator:  # the other node is busy
        assert trigger(operator, mission, 'pause').success
        assert trigger(operator, mission, 'resume').success
    reader.answer_ok('1', co2=1.0)
    assert mission.end() == 0


def test_the_executor_is_never_blocked_while_a_reply_is_withheld(reader, tmp_path, request):
    parameters = {
        'bridge_service_name': reader.name,
        'tag_ids': '"1"',
        'request_timeout_seconds': PATIENCE_SECONDS,
        'report_file': f'"{tmp_path / "report.jsonl"}"',
    }
    rclpy.init(
        args=['--ros-args', *(w for item in parameters.items() for w in ('-p', '{}:={}'.format(*item)))]
    )
    request.addfinalizer(rclpy.shutdown)
    node = mission_node.MissionNode()
    request.addfinalizer(node.destroy_node)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    ticks = []
    node.create_timer(0.01, lambda: ticks.append(len(reader.tag_ids)))
    while ticks.count(1) < 50:  # ticks between the request and its reply
        executor.spin_once(timeout_sec=PATIENCE_SECONDS)
    assert node.mission.state is State.INSPECTING
    reader.answer_ok('1', co2=1.0)
    while node.mission.state is not State.DONE:
        executor.spin_once(timeout_sec=PATIENCE_SECONDS)
    assert node.mission.outcomes == {'1': OK}


@pytest.mark.parametrize('signals', SIGNALS.values(), ids=SIGNALS)
def test_a_signal_ends_the_mission_with_the_table_so_far(start_mission, reader, signals):
    mission = start_mission(**READER, tag_ids='1 2', request_timeout_seconds=PATIENCE_SECONDS)
    reader.answer_ok('1', co2=1.0)
    mission.wait_for_log("tag '1': co2")
    mission.send(*signals)
    assert mission.end() == 1
    assert mission.log[-1] == '1/2 tags read'
    reader.answer_ok('2', co2=1.0)  # releases a pending request


@pytest.mark.parametrize('moment', MOMENTS)
def test_a_signal_at_any_moment_ends_the_mission_with_a_table(start_mission, moment):
    """Even before the tags are known, and while the mission ends."""
    run = command('lupin_mission', 'mission_node', moment, SIGNALS['Ctrl-C twice'])
    mission = start_mission(run, bridge_service_name='/nobody/get_tag_reading')
    mission.wait_for_log('signalled in' if moment in MOMENTS[:7] else 'waiting for the tags of')
    mission.send(*SIGNALS['SIGTERM and Ctrl-C'])
    assert mission.end() == 1
    assert '0/0 tags read' in mission.log
    assert any(f'signalled in {moment}' in line for line in mission.log)


@pytest.mark.parametrize(
    ('name', 'value', 'fragment'),
    [
        ('tag_ids', '1 2 1', "names '1' twice"),
        ('max_attempts', 0, 'must be a whole number from 1 to 1000'),
        ('max_attempts', 1.5, 'must be a whole number'),
        ('request_timeout_seconds', 0, 'must be a number from 0.001 to 86400'),
        ('request_timeout_seconds', '.inf', 'must be a number from 0.001'),
        ('dwell_seconds', -1, 'must be a number from 0 to 86400'),
        ('dwell_seconds', 'long', 'must be a number'),
        ('require_visual_confirmation', 1, 'must be true or false'),
        ('bridge_service_name', 'no such name', 'is not a service name'),
        ('tag_file', '/missing/tags.json', '/missing/tags.json'),
        ('report_file', '/missing/report.jsonl', 'name a file that can be written'),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(start_mission, name, value, fragment):
    assert fragment in start_mission(**{name: value}).refusal(exit_code=2)


@pytest.mark.parametrize('ids', ['5 7', '5,7', '[5, 7]', '["5", "7"]'])
def test_tag_ids_may_be_text_or_an_array(start_mission, ids):
    mission = start_mission(tag_ids=ids, max_attempts=1, request_timeout_seconds=0.01)
    assert mission.end() == 1
    assert [tag_id for tag_id, _ in mission.outcomes()] == ['5', '7']


def test_one_whole_number_is_a_tag_id_too(start_mission):
    mission = start_mission(tag_ids=5, max_attempts=1, request_timeout_seconds=0.01)
    assert mission.end() == 1
    assert mission.outcomes() == [('5', Outcome.NO_SERVICE)]


def test_a_mistyped_parameter_is_named_and_changes_nothing(start_mission):
    mission = start_mission(tag_ids='1', tags='2', max_attempts=1, request_timeout_seconds=0.01)
    assert mission.end() == 1
    assert [tag_id for tag_id, _ in mission.outcomes()] == ['1']
    assert len([line for line in mission.log if 'parameter tags is unknown and ignored' in line]) == 1
