"""The mission's interface to the team's stack: observations, state, start, skip, abort."""

import itertools
import json
import re
import sys
from pathlib import Path

from builtin_interfaces.msg import Time
from lupin_greenhouse_bridge.testing.helpers import executable, wait_until
from lupin_mission.mission_orchestrator import MissionNode
from lupin_msgs.msg import MissionState, Observation, TagReading
from lupin_readings.reading_file import read_file
from lupin_readings.report_line import Outcome
from mission_helpers import CAMERA, HOUR, READER, REAL, TWIN_QOS, WEB_QOS, Subscriber, publish
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Bool, String

READINGS = 'mission/readings'


def received_tags(subscriber) -> list[str]:
    return [each.tag_reading.tag_id for each in subscriber.received]


def test_a_twin_that_joins_in_the_middle_has_every_tag_at_the_end(
    start_mission, reader, twin, node, shipped_tags
):
    """The mission stands at its third tag until the twin has joined, and exits after its last."""
    mission = start_mission(**READER, tag_sequence='9 7 1 29')
    reader.answer_ok('9', co2=9.0)
    reader.answer_ok('7', co2=7.0, temperature=20.5)
    assert [reader.wait_for_request() for _ in range(3)] == ['9', '7', '1']
    late, readings = twin(), Subscriber(node, TagReading, f'{mission.namespace}/{READINGS}', TWIN_QOS)
    wait_until(lambda: received_tags(late) == ['9', '7'] and len(readings.received) == 2)
    reader.answer_ok('1')
    reader.answer(status=1, error_message='tag 29: who?')
    assert mission.end() == 1
    wait_until(lambda: len(late.received) == 4 and len(readings.received) == 3)
    *written, _ = mission.observations()
    *read, unread = late.received
    assert [each.tag_reading for each in read] == readings.received
    assert [each.tag_id for each in readings.received] == [each.tag_id for each in written] == ['9', '7', '1']
    for received, observation in zip(read, written, strict=True):
        assert (received.kind, received.status) == (Observation.KIND_TAG_READING, Observation.STATUS_OK)
        assert received.status_detail == 'simulated drive'
        assert {each.name: each.value for each in received.tag_reading.readings} == observation.reading.values
        assert received.tag_reading.sim_time_of_day_seconds == 12 * 3600.0
        place, pose = shipped_tags[observation.tag_id], received.tag_pose_in_map
        assert (pose.position.x, pose.position.y, pose.orientation.w) == (place['x'], place['y'], 1.0)
    assert (unread.status, unread.tag_reading) == (Observation.STATUS_SCAN_FAILED, TagReading())
    # Named once, though the reply names it too.
    assert unread.status_detail == 'tag 29: UNKNOWN_TAG: who? (simulated drive)'
    for pose in (unread.tag_pose_in_map, unread.flower.pose.pose, unread.anomaly.pose.pose):
        assert (pose.position.x, pose.orientation.w) == (0.0, 0.0)  # never populated
    assert len({each.mission_id for each in late.received}) == 1
    assert {each.source for each in late.received} == {'InspectionMission'}
    assert all(each.header.frame_id == 'map' and each.header.stamp.sec > 0 for each in late.received)


def test_a_web_client_receives_every_state_that_lasts(start_waiting_mission, reader, confirmer, states_of):
    mission, operator = start_waiting_mission(**CAMERA, tag_sequence='1', flower_scan_dwell_s=HOUR)
    started = operator.start()
    confirmer.wait_for_request()
    web = states_of(mission)
    state = web.wait_for()  # joins in the middle, and receives the next one
    assert (state.lifecycle_state, state.mission_phase) == ('INSPECTING', 'CONFIRMING')
    assert (state.mission_id, state.mission_type) == (started, 'InspectionMission')
    assert (state.current_target, state.targets_total, state.battery_percentage) == ('1', 1, 1.0)
    assert state.started_at.sec > 0
    assert (state.targets_completed, state.last_event_severity) == (0, MissionState.SEVERITY_INFO)

    def has_two_within_a_second():
        stamps = [each.header.stamp.sec + each.header.stamp.nanosec / 1e9 for each in web.received]
        return any(after - before < 1.0 for before, after in itertools.pairwise(stamps))

    wait_until(has_two_within_a_second)  # though nothing changes
    confirmer.answer(detected=False, error_message='no tag in view')
    event = "tag '1': NOT_CONFIRMED, trying again: no tag in view (simulated drive)"
    state = operator.wait_for(last_event=event)
    assert (state.last_event_severity, state.mission_phase) == (MissionState.SEVERITY_WARN, 'CONFIRMING')
    confirmer.answer(detected=True, detection_confidence=1.0)
    reader.wait_for_request()
    operator.wait_for(mission_phase='SCANNING', current_target='1')
    reader.answer_ok('1')
    operator.wait_for(
        mission_phase='SCANNING', targets_completed=1, last_event="tag '1': co2 1 (simulated drive)"
    )
    assert operator.trigger('pause')
    assert not operator.trigger('pause')
    operator.wait_for(paused=True, mission_phase='SCANNING', current_target='1')
    assert operator.trigger('resume')
    assert operator.trigger('skip_current')  # the rest of the dwell
    state = web.wait_for(lambda state: state.lifecycle_state == 'DONE')
    assert (state.targets_completed, state.mission_phase, state.current_target) == (1, '', '')
    assert mission.stop() == 0


