"""The real mission node with Nav2's action: what ends it stops the robot, and what fails is reported."""

import functools
import gc
import json
import math
import queue
import signal
import sys
import threading
from importlib.util import find_spec

import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import OneLineError
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS, wait_until
from lupin_mission import nav2_drive, planner, tags
from lupin_mission.announcer import Announcer
from lupin_mission.plan import Plan
from lupin_mission.settings import Settings
from lupin_msgs.msg import MissionState, Observation
from lupin_planning.registration import Transform
from lupin_readings.report_line import Outcome
from mission_helpers import CAMERA, HOUR, READER, localized, publish
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import Bool

# Not importorskip, which ends the import: launch_testing imports every test module.
pytestmark = pytest.mark.skipif(not find_spec('nav2_msgs'), reason='nav2_msgs is missing')
NAME = '/held/navigate_to_pose'
NAV2 = {**READER, 'drive': 'nav2', 'nav_action_name': NAME, 'max_poses': 1, 'map_topic': "''"}
WITH_MAP = {**NAV2, 'map_topic': '/held/map'}
# A plan of it takes a tenth of the time of the shipped one. A large robot does not get to tag 13, between the
# tables.
LAYOUT = Layout(
    {
        **{tag_id: Tag(x, 1.0, ['co2']) for tag_id, x in (('1', 0.5), ('2', 1.5), ('3', 2.5), ('29', 3.5))},
        '7': Tag(3.0, 1.0, ['co2']),
        '13': Tag(2.0, 1.5, ['co2']),
    },
    {'south': (0.0, 1.0, 4.0, 1.5), 'north': (0.0, 2.0, 4.0, 2.5)},
)


def write_layout(path, tags, tables):
    edges = {name: dict(zip(('x0', 'y0', 'x1', 'y1'), each, strict=True)) for name, each in tables.items()}
    document = {'tags': {tag_id: tag._asdict() for tag_id, tag in tags.items()}, 'tables': edges}
    path.write_text(json.dumps(document), encoding='utf-8')
    return path


@pytest.fixture(autouse=True)
def shipped_layout(tmp_path, monkeypatch):
    """Let this layout be that of the simulator."""
    path = write_layout(tmp_path / 'tag_locations.json', LAYOUT.tags, LAYOUT.tables)
    monkeypatch.setattr(tags, 'shipped_file', lambda _name: path)


@pytest.fixture
def navigator(held_navigator, monkeypatch):
    """Return the navigator of the mission, which warns of it and of the bridge only after an hour."""
    monkeypatch.setattr(nav2_drive, 'DISCOVERY_SECONDS', HOUR)
    monkeypatch.setattr(tags, 'LONGEST_WITHOUT_PARAMETERS_SECONDS', HOUR)
    return held_navigator(NAME)


@functools.cache
def goals_of(**parameters):
    """Return the goals in the layout by tag id, and the reasons of the other tags."""
    plan = Plan(LAYOUT, Settings(drive='nav2', **parameters), Transform())
    return plan.goals, plan.unreachable


def places(navigator):
    return [(goal.pose.position.x, goal.pose.position.y) for goal in navigator.goals]


def test_the_robot_drives_in_the_shortest_order_from_the_dock_and_reads_each_tag_there(
    start_mission, reader, navigator, twin
):
    tag_ids, subscriber = ['1', '2', '3', '29'], twin()
    goals, _ = goals_of()
    x, y, yaw = goals['29'][0]
    mission = start_mission(
        **NAV2, tag_sequence=' '.join(tag_ids), order='shortest', dock_pose=f'"{x} {y} {yaw}"'
    )
    for count in range(4):
        goal = navigator.accept()
        assert len(reader.tag_ids) == count
        navigator.end(goal, 'succeed')
        reader.answer_ok(reader.wait_for_request())
    navigator.end(navigator.accept(), 'succeed')
    assert mission.end() == 0
    assert sorted(reader.tag_ids) == sorted(tag_ids)
    assert reader.tag_ids[0] == '29'
    assert places(navigator) == [*(goals[tag_id][0][:2] for tag_id in reader.tag_ids), (x, y)]
    assert mission.outcomes() == [(tag_id, Outcome.OK) for tag_id in reader.tag_ids]
    assert mission.warnings() == []
    wait_until(lambda: len(subscriber.received) == 4)
    assert {each.status_detail for each in subscriber.received} == {''}
    assert {each.drive for each in mission.observations()} == {''}


