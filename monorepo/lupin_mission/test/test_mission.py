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


def reading(tag_id: str, value: float = 20.0) -> Reading:
    return Reading(tag_id, (1, 2), 43200.0, {'temperature': value})


class World:
    """MissionPorts that record what the mission does."""

    def __init__(self, tag_ids='ab', drive=None, limits=LIMITS, now=0.0, **options):
        self.now = now
        self.sent, self.abandoned, self.recorded, self.events = [], [], [], []
        self.mission = Mission(tag_ids, self, drive or SimulatedDrive(0.0), limits, **options)
        self.mission.start(self.now)

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
    def asked(self):
        return [(request.service, request.tag_id) for request in self.sent]

    @property
    def outcomes(self):
        return [(each.tag_id, each.outcome) for each in self.recorded]

    def answer(self, **fields):
        tag_id = self.sent[-1].tag_id
        return self.mission.on_reading(self.sent[-1].number, fields.get('reading', reading(tag_id)))


def test_a_mission_is_ready_until_it_is_started():
    mission = Mission('a', None, SimulatedDrive(0.0), LIMITS)
    assert (mission.state, mission.target, mission.tag_at_hand) == (State.READY, None, None)
    assert mission.phase == ''


def test_each_tag_is_read_once_and_in_order():
    world = World('abc')
    while world.mission.state is not State.DONE:
        assert world.answer()
        world.wait(1.0)
    assert world.asked == [(Service.READ, tag) for tag in 'abc']
    assert world.outcomes == [(tag, Outcome.OK) for tag in 'abc']
    assert [(each.reading, each.attempts) for each in world.recorded] == [(reading(tag), 1) for tag in 'abc']


def test_the_time_before_the_start_does_not_count():
    world = World(drive=SimulatedDrive(10.0), now=1000.0)
    world.wait(9.75)
    assert world.mission.state is State.DRIVING
    world.wait(0.25)
    assert world.mission.tag_at_hand == 'a'


def test_a_tag_is_not_left_before_the_dwell_is_over():
    world = World()
    world.answer()
    world.wait(0.9)
    assert world.mission.tag_at_hand == 'a'
    world.wait(0.2)
    assert world.mission.tag_at_hand == 'b'


def test_the_scan_may_take_longer_than_the_dwell():
    world = World()
    world.wait(1.5)
    assert world.mission.tag_at_hand == 'a'
    world.answer()
    world.wait(0.0)
    assert world.mission.tag_at_hand == 'b'


def test_a_pause_in_the_dwell_does_not_scan_the_tag_again():
    world = World('a')
    world.answer()
    assert world.mission.pause()
    world.wait(100.0)
    assert world.mission.state is State.INSPECTING
    assert world.mission.resume()
    world.wait(0.5)
    assert world.mission.state is State.INSPECTING
    world.wait(0.5)
    assert world.mission.state is State.DONE
    assert world.outcomes == [('a', Outcome.OK)]
    assert len(world.sent) == 1


def test_nothing_is_asked_in_a_pause_and_a_reply_still_counts():
    world = World()
    world.mission.pause()
    assert world.answer()
    world.wait(100.0)
    assert world.mission.tag_at_hand == 'a'
    assert len(world.sent) == 1
    assert world.outcomes == [('a', Outcome.OK)]


def test_a_tag_that_is_confirmed_in_a_pause_is_read_after_it():
    world = World('a', require_visual_confirmation=True)
    world.mission.pause()
    world.mission.on_confirmation(1, True, 'seen')
    world.wait(1.0)
    assert world.asked == [(Service.CONFIRM, 'a')]
    world.mission.resume()
    world.wait(0.0)
    assert world.asked == [(Service.CONFIRM, 'a'), (Service.READ, 'a')]


def test_attempts_do_not_leak_from_tag_to_tag():
    """Two failures at a, then two at b: the third attempt at b is still made."""
    world = World('ab')
    for tag_id in 'ab':
        for _ in range(LIMITS.max_attempts - 1):
            world.mission.on_refusal(world.sent[-1].number, Outcome.SIMULATOR_ERROR, 'broken')
            world.wait(10.0)
        assert world.sent[-1].tag_id == tag_id
        assert world.answer()
        world.wait(1.0)
    assert world.outcomes == [('a', Outcome.OK), ('b', Outcome.OK)]


