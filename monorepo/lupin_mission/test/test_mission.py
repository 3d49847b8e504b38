"""The state machine of a mission, without ROS. The test supplies time and replies."""

import os
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from lupin_greenhouse_bridge.display.report_line import Observation, Outcome, Reading
from lupin_mission.drive import Arrival, SimulatedDrive
from lupin_mission.mission import Mission, Severity, State
from lupin_mission.report import Report
from lupin_mission.visit import Limits, Service

LIMITS = Limits(
    dwell_seconds=1.0,
    confirm_timeout_seconds=2.0,
    read_timeout_seconds=2.0,
    max_attempts=3,
    retry_delay_seconds=0.5,
)
LONGEST_MISSION_SECONDS = 100_000.0  # simulated
SEEN = {True: Outcome.OK, False: Outcome.NOT_CONFIRMED}  # what the camera replies
STUCK = Arrival('aborted', is_stuck=True)
NEEDS_PERSON = Arrival('Nav2 sleeps', needs_person=True)


def reading(tag_id: str, value: float = 20.0) -> Reading:
    return Reading(tag_id, (1, 2), 43200.0, {'temperature': value})


class Robot(SimulatedDrive):
    """
    A drive that records what it is told: 'a' for the first pose of tag a, 'a2' for its second, and so on.

    `failures` has the reasons by these names. The first drives end with `arrivals`, one after the other.
    """

    def __init__(self, drive_seconds=0.0, *arrivals, poses=1, **failures):
        super().__init__(drive_seconds)
        self.told, self.arrivals = [], list(arrivals)
        self._poses, self._failures = poses, failures

    def count_poses(self, tag_id):  # noqa: ARG002
        return self._poses

    def start(self, tag_id, now_seconds, pose=1):
        self._set_off(f'{tag_id}{pose}' if pose > 1 else tag_id, now_seconds)

    def start_return(self, now_seconds):
        self._set_off('dock', now_seconds)

    def _set_off(self, goal, now_seconds):
        super().start_return(now_seconds)
        self.told.append(goal)
        self._arrival = self.arrivals.pop(0) if self.arrivals else Arrival(self._failures.get(goal, ''))

    def arrival(self, now_seconds):
        return super().arrival(now_seconds) and self._arrival

    def pause(self):
        self.told.append('pause')

    def resume(self):
        self.told.append('resume')

    def stop(self):
        self.told.append('stop')


class World:
    """MissionPorts that record what the mission does."""

    def __init__(self, tag_ids='ab', robot=None, limits=LIMITS, now=0.0, **options):
        self.now = now
        self.sent, self.abandoned, self.recorded, self.events = [], [], [], []
        self.robot = robot or Robot()
        self.mission = Mission(tag_ids, self, self.robot, limits, **options)
        self.mission.step(self.now)

    def send(self, request):
        self.sent.append(request)

    def abandon(self, request):
        self.abandoned.append(request)
        return Outcome.TIMEOUT

    def record(self, observation):
        self.recorded.append(observation)

    def note(self, event, severity):
        self.events.append((event, severity))

    def wait(self, *durations):
        """Take a step after each of these times in seconds."""
        for seconds in durations:
            self.now += seconds
            assert self.now < LONGEST_MISSION_SECONDS, 'the mission does not end'
            self.mission.step(self.now)

    @property
    def state(self):
        return self.mission.state

    @property
    def asked(self):
        return [(request.service, request.tag_id) for request in self.sent]

    @property
    def outcomes(self):
        return [(each.tag_id, each.outcome) for each in self.recorded]

    def answer(self, found=None):
        """Reply to the last request with a reading, by default of its tag."""
        request = self.sent[-1]
        return self.mission.on_reply(request, Outcome.OK, reading=found or reading(request.tag_id))

    def confirm(self, *replies):
        """Reply to the last request of the camera, again and again."""
        for is_seen in replies:
            assert self.mission.on_reply(self.sent[-1], SEEN[is_seen], 'not in view')
            self.wait(0.0)

    def refuse(self, outcome=Outcome.SIMULATOR_ERROR):
        """Reply to the last request with a failure."""
        assert self.mission.on_reply(self.sent[-1], outcome, 'broken')


def test_a_mission_is_ready_until_it_is_started():
    mission = Mission('a', None, Robot(), LIMITS)
    assert (mission.state, mission.target, mission.tag_at_hand) == (State.READY, None, None)
    assert mission.phase == ''
    assert not mission.pause()


def test_each_tag_is_read_once_and_in_order():
    world = World('abc')
    while world.state is not State.DONE:
        assert world.answer()
        world.wait(1.0)
    assert world.asked == [(Service.READ, tag) for tag in 'abc']
    assert world.recorded == [Observation(tag, Outcome.OK, '', 1, reading(tag)) for tag in 'abc']


