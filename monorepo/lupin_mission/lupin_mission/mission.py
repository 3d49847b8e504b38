"""
The mission's state machine: visits each tag once, and records one outcome for each. Does not import ROS.

The caller passes the time to step(), in seconds of a monotonic clock. doc/state_machine.md draws the states.
"""

from collections import deque
from collections.abc import Callable, Iterable
from enum import Enum, IntEnum
from functools import partial
from typing import Protocol

from lupin_readings.report_line import Observation, Outcome, Reading

from lupin_mission.drive import DEPENDENCY_TIMEOUT, Arrival, Drive
from lupin_mission.settings import Settings
from lupin_mission.visit import NO_REPLY, SERVICES, Attempts, Phase, Request, Service, Visit

STUCK_DRIVES = 2  # After so many in a row, the robot needs a person.


class State(Enum):
    """
    The state of a mission. A pause does not change it.

    DOCKING and DOCKED interrupt a mission that has tags left; RETURNING ends it.
    """

    PREPARE = 'prepare'  # until the first step without a pause
    DRIVING = 'driving'
    INSPECTING = 'inspecting'
    DOCKING = 'docking'
    DOCKED = 'docked'
    RETURNING = 'returning'
    DONE = 'done'


class Severity(IntEnum):
    """The severity of an event, with the values of MissionState."""

    INFO = 0
    WARN = 1
    ERROR = 2


class MissionPorts(Protocol):
    """The interface that the mission needs; the node implements it."""

    def send(self, request: Request) -> None:
        """Start a request without waiting. The reply arrives by on_reply()."""

    def abandon(self, request: Request) -> Outcome:
        """Give up a request; return TIMEOUT, or NO_SERVICE if the service was not available."""

    def record(self, observation: Observation) -> None:
        """Store an observation permanently."""

    def note(self, event: str, severity: Severity, code: str = '') -> None:
        """Report an event in one line; `code` is the team's code for what stops or delays the mission."""