def test_attempts_do_not_leak_from_confirming_to_reading():
    world = World('a', require_visual_confirmation=True)
    for _ in range(LIMITS.max_attempts - 1):
        world.mission.on_confirmation(world.sent[-1].number, False, 'not seen')
        world.wait(10.0)
    world.mission.on_confirmation(world.sent[-1].number, True, '')
    world.wait(0.0)
    for _ in range(LIMITS.max_attempts - 1):
        world.mission.on_refusal(world.sent[-1].number, Outcome.SIMULATOR_ERROR, 'broken')
        world.wait(10.0)
    assert world.answer()
    assert world.outcomes == [('a', Outcome.OK)]


def test_a_pause_stops_the_drive_and_is_told_from_no_pause():
    world = World(drive=(motor := Motor(10.0)))
    world.wait(6.0)
    assert [world.mission.resume(), world.mission.pause(), world.mission.pause()] == [False, True, False]
    world.wait(100.0)
    assert [world.mission.resume(), world.mission.resume()] == [True, False]
    world.wait(3.9)
    assert world.mission.state is State.DRIVING
    world.wait(0.2)
    assert world.mission.tag_at_hand == 'a'
    assert motor.told == ['a', 'pause', 'resume']


def test_a_timeout_gives_the_request_up_and_asks_again_later_and_later():
    world = World('a')
    times = []
    while world.mission.state is not State.DONE:
        before = len(world.sent)
        world.wait(0.125)
        if len(world.sent) > before:
            times.append(world.now)
    assert times == [2.0 + 0.5, 2.5 + 2.0 + 1.0]
    assert world.abandoned == world.sent
    assert world.outcomes == [('a', Outcome.TIMEOUT)]
    assert world.recorded[0].attempts == 3


def test_the_delay_before_a_further_attempt_grows_up_to_10_seconds():
    world = World('a', limits=Limits(retry_delay_seconds=3.0, max_attempts=5))
    delays = []
    for _ in range(4):
        failed = world.now
        world.mission.on_refusal(world.sent[-1].number, Outcome.SIMULATOR_ERROR, 'broken')
        attempts = len(world.sent)
        while len(world.sent) == attempts:
            world.wait(0.5)
        delays.append(world.now - failed)
    assert delays == [3.0, 6.0, 10.0, 10.0]


def test_the_delay_of_a_skipped_tag_is_not_that_of_the_next():
    world = World('ab')
    world.mission.on_refusal(1, Outcome.SIMULATOR_ERROR, 'broken')
    assert world.mission.skip()
    world.wait(0.0)
    assert world.asked == [(Service.READ, 'a'), (Service.READ, 'b')]
    world.mission.on_refusal(2, Outcome.SIMULATOR_ERROR, 'broken')
    world.wait(0.5)  # the first delay again, not the second
    assert len(world.sent) == 3


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
    world.mission.on_refusal(world.sent[0].number, Outcome.UNKNOWN_TAG, 'no such tag')
    world.wait(1.0)
    assert world.recorded[0] == Observation('a', Outcome.UNKNOWN_TAG, 'no such tag', 1)
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
        assert world.answer(reading=bad)
        world.wait(2.0)
    assert world.outcomes == [('a', outcome)]
    assert len(world.sent) == 3


def test_a_late_reply_is_not_taken_for_the_next_ones():
    world = World('ab')
    late = world.sent[0]
    world.wait(2.0, 0.5)
    assert world.answer()
    world.wait(1.0)
    assert world.mission.tag_at_hand == 'b'
    assert not world.mission.on_reading(late.number, reading('a'))
    assert not world.mission.on_refusal(late.number, Outcome.SIMULATOR_ERROR, '')
    assert world.outcomes == [('a', Outcome.OK)]


