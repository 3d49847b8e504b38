"""
The mission's state machine: visits each tag once, and records one outcome for each. Does not import ROS.

The caller passes the time to step(), in seconds of a monotonic clock. doc/state_machine.md draws the states.
"""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Protocol

from lupin_greenhouse_bridge.display.report_line import Observation, Outcome, Reading

from lupin_mission.drive import Arrival, Drive

LONGEST_RETRY_DELAY_SECONDS = 10.0
STUCK_DRIVES = 2  # in a row, after which the robot needs a person


class State(Enum):
    """The state of a mission. A pause does not change it."""

    READY = 'ready'
    DRIVING = 'driving'
    INSPECTING = 'inspecting'
    RETURNING = 'returning'
    DONE = 'done'


class Severity(IntEnum):
    """The severity of an event, with the values of MissionState."""

    INFO = 0
    WARN = 1
    ERROR = 2


class Service(Enum):
    """The service that a request goes to."""

    CONFIRM = 'confirm'  # does the camera see this tag?
    READ = 'read'  # what is the climate at it?


@dataclass(frozen=True)
class Request:
    """One request to one service. Its unique number distinguishes a late reply from a current one."""

    number: int
    service: Service
    tag_id: str


@dataclass(frozen=True)
class Limits:
    """Times, in seconds, and the number of attempts."""

    dwell_seconds: float = 0.0  # the robot stays at a tag for at least this time
    confirm_timeout_seconds: float = 6.0  # of one attempt
    read_timeout_seconds: float = 5.0  # of one attempt
    max_attempts: int = 3  # of each service, per tag
    retry_delay_seconds: float = 0.5  # before the second attempt, or drive; doubles each time, up to 10
    max_drives: int = 2  # to each tag, and to the dock


class MissionPorts(Protocol):
    """The interface that the mission needs; the node implements it."""

    def send(self, request: Request) -> None:
        """Start a request without waiting. The reply arrives by on_confirmation, on_reading or on_refusal."""

    def abandon(self, request: Request) -> Outcome:
        """Give up a request; return TIMEOUT, or NO_SERVICE if the service was never available."""

    def record(self, observation: Observation) -> None:
        """Store an observation permanently; an exception ends the mission."""

    def note(self, event: str, severity: Severity) -> None:
        """Report an event in one line."""


