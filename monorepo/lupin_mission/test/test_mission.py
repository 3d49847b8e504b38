"""The state machine of a mission, without ROS. The test supplies time and replies."""

from dataclasses import replace

import pytest
from lupin_mission.drive import Arrival, SimulatedDrive
from lupin_mission.mission import Mission, State
from lupin_mission.settings import Settings
from lupin_readings.report_line import Outcome, Reading

SETTINGS = Settings(dock_pose='', flower_scan_dwell_s=1.0, scan_timeout_s=2.0)
LONGEST_MISSION_SECONDS = 100_000.0  # simulated
STUCK = Arrival('aborted', is_stuck=True)
MISSED = Arrival(miss='0.39 m and 32 degrees')
NEEDS_PERSON = Arrival('Nav2 sleeps', needs_person=True)


def reading(tag_id: str) -> Reading:
    return Reading(tag_id, (1, 2), 43200.0, {'temperature': 20.0})


class Robot(SimulatedDrive):
    """
    A drive that records what it is told: 'a' for the first pose of tag a, 'a2' for its second, and so on.

    The first drives end with `arrivals`, one after the other, and the others where they should.
    """

    def __init__(self, drive_seconds=0.0, arrivals=(), poses=1):
        super().__init__(drive_seconds)
        self.told, self.arrivals = [], list(arrivals)
        self.count_poses = lambda _tag_id: poses

    def start(self, tag_id, now_seconds, pose=1):
        self._set_off(f'{tag_id}{pose}' if pose > 1 else tag_id, now_seconds)

    def start_return(self, now_seconds):
        self._set_off('dock', now_seconds)

    def _set_off(self, goal, now_seconds):
        super().start_return(now_seconds)
        self.told.append(goal)
        self._arrival = self.arrivals.pop(0) if self.arrivals else Arrival()

    def arrival(self, now_seconds):
        return super().arrival(now_seconds) and self._arrival

    def pause(self):
        self.told.append('pause')

    def resume(self):
        self.told.append('resume')

    def stop(self):
        self.told.append('stop')


class World:
    """
    MissionPorts that record what the mission does.

    `trace` has it in order: what the robot is told; 'confirm' and 'read' for the requests, and 'give-up' for
    the end of one without a reply; 'a=OK' for the outcome of tag a, and 'a=OK@2' if from its second pose.
    `events` has what the mission tells people: the severity, the text, and the code if there is one.
    """

    def __init__(self, tag_ids='ab', *, is_estop_engaged=False, **options):
        self.now = 0.0
        self.sent, self.abandoned, self.recorded, self.events = [], [], [], []
        of_robot = options.keys() & {'drive_seconds', 'arrivals', 'poses'}
        self.robot = Robot(**{name: options.pop(name) for name in of_robot})
        self.trace = self.robot.told
        delay_seconds = options.pop('retry_delay_seconds', Mission.retry_delay_seconds)
        self.mission = Mission(tag_ids, self, self.robot, replace(SETTINGS, **options))
        self.mission.retry_delay_seconds = delay_seconds
        if is_estop_engaged:
            self.mission.engage_estop()
        self.mission.step(self.now)

    def send(self, request):
        assert not self.mission.is_paused
        assert request.tag_id not in self.mission.outcomes
        self.sent.append(request)
        self.trace.append(request.service.value)

    def abandon(self, request):
        self.abandoned.append(request)
        self.trace.append('give-up')
        return Outcome.TIMEOUT

    def record(self, observation):
        assert self.mission.phase == ('PUBLISHING' if self.mission.target else '')
        self.recorded.append(observation)
        pose = f'@{observation.pose}' if observation.pose > 1 else ''
        self.trace.append(f'{observation.tag_id}={observation.outcome.value}{pose}')

    def note(self, event, severity, code=''):
        self.events.append(f'{severity.name} {event} {code}'.rstrip())

    def wait(self, seconds):
        self.now += seconds
        assert self.now < LONGEST_MISSION_SECONDS, 'the mission does not end'
        self.mission.step(self.now)

    @property
    def summary(self):
        """The state, the target, the phase, and whether the mission is paused, in words."""
        mission = self.mission
        assert mission.tag_at_hand == (mission.target if mission.state is State.INSPECTING else None)
        words = (mission.state.value, mission.target, mission.phase, 'paused' if mission.is_paused else '')
        return ' '.join(filter(None, words))

    def answer(self, outcome=Outcome.OK, detail='', found=None):
        assert self.mission.on_reply(self.sent[-1], outcome, detail, found)

    def read(self):
        self.answer(found=reading(self.sent[-1].tag_id))

    def confirm(self, outcome):
        self.answer(outcome, 'not in view')
        self.wait(0.0)

    def reply_late(self):
        """Reply to all requests that were given up."""
        for request in self.abandoned:
            assert not self.mission.on_reply(request, Outcome.OK, reading=reading(request.tag_id))
            assert not self.mission.on_reply(request, Outcome.SIMULATOR_ERROR)

    def play(self, script):
        """
        Do what the words of a script say, one after the other.

        A number is a time in seconds, and one after `~` a time in which nothing happens. Where people ask
        something of the mission, it must do it, or refuse it after `no-`.
        """
        acts = {
            'estop': self.mission.engage_estop,
            'release': self.mission.release_estop,
            'answer': self.read,
            'seen': lambda: self.confirm(Outcome.OK),
            'unseen': lambda: self.confirm(Outcome.NOT_CONFIRMED),
            'bad': lambda: self.answer(Outcome.BAD_READING, 'it has no value'),
            'refused': lambda: self.answer(Outcome.SIMULATOR_ERROR, 'broken'),
            'unknown': lambda: self.answer(Outcome.UNKNOWN_TAG, 'broken'),
            'late': self.reply_late,
            'end': lambda: self.mission.end('the node was ended'),
        }
        for word in script.split():
            asked = word.removeprefix('no-')
            if word in acts:
                acts[word]()
            elif asked in ('pause', 'resume', 'skip', 'abort', 'dock'):
                assert getattr(self.mission, asked)() == (asked == word), word
            else:
                before = list(self.trace)
                self.wait(float(word.removeprefix('~')))
                assert self.trace == before or not word.startswith('~')