def test_the_bridge_is_asked_only_after_the_camera_has_confirmed_the_tag():
    world = World('a', require_visual_confirmation=True)
    assert world.asked == [(Service.CONFIRM, 'a')]
    world.mission.on_confirmation(1, False, 'no tag in view')
    world.wait(0.5)
    assert world.asked == [(Service.CONFIRM, 'a')] * 2
    world.mission.on_confirmation(2, True, 'seen')
    world.wait(0.0)
    assert world.asked[2:] == [(Service.READ, 'a')]
    world.answer()
    assert world.outcomes == [('a', Outcome.OK)]


def test_a_tag_that_is_never_confirmed_is_never_read():
    world = World('a', require_visual_confirmation=True)
    while world.mission.state is not State.DONE:
        world.mission.on_confirmation(world.sent[-1].number, False, 'other tags: 7')
        world.wait(0.25)
    assert world.asked == [(Service.CONFIRM, 'a')] * 3
    assert world.recorded == [Observation('a', Outcome.NOT_CONFIRMED, 'other tags: 7', 3, seen=False)]


def test_a_scan_has_one_outcome_and_only_the_tag_at_hand_has_one():
    mission = World('ab').mission
    with pytest.raises(ValueError, match='not being scanned'):
        mission.mark_scan_ok('b', reading('b'))
    mission.mark_scan_ok('a', reading('a'))
    with pytest.raises(ValueError, match='not being scanned'):
        mission.mark_scan_failed('a', Outcome.TIMEOUT, '')


def test_a_tag_given_twice_is_refused():
    with pytest.raises(ValueError, match='twice'):
        World('aba')


def test_a_skip_on_the_way_stops_the_robot_even_to_the_last_tag():
    world = World('ab', drive=(motor := Motor()))
    assert world.mission.skip()
    world.wait(0.0)
    assert (world.mission.target, world.mission.phase) == ('b', 'NAVIGATING')
    assert world.recorded == [Observation('a', Outcome.SKIPPED, 'skipped', 0)]
    assert world.mission.skip()
    world.wait(0.0)
    assert motor.told == ['a', 'stop', 'b', 'stop']
    assert (world.mission.state, world.sent) == (State.DONE, [])


def test_a_tag_that_is_skipped_while_it_is_scanned_awaits_no_reply():
    world = World('ab', drive=(motor := Motor(0.0)))
    late = world.sent[0]
    assert world.mission.skip()
    world.wait(0.0)
    assert (world.abandoned, motor.told) == ([late], ['a', 'b'])  # there is no drive to stop
    assert not world.mission.on_reading(late.number, reading('a'))
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


def test_a_skip_in_a_pause_moves_nothing_until_it_is_over():
    world = World('ab')
    world.mission.pause()
    assert world.mission.skip()
    world.wait(10.0)
    assert world.mission.target == 'a'
    world.mission.resume()
    world.wait(0.0)
    assert world.mission.target == 'b'


@pytest.mark.parametrize('is_paused', [False, True])
def test_an_abort_while_the_camera_is_awaited_closes_every_tag_left(is_paused):
    world = World('abc', require_visual_confirmation=True)
    awaited = world.sent[0]
    assert world.mission.phase == 'CONFIRMING'
    if is_paused:
        world.mission.pause()
    assert world.mission.abort()
    assert world.mission.state is State.DONE
    assert world.abandoned == [awaited]
    assert world.recorded == [Observation(tag, Outcome.SKIPPED, 'aborted', int(tag == 'a')) for tag in 'abc']
    assert not world.mission.on_confirmation(awaited.number, True, '')
    assert not world.mission.abort()
    assert not world.mission.skip()
    assert not world.mission.pause()


class Motor(SimulatedDrive):
    """A drive that fails for these reasons by tag, and records what it is told."""

    def __init__(self, drive_seconds=10.0, **failures):
        super().__init__(drive_seconds)
        self.told = []
        self._failures = failures

    def start(self, tag_id, now_seconds, pose=1):  # noqa: ARG002
        SimulatedDrive.start_return(self, now_seconds)
        self.told.append(tag_id)
        self._tag_id = tag_id

    def start_return(self, now_seconds):
        super().start_return(now_seconds)
        self.told.append('return')
        self._tag_id = 'dock'

    def pause(self):
        self.told.append('pause')

    def resume(self):
        self.told.append('resume')

    def arrival(self, now_seconds):
        arrival = super().arrival(now_seconds)
        return arrival and Arrival(self._failures.get(self._tag_id, ''))

    def stop(self):
        self.told.append('stop')