class Mission:
    """Drives to each tag, has it confirmed if required, reads it, and records one outcome, whatever it is."""

    def __init__(
        self,
        tag_ids: Iterable[str],
        ports: MissionPorts,
        drive: Drive,
        limits: Limits,
        *,
        require_visual_confirmation: bool = False,
        returns_to_dock: bool = False,
    ):
        """Visit `tag_ids` in this order, each once; raises ValueError if one is repeated."""
        self.tag_ids = tuple(tag_ids)
        if len(set(self.tag_ids)) != len(self.tag_ids):
            raise ValueError('a tag id appears twice')
        self.state = State.READY
        self.is_paused = False
        self.is_estop_engaged = False
        self.outcomes: dict[str, Outcome] = {}
        self._ports = ports
        self._drive = drive
        self._limits = limits
        self._timeouts = {
            Service.CONFIRM: limits.confirm_timeout_seconds,
            Service.READ: limits.read_timeout_seconds,
        }
        self._returns_to_dock = returns_to_dock
        self._first_service = Service.CONFIRM if require_visual_confirmation else Service.READ
        self._to_visit = iter(self.tag_ids)
        self._tag_id: str | None = None
        self._drives = 0  # to this pose, or to the dock
        self._pose = 1  # of this tag, from 1
        self._failures: list[str] = []  # from the poses before
        self._seen: bool | None = None  # this tag, by the camera
        self._departure: float | None = None  # of the next of them, until the robot sets off
        self._stuck_drives = 0  # in a row
        self._stuck_tag_id: str | None = None  # at the last pause for them
        self._is_docking = self._is_docked = False  # with tags left
        self._now = 0.0
        self._active_seconds = 0.0  # stops during a pause; drive, dwell and back-off use it
        self._dwell_end = 0.0
        self._is_publishing = False
        self._scan_reading_done = False  # the latch: this visit has its outcome and sends no more requests
        self._requests = 0
        self._requests_before = 0  # of this visit
        self._request: Request | None = None  # the pending one
        self._deadline = 0.0  # of that request, on the clock that continues during a pause
        self._service = self._first_service
        self._attempts = 0  # of that service, at this tag
        self._next_attempt = 0.0
        self._retry_delay = 0.0

    @property
    def target(self) -> str | None:
        """The tag that the robot drives to or stands at; None before the first and after the last tag."""
        return self._tag_id if self.state in (State.DRIVING, State.INSPECTING) else None

    @property
    def phase(self) -> str:
        """
        NAVIGATING, CONFIRMING, SCANNING or PUBLISHING, as in MissionState; '' if no mission runs.

        SCANNING lasts until the robot leaves the tag; PUBLISHING only while an observation is recorded.
        """
        if not self.target:
            return ''
        if self._is_publishing:
            return 'PUBLISHING'
        if self.state is State.DRIVING:
            return 'NAVIGATING'
        is_confirming = self._service is Service.CONFIRM and not self._scan_reading_done
        return 'CONFIRMING' if is_confirming else 'SCANNING'

    @property
    def tag_at_hand(self) -> str | None:
        """The tag that the robot stands at; None while it drives, before the first and after the last tag."""
        return self._tag_id if self.state is State.INSPECTING else None

    def start(self, now_seconds: float) -> None:
        """Drive to the first tag, unless the e-stop is engaged."""
        self._now = now_seconds
        self.step(now_seconds)

    def step(self, now_seconds: float) -> None:
        """Do what is due at this time. After start(), call this often, and after every reply."""
        if not self.is_paused:
            self._active_seconds += now_seconds - self._now
        self._now = now_seconds
        if self._request and now_seconds >= self._deadline:
            request, self._request = self._request, None
            outcome = self._ports.abandon(request)
            self._attempt_failed(outcome, f'{request.service.value}: {_NO_REPLY[outcome]}')
        while not self.is_paused and self._take_transition():
            pass

    def _take_transition(self) -> bool:
        """Take the transition that is due; return whether there was one."""
        if self.state is State.READY or self._is_docked:
            self._is_docked = False
            self._drive_on()
        elif self.target and self._scan_reading_done:
            if self._active_seconds < self._dwell_end:
                return False
            self._drive_on()
        elif self._departure is not None:
            if self._active_seconds < self._departure:
                return False
            self._set_off()
        elif self.state in (State.DRIVING, State.RETURNING):
            arrival = self._drive.arrival(self._active_seconds)
            if not arrival:
                return False
            self._end_drive(arrival)
        elif self.state is State.DONE or self._request or self._active_seconds < self._next_attempt:
            return False
        else:
            self._ask()
        return True

    def _drive_on(self) -> None:
        self._take_up(next(self._to_visit, None))
        if self._tag_id is not None:
            self._depart(State.DRIVING)
        elif self._returns_to_dock:
            self._depart(State.RETURNING)
        else:
            self._end()

    def _take_up(self, tag_id: str | None) -> None:
        self._tag_id = tag_id
        self._requests_before = self._requests
        self._pose, self._failures, self._seen = 1, [], None

    def _depart(self, state: State) -> None:
        """Set off now, or after the pause."""
        self.state = state
        self._scan_reading_done = False
        self._drives = 0
        self._departure = self._active_seconds
        self._retry_delay = self._limits.retry_delay_seconds
        if not self.is_paused:
            self._set_off()

    @property
    def _goal(self) -> str:
        return 'the dock' if self.state is State.RETURNING else f'tag {self._tag_id!r}'

    def _set_off(self) -> None:
        self._departure = None
        self._drives += 1
        if self._drives == 1:
            self._ports.note(f'driving to {self._goal}', Severity.INFO)
        if self.state is State.RETURNING:
            self._drive.start_return(self._active_seconds)
        else:
            self._drive.start(self._tag_id, self._active_seconds, self._pose)

    def _end(self) -> None:
        self.state = State.DONE
        self.is_paused = self._is_docking = self._is_docked = False
        self._departure = None
        self._ports.note(f'done: {self.count(Outcome.OK)} tags read', Severity.INFO)

    def _hold(self, reason: str) -> None:
        """Pause with an error; resume() sets off to the same goal again, with all its attempts."""
        self.is_paused = True
        self._drive.pause()
        self._depart(self.state)
        self._stuck_drives = 0
        self._ports.note(f'{reason}: resume to go on', Severity.ERROR)

    def _end_drive(self, arrival: Arrival) -> None:
        self._stuck_drives = self._stuck_drives + 1 if arrival.is_stuck else 0
        # A second time at the same tag, the goal is at fault.
        can_hold = self.state is State.DRIVING and self._tag_id != self._stuck_tag_id
        if arrival.needs_person:
            self._hold(arrival.failure)
        elif can_hold and self._stuck_drives >= STUCK_DRIVES:
            self._stuck_tag_id = self._tag_id
            self._hold(f'the robot is stuck: it did not move in {STUCK_DRIVES} drives: {arrival.failure}')
        elif arrival.failure and not arrival.is_final and self._drives < self._limits.max_drives:
            event = f'the drive to {self._goal} failed: {arrival.failure}: trying again'
            self._ports.note(event, Severity.WARN)
            self._departure = self._next_try()
        elif self.state is State.RETURNING:
            if arrival.failure:
                self._ports.note(f'the robot is not at the dock: {arrival.failure}', Severity.WARN)
            if not self._is_docking:
                self._end()
                return
            self._is_docking, self._is_docked, self.is_paused = False, True, True
            self._ports.note('paused after the return: resume to go on with the tags left', Severity.INFO)
        elif arrival.failure:
            if not self._looks_again(Outcome.UNREACHABLE, arrival.failure):
                self._close(Outcome.UNREACHABLE, arrival.failure)
                self._dwell_end = self._active_seconds
        else:
            self.state = State.INSPECTING
            self._dwell_end = self._active_seconds + self._limits.dwell_seconds
            self._turn_to(self._first_service)

    def _looks_again(self, outcome: Outcome, detail: str) -> bool:
        """Set off to the next pose of the tag, because this one has failed; return False if there is none."""
        count = self._drive.count_poses(self._tag_id)
        if self._pose >= count:
            return False
        event = f'tag {self._tag_id!r}: {outcome.value} {detail}: trying pose {self._pose + 1} of {count}'
        self._ports.note(event, Severity.WARN)
        self._failures.append(detail)
        self._pose += 1
        self._depart(State.DRIVING)
        return True

    def _turn_to(self, service: Service) -> None:
        self._service = service
        self._attempts = 0
        self._next_attempt = self._active_seconds
        self._retry_delay = self._limits.retry_delay_seconds

    def _ask(self) -> None:
        self._requests += 1
        self._attempts += 1
        self._request = Request(self._requests, self._service, self._tag_id)
        self._deadline = self._now + self._timeouts[self._service]
        self._ports.send(self._request)

    def pause(self) -> bool:
        """Stop driving, sending requests and dwelling; return False if already paused, or not started."""
        if self.is_paused or self.state in (State.READY, State.DONE):
            return False
        self.is_paused = True
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
        if self.state is State.READY:
            self.is_paused = True
        else:
            self.pause()

    def release_estop(self) -> None:
        """Allow resume(). The robot does not move before that call."""
        self.is_estop_engaged = False

    def dock(self) -> bool:
        """
        Return to the dock and pause there; return False without a dock, or if the robot visits no tag.

        resume() continues with the remaining tags, and with the target unless it has its outcome.
        """
        if not (self.target and self._returns_to_dock):
            return False
        self._ports.note('heading to dock', Severity.INFO)
        self._stop_work()
        if not self._scan_reading_done:
            self._to_visit = itertools.chain([self._tag_id], self._to_visit)
        self._is_docking = True
        self.is_paused = self.is_estop_engaged
        self._depart(State.RETURNING)
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
        End the mission: the target and all unvisited tags are SKIPPED; return False if no mission runs.

        The robot returns to its dock if it has one. In two cases it stays where it is: if the return itself
        is aborted, and if the mission was started under the e-stop and has not begun to drive.
        """
        has_not_set_off = self.state is State.READY
        if self.state is State.DONE or (has_not_set_off and not self.is_paused):
            return False
        self._ports.note('aborted', Severity.WARN)
        is_returning = self.state is State.RETURNING
        if is_returning:
            self._drive.stop()
        elif not has_not_set_off:
            self._leave('aborted')
        for tag_id in self._to_visit:
            self._take_up(tag_id)
            self._close(Outcome.SKIPPED, 'aborted')
        if has_not_set_off or is_returning:
            self._end()
        else:
            self.is_paused = self.is_estop_engaged  # then resume() lets the robot return
            self._drive_on()
        return True

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

    def count(self, *outcomes: Outcome) -> int:
        """Return the number of tags with one of these outcomes."""
        return sum(outcome in outcomes for outcome in self.outcomes.values())

    def on_confirmation(self, number: int, confirmed: bool, message: str) -> bool:
        """Accept the reply to a CONFIRM request; return False if it is no longer pending."""
        if not self._is_awaited(number):
            return False
        self._seen = confirmed
        if confirmed:
            self._turn_to(Service.READ)
        else:
            self._attempt_failed(Outcome.NOT_CONFIRMED, message)
        return True

    def on_reading(self, number: int, reading: Reading) -> bool:
        """Accept an OK reply to a READ request; return False if it is no longer pending."""
        if not self._is_awaited(number):
            return False
        if reading.tag_id != self._tag_id:
            self._attempt_failed(Outcome.WRONG_TAG, f'asked for {self._tag_id!r}, got {reading.tag_id!r}')
        elif reading.fault:
            self._attempt_failed(Outcome.BAD_READING, reading.fault)
        else:
            self.mark_scan_ok(self._tag_id, reading)
        return True

    def on_refusal(self, number: int, outcome: Outcome, message: str) -> bool:
        """Accept a reply that reports a failure; return False if the request is no longer pending."""
        if not self._is_awaited(number):
            return False
        self._attempt_failed(outcome, message)
        return True

    def _is_awaited(self, number: int) -> bool:
        if self._request is None or self._request.number != number:
            return False
        self._request = None
        return True

    def _attempt_failed(self, outcome: Outcome, detail: str) -> None:
        is_last = outcome is Outcome.UNKNOWN_TAG or self._attempts >= self._limits.max_attempts
        if not is_last:
            event = f'tag {self._tag_id!r}: {outcome.value} {detail}: trying again'
            self._ports.note(event, Severity.WARN)
            self._next_attempt = self._next_try()
        elif outcome is not Outcome.NOT_CONFIRMED or not self._looks_again(outcome, detail):
            self.mark_scan_failed(self._tag_id, outcome, detail)

    def _next_try(self) -> float:
        """Return the time of another attempt, and double the delay of the one after it."""
        delay_seconds = self._retry_delay
        self._retry_delay = min(2 * delay_seconds, LONGEST_RETRY_DELAY_SECONDS)
        return self._active_seconds + delay_seconds

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
        attempts = self._requests - self._requests_before
        if self._failures and outcome is not Outcome.OK:
            # That the camera did not see the tag tells more than a failed drive.
            if outcome is Outcome.UNREACHABLE and self._seen is not None:
                outcome = Outcome.NOT_CONFIRMED
            details = [*self._failures, detail]
            detail = '; '.join(f'pose {number}: {each}' for number, each in enumerate(details, start=1))
        self.outcomes[self._tag_id] = outcome
        self._is_publishing = True
        observation = Observation(self._tag_id, outcome, detail, attempts, reading, self._seen, self._pose)
        self._ports.record(observation)
        self._is_publishing = False
        self._request = None
        self._scan_reading_done = True


_NO_REPLY = {
    Outcome.TIMEOUT: 'no reply before the timeout',
    Outcome.NO_SERVICE: 'the service is not available',
}