def test_abort_and_skip_over_ros(start_waiting_mission, confirmer, twin):
    """Both arrive while the mission waits for the camera."""
    subscriber = twin()
    mission, operator = start_waiting_mission(**CAMERA, tag_sequence='1 2 3')
    started = operator.start()
    assert confirmer.wait_for_request() == '1'
    assert operator.trigger('skip_current')
    confirmer.answer(detected=True, detection_confidence=1.0)  # too late for 1
    assert confirmer.wait_for_request() == '2'
    assert operator.trigger('abort')
    confirmer.answer(detected=True, detection_confidence=1.0)
    wait_until(lambda: len(subscriber.received) == 3)
    assert {each.status for each in subscriber.received} == {Observation.STATUS_SKIPPED}
    assert [each.status_detail for each in subscriber.received] == [
        'tag 1: SKIPPED: skipped (simulated drive)',
        'tag 2: SKIPPED: aborted (simulated drive)',
        'tag 3: SKIPPED: aborted (simulated drive)',
    ]
    state = operator.wait_for(lifecycle_state='DONE')
    assert (state.targets_skipped, state.targets_failed, state.targets_completed) == (3, 0, 0)
    assert not operator.trigger('abort')
    assert mission.stop() == 1
    assert mission.outcomes(started) == [(tag_id, Outcome.SKIPPED) for tag_id in '123']


def test_a_start_that_cannot_be_is_rejected_with_the_reason(start_waiting_mission, reader, tmp_path):
    """Without a sequence, it takes all tags that have a sensor, in numeric order."""
    tag = {'x': 1.0, 'y': 2.0, 'sensors': ['co2']}
    tags = {**dict.fromkeys(['b', '10', '9', 'a'], tag), 'bare': {**tag, 'sensors': []}}
    (tmp_path / 'tags.json').write_text(json.dumps({'tags': tags}), encoding='utf-8')
    files = {'tag_locations_file': tmp_path / 'tags.json', 'report_file': tmp_path / 'reports/report.jsonl'}
    _, operator = start_waiting_mission(**READER, **files)
    assert f"make the folder '{tmp_path}/reports'" in operator.rejection()
    (tmp_path / 'reports').mkdir()
    for rejected, reason in (
        (
            {'mission_type': 'ExplorationMission'},
            "mission_type is 'ExplorationMission': must be InspectionMission or empty",
        ),
        ({'tag_sequence': ['9', '99']}, "tag '99' is unknown: must be one of the 4 tags of the greenhouse"),
        ({'tag_sequence': ['9', '9']}, 'tag_sequence names a tag twice: a mission visits a tag once'),
    ):
        assert operator.rejection(**rejected) == reason
        state = operator.wait_for(last_event=f'start rejected: {reason} (simulated drive)')
        assert (state.lifecycle_state, state.last_event_severity) == ('READY', MissionState.SEVERITY_WARN)
    first = operator.start(tag_sequence=['a'])
    assert reader.wait_for_request() == 'a'
    assert operator.rejection() == f'mission already running: abort {first}, or wait for its end'
    assert operator.dock() == (False, 'there is no dock: set dock_pose')
    visited = ['a', '9', '10', 'a', 'b']
    reader.answer_ok(*visited)
    operator.wait_for(lifecycle_state='DONE', mission_id=first, targets_completed=1)
    second = operator.start()
    operator.wait_for(lifecycle_state='DONE', mission_id=second, targets_completed=4)
    assert reader.tag_ids == visited


def test_a_start_names_a_tag_of_the_bridge_once_it_has_replied(
    start_waiting_mission, bridge_parameters, reader
):
    _, operator = start_waiting_mission(**READER, tag_sequence='1')
    assert operator.rejection(tag_sequence=['3']) == 'the tags are not known yet: start the bridge'
    bridge_parameters.answer_tags('1', '3')
    while operator._call('start', tag_sequence=['3']).accepted is False:
        operator.states.wait_for()
    reader.answer_ok('3')
    operator.wait_for(lifecycle_state='DONE', targets_completed=1)