def test_the_time_before_the_start_does_not_count():
    world = World(robot=Robot(10.0), now=1000.0)
    world.wait(9.75)
    assert world.state is State.DRIVING
    world.wait(0.25)
    assert world.mission.tag_at_hand == 'a'


def test_a_tag_is_left_after_the_dwell_and_after_the_scan():
    world = World('abc')
    world.answer()
    world.wait(0.9)
    assert world.mission.tag_at_hand == 'a'
    world.wait(0.2)
    assert world.mission.tag_at_hand == 'b'
    world.wait(1.5)
    assert world.mission.tag_at_hand == 'b'
    world.answer()
    world.wait(0.0)
    assert world.mission.tag_at_hand == 'c'


def test_a_pause_in_the_dwell_does_not_scan_the_tag_again():
    world = World('a')
    world.answer()
    assert world.mission.pause()
    world.wait(100.0)
    assert world.mission.resume()
    world.wait(0.5)
    assert world.state is State.INSPECTING
    world.wait(0.5)
    assert world.state is State.DONE
    assert world.outcomes == [('a', Outcome.OK)]
    assert len(world.sent) == 1


def test_nothing_is_asked_in_a_pause_and_a_reply_still_counts():
    world = World(require_visual_confirmation=True)
    world.mission.pause()
    world.confirm(True)
    world.wait(100.0)
    assert world.asked == [(Service.CONFIRM, 'a')]
    world.mission.resume()
    world.wait(0.0)
    assert world.asked == [(Service.CONFIRM, 'a'), (Service.READ, 'a')]
    world.mission.pause()
    assert world.answer()
    world.wait(100.0)
    assert world.mission.tag_at_hand == 'a'
    assert world.outcomes == [('a', Outcome.OK)]
    assert len(world.sent) == 2


def test_attempts_do_not_leak_from_tag_to_tag():
    """Two failures at a, then two at b: the third attempt at b is still made."""
    world = World('ab')
    for tag_id in 'ab':
        for _ in range(LIMITS.max_attempts - 1):
            world.refuse()
            world.wait(10.0)
        assert world.sent[-1].tag_id == tag_id
        assert world.answer()
        world.wait(1.0)
    assert world.outcomes == [('a', Outcome.OK), ('b', Outcome.OK)]


def test_attempts_do_not_leak_from_confirming_to_reading():
    world = World('a', require_visual_confirmation=True)
    for _ in range(LIMITS.max_attempts - 1):
        world.confirm(False)
        world.wait(10.0)
    world.confirm(True)
    for _ in range(LIMITS.max_attempts - 1):
        world.refuse()
        world.wait(10.0)
    assert world.answer()
    assert world.outcomes == [('a', Outcome.OK)]


def test_a_pause_stops_the_drive_and_is_told_from_no_pause():
    world = World(robot=Robot(10.0))
    world.wait(6.0)
    assert [world.mission.resume(), world.mission.pause(), world.mission.pause()] == [False, True, False]
    world.wait(100.0)
    assert [world.mission.resume(), world.mission.resume()] == [True, False]
    world.wait(3.9)
    assert world.state is State.DRIVING
    world.wait(0.2)
    assert world.mission.tag_at_hand == 'a'
    assert world.robot.told == ['a', 'pause', 'resume']


def test_a_timeout_gives_the_request_up_and_asks_again_later_and_later():
    world = World('a')
    times = []
    while world.state is not State.DONE:
        before = len(world.sent)
        world.wait(0.125)
        if len(world.sent) > before:
            times.append(world.now)
    assert times == [2.0 + 0.5, 2.5 + 2.0 + 1.0]
    assert world.abandoned == world.sent
    assert world.recorded == [Observation('a', Outcome.TIMEOUT, 'read: no reply before the timeout', 3)]


def test_the_delay_before_a_further_attempt_grows_up_to_10_seconds():
    world = World('a', limits=Limits(retry_delay_seconds=3.0, max_attempts=5))
    delays = []
    for attempts in (2, 3, 4, 5):
        failed = world.now
        world.refuse()
        while len(world.sent) < attempts:
            world.wait(0.5)
        delays.append(world.now - failed)
    assert delays == [3.0, 6.0, 10.0, 10.0]


def test_the_delay_of_a_skipped_tag_is_not_that_of_the_next():
    world = World('ab')
    world.refuse()
    assert world.mission.skip()
    world.wait(0.0)
    world.refuse()
    world.wait(0.5)  # the first delay again, not the second
    assert world.asked == [(Service.READ, tag) for tag in 'abb']


def test_the_delay_stops_in_a_pause_and_the_timeout_does_not():
    world = World('a')
    world.mission.pause()
    world.wait(2.0)
    assert world.abandoned == world.sent
    world.wait(100.0)
    world.mission.resume()
    world.wait(0.25)
    assert len(world.sent) == 1
    world.wait(0.25)
    assert len(world.sent) == 2