def test_a_drive_that_fails_is_tried_again_and_then_the_tag_is_unreachable():
    world = World('ab', drive=(motor := Motor(1.0, a='the aisle is blocked')))
    world.wait(1.0)
    assert (world.mission.target, world.recorded) == ('a', [])
    retry = "the drive to tag 'a' failed: the aisle is blocked: trying again"
    assert (retry, Severity.WARN) in world.events
    world.wait(0.25)
    assert motor.told == ['a']
    world.wait(0.25)
    assert motor.told == ['a', 'a']
    world.wait(1.0)
    assert world.recorded == [Observation('a', Outcome.UNREACHABLE, 'the aisle is blocked', 0)]
    assert (world.mission.target, world.sent) == ('b', [])
    world.wait(1.0)
    assert world.mission.tag_at_hand == 'b'
    assert motor.told == ['a', 'a', 'b']


def test_each_tag_has_all_its_drives():
    world = World('abc', drive=(motor := Motor(1.0, a='no', b='no')), limits=Limits(max_drives=3))
    departures = []
    while motor.told[-1] != 'c':
        before = len(motor.told)
        world.wait(0.25)
        if len(motor.told) > before:
            departures.append(world.now)
    assert departures == [1.5, 3.5, 4.5, 6.0, 8.0, 9.0]  # 0.5 s and 1 s after the end of the drive
    assert motor.told == [*'aaabbb', 'c']
    assert world.outcomes == [(tag, Outcome.UNREACHABLE) for tag in 'ab']


def test_a_tag_is_skipped_in_its_second_drive_too():
    world = World('ab', drive=(motor := Motor(1.0, a='no')))
    world.wait(1.0, 0.5)
    assert world.mission.skip()
    world.wait(0.0)
    assert motor.told == ['a', 'a', 'stop', 'b']
    assert world.outcomes == [('a', Outcome.SKIPPED)]


def test_the_phase_is_publishing_only_while_an_observation_is_recorded():
    world = World('a')
    phases = []
    world.record = lambda _observation: phases.append(world.mission.phase)
    world.answer()
    assert phases == ['PUBLISHING']
    assert world.mission.phase == 'SCANNING'


def test_the_robot_returns_to_its_dock_after_the_last_tag():
    world = World('a', drive=(motor := Motor(1.0)), returns_to_dock=True)
    world.wait(1.0)
    world.answer()
    world.wait(1.0)
    assert (world.mission.state, world.mission.target, world.mission.phase) == (State.RETURNING, None, '')
    assert not world.mission.skip()
    world.wait(1.0)
    assert world.mission.state is State.DONE
    assert motor.told == ['a', 'return']


def test_an_abort_returns_too_and_an_abort_on_the_return_ends_it():
    world = World('ab', drive=(motor := Motor()), returns_to_dock=True)
    assert world.mission.abort()
    assert world.mission.state is State.RETURNING
    assert world.mission.abort()
    assert world.mission.state is State.DONE
    assert motor.told == ['a', 'stop', 'return', 'stop']
    assert world.outcomes == [(tag, Outcome.SKIPPED) for tag in 'ab']


def test_an_abort_before_a_drive_is_tried_again_leaves_no_drive():
    world = World('a', drive=(motor := Motor(1.0, a='no')))
    world.wait(1.0)
    assert world.mission.abort()
    world.wait(10.0)
    assert world.mission.state is State.DONE
    assert motor.told == ['a', 'stop']


def test_a_return_that_fails_is_tried_again_and_then_a_warning():
    world = World('', drive=(motor := Motor(1.0, dock='the door is shut')), returns_to_dock=True)
    world.wait(1.0)
    assert world.mission.state is State.RETURNING
    world.wait(0.5, 1.0)
    assert world.mission.state is State.DONE
    assert motor.told == ['return', 'return']
    assert ('the robot is not at the dock: the door is shut', Severity.WARN) in world.events