def end_on_the_way(mission, navigator, goal):
    """End a mission whose robot drives, and cancel its goal, which the mission would await for 2 s."""
    mission.send(signal.SIGTERM)
    navigator.grant_cancel(goal)
    assert mission.end() == 1


@pytest.fixture
def publish_map(node, monkeypatch):
    """Return a function that publishes a latched map, with cells of 0.1 m, until the mission has it."""
    received = queue.SimpleQueue()
    on_map = planner.Planner._on_map

    def record(self, message):
        on_map(self, message)
        received.put(message)

    monkeypatch.setattr(planner.Planner, '_on_map', record)
    publisher = node.create_publisher(OccupancyGrid, '/held/map', latched())

    def send(occupied=(), origin=(-1.0, -1.0), frame_id='map'):
        message = OccupancyGrid()
        message.header.frame_id = frame_id
        message.info.width, message.info.height, message.info.resolution = 60, 100, 0.1
        message.info.origin.position.x, message.info.origin.position.y = origin
        cells = [0] * 6000
        for x, y in occupied:
            cells[int((y - origin[1]) / 0.1) * 60 + int((x - origin[0]) / 0.1)] = 100
        message.data = cells
        publish(publisher, message)
        # Not only until DDS has it: a request that is sent after it may still overtake it.
        received.get(timeout=PATIENCE_SECONDS)

    return send


def test_the_map_that_is_there_at_the_start_moves_a_pose_or_rejects_the_start(
    start_waiting_mission, reader, navigator, publish_map
):
    (usual, *_) = goals_of()[0]['1']
    mission, operator = start_waiting_mission(**WITH_MAP, tag_sequence='1')
    publish_map([(2.0, 2.5)], frame_id='odom')  # which is not used

    def run_mission():
        started = operator.start()
        navigator.end(navigator.accept(), 'succeed')
        reader.answer_ok('1')
        operator.wait_for(lifecycle_state='DONE', mission_id=started)

    run_mission()
    publish_map(origin=(50.0, 0.0))
    for _ in range(2):
        assert 'the map holds only 0 of the ' in operator.rejection()
    publish_map([usual[:2]])
    run_mission()
    assert mission.stop() == 0
    first, second = places(navigator)
    assert first == usual[:2]
    assert math.dist(second, usual[:2]) > 0.2
    lines = [line.partition('approach poses are planned ')[2] for line in mission.log]
    assert [*dict.fromkeys(filter(None, lines))] == [
        "around the tables of the layout alone: /held/map has a map in the frame 'odom'",
        'with the map of /held/map: 60 x 100 cells of 0.1 m',
    ]


def test_the_first_map_is_awaited_if_its_topic_has_a_publisher(
    start_mission, navigator, publish_map, states_of, monkeypatch
):
    for name in ('DISCOVERY_SECONDS', 'LONGEST_MAP_SECONDS'):
        monkeypatch.setattr(planner, name, HOUR)
    (usual, *_) = goals_of()[0]['1']
    mission = start_mission(**WITH_MAP, tag_sequence='1')
    states = states_of(mission)
    for _ in range(3):  # a plan takes less than that
        states.wait_for(lambda state: state.lifecycle_state == 'PREPARE')
    publish_map([usual[:2]])
    goal = navigator.accept()
    assert math.dist(places(navigator)[0], usual[:2]) > 0.2
    end_on_the_way(mission, navigator, goal)
    assert mission.warnings() == []


@pytest.mark.parametrize('has_publisher', [False, True])
def test_without_a_map_the_log_says_around_what_the_poses_are_planned(
    start_mission, navigator, node, monkeypatch, has_publisher
):
    """It is a warning if somebody could have published one."""
    monkeypatch.setattr(planner, 'DISCOVERY_SECONDS', HOUR if has_publisher else 0.0)
    monkeypatch.setattr(planner, 'LONGEST_MAP_SECONDS', 1.0 if has_publisher else HOUR)
    said = 'no map is published on /held/map, and none is needed: the approach poses are planned around'
    if has_publisher:
        node.create_publisher(OccupancyGrid, '/held/map', latched())
        said = 'planned around the tables of the layout alone: /held/map sent no map within 1 s'
    mission = start_mission(**WITH_MAP, tag_sequence='1', approach_clearance_m=1.0)
    end_on_the_way(mission, navigator, navigator.accept())
    (line,) = mission.lines_with(said)
    assert mission.warnings() == ([line] if has_publisher else [])
    assert len(mission.lines_with("tag '1': its pose has ")) == 1  # nothing needs to be done