def test_an_unknown_tag_is_not_asked_for_again():
    world = World('ab')
    world.refuse(Outcome.UNKNOWN_TAG)
    world.wait(1.0)
    assert world.recorded == [Observation('a', Outcome.UNKNOWN_TAG, 'broken', 1)]
    assert world.asked[1:] == [(Service.READ, 'b')]


@pytest.mark.parametrize(
    ('bad', 'outcome'),
    [
        (reading('b'), Outcome.WRONG_TAG),
        (reading('a', float('nan')), Outcome.BAD_READING),
        (Reading('a', (1, 2), float('inf'), {'co2': 1.0}), Outcome.BAD_READING),
        (Reading('a', (1, 2), 0.0, {}), Outcome.BAD_READING),
        (Reading('a', (-1, 2), 0.0, {'co2': 1.0}), Outcome.BAD_READING),
    ],
    ids=['another tag', 'NaN', 'time without end', 'empty', 'before 1970'],
)
def test_a_reading_that_cannot_be_is_refused_and_asked_for_again(bad, outcome):
    world = World('a')
    for _ in range(3):
        assert world.answer(bad)
        world.wait(2.0)
    assert world.outcomes == [('a', outcome)]
    assert len(world.sent) == 3


def test_a_late_reply_is_not_taken_for_the_next_ones():
    world = World('ab')
    late = world.sent[0]
    world.wait(2.0, 0.5)
    assert world.answer()
    world.wait(1.0)
    assert not world.mission.on_reply(late, Outcome.OK, reading=reading('a'))
    assert not world.mission.on_reply(late, Outcome.SIMULATOR_ERROR)
    assert world.outcomes == [('a', Outcome.OK)]


def test_the_bridge_is_asked_only_after_the_camera_has_confirmed_the_tag():
    world = World('a', require_visual_confirmation=True)
    assert world.mission.phase == 'CONFIRMING'
    world.confirm(False)
    world.wait(0.5)
    assert world.asked == [(Service.CONFIRM, 'a')] * 2
    world.confirm(True)
    assert world.asked[2:] == [(Service.READ, 'a')]
    assert world.mission.phase == 'SCANNING'
    world.answer()
    assert world.outcomes == [('a', Outcome.OK)]


def test_a_tag_that_is_never_confirmed_is_never_read():
    world = World('a', require_visual_confirmation=True)
    while world.state is not State.DONE:
        world.confirm(False)
        world.wait(1.0)
    assert world.asked == [(Service.CONFIRM, 'a')] * 3
    assert world.recorded == [Observation('a', Outcome.NOT_CONFIRMED, 'not in view', 3, seen=False)]


def test_a_scan_has_one_outcome_and_only_the_tag_at_hand_has_one():
    mission = World('ab').mission
    with pytest.raises(ValueError, match='not being scanned'):
        mission.mark_scan_ok('b', reading('b'))
    mission.mark_scan_ok('a', reading('a'))
    with pytest.raises(ValueError, match='not being scanned'):
        mission.mark_scan_failed('a', Outcome.TIMEOUT, '')


def test_a_skip_on_the_way_stops_the_robot_even_to_the_last_tag():
    world = World('ab', Robot(10.0))
    assert world.mission.skip()
    world.wait(0.0)
    assert (world.mission.target, world.mission.phase) == ('b', 'NAVIGATING')
    assert world.recorded == [Observation('a', Outcome.SKIPPED, 'skipped', 0)]
    assert world.mission.skip()
    world.wait(0.0)
    assert world.robot.told == ['a', 'stop', 'b', 'stop']
    assert (world.state, world.sent) == (State.DONE, [])


def test_a_tag_that_is_skipped_while_it_is_scanned_awaits_no_reply():
    world = World('ab')
    late = world.sent[0]
    assert world.mission.skip()
    world.wait(0.0)
    assert (world.abandoned, world.robot.told) == ([late], ['a', 'b'])  # there is no drive to stop
    assert not world.mission.on_reply(late, Outcome.OK, reading=reading('a'))
    assert world.mission.tag_at_hand == 'b'
    assert world.outcomes == [('a', Outcome.SKIPPED)]


def test_a_skip_in_the_dwell_keeps_the_outcome_and_ends_the_dwell():
    world = World('ab')
    world.answer()
    assert world.mission.phase == 'SCANNING'
    assert world.mission.skip()
    world.wait(0.0)
    assert world.mission.tag_at_hand == 'b'
    assert world.outcomes == [('a', Outcome.OK)]


@pytest.mark.parametrize(('drive_seconds', 'phase'), [(0.0, 'SCANNING'), (1.0, 'NAVIGATING')])
def test_a_skip_in_a_pause_moves_nothing_until_it_is_over(drive_seconds, phase):
    world = World('ab', Robot(drive_seconds))
    world.mission.pause()
    assert world.mission.skip()
    world.wait(10.0)
    assert (world.mission.target, world.mission.phase) == ('a', phase)
    world.mission.resume()
    world.wait(0.0)
    assert world.mission.target == 'b'