def to_the_dock(world):
    world.wait(1.0)
    assert world.mission.dock()
    assert not world.mission.dock()
    world.wait(0.0)
    assert (world.mission.state, world.mission.target) == (State.DOCKING, None)
    assert not world.mission.is_paused
    world.wait(1.0)
    assert (world.mission.state, world.mission.is_paused) == (State.DOCKED, True)


def test_a_mission_that_docked_goes_on_with_the_tags_left():
    world = World('abc', drive=(motor := Motor(1.0)), returns_to_dock=True)
    to_the_dock(world)
    late = world.sent[0]
    world.wait(100.0)
    assert world.abandoned == [late]
    assert (motor.told, world.outcomes) == (['a', 'return'], [])
    assert world.mission.resume()
    world.wait(0.0)
    assert not world.mission.on_reading(late.number, reading('a'))
    while world.mission.state is not State.RETURNING:
        world.wait(1.0)
        world.answer()
    assert motor.told == ['a', 'return', 'resume', *'abc', 'return']
    assert world.outcomes == [(tag, Outcome.OK) for tag in 'abc']
    world.wait(1.0)
    assert world.mission.state is State.DONE


def test_a_mission_docks_from_the_way_from_the_dwell_and_from_a_pause():
    world = World('ab', drive=(motor := Motor(1.0)), returns_to_dock=True)
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
    assert motor.told == ['a', 'stop', 'return', 'resume', 'a', 'pause', 'return', 'resume', 'b']
    assert world.outcomes == [('a', Outcome.OK)]


def test_an_abort_at_the_dock_skips_the_tags_left():
    world = World('abc', drive=Motor(1.0), returns_to_dock=True)
    to_the_dock(world)
    assert world.mission.abort()
    world.wait(1.0)
    assert (world.mission.state, world.mission.is_paused) == (State.DONE, False)
    assert world.outcomes == [(tag, Outcome.SKIPPED) for tag in 'abc']


def test_a_dock_that_is_not_reached_pauses_the_mission_too():
    world = World('a', drive=Motor(1.0, dock='the door is shut'), returns_to_dock=True)
    assert world.mission.dock()
    for seconds in (1.0, 0.5, 1.0):
        world.wait(seconds)
    assert (world.mission.state, world.mission.is_paused) == (State.DOCKED, True)
    assert ('the robot is not at the dock: the door is shut', Severity.WARN) in world.events


def test_a_mission_without_a_dock_does_not_dock():
    world = World('a', drive=(motor := Motor(1.0)))
    assert not world.mission.dock()
    assert (world.mission.target, motor.told) == ('a', ['a'])


class Wheels(SimulatedDrive):
    """A drive whose arrivals the test sets."""

    def __init__(self, *arrivals):
        super().__init__(0.0)
        self.arrivals, self.goals = list(arrivals), []

    def start(self, tag_id, now_seconds, pose=1):
        self.goals.append(tag_id)
        super().start(tag_id, now_seconds, pose)

    def arrival(self, now_seconds):  # noqa: ARG002
        return self.arrivals.pop(0) if self.arrivals else None


def test_a_failure_that_is_final_is_not_tried_again():
    world = World('ab', drive=(wheels := Wheels(Arrival('cut off', is_final=True))))
    assert wheels.goals == ['a', 'b']
    assert world.recorded == [Observation('a', Outcome.UNREACHABLE, 'cut off', 0)]


def test_a_drive_that_needs_a_person_pauses_the_mission_and_keeps_the_tag():
    world = World('ab', drive=(wheels := Wheels(Arrival('Nav2 sleeps', needs_person=True))))
    assert world.events[-1] == ('Nav2 sleeps: resume to go on', Severity.ERROR)
    assert (world.mission.is_paused, world.mission.target, world.outcomes) == (True, 'a', [])
    world.wait(100.0)
    assert wheels.goals == ['a']
    wheels.arrivals = [Arrival('blocked'), Arrival()]  # all attempts are left
    assert world.mission.resume()
    world.wait(0.0, 0.5)
    assert wheels.goals == ['a', 'a', 'a']
    assert world.mission.tag_at_hand == 'a'