@pytest.fixture
def yard(tmp_path):
    """Return the parameters of a layout: tag 3 is in a yard whose entrance is too narrow; 1 and 2 are not."""
    tables = {'s': (0, 0, 3, 0.5), 'n': (0, 3, 3, 3.5), 'w': (0, 0.5, 0.5, 3), 'e': (2.5, 0.5, 3, 2.9)}
    places = {'1': (0.5, 0.0), '2': (2.5, 0.0), '3': (1.5, 0.5)}
    tags = {tag_id: Tag(*place, ['co2']) for tag_id, place in places.items()}
    tag_file = write_layout(tmp_path / 'yard.json', tags, tables)
    return {**NAV2, 'tag_locations_file': str(tag_file), 'walls': '"-1.6 -1.6 4.6 5.1"', 'dock_pose': '[]'}


def test_the_robot_visits_the_tags_of_the_room_that_it_stands_in(
    start_waiting_mission, reader, navigator, node, yard
):
    """Most tags are outside the yard. A tag without a pose has no line about the room of its pose."""
    mission, operator = start_waiting_mission(**yard, nav_max_attempts=1, approach_clearance_m=1.0)
    poses = node.create_publisher(PoseWithCovarianceStamped, f'{mission.namespace}/amcl_pose', latched())
    for place, reached in (((1.5, 1.75), '3'), ((-0.8, -0.8), '12')):
        publish(poses, localized(*place))
        started = operator.start()
        for tag_id in reached:
            navigator.end(navigator.accept(), 'succeed')
            reader.answer_ok(tag_id)
        operator.wait_for(lifecycle_state='DONE', mission_id=started)
        cut_off = 'cut off from the start at ({:g}, {:g})'.format(*place)
        for each in mission.observations(started):
            assert (each.outcome is Outcome.OK) == (each.tag_id in reached) == (cut_off not in each.detail)
    mission.stop()
    rooms = mission.lines_with('its pose has ')
    assert (len(rooms), "tag '3'" in rooms[0]) == (3, True)


def test_tags_that_are_cut_off_from_the_dock_keep_their_order_with_a_warning(
    start_mission, reader, navigator, yard
):
    yard['dock_pose'] = '"1.5 1.75 0.0"'
    mission = start_mission(**yard, tag_sequence='2 1', order='shortest')
    for tag_id in '21':
        navigator.end(navigator.accept(), 'succeed')
        reader.answer_ok(tag_id)
    navigator.end(navigator.accept(), 'succeed')
    assert mission.end() == 0
    assert reader.tag_ids == ['2', '1']
    (warning,) = mission.warnings()
    assert 'the order is not the shortest: ' in warning
    assert 'from (1.50, 1.75)' in warning


def test_a_tag_that_cannot_be_reached_is_unreachable_with_its_reason(
    start_mission, reader, navigator, twin, states_of
):
    """One tag has no pose; the drives to the other are aborted."""
    goals, unreachable = goals_of(robot_radius_m=0.3)
    no_pose, reason = next(iter(unreachable.items()))
    subscriber = twin()
    mission = start_mission(**NAV2, tag_sequence=f'{no_pose} 1', robot_radius_m=0.3)
    states = states_of(mission)
    for _ in range(2):
        navigator.end(navigator.accept(), 'abort')
    done = states.wait_for(lambda state: state.lifecycle_state == 'DONE')
    assert (done.targets_unreachable, done.targets_failed, done.targets_total) == (2, 0, 2)
    assert mission.end() == 1
    assert len(navigator.goals) == 2
    assert reader.tag_ids == []
    assert [each.goal for each in mission.observations()] == [None, pytest.approx(goals['1'][0][:2], 1e-3)]
    for tag_id, detail in ((no_pose, reason), ('1', f'{NAME} aborted the drive')):
        received = subscriber.wait_for()
        assert received.status_detail == f'tag {tag_id}: UNREACHABLE: {detail}'
        assert (received.status, received.tag_reading.tag_id) == (Observation.STATUS_UNREACHABLE, '')