CAMERA, DOCK = {'require_visual_confirmation': True}, {'dock_pose': '0 0 0'}
DOCK_AFTER_1_S = {'drive_seconds': 1.0, **DOCK}
LOOKS = {
    **CAMERA,
    'drive_seconds': 1.0,
    'poses': 3,
    'max_attempts': 2,
    'nav_max_attempts': 1,
    'retry_delay_seconds': 0.0,
    'flower_scan_dwell_s': 0.0,
}
# By name: the options of the world, then the script => the trace that it leads to => the summary at its end.
SCENARIOS = {
    'the delay before a further attempt grows up to 10 seconds': (
        {'retry_delay_seconds': 3.0, 'max_attempts': 5, 'scan_timeout_s': 5.0},
        'refused ~2.5 0.5 refused ~5.5 0.5 refused ~9.5 0.5 refused ~9.5 0.5'
        ' => a read read read read read => inspecting a SCANNING',
    ),
    'a dock that is not reached is tried again, and the mission ends': (
        {'tag_ids': '', 'drive_seconds': 1.0, 'arrivals': [Arrival('the door is shut')] * 2, **DOCK},
        'no-dock ~1 0.5 ~1 => dock dock => done',
    ),
    'nothing is asked in a pause, a reply still counts, and the tag is not scanned again': (
        {'tag_ids': 'a', **CAMERA},
        'pause seen 100 resume 0 pause answer 100 resume 0.5 pause 100 resume 0.5'
        ' => a confirm pause resume read pause a=OK resume pause resume => done',
    ),
    'a reading that cannot be is asked for again, and an unknown tag is not': (
        {},
        'bad 2 bad 2 bad 2 unknown 1 => a read read read a=BAD_READING b read b=UNKNOWN_TAG => done',
    ),
    'a skip stops the robot, and ends the dwell with its outcome': (
        {'tag_ids': 'abc', 'drive_seconds': 10.0},
        'skip 0 10 answer skip 0 skip 0 => a stop a=SKIPPED b read b=OK c stop c=SKIPPED => done',
    ),
    'an abort in a pause returns too, and an abort on the return ends it': (
        {'drive_seconds': 10.0, **DOCK},
        'pause abort abort => a pause stop a=SKIPPED b=SKIPPED dock stop => done',
    ),
    'a mission docks from the way, from the dwell and from a pause, and an abort there skips the tags left': (
        DOCK_AFTER_1_S,
        'dock 1 resume 0 1 answer pause dock 1 resume 0 dock 1 abort 1'
        ' => a stop dock resume a read a=OK pause dock resume b stop dock stop b=SKIPPED => done',
    ),
    'a mission that needs a person can be skipped or aborted': (
        {'arrivals': [NEEDS_PERSON] * 2},
        'skip resume 0 abort no-resume => a pause stop a=SKIPPED resume b pause stop b=SKIPPED => done',
    ),
    'the e-stop holds a drive, the requests, the dwell and the return until it is released and resumed': (
        DOCK_AFTER_1_S,
        'estop no-resume 1.9 release 0.05 resume 1 refused estop 1.9 release 0.05 resume 0.5'
        ' answer estop 1.9 release 0.05 resume 1 abort estop no-resume 1.9 release 0.05 resume 1'
        ' => a pause resume read pause resume read a=OK pause resume b stop b=SKIPPED dock pause resume'
        ' => done',
    ),
    'the delay stops in a pause, the timeout does not, and a late reply is not taken for the next': (
        {},
        'pause 2 100 resume 0.25 pause 1 resume 0.25 late'
        ' => a read pause give-up resume pause resume read => inspecting a SCANNING',
    ),
    'a mission that docked goes on with the tags left': (
        {'tag_ids': 'abc', **DOCK_AFTER_1_S},
        '1 dock no-dock 1 100 resume 0 late 1 answer 1 1 answer 1 1 answer 1 1'
        ' => a read give-up dock resume a read a=OK b read b=OK c read c=OK dock => done',
    ),
    'a failure that is final is not tried again': (
        {'arrivals': [Arrival('cut off', is_final=True)]},
        '=> a a=UNREACHABLE b read => inspecting b SCANNING',
    ),
    'drives without a move pause the mission once for each tag': (
        {'arrivals': [STUCK] * 5},
        '0.5 resume 0 0.5 => a a pause resume a a a=UNREACHABLE b pause => driving b NAVIGATING paused',
    ),
    'after a pause the next tag has two drives without a move again': (
        {'arrivals': [STUCK] * 3},
        '0.5 skip resume 0 => a a pause stop a=SKIPPED resume b => driving b NAVIGATING',
    ),
    'a drive that moved is between two that did not': (
        {'tag_ids': 'a', 'arrivals': [STUCK, Arrival('aborted'), STUCK], 'nav_max_attempts': 3},
        '0.5 1 => a a a a=UNREACHABLE => done',
    ),
    'an abort before a start under the e-stop ends the mission where it is': (
        {'drive_seconds': 10.0, 'is_estop_engaged': True, **DOCK},
        '10 abort no-abort => a=SKIPPED b=SKIPPED => done',
    ),
    'an abort on the way under the e-stop returns after the resume': (
        {'drive_seconds': 10.0, **DOCK},
        'estop abort 100 release resume 0 => a pause stop a=SKIPPED b=SKIPPED resume dock => returning',
    ),
    'the end of the node closes every tag, and does not move the robot': (
        DOCK,
        'end end no-abort no-skip no-pause late => a read give-up a=SKIPPED b=SKIPPED => done',
    ),
    'a pose is kept over a pause and an e-stop between two looks': (
        LOOKS,
        '1 unseen pause unseen estop 5 no-resume release resume 0 1 seen answer'
        ' => a confirm confirm pause resume a2 confirm read a=OK@2 => inspecting a SCANNING',
    ),
}