@pytest.mark.parametrize('do', ['skip', 'abort'])
def test_a_mission_that_needs_a_person_can_be_skipped_and_aborted(do):
    world = World('ab', drive=(wheels := Wheels(Arrival('Nav2 sleeps', needs_person=True))))
    assert getattr(world.mission, do)()
    world.mission.resume()
    world.wait(0.0)
    assert world.outcomes[0] == ('a', Outcome.SKIPPED)
    assert wheels.goals == {'skip': ['a', 'b'], 'abort': ['a']}[do]


def test_two_drives_in_a_row_without_a_move_pause_the_mission_once_for_each_tag():
    stuck = Arrival('aborted', is_stuck=True)
    world = World('ab', drive=(wheels := Wheels(stuck, stuck)))
    world.wait(0.5)
    event = 'the robot is stuck: it did not move in 2 drives: aborted: resume to go on'
    assert world.events[-1] == (event, Severity.ERROR)
    assert (world.mission.is_paused, world.mission.target, world.outcomes) == (True, 'a', [])
    wheels.arrivals = [stuck, stuck]
    assert world.mission.resume()
    world.wait(0.0, 0.5)
    assert world.outcomes == [('a', Outcome.UNREACHABLE)]  # it was the goal
    wheels.arrivals = [stuck]
    world.wait(0.0)
    assert (world.mission.is_paused, world.mission.target) == (True, 'b')  # the third in a row


def test_a_drive_that_moved_is_between_two_that_did_not():
    stuck = Arrival('aborted', is_stuck=True)
    world = World('a', drive=Wheels(stuck, Arrival('aborted'), stuck), limits=Limits(max_drives=3))
    for seconds in (0.5, 1.0):
        world.wait(seconds)
    assert world.outcomes == [('a', Outcome.UNREACHABLE)]


WAYS = {
    'to driving': lambda _world: None,
    'to inspecting': lambda world: world.wait(1.0),
    'to dwelling': lambda world: world.wait(1.0) or world.answer(),
    'to returning': lambda world: world.mission.abort(),
}


@pytest.mark.parametrize('go', WAYS.values(), ids=WAYS)
def test_the_estop_holds_every_state_until_it_is_released_and_resumed(go):
    world = World('ab', drive=(motor := Motor(1.0)), returns_to_dock=True)
    go(world)
    before = (world.mission.state, world.mission.target, len(world.sent))
    world.mission.engage_estop()
    assert motor.told[-1] == 'pause'
    assert not world.mission.resume()
    world.wait(1.9)
    world.mission.release_estop()
    world.wait(0.05)
    assert (world.mission.state, world.mission.target, len(world.sent)) == before
    assert world.mission.resume()
    world.wait(100.0, 100.0)
    assert (world.mission.state, world.mission.target, len(world.sent)) != before


def test_a_mission_that_starts_under_the_estop_sets_off_after_the_resume():
    motor = Motor()
    mission = Mission('a', World(''), motor, LIMITS)
    mission.engage_estop()
    mission.start(0.0)
    mission.step(10.0)
    assert (mission.state, motor.told) == (State.READY, [])
    mission.release_estop()
    assert mission.resume()
    mission.step(20.0)
    assert (mission.state, motor.told) == (State.DRIVING, ['resume', 'a'])


@pytest.mark.parametrize('returns_to_dock', [False, True])
def test_an_abort_before_a_start_under_the_estop_ends_the_mission_where_it_is(returns_to_dock):
    world, motor = World(''), Motor()
    mission = Mission('ab', world, motor, LIMITS, returns_to_dock=returns_to_dock)
    mission.engage_estop()
    mission.start(0.0)
    assert mission.abort()
    assert (mission.state, motor.told) == (State.DONE, [])
    assert world.outcomes == [(tag, Outcome.SKIPPED) for tag in 'ab']
    assert not mission.abort()


def test_an_abort_under_the_estop_moves_nothing():
    world = World('ab', drive=(motor := Motor()), returns_to_dock=True)
    world.mission.engage_estop()
    assert world.mission.abort()
    world.wait(100.0)
    assert motor.told == ['a', 'pause', 'stop']
    assert world.outcomes == [(tag, Outcome.SKIPPED) for tag in 'ab']
    world.mission.release_estop()
    assert world.mission.resume()
    world.wait(0.0)
    assert world.mission.state is State.RETURNING
    assert motor.told[-1] == 'return'


