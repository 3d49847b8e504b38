"""The mission's interface to the team's stack: observations, state, start, skip, abort."""

import json
import queue

import pytest
from lupin_greenhouse_bridge.signalled import SIGNALS
from lupin_greenhouse_bridge.testing import PATIENCE_SECONDS, call, greet, spinning_node, wait_until
from lupin_mission.report import Outcome, read_report
from lupin_msgs.msg import MissionState, Observation, TagReading
from lupin_msgs.srv import StartMission
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

TOPIC = '/floranova/observations'
TWIN_QOS = QoSProfile(
    depth=50, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
WEB_QOS = QoSProfile(depth=10)  # a web client has no durability
READER = {'bridge_service_name': '/commanded/get_tag_reading'}


class Subscriber:
    """Subscribes to one topic, and keeps its messages."""

    def __init__(self, node, message_type, topic: str, qos):
        self.heard = []
        self._news = queue.SimpleQueue()
        node.create_subscription(message_type, topic, self._on_message, qos)

    def _on_message(self, message):
        self.heard.append(message)
        self._news.put(message)

    def wait_for(self, is_it):
        """Return the first new message that matches."""
        while True:
            message = self._news.get(timeout=PATIENCE_SECONDS)
            if is_it(message):
                return message


@pytest.fixture
def listener():
    """Return a node without services."""
    with spinning_node('listener') as listener:
        yield listener


@pytest.fixture
def twin(listener):
    """Return a function that subscribes like the digital twin."""
    return lambda: Subscriber(listener, Observation, TOPIC, TWIN_QOS)


@pytest.fixture
def web(listener):
    """Return a function that subscribes to the state of a mission like a web client."""
    return lambda mission: Subscriber(listener, MissionState, f'{mission.namespace}/mission/state', WEB_QOS)


def is_done(state, started) -> bool:
    return (state.lifecycle_state, state.mission_id) == ('DONE', started.mission_id)


def ask(node, mission, service_type, name, **fields):
    client = node.create_client(service_type, f'{mission.namespace}/mission/{name}')
    assert client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
    if service_type is StartMission:
        greet(client, StartMission.Request(mission_type='none'))  # is rejected, and changes nothing
    return call(client, service_type.Request(**fields))


def test_a_twin_that_joins_in_the_middle_has_heard_every_tag_at_the_end(
    start_mission, start_bridge, twin, shipped_tags
):
    bridge = start_bridge(debug_time_of_day=12.0)
    mission = start_mission(bridge_service_name=bridge.service_name, dwell_seconds=0.2)
    mission.wait_for_log("tag '9': ")
    late = twin()
    assert mission.end() == 0
    wait_until(lambda: len(late.heard) == len(shipped_tags))
    observations = read_report(mission.report_file)
    assert [each.tag_reading.tag_id for each in late.heard] == [each.tag_id for each in observations]
    for heard, written in zip(late.heard, observations, strict=True):
        assert (heard.kind, heard.status, heard.status_detail) == (0, Observation.STATUS_OK, '')
        assert heard.header.frame_id == 'map'
        assert heard.header.stamp.sec > 0
        assert {each.name: each.value for each in heard.tag_reading.readings} == written.reading.values
        assert heard.tag_reading.sim_time_of_day_seconds == 12 * 3600.0
        place, pose = shipped_tags[written.tag_id], heard.tag_pose_in_map
        assert (pose.position.x, pose.position.y, pose.orientation.w) == (place['x'], place['y'], 1.0)
    assert len({each.mission_id for each in late.heard}) == 1
    assert {each.source for each in late.heard} == {f'{mission.namespace}/mission'}


def test_a_tag_that_was_not_read_carries_its_id_its_reason_and_nothing_else(
    start_mission, reader, listener, twin
):
    hearer = twin()
    mission = start_mission(
        **READER,
        tag_ids='1',
        max_attempts=1,
        tag_poses_in_map='false',
        wait_for_start=True,
        request_timeout_seconds=PATIENCE_SECONDS,
    )
    assert ask(listener, mission, StartMission, 'start').accepted
    reader.answer(status=1, error_message='who?')
    heard = hearer.wait_for(lambda _observation: True)
    assert (heard.status, heard.status_detail) == (Observation.STATUS_SCAN_FAILED, 'UNKNOWN_TAG: who?')
    assert heard.tag_reading == TagReading(tag_id='1')
    for pose in (heard.tag_pose_in_map, heard.flower.pose.pose, heard.anomaly.pose.pose):
        assert (pose.position.x, pose.orientation.w) == (0.0, 0.0)  # never populated
    assert mission.stop() == 1


@pytest.mark.parametrize(
    ('parameters', 'has_pose'),
    [
        ({}, True),
        ({'tag_poses_in_map': False}, False),
        ({'tag_poses_in_map': 'false'}, False),
        ({'require_visual_confirmation': True}, False),
        ({'require_visual_confirmation': True, 'tag_poses_in_map': True}, True),
    ],
)
def test_poses_are_published_where_the_ids_are_trusted_or_as_told(
    start_mission, reader, confirmer, listener, twin, parameters, has_pose
):
    hearer = twin()
    mission = start_mission(
        **READER, confirm_service_name=confirmer.name, tag_ids='1', wait_for_start=True, **parameters
    )
    assert ask(listener, mission, StartMission, 'start').accepted
    confirmer.answer(detected=True, detection_confidence=1.0)
    reader.answer_ok('1', co2=1.0)
    heard = hearer.wait_for(lambda _observation: True)
    assert (heard.tag_pose_in_map.orientation.w == 1.0) == has_pose
    assert mission.stop() == 0


def test_the_shipped_places_are_not_those_of_a_bridge_with_its_own_tag_file(
    start_mission, start_bridge, node, twin, tmp_path
):
    tag_file = tmp_path / 'tags.json'
    tag_file.write_text(json.dumps({'1': {'x': 9.0, 'y': 9.5, 'sensors': ['co2']}}))
    service = {'bridge_service_name': start_bridge(tag_file=tag_file).service_name}
    hearer = twin()
    mission = start_mission(**service, wait_for_start=True)
    mission.wait_for_log("the positions of the tags are unknown: set tag_file to the bridge's")
    assert ask(node, mission, StartMission, 'start').accepted
    assert hearer.wait_for(lambda _observation: True).tag_pose_in_map.orientation.w == 0.0
    assert mission.stop() == 0
    mission = start_mission(**service, wait_for_start=True, tag_file=f'"{tag_file}"')
    assert ask(node, mission, StartMission, 'start').accepted
    position = hearer.wait_for(lambda _observation: True).tag_pose_in_map.position
    assert (position.x, position.y) == (9.0, 9.5)


def test_a_web_client_hears_the_state_within_a_second_at_any_time(start_mission, reader, confirmer, web):
    mission = start_mission(
        **READER, confirm_service_name=confirmer.name, require_visual_confirmation=True, tag_ids='1 2',
        request_timeout_seconds=PATIENCE_SECONDS, dwell_seconds=2,
    )  # fmt: skip
    confirmer.wait_for_request()
    state = web(mission).wait_for(lambda _state: True)  # joins in the middle, and receives the next one
    assert (state.lifecycle_state, state.mission_phase, state.current_target) == (
        'INSPECTING',
        'CONFIRMING',
        '1',
    )
    assert (state.mission_type, state.targets_total, state.battery_percentage) == (
        'InspectionMission',
        2,
        1.0,
    )
    assert state.mission_id
    assert state.started_at.sec > 0
    confirmer.answer(detected=True, detection_confidence=1.0)
    reader.wait_for_request()
    states = web(mission)
    assert states.wait_for(lambda state: state.mission_phase == 'SCANNING').current_target == '1'
    reader.answer_ok('1', co2=1.0)
    state = states.wait_for(lambda state: state.mission_phase == 'PUBLISHING')
    assert (state.targets_completed, state.last_event) == (1, "tag '1': co2 1.000")
    confirmer.answer(detected=False, error_message='no tag in view')
    state = states.wait_for(lambda state: state.last_event_severity == MissionState.SEVERITY_WARN)
    assert "tag '2': NOT_CONFIRMED no tag in view: trying again" in state.last_event
    confirmer.answer(detected=True, detection_confidence=1.0)
    reader.answer_ok('2', co2=1.0)
    assert states.wait_for(lambda state: state.lifecycle_state == 'DONE').targets_completed == 2
    assert mission.end() == 0


def test_abort_and_skip_over_ros(start_mission, confirmer, listener, twin):
    """Both arrive while the mission waits for the camera."""
    hearer = twin()
    mission = start_mission(
        **READER, confirm_service_name=confirmer.name, require_visual_confirmation=True, tag_ids='1 2 3',
        request_timeout_seconds=PATIENCE_SECONDS, wait_for_start=True,
    )  # fmt: skip
    started = ask(listener, mission, StartMission, 'start')
    confirmer.wait_for_request()
    assert ask(listener, mission, Trigger, 'skip_current').success
    confirmer.answer(detected=True, detection_confidence=1.0)  # too late for 1
    confirmer.wait_for_request()
    assert ask(listener, mission, Trigger, 'abort').success
    confirmer.answer(detected=True, detection_confidence=1.0)
    wait_until(lambda: len(hearer.heard) == 3)
    assert [each.tag_reading.tag_id for each in hearer.heard] == ['1', '2', '3']
    assert {each.status for each in hearer.heard} == {Observation.STATUS_SKIPPED}
    assert [each.status_detail for each in hearer.heard] == ['SKIPPED: skipped', *['SKIPPED: aborted'] * 2]
    assert mission.stop() == 1
    assert mission.log[-1] == '0/3 tags read'
    report = mission.report_file.with_name(f'report-{started.mission_id}.jsonl')
    assert [(each.tag_id, each.outcome) for each in read_report(report)] == [
        (tag_id, Outcome.SKIPPED) for tag_id in '123'
    ]


def test_a_mission_waits_for_its_start_and_lives_on_after_it(
    start_mission, start_bridge, node, web, twin, shipped_tags
):
    bridge = start_bridge()
    mission = start_mission(bridge_service_name=bridge.service_name, wait_for_start=True)
    states = web(mission)
    state = states.wait_for(lambda state: state.lifecycle_state == 'READY')
    assert (state.mission_id, state.mission_type, state.targets_total) == ('', '', 0)

    first = ask(node, mission, StartMission, 'start', tag_sequence=['7', '1'])
    assert (first.accepted, first.error_message) == (True, '')
    states.wait_for(lambda state: is_done(state, first))
    late = twin()  # after DONE, while the node keeps running
    wait_until(lambda: len(late.heard) == 2)
    assert [each.tag_reading.tag_id for each in late.heard] == ['7', '1']

    second = ask(node, mission, StartMission, 'start', mission_type='InspectionMission')
    assert second.accepted
    assert second.mission_id != first.mission_id
    done = states.wait_for(
        lambda state: state.lifecycle_state == 'DONE' and state.mission_id == second.mission_id
    )
    assert done.targets_completed == len(shipped_tags)
    wait_until(lambda: len(late.heard) == 2 + len(shipped_tags))
    visited = [each.tag_reading.tag_id for each in late.heard if each.mission_id == second.mission_id]
    assert visited == sorted(shipped_tags, key=int)

    mission.send(*SIGNALS['Ctrl-C'])
    assert mission.end() == 0
    for started, count in ((first, 2), (second, len(shipped_tags))):
        report = mission.report_file.with_name(f'report-{started.mission_id}.jsonl')
        assert len(read_report(report)) == count


def test_the_tags_and_their_places_come_from_the_world(
    start_mission, start_bridge, node, web, twin, tmp_path
):
    """The bridge does not know one of them: the world has another layout."""
    models = ''.join(
        f'<model name="tag_{tag_id}"><pose>{x} 8.5 0.3 0 0 0</pose></model>'
        for tag_id, x in (('400', 3.0), ('7', 2.5), ('1', 1.5))
    )
    world_file = tmp_path / 'greenhouse.sdf'
    world_file.write_text(f'<sdf version="1.6"><world name="w">{models}</world></sdf>')
    bridge = start_bridge()
    mission = start_mission(
        bridge_service_name=bridge.service_name, world_file=world_file, wait_for_start=True
    )
    states = web(mission)
    states.wait_for(lambda state: state.lifecycle_state == 'READY')
    late = twin()
    started = ask(node, mission, StartMission, 'start')
    states.wait_for(lambda state: is_done(state, started))
    wait_until(lambda: len(late.heard) == 3)
    assert [each.tag_reading.tag_id for each in late.heard] == ['1', '7', '400']
    assert [each.status for each in late.heard] == [
        Observation.STATUS_OK,
        Observation.STATUS_OK,
        Observation.STATUS_SCAN_FAILED,
    ]
    places = [each.tag_pose_in_map.position for each in late.heard]
    assert [(place.x, place.y) for place in places] == [(1.5, 8.5), (2.5, 8.5), (3.0, 8.5)]


def test_a_world_and_a_tag_file_at_once_are_refused(start_mission):
    refusal = start_mission(world_file='/a.sdf', tag_file='/b.json').refusal(2)
    assert 'parameters world_file and tag_file are both set: set one of them' in refusal


def test_a_world_that_cannot_be_read_is_refused_in_one_line(start_mission):
    assert "world_file '/missing.sdf' cannot be read" in start_mission(world_file='/missing.sdf').refusal(2)


def test_the_error_of_one_mission_is_not_that_of_the_next(start_mission, start_bridge, node, web):
    bridge = start_bridge()
    mission = start_mission(
        bridge_service_name=bridge.service_name,
        tag_ids='"1 99"',
        wait_for_start=True,
        max_attempts=1,
        request_timeout_seconds=PATIENCE_SECONDS,
    )
    states = web(mission)
    states.wait_for(lambda state: state.lifecycle_state == 'READY')
    for tag_id, error in (('99', "tag '99': scan failed after 1 requests: UNKNOWN_TAG"), ('1', '')):
        started = ask(node, mission, StartMission, 'start', tag_sequence=[tag_id])
        done = states.wait_for(lambda state, started=started: is_done(state, started))
        assert done.last_error[: len(error) or None] == error


@pytest.mark.parametrize(
    ('request_fields', 'reason'),
    [
        (
            {'mission_type': 'ExplorationMission'},
            "mission_type is 'ExplorationMission': must be InspectionMission",
        ),
        ({'tag_sequence': ['1', '99']}, "tag '99' is unknown: must be one of the 2 tags of the greenhouse"),
        ({'tag_sequence': ['1', '1']}, 'tag_sequence names a tag twice'),
    ],
)
def test_a_start_that_cannot_be_is_rejected_with_the_reason(start_mission, node, request_fields, reason):
    mission = start_mission(**READER, tag_ids='1 2', wait_for_start=True)
    response = ask(node, mission, StartMission, 'start', **request_fields)
    assert (response.accepted, response.mission_id) == (False, '')
    assert reason in response.error_message


def test_a_start_is_rejected_while_a_mission_runs_and_before_the_tags_are_known(
    start_mission, reader, listener
):
    patient = {'request_timeout_seconds': PATIENCE_SECONDS}
    mission = start_mission(**READER, tag_ids='1', wait_for_start=True, **patient)
    first = ask(listener, mission, StartMission, 'start')
    assert first.accepted
    reader.wait_for_request()
    again = ask(listener, mission, StartMission, 'start')
    assert again.error_message == f'mission {first.mission_id} is running: abort it, or wait for its end'
    reader.answer_ok('1', co2=1.0)
    ignorant = start_mission(bridge_service_name='/nobody/get_tag_reading', wait_for_start=True)
    assert ask(listener, ignorant, StartMission, 'start').error_message.startswith(
        'the tags are not known yet'
    )


def test_a_report_that_cannot_be_written_rejects_the_start(start_mission, node):
    mission = start_mission(**READER, tag_ids='1', wait_for_start=True, report_file='/missing/report.jsonl')
    assert 'name a file that can be written' in ask(node, mission, StartMission, 'start').error_message
    assert mission.stop() == 1


def test_a_mission_that_nobody_hears_ends_all_the_same(start_mission, reader):
    mission = start_mission(**READER, tag_ids='1')
    reader.answer_ok('1', co2=1.0)
    assert mission.end() == 0
