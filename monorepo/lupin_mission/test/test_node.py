"""The real mission node over real services, between processes."""

import signal

import pytest
import rclpy
from conftest import PATIENCE_SECONDS, bridge
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
    return bridge.call(client, Trigger.Request())


@pytest.fixture
def start_bridge(stack):
    """Return a function that starts the real bridge; its service is REAL, whichever process serves it."""
    command = [str(bridge.EXECUTABLES / 'bridge_node'), '--ros-args', '-r', f'~/get_tag_reading:={REAL}']
    return lambda: bridge.NodeProcess(stack, command, {}, {})


def test_every_tag_of_the_greenhouse_is_read_from_the_real_bridge(start_mission, start_bridge, shipped_tags):
    start_bridge()
    mission = start_mission(bridge_service_name=REAL)
    assert mission.end() == 0
    assert mission.outcomes() == [(tag_id, OK) for tag_id in shipped_tags]
    assert mission.log[-1] == f'{len(shipped_tags)}/{len(shipped_tags)} tags read'


def test_a_bridge_that_starts_after_the_mission_is_waited_for(start_mission, start_bridge):
    mission = start_mission(bridge_service_name=REAL, tag_ids='1', request_timeout_seconds=PATIENCE_SECONDS)
    mission.wait_for_log('1 tags to visit')
    start_bridge()
    assert mission.end() == 0
    assert mission.outcomes() == [('1', OK)]


def test_a_bridge_killed_and_started_again_costs_no_reading(start_mission, start_bridge, shipped_tags):
    first = start_bridge()
    mission = start_mission(
        bridge_service_name=REAL, dwell_seconds=0.1, request_timeout_seconds=1, max_attempts=10
    )
    mission.wait_for_log("tag '9': ")
    first.process.kill()
    start_bridge()
    assert mission.end() == 0
    assert mission.outcomes() == [(tag_id, OK) for tag_id in shipped_tags]


def test_a_mission_that_is_killed_goes_on_where_it_was(start_mission, start_bridge, shipped_tags):
    start_bridge()
    mission = start_mission(bridge_service_name=REAL, dwell_seconds=0.1)
    mission.wait_for_log("tag '9': ")
    mission.process.kill()
    mission.process.wait()
    again = start_mission(bridge_service_name=REAL)
    assert again.end() == 0
    assert again.outcomes() == [(tag_id, OK) for tag_id in shipped_tags]


def test_a_bridge_that_never_comes_fails_every_scan_and_ends_the_mission(start_mission):
    mission = start_mission(bridge_service_name=REAL, tag_ids='1 2', request_timeout_seconds=0.1)
    assert mission.end() == 1
    assert mission.outcomes() == [('1', Outcome.NO_SERVICE), ('2', Outcome.NO_SERVICE)]


def test_the_answers_of_the_bridge_become_outcomes(start_mission, reader):
    mission = start_mission(**READER, tag_ids='1 2 3 4', max_attempts=1)
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
    mission.wait_for_log('did not answer in time')
    reader.answer_ok('1', co2=1.0)  # of the first attempt, which is over
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
    with bridge.spinning_node('operator') as operator:  # the other node is busy withholding
        assert trigger(operator, mission, 'pause').success
        assert trigger(operator, mission, 'resume').success
    reader.answer_ok('1', co2=1.0)
    assert mission.end() == 0


def test_the_executor_is_never_blocked_while_a_reply_is_withheld(reader, tmp_path, stack):
    parameters = {
        'bridge_service_name': reader.name,
        'tag_ids': '"1"',
        'request_timeout_seconds': PATIENCE_SECONDS,
        'report_file': f'"{tmp_path / "report.jsonl"}"',
    }
    rclpy.init(
        args=['--ros-args', *(w for item in parameters.items() for w in ('-p', '{}:={}'.format(*item)))]
    )
    stack.callback(rclpy.shutdown)
    node = mission_node.MissionNode()
    stack.callback(node.destroy_node)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    ticks = []
    node.create_timer(0.01, lambda: ticks.append(len(reader.tag_ids)))
    while ticks.count(1) < 50:  # ticks after the request has come, and before it is answered
        executor.spin_once(timeout_sec=PATIENCE_SECONDS)
    assert node.mission.state is State.INSPECTING
    reader.answer_ok('1', co2=1.0)
    while node.mission.state is not State.DONE:
        executor.spin_once(timeout_sec=PATIENCE_SECONDS)
    assert node.mission.outcomes == {'1': OK}


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=['Ctrl-C', 'SIGTERM'])
def test_a_signal_ends_the_mission_with_the_table_so_far(start_mission, reader, number):
    mission = start_mission(**READER, tag_ids='1 2', request_timeout_seconds=PATIENCE_SECONDS)
    reader.answer_ok('1', co2=1.0)
    mission.wait_for_log("tag '1': co2")
    assert mission.stop(number) == 1
    assert mission.rest_of_log()[-1] == '1/2 tags read'
    assert 'Traceback' not in '\n'.join(mission.log)
    reader.answer_ok('2', co2=1.0)  # lets go of the request that may still wait


@pytest.mark.parametrize(
    ('name', 'value', 'fragment'),
    [
        ('tag_ids', '1 2 1', "names '1' twice"),
        ('max_attempts', 0, 'whole number from 1 up'),
        ('max_attempts', 1.5, 'not a whole number'),
        ('request_timeout_seconds', 0, 'give seconds above 0'),
        ('request_timeout_seconds', '.inf', 'give seconds above 0'),
        ('dwell_seconds', -1, 'give seconds, 0 or more'),
        ('dwell_seconds', 'long', 'not a number'),
        ('require_visual_confirmation', 1, 'not true or false'),
        ('bridge_service_name', 'no such name', 'is no service name'),
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
    assert len([line for line in mission.log if 'parameter tags is unknown, and ignored' in line]) == 1