def test_an_abort_at_a_tag_under_the_estop_leaves_no_tag_at_hand():
    world = World('ab', drive=(motor := Motor(0.0)), returns_to_dock=True)
    world.mission.engage_estop()
    assert world.mission.abort()
    world.wait(1.0)
    found = world.mission
    assert (found.state, found.target, found.tag_at_hand) == (State.RETURNING, None, None)
    assert found.is_paused
    assert found.abort()
    world.wait(1.0)
    assert (found.state, found.is_paused) == (State.DONE, False)
    assert motor.told == ['a', 'pause', 'stop']
    found.release_estop()
    assert not found.resume()


def test_a_mission_can_be_paused_and_aborted_from_its_start_on_and_not_before():
    mission = Mission('a', World(''), SimulatedDrive(10.0), LIMITS)
    assert not mission.pause()
    mission.start(0.0)
    assert mission.pause()
    assert mission.abort()


def test_events_tell_what_happened_and_how_bad_it_is():
    world = World('a')
    world.mission.on_refusal(1, Outcome.SIMULATOR_ERROR, 'broken')
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


class Looks(SimulatedDrive):
    """A drive with three poses for each tag; those of `failures` cannot be reached."""

    def __init__(self, *failures):
        super().__init__(1.0)
        self.poses, self._failures = [], failures

    def count_poses(self, tag_id):  # noqa: ARG002
        return 3

    def start(self, tag_id, now_seconds, pose=1):
        self.poses.append((tag_id, pose))
        super().start(tag_id, now_seconds, pose)

    def arrival(self, now_seconds):
        arrival = super().arrival(now_seconds)
        return arrival and Arrival('blocked' if self.poses[-1][1] in self._failures else '')


def looking_world(*failures, tag_ids='ab', **options):
    limits = replace(LIMITS, max_attempts=2, max_drives=1, retry_delay_seconds=0.0, dwell_seconds=0.0)
    return World(tag_ids, Looks(*failures), limits, require_visual_confirmation=True, **options)


def confirm(world, *replies):
    for is_seen in replies:
        assert world.mission.on_confirmation(world.sent[-1].number, is_seen, 'not in view')
        world.wait(0.0)


def test_a_robot_that_cannot_reach_a_pose_looks_from_the_next():
    world = looking_world(1)
    drive = world.mission._drive
    world.wait(1.0)
    assert drive.poses == [('a', 1), ('a', 2)]
    assert world.mission.phase == 'NAVIGATING'
    assert world.sent == world.recorded == []
    world.wait(1.0)
    confirm(world, True)
    assert world.answer()
    (found,) = world.recorded
    assert (found.outcome, found.detail, found.attempts) == (Outcome.OK, '', 2)
    assert (found.seen, found.pose) == (True, 2)
    assert ("tag 'a': UNREACHABLE blocked: trying pose 2 of 3", Severity.WARN) in world.events
    world.wait(0.0)
    assert drive.poses[-1] == ('b', 1)


def test_a_robot_whose_camera_does_not_see_the_tag_looks_from_the_next_pose():
    world = looking_world()
    world.wait(1.0)
    confirm(world, False, False)
    assert world.mission._drive.poses == [('a', 1), ('a', 2)]
    assert (world.mission.state, world.recorded) == (State.DRIVING, [])
    world.wait(1.0)
    confirm(world, False, True)
    assert world.answer()
    assert [(each.outcome, each.attempts, each.seen, each.pose) for each in world.recorded] == [
        (Outcome.OK, 5, True, 2)
    ]