def test_every_tag_of_the_bridge_is_read_on_a_machine_without_the_simulator_and_recorded_later(
    start_waiting_mission, start_bridge, start_node, monkeypatch, twin, shipped_tags, tmp_path
):
    """The twin and the recorder start after the mission, and receive what was latched."""
    service_name, tag_ids = start_bridge(debug_time_of_day=12.0).service_name, sorted(shipped_tags, key=int)
    monkeypatch.setitem(sys.modules, 'greenhouse_sim', None)  # as if it was not installed
    mission, operator = start_waiting_mission(**REAL, bridge_service_name=service_name)
    state = operator.wait_for(lifecycle_state='READY')
    assert (state.mission_id, state.mission_type, state.targets_total) == ('', '', 0)
    started = operator.start(mission_type='InspectionMission')
    done = operator.wait_for(lifecycle_state='DONE', mission_id=started)
    assert done.targets_completed == len(tag_ids)
    late = twin()
    wait_until(lambda: received_tags(late) == tag_ids)
    monkeypatch.delitem(sys.modules, 'greenhouse_sim')  # whose layout tells where the tags are
    rows = read_file(tmp_path / f'report-{started}.jsonl').rows
    topic = f'{mission.namespace}/{READINGS}'
    recorder = start_node(
        [executable('lupin_readings', 'record_readings')],
        readings_topics=topic,
        file=tmp_path / 'readings.sqlite',
    )
    recorder.wait_for_log(f'{len(rows)} rows kept')
    assert recorder.stop() == 0
    kept = read_file(tmp_path / 'readings.sqlite').rows
    assert [row._replace(source='mission report') for row in kept] == rows
    assert all(row.source == topic and row.x_m is not None for row in kept)
    assert {row.sim_time_of_day_seconds for row in kept} == {12 * 3600.0}
    assert mission.stop() == 0
    assert mission.log[-1] == f'{len(tag_ids)}/{len(tag_ids)} tags read'
    assert {each.drive for each in mission.observations(started)} == {'simulated'}


def test_the_error_of_one_mission_is_not_that_of_the_next(start_waiting_mission, reader):
    mission, operator = start_waiting_mission(**READER, tag_sequence='"1 99"')
    reader.answer(status=1, error_message='who?')
    reader.answer_ok('1')
    for tag_id, error in (('99', "tag '99': scan failed after 1 requests: UNKNOWN_TAG: who?"), ('1', '')):
        started = operator.start(tag_sequence=[tag_id])
        assert operator.wait_for(lifecycle_state='DONE', mission_id=started).last_error == error
    mission.report_file.with_name(f'report-{started}.jsonl').unlink()
    assert mission.stop() == 4  # though the mission had read its tag


def test_the_estop_stops_a_mission_and_rejects_a_start(start_waiting_mission, node, reader):
    mission, operator = start_waiting_mission(**READER, tag_sequence='1', flower_scan_dwell_s=HOUR)
    estop = node.create_publisher(Bool, '/e_stop_state', 10)
    publish(estop, Bool(data=True))
    state = operator.wait_for(estop_engaged=True)
    assert (state.lifecycle_state, state.last_event) == ('READY', 'e-stop engaged (simulated drive)')
    assert operator.rejection() == 'the e-stop is engaged: release it first'
    estop.publish(Bool(data=False))
    operator.wait_for(estop_engaged=False)
    operator.start()
    reader.answer_ok('1')
    operator.wait_for(targets_completed=1)
    estop.publish(Bool(data=True))
    state = operator.wait_for(estop_engaged=True, paused=True)
    assert state.last_event == 'e-stop engaged (simulated drive)'  # not the pause that follows
    assert (state.lifecycle_state, state.mission_phase) == ('INSPECTING', 'SCANNING')
    assert state.last_error == 'estop_engaged'
    estop.publish(Bool(data=False))
    event = 'e-stop released: call mission/resume to go on'
    operator.wait_for(estop_engaged=False, paused=True, last_error=event)
    assert operator.trigger('resume')
    operator.wait_for(paused=False, last_error='')
    assert operator.trigger('skip_current')
    operator.wait_for(lifecycle_state='DONE')
    for is_engaged in (True, False):
        estop.publish(Bool(data=is_engaged))
        state = operator.wait_for(estop_engaged=is_engaged)
    assert (state.last_event, state.last_error) == ('e-stop released (simulated drive)', '')
    assert mission.stop() == 0