@pytest.mark.parametrize('is_paused', [False, True])
def test_an_abort_while_the_camera_is_awaited_closes_every_tag_left(is_paused):
    world = World('abc', require_visual_confirmation=True)
    awaited = world.sent[0]
    if is_paused:
        world.mission.pause()
    assert world.mission.abort()
    assert world.state is State.DONE
    assert world.abandoned == [awaited]
    assert world.recorded == [Observation(tag, Outcome.SKIPPED, 'aborted', int(tag == 'a')) for tag in 'abc']
    assert not world.mission.on_reply(awaited, Outcome.OK)
    assert [world.mission.abort(), world.mission.skip(), world.mission.pause()] == [False] * 3


def test_a_drive_that_fails_is_tried_again_and_then_the_tag_is_unreachable():
    world = World('ab', Robot(1.0, a='the aisle is blocked'))
    world.wait(1.0)
    assert (world.mission.target, world.recorded) == ('a', [])
    retry = "the drive to tag 'a' failed: the aisle is blocked: trying again"
    assert world.events[-1] == (retry, Severity.WARN)
    world.wait(0.25, 0.25, 1.0)
    assert world.recorded == [Observation('a', Outcome.UNREACHABLE, 'the aisle is blocked', 0)]
    assert (world.mission.target, world.sent) == ('b', [])
    world.wait(1.0)
    assert world.mission.tag_at_hand == 'b'
    assert world.robot.told == ['a', 'a', 'b']


def test_each_tag_has_all_its_drives():
    world = World('abc', Robot(1.0, a='no', b='no'), Limits(max_drives=3))
    departures = []
    while world.robot.told[-1] != 'c':
        before = len(world.robot.told)
        world.wait(0.25)
        if len(world.robot.told) > before:
            departures.append(world.now)
    assert departures == [1.5, 3.5, 4.5, 6.0, 8.0, 9.0]  # 0.5 s and 1 s after the end of the drive
    assert world.robot.told == [*'aaabbb', 'c']
    assert world.outcomes == [(tag, Outcome.UNREACHABLE) for tag in 'ab']


def test_the_phase_is_publishing_only_while_an_observation_is_recorded():
    world = World('a')
    phases = []
    world.record = lambda _observation: phases.append(world.mission.phase)
    world.answer()
    assert phases == ['PUBLISHING']
    assert world.mission.phase == 'SCANNING'


def test_the_robot_returns_to_its_dock_after_the_last_tag():
    world = World('a', Robot(1.0), returns_to_dock=True)
    world.wait(1.0)
    world.answer()
    world.wait(1.0)
    assert (world.state, world.mission.target, world.mission.phase) == (State.RETURNING, None, '')
    assert not world.mission.skip()
    world.wait(1.0)
    assert world.state is State.DONE
    assert world.robot.told == ['a', 'dock']


def test_an_abort_returns_too_and_an_abort_on_the_return_ends_it():
    world = World('ab', Robot(10.0), returns_to_dock=True)
    assert world.mission.abort()
    assert world.state is State.RETURNING
    assert world.mission.abort()
    assert world.state is State.DONE
    assert world.robot.told == ['a', 'stop', 'dock', 'stop']
    assert world.outcomes == [(tag, Outcome.SKIPPED) for tag in 'ab']


def test_an_abort_before_a_drive_is_tried_again_leaves_no_drive():
    world = World('a', Robot(1.0, a='no'))
    world.wait(1.0)
    assert world.mission.abort()
    world.wait(10.0)
    assert world.state is State.DONE
    assert world.robot.told == ['a', 'stop']


@pytest.mark.parametrize('docks', [False, True])
def test_a_dock_that_is_not_reached_is_tried_again_and_then_a_warning(docks):
    world = World('a' if docks else '', Robot(1.0, dock='the door is shut'), returns_to_dock=True)
    assert world.mission.dock() == docks
    world.wait(1.0)
    assert world.state is (State.DOCKING if docks else State.RETURNING)
    world.wait(0.5, 1.0)
    assert (world.state, world.mission.is_paused) == (State.DOCKED if docks else State.DONE, docks)
    assert world.robot.told[-2:] == ['dock', 'dock']
    assert ('the robot is not at the dock: the door is shut', Severity.WARN) in world.events


def docked(tag_ids):
    """Return a world whose robot has docked from its first tag."""
    world = World(tag_ids, Robot(1.0), returns_to_dock=True)
    world.wait(1.0)
    assert world.mission.dock()
    assert not world.mission.dock()
    world.wait(0.0)
    assert (world.state, world.mission.target, world.mission.is_paused) == (State.DOCKING, None, False)
    world.wait(1.0)
    assert (world.state, world.mission.is_paused) == (State.DOCKED, True)
    return world