@pytest.mark.parametrize(('options', 'scenario'), SCENARIOS.values(), ids=SCENARIOS)
def test_what_happens_leads_to(options, scenario):
    script, trace, summary = scenario.split('=>')
    world = World(**options)
    world.play(script)
    assert world.trace == trace.split()
    assert world.summary == summary.strip()


OFF = 'the robot stands 0.39 m and 32 degrees from its pose'
# By name: the options of the world, the script, and of each observation the tag and the outcome, its detail,
# the number of requests, whether the camera has seen the tag, and the last pose.
OBSERVATIONS = {
    'a robot that stands off its poses': (
        {'tag_ids': 'abc', 'arrivals': [MISSED] * 6, **LOOKS, 'poses': 2},
        '1 1 seen answer 0 1 1 unseen unseen 1 1 skip',
        [
            ('a=OK', OFF, 2, True, 2),
            ('b=NOT_CONFIRMED', f'pose 1: {OFF}; pose 2: not in view; {OFF}', 2, False, 2),
            ('c=SKIPPED', f'pose 1: {OFF}; pose 2: skipped; {OFF}', 1, None, 2),
        ],
    ),
    'a tag that is not in view, and then is not reached': (
        {'tag_ids': 'a', 'arrivals': [Arrival(), *[Arrival('blocked')] * 2], **LOOKS},
        '1 unseen unseen 1 1',
        [('a=NOT_CONFIRMED', 'pose 1: not in view; pose 2: blocked; pose 3: blocked', 2, False, 3)],
    ),
    'the requests before a return to the dock, and the pose': (
        {
            'arrivals': [Arrival(), MISSED, *[Arrival()] * 2, *[Arrival('no')] * 4],
            'poses': 2,
            **CAMERA,
            **DOCK,
        },
        'unseen 0.5 unseen 1 unseen unseen dock 0 resume 0 seen answer 1 0.5 0.5',
        [('a=OK', '', 6, True, 2), ('b=UNREACHABLE', 'pose 1: no; pose 2: no', 0, None, 2)],
    ),
}