def test_a_robot_looks_once_more_from_another_pose(start_mission, reader, confirmer, navigator, twin):
    """Every drive to the first pose of tag 7 is aborted; tag 1 is hidden from its first pose."""
    subscriber = twin()
    parameters = {**NAV2, **CAMERA, 'max_poses': 2, 'max_attempts': 1, 'nav_max_attempts': 1}
    mission = start_mission(**parameters, tag_sequence='7 1')
    for end, is_seen in (('abort', None), ('succeed', True), ('succeed', False), ('succeed', True)):
        navigator.end(navigator.accept(), end)
        if is_seen is not None:
            confirmer.wait_for_request()
            confirmer.answer(detected=is_seen, error_message='' if is_seen else 'no tag in view')
        if is_seen:
            reader.answer_ok(reader.wait_for_request())
    assert mission.end() == 0
    goals, _ = goals_of(max_poses=2)
    assert places(navigator) == [goal[:2] for tag_id in '71' for goal in goals[tag_id]]
    read = [(each.outcome, each.seen, each.pose, each.attempts) for each in mission.observations()]
    assert read == [(Outcome.OK, True, 2, 2), (Outcome.OK, True, 2, 3)]
    wait_until(lambda: len(subscriber.received) == 2)
    assert {each.status_detail for each in subscriber.received} == {'read from pose 2'}
    first, second = mission.lines_with('trying pose')
    assert f"tag '7': UNREACHABLE, trying pose 2 of 2: {NAME} aborted the drive" in first
    assert "tag '1': NOT_CONFIRMED, trying pose 2 of 2: no tag in view" in second
    assert len(mission.lines_with('OK from pose 2')) == 2


@pytest.fixture
def held_plans(monkeypatch):
    """Hold every plan but the first in its thread; return events: a plan has begun, and it may go on."""
    begun, released, plan_of = threading.Event(), threading.Event(), planner.Planner._drives

    def drives(self, *arguments, **keywords):
        if self._plan:
            begun.set()
            assert released.wait(PATIENCE_SECONDS)
        return plan_of(self, *arguments, **keywords)

    monkeypatch.setattr(planner.Planner, '_drives', drives)
    yield begun, released
    released.set()


def test_the_estop_holds_a_mission_that_plans_and_cancels_a_goal_which_a_resume_sends_again(
    start_waiting_mission, reader, navigator, node, held_plans
):
    """The state is published, and the e-stop is answered, while the mission plans."""
    mission, operator = start_waiting_mission(**NAV2, tag_sequence='1', estop_topic='/held/estop')
    estop = node.create_publisher(Bool, '/held/estop', 10)
    started = operator.start_later()
    begun, released = held_plans
    assert begun.wait(PATIENCE_SECONDS)
    publish(estop, Bool(data=True))
    operator.wait_for(estop_engaged=True, paused=True, lifecycle_state='PREPARE')
    released.set()
    wait_until(started.done)
    assert started.result().accepted
    operator.wait_for(estop_engaged=True, paused=True, mission_id=started.result().mission_id)
    assert navigator.goals == []
    estop.publish(Bool(data=False))
    operator.wait_for(estop_engaged=False, paused=True)
    assert operator.trigger('resume')
    goal = navigator.accept()
    while not navigator.has_cancel():  # the e-stop is repeated until it is received
        estop.publish(Bool(data=True))
    navigator.grant_cancel(goal)
    operator.wait_for(estop_engaged=True, paused=True, mission_phase='NAVIGATING')
    estop.publish(Bool(data=False))
    operator.wait_for(estop_engaged=False, paused=True)
    assert len(navigator.goals) == 1
    assert operator.trigger('resume')
    navigator.end(navigator.accept(), 'succeed')
    reader.wait_for_request()
    assert places(navigator)[0] == places(navigator)[1]
    mission.stop()


def test_abort_and_pause_hold_while_the_mission_plans(start_waiting_mission, navigator, twin, held_plans):
    subscriber = twin()
    mission, operator = start_waiting_mission(**NAV2, tag_sequence='1')
    begun, released = held_plans
    start = operator.start_later()
    assert begun.wait(PATIENCE_SECONDS)
    assert operator.dock() == (False, 'cannot dock in state PREPARE')
    assert operator.trigger('abort')
    operator.wait_for(lifecycle_state='DONE', targets_skipped=1)
    assert subscriber.wait_for().status_detail == 'tag 1: SKIPPED: aborted'
    begun.clear()
    released.set()
    wait_until(start.done)
    assert start.result().accepted
    released.clear()
    start = operator.start_later()
    assert begun.wait(PATIENCE_SECONDS)
    assert operator.trigger('pause')
    released.set()
    wait_until(start.done)
    operator.wait_for(lifecycle_state='PREPARE', paused=True, mission_id=start.result().mission_id)
    assert operator.dock() == (False, 'cannot dock in state PREPARE')
    assert operator.rejection().startswith('mission already running')
    assert navigator.goals == []
    assert operator.trigger('resume')
    end_on_the_way(mission, navigator, navigator.accept())