def test_a_mission_that_docked_goes_on_with_the_tags_left():
    world = docked('abc')
    late = world.sent[0]
    world.wait(100.0)
    assert world.abandoned == [late]
    assert (world.robot.told, world.outcomes) == (['a', 'dock'], [])
    assert world.mission.resume()
    world.wait(0.0)
    assert not world.mission.on_reply(late, Outcome.OK, reading=reading('a'))
    while world.state is not State.RETURNING:
        world.wait(1.0)
        world.answer()
    assert world.robot.told == ['a', 'dock', 'resume', *'abc', 'dock']
    assert world.outcomes == [(tag, Outcome.OK) for tag in 'abc']
    world.wait(1.0)
    assert world.state is State.DONE


def test_a_mission_docks_from_the_way_from_the_dwell_and_from_a_pause():
    world = World('ab', Robot(1.0), returns_to_dock=True)
    assert world.mission.dock()
    world.wait(1.0)
    world.mission.resume()
    world.wait(0.0, 1.0)
    world.answer()
    assert world.mission.pause()
    assert world.mission.dock()
    world.wait(1.0)
    world.mission.resume()
    world.wait(0.0)
    assert world.robot.told == ['a', 'stop', 'dock', 'resume', 'a', 'pause', 'dock', 'resume', 'b']
    assert world.outcomes == [('a', Outcome.OK)]


def test_an_abort_at_the_dock_skips_the_tags_left():
    world = docked('abc')
    assert world.mission.abort()
    world.wait(1.0)
    assert (world.state, world.mission.is_paused) == (State.DONE, False)
    assert world.outcomes == [(tag, Outcome.SKIPPED) for tag in 'abc']


def test_a_mission_without_a_dock_does_not_dock():
    world = World('a', Robot(1.0))
    assert not world.mission.dock()
    assert (world.mission.target, world.robot.told) == ('a', ['a'])


def test_a_failure_that_is_final_is_not_tried_again():
    world = World('ab', Robot(0.0, Arrival('cut off', is_final=True)))
    assert world.robot.told == ['a', 'b']
    assert world.recorded == [Observation('a', Outcome.UNREACHABLE, 'cut off', 0)]


def test_a_drive_that_needs_a_person_pauses_the_mission_and_keeps_the_tag():
    world = World('ab', Robot(0.0, NEEDS_PERSON, Arrival('blocked')))
    assert world.events[-1] == ('Nav2 sleeps: resume to go on', Severity.ERROR)
    assert (world.mission.is_paused, world.mission.target, world.outcomes) == (True, 'a', [])
    world.wait(100.0)
    assert world.mission.resume()
    world.wait(0.0, 0.5)  # all attempts are left
    assert world.robot.told == ['a', 'pause', 'resume', 'a', 'a']
    assert world.mission.tag_at_hand == 'a'


@pytest.mark.parametrize(
    ('do', 'told'),
    [(Mission.skip, ['a', 'pause', 'stop', 'resume', 'b']), (Mission.abort, ['a', 'pause', 'stop'])],
)
def test_a_mission_that_needs_a_person_can_be_skipped_and_aborted(do, told):
    world = World('ab', Robot(0.0, NEEDS_PERSON))
    assert do(world.mission)
    world.mission.resume()
    world.wait(0.0)
    assert world.outcomes[0] == ('a', Outcome.SKIPPED)
    assert world.robot.told == told


def test_two_drives_in_a_row_without_a_move_pause_the_mission_once_for_each_tag():
    world = World('ab', Robot(0.0, STUCK, STUCK, STUCK, STUCK, STUCK))
    world.wait(0.5)
    event = 'the robot is stuck: it did not move in 2 drives: aborted: resume to go on'
    assert world.events[-1] == (event, Severity.ERROR)
    assert (world.mission.is_paused, world.mission.target, world.outcomes) == (True, 'a', [])
    assert world.mission.resume()
    world.wait(0.0, 0.5)
    assert world.outcomes == [('a', Outcome.UNREACHABLE)]  # it was the goal
    assert (world.mission.is_paused, world.mission.target) == (True, 'b')  # the third in a row


def test_after_a_pause_the_next_tag_has_two_drives_without_a_move_again():
    world = World('ab', Robot(0.0, STUCK, STUCK, STUCK))
    world.wait(0.5)
    assert world.mission.skip()
    assert world.mission.resume()
    world.wait(0.0)
    assert (world.mission.is_paused, world.mission.target) == (False, 'b')


def test_a_drive_that_moved_is_between_two_that_did_not():
    world = World('a', Robot(0.0, STUCK, Arrival('aborted'), STUCK), Limits(max_drives=3))
    world.wait(0.5, 1.0)
    assert world.outcomes == [('a', Outcome.UNREACHABLE)]


WAYS = {
    'to driving': lambda _world: None,
    'to inspecting': lambda world: world.wait(1.0),
    'to dwelling': lambda world: world.wait(1.0) or world.answer(),
    'to returning': lambda world: world.mission.abort(),
}


