"""The real mission node over real services. A process is started only where a process is what is proved."""

import errno
import os

import pytest
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.runtime.rclpy_internals import pending_requests
from lupin_greenhouse_bridge.testing.commands import SIGNALS
from lupin_greenhouse_bridge.testing.helpers import executable, has_found_a_client, wait_until
from lupin_mission import mission_orchestrator, tags, transport
from lupin_mission.settings import Settings
from lupin_mission.transport import Transport
from lupin_mission.visit import Request, Service
from lupin_msgs.msg import Observation, TagReading
from lupin_msgs.srv import GetTagReading
from lupin_readings.report_line import Outcome
from mission_helpers import CAMERA, HOUR, READER, REAL, observations_in
from rcl_interfaces.msg import ParameterValue

OK = Outcome.OK
MISSION = [executable('lupin_mission', 'mission_orchestrator')]


def test_without_tags_and_without_a_bridge_the_mission_is_refused_after_30_s(
    start_mission, bridge_parameters, clock
):
    mission = start_mission(**READER)
    bridge_parameters.wait_for_request()
    clock.pass_seconds(29.9)
    for _ in range(3):  # it still asks
        bridge_parameters.wait_for_request()
    clock.pass_seconds(0.1)
    reason = '/held/get_parameters did not return the tags within 30 s'
    assert f'{reason}: start the bridge, or set tag_sequence or tag_locations_file' in mission.refusal(
        exit_code=2
    )


def test_a_mission_that_waits_for_its_start_waits_for_its_bridge_too(
    start_waiting_mission, bridge_parameters, clock
):
    mission, operator = start_waiting_mission(**READER)
    bridge_parameters.wait_for_request()
    clock.pass_seconds(HOUR)
    for _ in range(2):  # it still asks
        bridge_parameters.wait_for_request()
    assert operator.wait_for().lifecycle_state == 'BOOT'
    assert operator.rejection() == 'the tags are not known yet: start the bridge'
    bridge_parameters.answer()  # to the first request
    bridge_parameters.answer_tags('7')
    operator.wait_for(lifecycle_state='READY')
    assert mission.stop() == 0
    assert len(mission.lines_with('waiting for the list of tags')) == 1
    assert not mission.lines_with('tags read')


def test_without_a_shipped_file_a_node_that_does_not_tell_its_tags_is_asked_again(
    start_mission, bridge_parameters, reader, monkeypatch
):
    """Tags that it then tells twice start one mission; an empty array is no tag and no dock."""
    monkeypatch.setattr(tags, 'shipped_file', lambda _name: None)
    mission = start_mission(**READER, tag_sequence='[]', dock_pose='[]')
    for _ in range(3):
        bridge_parameters.wait_for_request()
    bridge_parameters.answer()
    for _ in range(2):
        bridge_parameters.answer_tags('5', '7')
    reader.answer_ok('5', '7')
    assert mission.end() == 0
    assert len(mission.lines_with('2 tags to visit')) == 1
    assert reader.tag_ids == ['5', '7']


def test_a_bridge_that_does_not_tell_its_tags_is_asked_for_the_shipped_ones(
    start_mission, bridge_parameters, reader, shipped_tags
):
    tag_ids = sorted(shipped_tags, key=int)
    bridge_parameters.answer(values=[ParameterValue()] * 2)
    reader.answer_ok(*tag_ids)
    mission = start_mission(**READER)
    assert mission.end() == 0
    assert reader.tag_ids == tag_ids
    reason = 'the node of /held/get_tag_reading does not list its tags: using those of '
    assert len(mission.lines_with(reason)) == 1


def test_a_service_without_the_parameters_of_a_bridge_is_asked_for_the_shipped_tags_after_5_s(
    start_mission, reader, shipped_tags, clock, node, states_of
):
    """As in the team's tests, whose node is not named as the prefix of its service."""
    tag_ids = sorted(shipped_tags, key=int)
    reader.answer_ok(*tag_ids)
    mission = start_mission(**READER)
    states = states_of(mission)
    wait_until(lambda: has_found_a_client(node, reader.name))
    clock.pass_seconds(4.9)
    for _ in range(3):  # the mission looks more often
        assert states.wait_for().lifecycle_state == 'BOOT'
    clock.pass_seconds(5.0)  # since its first look
    assert mission.end() == 0
    assert reader.tag_ids == tag_ids
    (warning,) = mission.warnings()
    assert 'no node offers /held/get_parameters: using those of ' in warning