def test_the_state_tells_what_delays_a_mission(start_waiting_mission, held_navigator, clock):
    waiting = f'waiting for the action server {NAME}: start Nav2'
    mission, operator = start_waiting_mission(**NAV2, tag_sequence='1')
    operator.start()
    for seconds, error in ((1.9, ''), (0.1, waiting), (27.9, waiting)):  # a server may be found late
        clock.pass_seconds(seconds)
        operator.states.wait_for_steps()
        state = operator.states.received[-1]
        assert (state.last_error, state.paused) == (error, False)
    clock.pass_seconds(0.1)
    state = operator.wait_for(last_error='dependency_timeout', paused=True)
    assert state.last_event == f'there is no action server {NAME}: start Nav2: resume to go on'
    assert state.last_event_severity == MissionState.SEVERITY_ERROR
    assert operator.trigger('resume')
    clock.pass_seconds(29.9)  # it waits for 30 s again
    operator.states.wait_for_steps()
    navigator = held_navigator(NAME)
    goal = navigator.accept()
    operator.wait_for(last_error='', paused=False)
    end_on_the_way(mission, navigator, goal)
    assert len(mission.lines_with(waiting)) == 1


@pytest.mark.usefixtures('navigator')
def test_a_signal_ends_a_mission_that_plans(start_mission, held_plans):
    begun, released = held_plans
    mission = start_mission(**NAV2, tag_sequence='1')
    assert begun.wait(PATIENCE_SECONDS)
    assert mission.stop() == 1
    assert mission.log[-1] == '0/1 tags read'
    assert not released.is_set()


@pytest.mark.parametrize('is_fatal', [False, True], ids=['signal', 'fatal error'])
def test_the_end_of_the_node_cancels_the_goal_awaits_its_end_for_2_s_and_sends_no_other(
    start_mission, navigator, clock, states_of, monkeypatch, is_fatal
):
    def fail(*_arguments):
        raise OneLineError('the disk is full')

    mission = start_mission(**NAV2, tag_sequence='1')
    goal = navigator.accept()
    states = states_of(mission)
    states.wait_for()
    clock.pass_seconds(3.0)  # a drive sends its next goal after 2 s at the latest
    if is_fatal:
        monkeypatch.setattr(Announcer, 'moved', fail)
    else:
        mission.send(signal.SIGTERM)
    navigator.wait_for_cancel()
    clock.pass_seconds(1.9)
    states.wait_for_steps()  # it still runs
    if is_fatal:
        navigator.answer_cancel()
        navigator.end(goal, 'canceled')
    else:  # the server never answers
        clock.pass_seconds(0.1)
    assert mission.end() == (2 if is_fatal else 1)
    assert len(navigator.goals) == 1


@pytest.mark.usefixtures('clock')  # which stands still
def test_a_goal_that_is_pending_at_the_end_is_cancelled_when_it_is_accepted(
    start_mission, navigator, states_of, node, request
):
    """The mission would wait for ever; then it is off the graph, also what nothing refers to but itself."""
    request.addfinalizer(gc.enable)
    gc.disable()
    mission = start_mission(**NAV2, tag_sequence='1')
    navigator.wait_for_goal()
    states_of(mission).wait_for_steps()  # no callback waits for the server
    mission.send(signal.SIGTERM)
    navigator.grant_cancel(navigator.accept())
    assert mission.end() == 1
    name = ('mission_orchestrator', mission.namespace)
    wait_until(lambda: name not in node.get_node_names_and_namespaces())


@pytest.mark.parametrize('parameters', [{}, {'tag_sequence': '7'}])
def test_without_its_layout_the_robot_does_not_drive(start_mission, bridge_parameters, parameters):
    """The positions of the shipped tag file are wrong for a bridge with its own."""
    mission = start_mission(**NAV2, **parameters)
    bridge_parameters.answer_tags('7', tag_file='/home/me/tags.json')
    refusal = mission.refusal(exit_code=2)
    assert "the layout is unknown: set tag_locations_file to the bridge's tag_file" in refusal


def test_without_nav2_msgs_the_drive_is_refused_with_their_source(start_mission, monkeypatch):
    monkeypatch.setitem(sys.modules, 'nav2_msgs.action', None)  # as if it was not installed
    refusal = start_mission(**NAV2, tag_sequence='1').refusal(exit_code=2)
    assert 'nav2-msgs' in refusal