@pytest.mark.parametrize('go', WAYS.values(), ids=WAYS)
def test_the_estop_holds_every_state_until_it_is_released_and_resumed(go):
    world = World('ab', Robot(1.0), returns_to_dock=True)
    go(world)
    before = (world.state, world.mission.target, len(world.sent))
    world.mission.engage_estop()
    assert world.robot.told[-1] == 'pause'
    assert not world.mission.resume()
    world.wait(1.9)
    world.mission.release_estop()
    world.wait(0.05)
    assert (world.state, world.mission.target, len(world.sent)) == before
    assert world.mission.resume()
    world.wait(100.0, 100.0)
    assert (world.state, world.mission.target, len(world.sent)) != before


def started_under_the_estop(tag_ids, **options):
    """Return the mission, what it has closed, and its robot."""
    world, robot = World(''), Robot(10.0)
    mission = Mission(tag_ids, world, robot, LIMITS, **options)
    mission.engage_estop()
    mission.step(0.0)
    mission.step(10.0)
    assert (mission.state, robot.told) == (State.READY, [])
    return mission, world, robot


def test_a_mission_that_starts_under_the_estop_sets_off_after_the_resume():
    mission, _, robot = started_under_the_estop('a')
    mission.release_estop()
    assert mission.resume()
    mission.step(20.0)
    assert (mission.state, robot.told) == (State.DRIVING, ['resume', 'a'])


@pytest.mark.parametrize('returns_to_dock', [False, True])
def test_an_abort_before_a_start_under_the_estop_ends_the_mission_where_it_is(returns_to_dock):
    mission, world, robot = started_under_the_estop('ab', returns_to_dock=returns_to_dock)
    assert mission.abort()
    assert (mission.state, robot.told) == (State.DONE, [])
    assert world.outcomes == [(tag, Outcome.SKIPPED) for tag in 'ab']
    assert not mission.abort()


@pytest.mark.parametrize('drive_seconds', [0.0, 10.0])
def test_an_abort_under_the_estop_moves_nothing_and_leaves_no_tag_at_hand(drive_seconds):
    world = World('ab', Robot(drive_seconds), returns_to_dock=True)
    world.mission.engage_estop()
    assert world.mission.abort()
    world.wait(100.0)
    assert 'dock' not in world.robot.told
    assert (world.state, world.mission.is_paused) == (State.RETURNING, True)
    assert (world.mission.target, world.mission.tag_at_hand) == (None, None)
    assert world.outcomes == [(tag, Outcome.SKIPPED) for tag in 'ab']
    world.mission.release_estop()
    assert world.mission.resume()
    world.wait(0.0)
    assert world.robot.told[-1] == 'dock'


def test_an_abort_of_a_return_under_the_estop_ends_the_mission():
    world = World('ab', returns_to_dock=True)
    world.mission.engage_estop()
    assert world.mission.abort()
    assert world.mission.abort()
    assert (world.state, world.mission.is_paused) == (State.DONE, False)
    assert world.robot.told == ['a', 'pause', 'stop']
    world.mission.release_estop()
    assert not world.mission.resume()


def test_events_tell_what_happened_and_how_bad_it_is():
    world = World('a')
    world.refuse()
    world.wait(1.0)
    world.mission.pause()
    world.mission.resume()
    world.answer()
    world.wait(1.0)
    assert world.events == [
        ("driving to tag 'a'", Severity.INFO),
        ("tag 'a': SIMULATOR_ERROR broken: trying again", Severity.WARN),
        ('paused', Severity.INFO),
        ('resumed', Severity.INFO),
        ('done: 1 tags read', Severity.INFO),
    ]


def looking(tag_ids='ab', **failures):
    """Return a world whose robot can look at each tag from three poses, and has left for the first one."""
    limits = replace(LIMITS, max_attempts=2, max_drives=1, retry_delay_seconds=0.0, dwell_seconds=0.0)
    world = World(tag_ids, Robot(1.0, poses=3, **failures), limits, require_visual_confirmation=True)
    world.wait(1.0)
    return world


def test_a_robot_that_cannot_reach_a_pose_looks_from_the_next():
    world = looking(a='blocked')
    assert world.robot.told == ['a', 'a2']
    assert (world.mission.phase, world.sent, world.recorded) == ('NAVIGATING', [], [])
    world.wait(1.0)
    world.confirm(True)
    assert world.answer()
    assert world.recorded == [Observation('a', Outcome.OK, '', 2, reading('a'), seen=True, pose=2)]
    assert ("tag 'a': UNREACHABLE blocked: trying pose 2 of 3", Severity.WARN) in world.events
    world.wait(0.0)
    assert world.robot.told[-1] == 'b'