def test_a_bridge_killed_and_started_again_costs_no_reading(start_waiting_mission, start_bridge):
    bridge_node = executable('lupin_greenhouse_bridge', 'bridge_node')
    run = [bridge_node, '--ros-args', '-r', '~/get_tag_reading:=/real/get_tag_reading']
    first = start_bridge(run)
    mission, operator = start_waiting_mission(
        **REAL,
        bridge_service_name='/real/get_tag_reading',
        tag_sequence='1 2',
        flower_scan_dwell_s=HOUR,
    )
    started = operator.start()
    operator.wait_for(targets_completed=1, current_target='1')
    first.close()
    assert operator.trigger('skip_current')
    operator.states.wait_for(lambda state: 'trying again' in state.last_event)  # at tag 2
    start_bridge(run)
    operator.wait_for(targets_completed=2, current_target='2')
    assert operator.trigger('skip_current')
    assert mission.stop() == 0
    assert mission.outcomes(started) == [('1', OK), ('2', OK)]


def test_a_report_is_continued_with_the_tags_that_were_not_read(
    start_node, settings, start_mission, reader, held_service
):
    """After a kill and after failed readings alike."""
    killed = start_node(MISSION, **settings, **READER, tag_sequence='1 2 3')
    reader.answer_ok('1')
    assert [reader.wait_for_request(), reader.wait_for_request()] == ['1', '2']
    killed.close()
    other_reader = held_service(GetTagReading, '/other/get_tag_reading')
    other_reader.answer(status=1)
    other_reader.answer_ok('3', '2')
    for tags_left, exit_code in ((2, 1), (1, 0), (0, 0)):
        mission = start_mission(bridge_service_name=other_reader.name, tag_sequence='1 2 3')
        assert mission.end() == exit_code
        to_visit = pluralized(tags_left, 'tag')
        assert mission.lines_with(
            f'{to_visit} to visit, {3 - tags_left} read before; report: {mission.report_file}'
        )
    assert [tag_id for tag_id, outcome in mission.outcomes() if outcome is OK] == ['1', '3', '2']
    assert other_reader.tag_ids == ['2', '3', '2']


def test_a_report_without_a_name_lies_in_the_current_folder(start_mission, reader, tmp_path, monkeypatch):
    """In a folder that cannot be written there is none, with a warning."""
    reader.answer_ok('1', '1')
    for folder in (tmp_path, '/proc'):
        monkeypatch.chdir(folder)
        mission = start_mission(**READER, tag_sequence='1', report_file="''")
        assert mission.end() == 0
        assert mission.log[-1] == '1/1 tags read'
        unwritten = mission.lines_with('the mission writes no report: ')
        assert (mission.warnings(), len(unwritten)) == (unwritten, folder == '/proc')
    (report,) = tmp_path.glob('mission-*T*.jsonl')
    assert [each.tag_id for each in observations_in(report)] == ['1']


def test_a_bridge_that_never_comes_fails_every_scan_and_ends_the_mission(start_mission):
    service = {'bridge_service_name': '/nobody/get_tag_reading', 'scan_timeout_s': 0.01}
    mission = start_mission(**service, tag_sequence='[5, 7]', max_attempts=2)
    assert mission.end() == 1
    assert mission.outcomes() == [('5', Outcome.NO_SERVICE), ('7', Outcome.NO_SERVICE)]
    assert {each.attempts for each in mission.observations()} == {2}
    assert len(mission.lines_with('/nobody/get_tag_reading is not found on domain ')) == 1


