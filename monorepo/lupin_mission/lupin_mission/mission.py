"""
The mission: visit each tag once, and bring home one outcome for each. No ROS here.

Time comes from outside, in seconds of a clock that never goes back; step() says how late it is.
The state machine is drawn in the package's README.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Protocol

from lupin_mission.drive import Drive
from lupin_mission.report import Observation, Outcome, Reading, fault_of

LONGEST_RETRY_DELAY_SECONDS = 10.0


class State(Enum):
    """Where the mission is; a pause holds it in whichever it is in."""

    READY = 'ready'
    DRIVING = 'driving'
    INSPECTING = 'inspecting'
    DONE = 'done'


class Severity(IntEnum):
    """How bad an event is; the values are those of MissionState."""

    INFO = 0
    WARN = 1
    ERROR = 2


class Service(Enum):
    """Whom a request goes to."""

    CONFIRM = 'confirm'  # does the camera see this tag?
    READ = 'read'  # what is the climate at it?


@dataclass(frozen=True)
class Request:
    """One question to one service. Its number is used once, so a late reply cannot pass for another's."""

    number: int
    service: Service
    tag_id: str


@dataclass(frozen=True)
class Limits:
    """How long and how often; all times in seconds."""

    dwell_seconds: float = 1.0  # the robot stands at a tag at least this long
    request_timeout_seconds: float = 2.0  # of one attempt
    max_attempts: int = 3  # of each service, per tag
    retry_delay_seconds: float = 0.5  # before the second attempt; doubles each time, up to 10


class Surroundings(Protocol):
    """What the mission needs of the world; the node is one."""

    def send(self, request: Request) -> None:
        """Start a request without waiting; its reply comes by on_confirmation, on_reading or on_refusal."""

    def abandon(self, request: Request) -> Outcome:
        """Give a request up; return TIMEOUT, or NO_SERVICE when there was nobody to send it to."""

    def record(self, observation: Observation) -> None:
        """Keep an observation for good; an exception ends the mission."""

    def note(self, event: str, severity: Severity) -> None:
        """Tell people what happened, in one line."""