def test_a_robot_whose_camera_does_not_see_the_tag_looks_from_the_next_pose():
    world = looking()
    world.confirm(False, False)
    assert world.robot.told == ['a', 'a2']
    assert (world.state, world.recorded) == (State.DRIVING, [])
    world.wait(1.0)
    world.confirm(False, True)
    assert world.answer()
    assert world.recorded == [Observation('a', Outcome.OK, '', 5, reading('a'), seen=True, pose=2)]


@pytest.mark.parametrize(
    ('blocked', 'outcome', 'detail', 'attempts'),
    [
        (['a', 'a2', 'a3'], Outcome.UNREACHABLE, 'pose 1: blocked; pose 2: blocked; pose 3: blocked', 0),
        (['a'], Outcome.NOT_CONFIRMED, 'pose 1: blocked; pose 2: not in view; pose 3: not in view', 4),
        (['a2', 'a3'], Outcome.NOT_CONFIRMED, 'pose 1: not in view; pose 2: blocked; pose 3: blocked', 2),
    ],
)
def test_a_tag_that_no_pose_shows_has_one_outcome_with_every_reason(blocked, outcome, detail, attempts):
    world = looking('a', **dict.fromkeys(blocked, 'blocked'))
    for pose in ('a', 'a2', 'a3'):
        world.confirm(*([] if pose in blocked else [False, False]))
        world.wait(1.0)
    seen = False if attempts else None
    assert world.recorded == [Observation('a', outcome, detail, attempts, seen=seen, pose=3)]
    assert world.state is State.DONE


def test_a_pose_is_kept_over_a_pause_and_an_estop_between_two_looks():
    world = looking()
    world.confirm(False)
    world.mission.pause()
    world.confirm(False)
    assert world.robot.told == ['a', 'pause']
    world.mission.engage_estop()
    world.wait(5.0)
    assert world.state is State.DRIVING
    assert not world.mission.resume()
    world.mission.release_estop()
    assert world.mission.resume()
    world.wait(0.0)
    assert world.robot.told == ['a', 'pause', 'resume', 'a2']
    world.wait(1.0)
    world.confirm(True)
    assert world.answer()
    assert [(each.outcome, each.pose) for each in world.recorded] == [(Outcome.OK, 2)]


def test_a_tag_that_is_skipped_or_aborted_between_two_looks_says_from_which_poses():
    world = looking('abc')
    world.confirm(False, False)
    assert world.mission.skip()
    world.wait(0.0, 1.0)
    assert world.robot.told[-1] == 'b'
    world.confirm(False, False)
    assert world.mission.abort()
    assert world.recorded == [
        Observation('a', Outcome.SKIPPED, 'pose 1: not in view; pose 2: skipped', 2, seen=False, pose=2),
        Observation('b', Outcome.SKIPPED, 'pose 1: not in view; pose 2: aborted', 2, seen=False, pose=2),
        Observation('c', Outcome.SKIPPED, 'aborted', 0),
    ]


class BlockableRobot(SimulatedDrive):
    """A drive with two poses for each tag. It fails on demand, and knows whether the robot moves."""

    def __init__(self):
        super().__init__(0.02)
        self.is_blocked = self.is_moving = False

    def count_poses(self, tag_id):  # noqa: ARG002
        return 2

    def start_return(self, now_seconds):
        super().start_return(now_seconds)
        self.is_moving = True

    def arrival(self, now_seconds):
        arrival = super().arrival(now_seconds)
        self.is_moving = not arrival
        return arrival and Arrival('blocked' if self.is_blocked else '')

    def stop(self):
        self.is_moving = False

    pause = stop