def test_the_answers_of_the_bridge_become_outcomes(start_mission, reader, monkeypatch):
    """Two servers of the service are named once; tests of the bridge's package hold how they are found."""
    monkeypatch.setattr(transport, 'duplicate_server_warning', lambda _node, name: f'{name} has two servers')
    mission = start_mission(**READER, tag_sequence='1 2 3 4 5', max_attempts=1)
    reader.answer(status=GetTagReading.Response.STATUS_UNKNOWN_TAG, error_message='who?')
    reader.answer(status=GetTagReading.Response.STATUS_SIMULATOR_ERROR, error_message='broken')
    reader.answer_ok('1')  # another tag
    reader.answer(reading=TagReading(tag_id='4'))
    reader.answer(status=77, error_message='from the future')
    assert mission.end() == 1
    assert mission.outcomes() == [
        ('1', Outcome.UNKNOWN_TAG),
        ('2', Outcome.SIMULATOR_ERROR),
        ('3', Outcome.BAD_READING),
        ('4', Outcome.BAD_READING),
        ('5', Outcome.BAD_READING),
    ]
    assert mission.lines_with('who?')
    assert len(mission.lines_with('/held/get_tag_reading has two servers')) == 1
    assert mission.log[-1] == '0/5 tags read'


def test_a_number_is_an_id_and_the_log_says_which(start_mission, reader):
    """ROS reads 010 as an octal number."""
    mission = start_mission(**READER, tag_sequence='010')
    reader.answer_ok('8')
    assert mission.end() == 0
    assert reader.tag_ids == ['8']
    assert mission.lines_with('tag_sequence: tag 8')


def test_a_mission_without_a_failure_logs_no_warning(start_mission, reader, confirmer, monkeypatch):
    """The arguments of the team that have no effect are named in one line."""
    monkeypatch.setattr(tags, 'LONGEST_WITHOUT_PARAMETERS_SECONDS', HOUR)
    of_other_missions = (
        'battery_low_threshold battery_topic discovered_tags_topic frontier_free_thresh'
        ' frontier_min_cluster_cells frontier_occupied_thresh frontier_robot_radius_cells'
        ' monitoring_sweeps seed_climate_on_discovery'
    )
    unused = {'discovery_goal': 5, 'map_yaml_path': '/map.yaml'}
    unused |= dict.fromkeys(of_other_missions.split(), '0.5')
    mission = start_mission(**CAMERA, tag_sequence='1 2', **unused)
    for _ in range(2):
        confirmer.answer(detected=True)
    reader.answer_ok('1', '2')
    assert mission.end() == 0
    assert mission.warnings() == []
    (line,) = mission.lines_with('without effect')
    assert line.endswith('without effect in this node: ' + ', '.join(sorted(unused)))


def test_a_request_that_waits_for_its_service_is_not_sent_in_a_pause(
    start_waiting_mission, held_service, node
):
    mission, operator = start_waiting_mission(**READER, tag_sequence='1')
    operator.start()
    assert operator.trigger('pause')
    reader = held_service(GetTagReading, READER['bridge_service_name'])
    wait_until(lambda: has_found_a_client(node, reader.name))
    operator.states.wait_for_steps()
    assert reader.tag_ids == []
    assert operator.trigger('resume')
    reader.answer_ok('1')
    operator.wait_for(lifecycle_state='DONE', targets_completed=1)
    assert mission.stop() == 0


@pytest.mark.usefixtures('reader')
def test_a_request_that_is_given_up_is_not_kept(node):
    transport = Transport(node, Settings(drive='simulated', **READER))
    wait_until(lambda: transport.is_available(Service.READ))
    request = Request(Service.READ, '1', 0.0)
    transport.send(request, lambda _response: None)
    client = transport._clients[Service.READ]
    assert len(pending_requests(client)) == 1
    assert transport.abandon(request) is Outcome.TIMEOUT
    assert not pending_requests(client)  # rclpy would keep it for ever
    assert client.qos_profile == SERVICE_QOS  # it keeps as many replies to others as the bridge sends


def test_an_error_in_the_middle_of_the_start_is_one_line(start_mission, monkeypatch):
    def fail(*_arguments, **_keywords):
        raise ValueError('the pose is odd')

    monkeypatch.setattr(mission_orchestrator, 'TagPositions', fail)
    assert 'the node cannot start: ValueError: the pose is odd' in start_mission().refusal(exit_code=2)