class Mission:
    """
    Drives to each tag, has it confirmed where that is required, reads it, and records one outcome.

    A scan that fails is recorded with its reason, and the mission goes on with the next tag.
    """

    def __init__(
        self,
        tag_ids: Iterable[str],
        surroundings: Surroundings,
        drive: Drive,
        limits: Limits,
        *,
        require_visual_confirmation: bool = False,
    ):
        """`tag_ids` are visited in this order, each once; raises ValueError on one that is given twice."""
        self.tag_ids = tuple(tag_ids)
        if len(set(self.tag_ids)) != len(self.tag_ids):
            raise ValueError('a tag id is given twice')
        self.state = State.READY
        self.is_paused = False
        self.outcomes: dict[str, Outcome] = {}
        self._surroundings = surroundings
        self._drive = drive
        self._limits = limits
        self._first_service = Service.CONFIRM if require_visual_confirmation else Service.READ
        self._to_visit = iter(self.tag_ids)
        self._tag_id: str | None = None
        self._now = 0.0
        self._active_seconds = 0.0  # stands still in a pause; drive, dwell and back-off go by it
        self._dwell_end = 0.0
        self._scan_reading_done = False  # the latch: this visit has its outcome, there is nothing more to ask
        self._requests = 0
        self._requests_before = 0  # of this visit
        self._request: Request | None = None  # the one that is awaited
        self._deadline = 0.0  # of that request, by the clock that a pause does not stop
        self._service = self._first_service
        self._attempts = 0  # of that service, at this tag
        self._next_attempt = 0.0
        self._retry_delay = 0.0

    @property
    def target(self) -> str | None:
        """The tag that the robot drives to or stands at; None before the first and after the last."""
        return self._tag_id if self.state in (State.DRIVING, State.INSPECTING) else None

    @property
    def phase(self) -> str:
        """NAVIGATING, CONFIRMING, SCANNING or PUBLISHING, as in MissionState; '' when it does not run."""
        if self.state is State.DRIVING:
            return 'NAVIGATING'
        if self.state is not State.INSPECTING:
            return ''
        if self._scan_reading_done:
            return 'PUBLISHING'
        return 'CONFIRMING' if self._service is Service.CONFIRM else 'SCANNING'

    @property
    def tag_at_hand(self) -> str | None:
        """The tag that the robot stands at; None while it drives, before the first and after the last."""
        return self._tag_id if self.state is State.INSPECTING else None

    def start(self, now_seconds: float) -> None:
        """Set off for the first tag."""
        self._now = now_seconds
        self._drive_on()
        self.step(now_seconds)

    def step(self, now_seconds: float) -> None:
        """Do what is due by now; call it often, and after every reply."""
        if not self.is_paused:
            self._active_seconds += now_seconds - self._now
        self._now = now_seconds
        if self._request and now_seconds >= self._deadline:
            request, self._request = self._request, None
            outcome = self._surroundings.abandon(request)
            self._attempt_failed(outcome, f'{request.service.value}: {_NO_REPLY[outcome]}')
        while not self.is_paused and self._take_transition():
            pass

    def _take_transition(self) -> bool:
        """Take the transition that is due, and tell whether there was one."""
        if self.target and self._scan_reading_done:
            if self._active_seconds < self._dwell_end:
                return False
            self._drive_on()
        elif self.state is State.DRIVING and self._drive.has_arrived(self._active_seconds):
            self._inspect()
        elif (
            self.state is State.INSPECTING
            and not self._request
            and self._active_seconds >= self._next_attempt
        ):
            self._ask()
        else:
            return False
        return True

    def _drive_on(self) -> None:
        self._tag_id = next(self._to_visit, None)
        self._scan_reading_done = False
        self._requests_before = self._requests
        if self._tag_id is None:
            self.state = State.DONE
            self._surroundings.note(f'done: {self.count(Outcome.OK)} tags read', Severity.INFO)
        else:
            self.state = State.DRIVING
            self._surroundings.note(f'driving to tag {self._tag_id!r}', Severity.INFO)
            self._drive.start(self._tag_id, self._active_seconds)

    def _inspect(self) -> None:
        self.state = State.INSPECTING
        self._dwell_end = self._active_seconds + self._limits.dwell_seconds
        self._turn_to(self._first_service)

    def _turn_to(self, service: Service) -> None:
        self._service = service
        self._attempts = 0
        self._next_attempt = self._active_seconds
        self._retry_delay = self._limits.retry_delay_seconds

    def _ask(self) -> None:
        self._requests += 1
        self._attempts += 1
        self._request = Request(self._requests, self._service, self._tag_id)
        self._deadline = self._now + self._limits.request_timeout_seconds
        self._surroundings.send(self._request)

    def pause(self) -> bool:
        """Stand still: no drive, no new request, no end of the dwell; False when that is so already."""
        if self.is_paused or self.state is State.DONE:
            return False
        self.is_paused = True
        self._drive.pause()
        self._surroundings.note('paused', Severity.INFO)
        return True

    def resume(self) -> bool:
        """Go on where the pause began; False when there was none."""
        if not self.is_paused:
            return False
        self.is_paused = False
        self._drive.resume()
        self._surroundings.note('resumed', Severity.INFO)
        return True

    def skip(self) -> bool:
        """
        Leave the target; False when there is none.

        It is recorded as SKIPPED; where it has its outcome already, only the rest of the dwell is skipped.
        In a pause the robot stays where it is until resume().
        """
        if not self.target:
            return False
        self._surroundings.note(f'tag {self.target!r} skipped', Severity.WARN)
        self._leave('skipped')
        return True

    def abort(self) -> bool:
        """End the mission: the target and all tags not visited are SKIPPED; False when none is left."""
        if not self.target:
            return False
        self._surroundings.note('aborted', Severity.WARN)
        self._drive.pause()
        self._leave('aborted')
        for tag_id in self._to_visit:
            self._tag_id, self._scan_reading_done, self._requests_before = tag_id, False, self._requests
            self._leave('aborted')
        self.is_paused = False
        self._drive_on()
        return True

    def _leave(self, detail: str) -> None:
        if self._request:
            self._surroundings.abandon(self._request)
        if not self._scan_reading_done:
            self._close(Outcome.SKIPPED, detail, None)
        self._dwell_end = self._active_seconds

    def count(self, *outcomes: Outcome) -> int:
        """Return how many tags have one of these outcomes."""
        return sum(outcome in outcomes for outcome in self.outcomes.values())

    def on_confirmation(self, number: int, confirmed: bool, message: str) -> bool:
        """Take the reply to a CONFIRM request; False when nobody awaits it any more."""
        if not self._is_awaited(number):
            return False
        if confirmed:
            self._turn_to(Service.READ)
        else:
            self._attempt_failed(Outcome.NOT_CONFIRMED, message)
        return True

    def on_reading(self, number: int, reading: Reading) -> bool:
        """Take an OK reply to a READ request; False when nobody awaits it any more."""
        if not self._is_awaited(number):
            return False
        if reading.tag_id != self._tag_id:
            self._attempt_failed(Outcome.WRONG_TAG, f'asked for {self._tag_id!r}, got {reading.tag_id!r}')
        elif fault := fault_of(reading):
            self._attempt_failed(Outcome.BAD_READING, fault)
        else:
            self.mark_scan_ok(self._tag_id, reading)
        return True

    def on_refusal(self, number: int, outcome: Outcome, message: str) -> bool:
        """Take the reply of a service that could not help; False when nobody awaits it any more."""
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
        if outcome is Outcome.UNKNOWN_TAG or self._attempts >= self._limits.max_attempts:
            self.mark_scan_failed(self._tag_id, outcome, detail)
        else:
            event = f'tag {self._tag_id!r}: {outcome.value} {detail}: asking again'
            self._surroundings.note(event, Severity.WARN)
            self._next_attempt = self._active_seconds + self._retry_delay
            self._retry_delay = min(2 * self._retry_delay, LONGEST_RETRY_DELAY_SECONDS)

    def mark_scan_ok(self, tag_id: str, reading: Reading) -> None:
        """Record the reading of the tag at hand; raises ValueError on another tag, or a second outcome."""
        self._end_scan(tag_id, Outcome.OK, '', reading)

    def mark_scan_failed(self, tag_id: str, outcome: Outcome, detail: str) -> None:
        """Record why the tag at hand has no reading; raises ValueError as mark_scan_ok() does."""
        self._end_scan(tag_id, outcome, detail, None)

    def _end_scan(self, tag_id: str, outcome: Outcome, detail: str, reading: Reading | None) -> None:
        if tag_id != self.tag_at_hand or self._scan_reading_done:
            raise ValueError(f'tag {tag_id!r} is not being scanned')
        self._close(outcome, detail, reading)

    def _close(self, outcome: Outcome, detail: str, reading: Reading | None) -> None:
        attempts = self._requests - self._requests_before
        self._surroundings.record(Observation(self._tag_id, outcome, detail, attempts, reading))
        self.outcomes[self._tag_id] = outcome
        self._request = None
        self._scan_reading_done = True


_NO_REPLY = {
    Outcome.TIMEOUT: 'no answer in time',
    Outcome.NO_SERVICE: 'the service is not there',
}