@pytest.mark.parametrize(('options', 'script', 'expected'), OBSERVATIONS.values(), ids=OBSERVATIONS)
def test_the_observation_tells_of(options, script, expected):
    world = World(**options)
    world.play(script)
    assert [
        (f'{each.tag_id}={each.outcome.value}', each.detail, each.attempts, each.seen, each.pose)
        for each in world.recorded
    ] == expected
    for each in world.recorded:
        assert each.reading == (reading(each.tag_id) if each.outcome is Outcome.OK else None)


def test_a_mission_prepares_until_its_first_step_without_a_pause():
    mission = Mission('ab', World(''), Robot(), SETTINGS)
    assert (mission.state, mission.target, mission.tag_at_hand) == (State.PREPARE, None, None)
    assert mission.phase == ''
    mission.reorder('ba')
    assert mission.pause()
    mission.step(0.0)
    assert mission.state is State.PREPARE
    assert mission.resume()
    mission.step(0.0)
    assert (mission.target, mission.tag_ids) == ('b', ('b', 'a'))


def test_a_scan_has_one_outcome_and_only_the_tag_at_hand_has_one():
    mission = World('ab').mission
    with pytest.raises(ValueError, match='not being scanned'):
        mission.mark_scan_ok('b', reading('b'))
    mission.mark_scan_ok('a', reading('a'))
    with pytest.raises(ValueError, match='not being scanned'):
        mission.mark_scan_failed('a', Outcome.TIMEOUT, '')


def test_events_tell_what_happened_and_how_bad_it_is():
    arrivals = [STUCK, STUCK, Arrival(), MISSED, MISSED, Arrival(), MISSED]
    world = World('abcd', arrivals=arrivals, poses=2, **CAMERA, **DOCK)
    world.play('0.5 resume 0 pause resume seen refused 1 2 1 answer 1 1 skip 0 unseen dock 0 abort')
    assert world.events == [
        "INFO driving to tag 'a'",
        "WARN the drive to tag 'a' failed, trying again: aborted",
        'ERROR the robot is stuck: it did not move in 2 drives: aborted: resume to go on',
        'INFO resumed',
        "INFO driving to tag 'a'",
        'INFO paused',
        'INFO resumed',
        "WARN tag 'a': SIMULATOR_ERROR, trying again: broken",
        "WARN tag 'a': TIMEOUT, trying again: read: no reply before the timeout dependency_timeout",
        "INFO driving to tag 'b'",
        f"WARN tag 'b': UNREACHABLE, trying pose 2 of 2: {OFF}",
        "INFO driving to tag 'b'",
        f"WARN tag 'b': {OFF}: inspecting the tag from there",
        "WARN tag 'b' skipped",
        "INFO driving to tag 'c'",
        "WARN tag 'c': NOT_CONFIRMED, trying again: not in view",
        'INFO heading to dock',
        'INFO driving to the dock',
        'WARN the robot is not at the dock: it stands 0.39 m and 32 degrees from its pose there',
        'INFO paused after the return: resume to go on with the tags left',
        'WARN aborted',
        'INFO done: 1 tags read',
    ]