def test_the_robot_docks_and_goes_on(start_waiting_mission, clock, reader, node):
    docked = {'dock_pose': '[1.0, 0.5, 3.14]', 'drive_seconds': HOUR}
    mission, operator = start_waiting_mission(**READER, **docked, tag_sequence='1')
    at_tag = Subscriber(node, String, f'{mission.namespace}/mission/at_tag', TWIN_QOS)
    answers = [operator.dock()]
    operator.start()
    answers.append(operator.dock())
    state = operator.wait_for(lifecycle_state='RETURNING', paused=False, current_target='', mission_phase='')
    assert state.last_event == 'driving to the dock (simulated drive)'
    answers.append(operator.dock())
    clock.pass_seconds(HOUR)
    operator.wait_for(lifecycle_state='RETURNING', paused=True)
    answers.append(operator.dock())
    assert operator.trigger('resume')
    operator.wait_for(current_target='1', mission_phase='NAVIGATING')
    clock.pass_seconds(HOUR)
    reader.answer_ok('1')
    operator.wait_for(lifecycle_state='RETURNING', targets_completed=1)
    clock.pass_seconds(HOUR)
    operator.wait_for(lifecycle_state='DONE')
    answers.append(operator.dock())
    assert answers == [
        (True, 'no mission runs: nothing moves'),
        (True, 'heading to dock'),
        (False, 'already returning to dock'),
        (False, 'already returning to dock'),
        (False, 'cannot dock in state DONE'),
    ]
    assert [at_tag.wait_for().data for _ in range(3)] == ['', '1', '']
    assert mission.stop() == 0


def test_simulated_time_reaches_the_stamps_and_delays_nothing(start_waiting_mission, node, reader):
    mission, operator = start_waiting_mission(**READER, tag_sequence='1', use_sim_time=True)
    clock = node.create_publisher(ClockMessage, '/clock', 10)
    publish(clock, ClockMessage(clock=Time(sec=1234)))
    operator.states.wait_for(lambda state: state.header.stamp.sec == 1234)
    operator.start()
    reader.answer_ok('1')
    assert operator.wait_for(lifecycle_state='DONE').header.stamp.sec == 1234
    assert mission.stop() == 0


def test_a_start_is_rejected_while_another_mission_of_that_name_lives(start_waiting_mission, reader, node):
    mission, operator = start_waiting_mission(**READER, tag_sequence='1')
    other = node.create_publisher(MissionState, f'{mission.namespace}/mission/state', TWIN_QOS)
    event = 'another mission publishes mission/state: end it, or give one of them a namespace'
    wait_until(lambda: operator.rejection(mission_type='none') == event)  # once the graph has it
    assert operator.rejection() == event
    node.destroy_publisher(other)
    wait_until(lambda: operator.rejection(mission_type='none') != event)
    operator.start()
    reader.answer_ok('1')
    operator.wait_for(lifecycle_state='DONE')


def test_a_mission_can_wait_for_a_subscriber_of_its_readings(start_mission, reader, node, states_of):
    mission = start_mission(**READER, tag_sequence='1', wait_for_subscriber=True)
    # A mission that does not wait starts before it can publish this.
    states_of(mission).wait_for(lambda each: each.last_event == '1 tag known (simulated drive)')
    recorder = Subscriber(node, TagReading, f'{mission.namespace}/{READINGS}', WEB_QOS)
    reader.answer_ok('1')
    assert mission.end() == 0
    assert recorder.wait_for().tag_id == '1'


def test_a_mission_without_a_subscriber_starts_after_its_patience(start_mission, reader):
    mission = start_mission(**READER, tag_sequence='1', wait_for_subscriber=True, dependency_timeout_s=0.0)
    reader.answer_ok('1')
    assert mission.end() == 0
    assert mission.lines_with('mission/readings has no subscriber')


def test_every_topic_has_the_qos_of_its_page(run_nodes):
    page = Path(__file__).resolve().parent.parent / 'doc/interface.md'
    groups = re.findall(
        r'^\| (`/.*`) \| (.*) \| (.*) \| (.*) \| (\d+) \|$', page.read_text('utf-8'), re.MULTILINE
    )
    rows = [(topic, *qos) for topics, *qos in groups for topic in re.findall(r'[/\w]+', topics)]
    node, *_ = run_nodes(MissionNode)
    found = []
    for direction, ends in (('publishes', node.publishers), ('subscribes', node.subscriptions)):
        for each in ends:
            qos = each.qos_profile
            words = [policy.name.lower().replace('_', ' ') for policy in (qos.reliability, qos.durability)]
            found.append((each.topic_name, direction, *words, str(qos.depth)))
    own = [row for row in found if row[0] not in ('/parameter_events', '/rosout')]
    assert sorted(rows) == sorted(own)