@pytest.mark.parametrize(
    ('failures', 'outcome', 'detail', 'attempts'),
    [
        ((1, 2, 3), Outcome.UNREACHABLE, 'pose 1: blocked; pose 2: blocked; pose 3: blocked', 0),
        ((1,), Outcome.NOT_CONFIRMED, 'pose 1: blocked; pose 2: not in view; pose 3: not in view', 4),
        ((2, 3), Outcome.NOT_CONFIRMED, 'pose 1: not in view; pose 2: blocked; pose 3: blocked', 2),
    ],
)
def test_a_tag_that_no_pose_shows_has_one_outcome_with_every_reason(failures, outcome, detail, attempts):
    world = looking_world(*failures, tag_ids='a')
    for pose in (1, 2, 3):
        world.wait(1.0)
        confirm(world, *([] if pose in failures else [False, False]))
    (found,) = world.recorded
    assert (found.outcome, found.detail, found.attempts) == (outcome, detail, attempts)
    assert found.seen is (False if attempts else None)
    assert found.pose == 3
    assert world.mission.state is State.DONE


def test_a_pose_is_kept_over_a_pause_and_an_estop_between_two_looks():
    world = looking_world()
    drive = world.mission._drive
    world.wait(1.0)
    world.mission.pause()
    confirm(world, False)
    assert drive.poses == [('a', 1)]
    world.mission.resume()
    world.wait(0.0)
    confirm(world, False)
    world.mission.engage_estop()
    world.wait(5.0)
    assert world.mission.state is State.DRIVING
    assert not world.mission.resume()
    world.mission.release_estop()
    assert world.mission.resume()
    world.wait(1.0)
    confirm(world, True)
    assert world.answer()
    assert [(each.outcome, each.pose) for each in world.recorded] == [(Outcome.OK, 2)]


def test_a_pause_at_the_last_refusal_keeps_the_robot_where_it_is():
    world = looking_world()
    world.wait(1.0)
    confirm(world, False)
    world.mission.pause()
    confirm(world, False)
    assert world.mission._drive.poses == [('a', 1)]
    world.mission.resume()
    world.wait(0.0)
    assert world.mission._drive.poses == [('a', 1), ('a', 2)]


def test_a_tag_that_is_skipped_or_aborted_between_two_looks_says_from_which_poses():
    world = looking_world(tag_ids='abc')
    world.wait(1.0)
    confirm(world, False, False)
    assert world.mission.skip()
    world.wait(0.0)
    assert world.mission._drive.poses[-1] == ('b', 1)
    world.wait(1.0)
    confirm(world, False, False)
    assert world.mission.abort()
    found = [(each.tag_id, each.outcome, each.detail, each.attempts, each.pose) for each in world.recorded]
    assert found == [
        ('a', Outcome.SKIPPED, 'pose 1: not in view; pose 2: skipped', 2, 2),
        ('b', Outcome.SKIPPED, 'pose 1: not in view; pose 2: aborted', 2, 2),
        ('c', Outcome.SKIPPED, 'aborted', 0, 1),
    ]
    assert [each.seen for each in world.recorded] == [False, False, None]


class Robot(SimulatedDrive):
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
        self.robot = Robot()
        self.mission = Mission(
            [tag_id for tag_id in self.tag_ids if tag_id not in done],
            self,
            self.robot,
            LIMITS,
            require_visual_confirmation=True,
            returns_to_dock=True,
        )
        self.mission.start(self.now)

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
            was_taken = self.mission.on_confirmation(request.number, confirmed, 'as the camera says')
            assert not (was_taken and request in self.abandoned)

    @precondition(lambda self: self.requests)
    @rule(data=st.data(), value=st.floats(-1e6, 1e6), tag=st.sampled_from(['own', *tag_ids]))
    def some_reading_comes(self, data, value, tag):
        request = data.draw(st.sampled_from(self.requests))
        tag_id = request.tag_id if tag == 'own' else tag
        if request.service is not Service.READ:
            return
        was_taken = self.mission.on_reading(request.number, reading(tag_id, value))
        assert not (was_taken and request in self.abandoned)
        if was_taken and tag_id == request.tag_id:
            assert tag_id not in self.accepted
            self.accepted[tag_id] = value

    @precondition(lambda self: self.requests)
    @rule(data=st.data(), outcome=st.sampled_from([Outcome.UNKNOWN_TAG, Outcome.SIMULATOR_ERROR]))
    def some_refusal_comes(self, data, outcome):
        request = data.draw(st.sampled_from(self.requests))
        if request.service is Service.READ:
            self.mission.on_refusal(request.number, outcome, 'as the bridge says')

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