class AnyOrder(RuleBasedStateMachine):
    """Pauses, blocked ways, all kinds of replies, losses and restarts in any order, with a real report."""

    tag_ids = ('1', '2', '3', '4')

    def __init__(self):
        super().__init__()
        self._folder = tempfile.TemporaryDirectory()
        self.path = Path(self._folder.name, 'report.jsonl')
        self.now = 0.0
        self.accepted = {}  # tag id -> value of the accepted reading
        self.report = None
        self.begin()

    def begin(self):
        """Start a mission like the node: it does not visit a tag in the report again."""
        self.report = Report(self.path)
        done = {each.tag_id for each in self.report.observations if each.outcome is Outcome.OK}
        assert done == self.accepted.keys(), 'a restart forgot a reading'
        self.requests, self.abandoned, self.closed = [], [], []
        self.robot = BlockableRobot()
        self.mission = Mission(
            [tag_id for tag_id in self.tag_ids if tag_id not in done],
            self,
            self.robot,
            LIMITS,
            require_visual_confirmation=True,
            returns_to_dock=True,
        )
        self.mission.step(self.now)

    def send(self, request):
        assert not self.mission.is_paused
        assert request.tag_id not in self.accepted
        self.requests.append(request)

    def abandon(self, request):
        self.abandoned.append(request)
        return Outcome.TIMEOUT

    def record(self, observation):
        self.report.record(observation)
        self.closed.append(observation.tag_id)

    def note(self, event, severity):
        assert event
        assert severity in Severity

    @rule(seconds=st.sampled_from([0.0, 0.02, 0.5, 1.0, 2.0, 5.0]))
    def time_passes(self, seconds):
        self.now += seconds
        self.mission.step(self.now)

    @rule()
    def pause(self):
        self.mission.pause()

    @rule()
    def resume(self):
        self.mission.resume()

    @rule()
    def dock(self):
        target, closed = self.mission.target, list(self.closed)
        assert self.mission.dock() == bool(target)
        assert self.closed == closed

    @rule(is_blocked=st.booleans())
    def the_way_is(self, is_blocked):
        self.robot.is_blocked = is_blocked

    @invariant()
    def the_robot_moves_only_on_its_way(self):
        is_on_its_way = self.mission.state in (State.DRIVING, State.DOCKING, State.RETURNING)
        assert not self.robot.is_moving or (is_on_its_way and not self.mission.is_paused)

    @precondition(lambda self: self.requests)
    @rule(data=st.data(), confirmed=st.booleans())
    def some_confirmation_comes(self, data, confirmed):
        """In time, late, or twice."""
        request = data.draw(st.sampled_from(self.requests))
        if request.service is Service.CONFIRM:
            was_taken = self.mission.on_reply(request, SEEN[confirmed], 'as the camera says')
            assert not (was_taken and request in self.abandoned)

    @precondition(lambda self: self.requests)
    @rule(data=st.data(), value=st.floats(-1e6, 1e6), tag=st.sampled_from(['own', *tag_ids]))
    def some_reading_comes(self, data, value, tag):
        request = data.draw(st.sampled_from(self.requests))
        tag_id = request.tag_id if tag == 'own' else tag
        if request.service is not Service.READ:
            return
        was_taken = self.mission.on_reply(request, Outcome.OK, reading=reading(tag_id, value))
        assert not (was_taken and request in self.abandoned)
        if was_taken and tag_id == request.tag_id:
            assert tag_id not in self.accepted
            self.accepted[tag_id] = value

    @precondition(lambda self: self.requests)
    @rule(data=st.data(), outcome=st.sampled_from([Outcome.UNKNOWN_TAG, Outcome.SIMULATOR_ERROR]))
    def some_refusal_comes(self, data, outcome):
        request = data.draw(st.sampled_from(self.requests))
        if request.service is Service.READ:
            self.mission.on_reply(request, outcome, 'as the bridge says')

    @rule()
    def skip(self):
        target, closed = self.mission.target, list(self.closed)
        assert self.mission.skip() == bool(target)
        assert self.closed in (closed, [*closed, target])
        if target:
            assert target in self.closed

    @rule()
    def abort(self):
        is_running = self.mission.state is not State.DONE
        assert self.mission.abort() == is_running
        assert sorted(self.closed) == sorted(self.mission.tag_ids)
        assert not self.mission.is_paused or not is_running

    @invariant()
    def a_tag_is_closed_once(self):
        assert len(set(self.closed)) == len(self.closed)
        assert list(self.mission.outcomes) == self.closed

    @rule(torn=st.booleans())
    def killed_and_started_again(self, torn):
        self.report.close()
        if torn:  # killed in the middle of a line
            with self.path.open('ab') as file:
                file.write(b'{"tag_id": "1", "outcome": "OK", "det')
        self.begin()

    @invariant()
    def no_reading_is_lost_or_there_twice(self):
        read = [each for each in self.report.observations if each.outcome is Outcome.OK]
        assert {each.tag_id: each.reading.values['temperature'] for each in read} == self.accepted
        assert len(read) == len(self.accepted)

    def teardown(self):
        """Left alone, the mission always ends with an outcome for every tag."""
        self.mission.resume()
        # The longest time at each of two poses: two drives and three attempts of each service, with their
        # delays, and the dwell.
        longest = 2 * (2 * 0.02 + 0.5 + 2 * (3 * 2.0 + 0.5 + 1.0) + 1.0)
        for _ in range(int(len(self.tag_ids) * longest / 0.5) + 10):
            self.mission.resume()  # at the dock, once more
            self.now += 0.5
            self.mission.step(self.now)
        assert self.mission.state is State.DONE
        assert {each.tag_id for each in self.report.observations} == set(self.tag_ids)
        self.no_reading_is_lost_or_there_twice()
        self.report.close()
        self._folder.cleanup()


@pytest.fixture
def no_disk(monkeypatch):
    """Do not wait for the disk: test_report.py tests that a report does."""
    monkeypatch.setattr(os, 'fsync', lambda _file: None)


TestAnyOrder = pytest.mark.usefixtures('no_disk')(AnyOrder.TestCase)
TestAnyOrder.settings = settings(max_examples=300, stateful_step_count=40)