class Mission:
    """Drives to each tag, has it confirmed if required, reads it, and records one outcome."""

    retry_delay_seconds = 0.5  # doubles with each further attempt

    def __init__(
        self,
        tag_ids: Iterable[str],
        ports: MissionPorts,
        drive: Drive,
        settings: Settings,
    ):
        """Visit `tag_ids`, which are all different, in this order."""
        self.tag_ids = tuple(tag_ids)
        self.state = State.PREPARE
        self.is_paused = False
        self.is_estop_engaged = False
        self.outcomes: dict[str, Outcome] = {}
        self._ports = ports
        self._drive = drive
        self._settings = settings
        self._now = 0.0
        self._active_seconds = 0.0  # This clock stops during a pause. Only the timeouts do not use it.
        self._to_visit = deque(map(Visit, self.tag_ids))
        self._visit = Visit('')
        self._dwell_end = 0.0
        self._attempts = Attempts(0.0, 0.0)
        self._is_under_way = False
        self._stuck_drives = 0
        self._tag_held_for_stuck_drives: str | None = None
        self._request: Request | None = None

    @property
    def target(self) -> str | None:
        """The tag that the robot drives to or stands at; None before the first and after the last tag."""
        return self._visit.tag_id if self.state in (State.DRIVING, State.INSPECTING) else None

    @property
    def phase(self) -> str:
        """
        NAVIGATING, CONFIRMING, SCANNING or PUBLISHING, as in MissionState; '' if no mission runs.

        SCANNING lasts until the robot leaves the tag; PUBLISHING only while an observation is recorded.
        """
        if not self.target:
            return ''
        if self._scan_reading_done:
            return 'SCANNING' if self.state is State.INSPECTING else 'NAVIGATING'
        return self._visit.phase.value

    @property
    def tag_at_hand(self) -> str | None:
        """The tag that the robot stands at; None while it drives, before the first and after the last tag."""
        return self._visit.tag_id if self.state is State.INSPECTING else None

    @property
    def _scan_reading_done(self) -> bool:
        """The latch: this visit has its outcome and sends no more requests, even after a pause."""
        return self._visit.phase is Phase.LATCHED

    def step(self, now_seconds: float) -> None:
        """
        Do what is due at this time. Call this often, and after every reply.

        The first step starts the mission, unless the e-stop is engaged.
        """
        if not self.is_paused:
            self._active_seconds += now_seconds - self._now
        self._now = now_seconds
        if self._request and now_seconds >= self._request.deadline_seconds:
            request, self._request = self._request, None
            outcome = self._ports.abandon(request)
            self._attempt_failed(outcome, f'{request.service.value}: {NO_REPLY[outcome]}')
        while not self.is_paused and (act := self._due_action()):
            act()

    def _due_action(self) -> Callable[[], None] | None:
        """Return the next action; None while the mission waits for a time, the robot or a reply."""
        if self.state is State.DONE or self._request:
            return None
        if self.state in (State.PREPARE, State.DOCKED):
            return self._drive_on
        if self.target and self._scan_reading_done:
            return self._drive_on if self._active_seconds >= self._dwell_end else None
        if self._is_under_way:
            arrival = self._drive.arrival(self._active_seconds)
            return partial(self._end_drive, arrival) if arrival else None
        if self._active_seconds < self._attempts.due_seconds:
            return None
        return self._ask if self.state is State.INSPECTING else self._set_off

    def reorder(self, tag_ids: Iterable[str]) -> None:
        """Visit the same tags in another order, unless the mission has begun, or was aborted."""
        if self.state is State.PREPARE:
            self.tag_ids = tuple(tag_ids)
            self._to_visit = deque(map(Visit, self.tag_ids))

    # The drives

    def _drive_on(self) -> None:
        if self._to_visit:
            self._visit = self._to_visit.popleft()
            self._depart(State.DRIVING)
        elif self._settings.dock:
            self._depart(State.RETURNING)
        else:
            self._end()

    def _depart(self, state: State) -> None:
        """Set off now, or after the pause."""
        self.state = state
        self._is_under_way = False
        self._turn_to(Phase.NAVIGATING)
        if not self.is_paused:
            self._set_off()

    @property
    def _goal(self) -> str:
        return f'tag {self._visit.tag_id!r}' if self.state is State.DRIVING else 'the dock'

    def _set_off(self) -> None:
        self._is_under_way = True
        self._attempts.count += 1
        if self._attempts.count == 1:
            self._ports.note(f'driving to {self._goal}', Severity.INFO)
        if self.state is State.DRIVING:
            self._drive.start(self._visit.tag_id, self._active_seconds, self._visit.pose)
        else:
            self._drive.start_return(self._active_seconds)

    def _end_drive(self, arrival: Arrival) -> None:
        self._is_under_way = False
        self._stuck_drives = self._stuck_drives + 1 if arrival.is_stuck else 0
        is_last = self._attempts.count >= self._settings.nav_max_attempts
        if arrival.needs_person:
            self._hold(arrival.failure, arrival.code)
        elif self._is_stuck_at_new_tag():
            self._tag_held_for_stuck_drives = self._visit.tag_id
            self._hold(f'the robot is stuck: it did not move in {STUCK_DRIVES} drives: {arrival.failure}')
        elif arrival.failure and not (is_last or arrival.is_final):
            event = f'the drive to {self._goal} failed, trying again: {arrival.failure}'
            self._ports.note(event, Severity.WARN)
            self._attempts.try_again(self._active_seconds)
        elif self.state is not State.DRIVING:
            miss = f'it stands {arrival.miss} from its pose there' if arrival.miss else ''
            self._end_return(arrival.failure or miss)
        elif not arrival.failure:
            self._arrive(arrival.miss)
        elif not self._try_next_pose(Outcome.UNREACHABLE, arrival.failure):
            self._close(Outcome.UNREACHABLE, arrival.failure)
            self._dwell_end = self._active_seconds

    def _arrive(self, miss: str) -> None:
        """Begin to inspect the tag, or set off to its next pose if the robot has missed this one."""
        detail = f'the robot stands {miss} from its pose' if miss else ''
        if detail and self._try_next_pose(Outcome.UNREACHABLE, detail):
            return
        self._visit.miss = detail
        if detail:
            event = f'tag {self._visit.tag_id!r}: {detail}: inspecting the tag from there'
            self._ports.note(event, Severity.WARN)
        self.state = State.INSPECTING
        self._dwell_end = self._active_seconds + self._settings.flower_scan_dwell_s
        has_camera = self._settings.require_visual_confirmation
        self._turn_to(Phase.CONFIRMING if has_camera else Phase.SCANNING)

    def _is_stuck_at_new_tag(self) -> bool:
        """Return whether to hold for stuck drives. A second time at the same tag, its goal is the problem."""
        is_new = self._visit.tag_id != self._tag_held_for_stuck_drives
        return self.state is State.DRIVING and is_new and self._stuck_drives >= STUCK_DRIVES

    def _hold(self, reason: str, code: str = '') -> None:
        """Pause with an error; resume() sets off to the same goal again, with all its attempts."""
        self.is_paused = True
        self._drive.pause()
        self._depart(self.state)
        self._stuck_drives = 0
        self._ports.note(f'{reason}: resume to go on', Severity.ERROR, code)

    def _end_return(self, failure: str) -> None:
        if failure:
            self._ports.note(f'the robot is not at the dock: {failure}', Severity.WARN)
        if self.state is State.RETURNING:
            self._end()
            return
        self.state = State.DOCKED
        self.is_paused = True
        self._ports.note('paused after the return: resume to go on with the tags left', Severity.INFO)

    def _try_next_pose(self, outcome: Outcome, detail: str) -> bool:
        """Set off to the next pose of the tag, because this one has failed; return False if there is none."""
        visit = self._visit
        count = self._drive.count_poses(visit.tag_id)
        if visit.pose >= count:
            return False
        next_pose = f'trying pose {visit.pose + 1} of {count}'
        self._ports.note(f'tag {visit.tag_id!r}: {outcome.value}, {next_pose}: {detail}', Severity.WARN)
        visit.failures.append(detail)
        visit.pose += 1
        self._depart(State.DRIVING)
        return True

    def _end(self) -> None:
        self.state = State.DONE
        self.is_paused = False
        self._ports.note(f'done: {self.count(Outcome.OK)} tags read', Severity.INFO)

    # The commands of people

    def pause(self) -> bool:
        """Stop driving, sending requests and dwelling; return False if already paused, or done."""
        if self.is_paused or self.state is State.DONE:
            return False
        self.is_paused = True
        if self.state is not State.PREPARE:
            self._drive.pause()
        self._ports.note('paused', Severity.INFO)
        return True

    def resume(self) -> bool:
        """Continue after a pause or the e-stop; return False if not paused, or still under the e-stop."""
        if not self.is_paused or self.is_estop_engaged:
            return False
        self.is_paused = False
        self._drive.resume()
        self._ports.note('resumed', Severity.INFO)
        return True

    def engage_estop(self) -> None:
        """Pause in any state but DONE, until the e-stop is released and resume() is called."""
        self.is_estop_engaged = True
        self.pause()

    def release_estop(self) -> None:
        """Allow resume(). The robot does not move before that call."""
        self.is_estop_engaged = False

    def dock(self) -> bool:
        """
        Return to the dock and pause there; return False without a dock, or if the robot visits no tag.

        resume() continues with the remaining tags, and with the target unless it has its outcome.
        """
        if not (self.target and self._settings.dock):
            return False
        self._ports.note('heading to dock', Severity.INFO)
        self._stop_work()
        if not self._scan_reading_done:
            self._to_visit.appendleft(self._visit)
        self.is_paused = self.is_estop_engaged
        self._depart(State.DOCKING)
        return True

    def skip(self) -> bool:
        """
        Leave the target; return False if there is none.

        The target is recorded as SKIPPED. If it already has its outcome, only the rest of the dwell is
        skipped. During a pause the robot stays where it is until resume().
        """
        if not self.target:
            return False
        self._ports.note(f'tag {self.target!r} skipped', Severity.WARN)
        self._leave('skipped')
        return True

    def abort(self) -> bool:
        """
        End the mission: the target and all unvisited tags are SKIPPED; return False if it is done.

        The robot returns to its dock if it has one. In two cases it stays where it is: if the return itself
        is aborted, and if the mission has not begun to drive.
        """
        if self.state is State.DONE:
            return False
        self._ports.note('aborted', Severity.WARN)
        was_visiting = bool(self.target)
        self._skip_all('aborted')
        if was_visiting:
            self.is_paused = self.is_estop_engaged  # then resume() lets the robot return
            self._drive_on()
        else:
            self._end()
        return True

    def end(self, reason: str) -> None:
        """End the mission where the robot is: the target and all unvisited tags are SKIPPED."""
        if self.state is not State.DONE:
            self._skip_all(reason)
            self._end()

    def _skip_all(self, detail: str) -> None:
        if self.target:
            self._leave(detail)
        elif self.state is not State.PREPARE:
            self._drive.stop()
        while self._to_visit:
            self._visit = self._to_visit.popleft()
            self._close(Outcome.SKIPPED, detail)

    def _stop_work(self) -> None:
        """Stop the drive to the tag, or give up the request there."""
        if self.state is State.DRIVING:
            self._drive.stop()
        if self._request:
            self._ports.abandon(self._request)
            self._request = None

    def _leave(self, detail: str) -> None:
        self._stop_work()
        if not self._scan_reading_done:
            self._close(Outcome.SKIPPED, detail)
        self._dwell_end = self._active_seconds

    def count(self, outcome: Outcome) -> int:
        """Return the number of tags with this outcome."""
        return list(self.outcomes.values()).count(outcome)

    # The requests and their replies

    def _turn_to(self, phase: Phase) -> None:
        self._visit.phase = phase
        self._attempts = Attempts(self._active_seconds, self.retry_delay_seconds)

    def _ask(self) -> None:
        self._visit.requests += 1
        self._attempts.count += 1
        service = SERVICES[self._visit.phase]
        deadline_seconds = self._now + self._settings.timeout_seconds(service)
        self._request = Request(service, self._visit.tag_id, deadline_seconds)
        self._ports.send(self._request)

    def on_reply(
        self, request: Request, outcome: Outcome, detail: str = '', reading: Reading | None = None
    ) -> bool:
        """
        Accept the reply to a request; return False if it is no longer pending.

        OK means that the camera sees the tag, or that the bridge has sent this reading, and it is valid.
        """
        if request is not self._request:
            return False
        self._request = None
        tag_id = request.tag_id
        if request.service is Service.CONFIRM:
            self._visit.seen = outcome is Outcome.OK
        if outcome is not Outcome.OK:
            self._attempt_failed(outcome, detail)
        elif reading is None:
            self._turn_to(Phase.SCANNING)
        else:
            self.mark_scan_ok(tag_id, reading)
        return True

    def _attempt_failed(self, outcome: Outcome, detail: str) -> None:
        tag_id = self._visit.tag_id
        is_last = outcome is Outcome.UNKNOWN_TAG or self._attempts.count >= self._settings.max_attempts
        if not is_last:
            code = DEPENDENCY_TIMEOUT if outcome in NO_REPLY else ''
            self._ports.note(f'tag {tag_id!r}: {outcome.value}, trying again: {detail}', Severity.WARN, code)
            self._attempts.try_again(self._active_seconds)
        elif outcome is not Outcome.NOT_CONFIRMED or not self._try_next_pose(outcome, detail):
            self.mark_scan_failed(tag_id, outcome, detail)

    def mark_scan_ok(self, tag_id: str, reading: Reading) -> None:
        """Record the reading of the tag at hand; raises ValueError for another tag or a second outcome."""
        self._require_at_hand(tag_id)
        self._close(Outcome.OK, '', reading)

    def mark_scan_failed(self, tag_id: str, outcome: Outcome, detail: str) -> None:
        """Record why the tag at hand has no reading; raises ValueError like mark_scan_ok()."""
        self._require_at_hand(tag_id)
        self._close(outcome, detail)

    def _require_at_hand(self, tag_id: str) -> None:
        if tag_id != self.tag_at_hand or self._scan_reading_done:
            raise ValueError(f'tag {tag_id!r} is not being scanned')

    def _close(self, outcome: Outcome, detail: str, reading: Reading | None = None) -> None:
        """Record the outcome of the visit, and latch it."""
        observation = self._visit.observation(outcome, detail, reading)
        self.outcomes[observation.tag_id] = observation.outcome
        self._visit.phase = Phase.PUBLISHING
        self._ports.record(observation)
        self._request = None
        self._visit.phase = Phase.LATCHED