@pytest.mark.parametrize(
    ('tag_ids', 'reason', 'statuses'),
    [
        ('1 2', 'was deleted or replaced: start the mission again', 'OK OK'),
        ('1 2 3', 'No space left on device', 'OK OK SKIPPED'),
    ],
)
def test_a_report_that_is_lost_ends_the_mission_with_its_table(
    start_mission, reader, twin, monkeypatch, tag_ids, reason, statuses
):
    def fail(_file):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    subscriber = twin()
    mission = start_mission(**READER, tag_sequence=tag_ids)
    reader.answer_ok('1')
    assert [reader.wait_for_request(), reader.wait_for_request()] == ['1', '2']
    if 'deleted' in reason:
        mission.report_file.unlink()
    else:
        monkeypatch.setattr(os, 'fsync', fail)
    reader.answer_ok('2')
    assert reason in mission.refusal(exit_code=4)
    assert mission.log[-1].endswith(f'/{len(tag_ids.split())} tags read')
    assert reader.tag_ids == ['1', '2']
    expected = [getattr(Observation, f'STATUS_{each}') for each in statuses.split()]
    wait_until(lambda: [each.status for each in subscriber.received] == expected)
    # An observation counts only once it is on the disk.
    assert mission.outcomes() == ([('1', OK)] if mission.report_file.exists() else [])


@pytest.mark.parametrize('is_reset', [False, True])
def test_a_node_that_waits_for_its_start_survives_the_loss_of_a_report(
    start_waiting_mission, reader, is_reset
):
    mission, operator = start_waiting_mission(**READER, tag_sequence='1 2 3')
    started = operator.start()
    reader.answer_ok('1')
    assert [reader.wait_for_request(), reader.wait_for_request()] == ['1', '2']
    mission.report_file.with_name(f'report-{started}.jsonl').unlink()
    reader.answer_ok('2')
    state = operator.wait_for(lifecycle_state='FAULT', targets_completed=2, targets_skipped=1)
    assert 'was deleted or replaced: start the mission again' in state.last_error
    assert operator.dock() == (False, 'cannot dock in state FAULT')
    if is_reset:
        assert operator.trigger('reset')
        operator.wait_for(lifecycle_state='READY', last_error='', mission_id='')
        assert not operator.trigger('reset')
    started = operator.start()
    reader.answer_ok(*'123')
    operator.wait_for(lifecycle_state='DONE', last_error='', mission_id=started, targets_completed=3)
    assert mission.stop() == 0


def test_a_signal_closes_the_tags_left_and_ends_the_mission_with_the_table_so_far(
    start_node, settings, reader, twin, states_of, tmp_path
):
    subscriber = twin()
    mission = start_node(MISSION, **settings, **READER, tag_sequence='1 2')
    states = states_of(mission)
    reader.answer_ok('1')
    assert [reader.wait_for_request(), reader.wait_for_request()] == ['1', '2']
    mission.send(*SIGNALS['Ctrl-C twice'])
    assert mission.end() == 1
    assert mission.log[-1] == '1/2 tags read'
    assert not any("tag '2': SKIPPED" in line for line in mission.log)  # of many tags, the table tells enough
    subscriber.wait_for(lambda each: each.status_detail.startswith('tag 2: SKIPPED: the node was ended'))
    states.wait_for(lambda state: state.lifecycle_state == 'DONE' and state.targets_skipped == 1)
    assert [each.outcome for each in observations_in(tmp_path / 'report.jsonl')] == [OK, Outcome.SKIPPED]


def test_a_signal_before_the_tags_are_known_ends_the_mission_with_a_table(start_mission):
    mission = start_mission(bridge_service_name='/nobody/get_tag_reading')
    assert mission.stop() == 1
    assert mission.log[-1] == '0/0 tags read'


@pytest.mark.parametrize(
    ('name', 'value', 'fragment'),
    [
        ('max_attempts', 0, 'must be a whole number from 1 to 1000'),
        ('tag_locations_file', '/missing/tags.json', '/missing/tags.json'),
        ('report_file', '/usr', 'Is a directory: name a file that can be written'),
        ('world_file', '/missing.sdf', "world_file '/missing.sdf': cannot be read"),
        ('layout_in_map', '/none.yaml', "registration '/none.yaml': cannot be read"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(start_mission, name, value, fragment):
    assert fragment in start_mission(**{name: value}).refusal(exit_code=2)
