"""One visit of a mission to a tag: its phase, its requests and its attempts. Does not import ROS."""

from dataclasses import dataclass, field
from enum import Enum

from lupin_readings.report_line import Observation, Outcome, Reading

LONGEST_RETRY_DELAY_SECONDS = 10.0


class Phase(Enum):
    """
    The phase of a visit, with the names of MissionState.

    A LATCHED visit has its outcome, and sends no more requests. MissionState does not have this phase.
    """

    NAVIGATING = 'NAVIGATING'
    CONFIRMING = 'CONFIRMING'
    SCANNING = 'SCANNING'
    PUBLISHING = 'PUBLISHING'
    LATCHED = 'LATCHED'


class Service(Enum):
    """The service that a request goes to: the camera's confirmation, or the reading of the bridge."""

    CONFIRM = 'confirm'
    READ = 'read'


SERVICES = {Phase.CONFIRMING: Service.CONFIRM, Phase.SCANNING: Service.READ}
NO_REPLY = {
    Outcome.TIMEOUT: 'no reply before the timeout',
    Outcome.NO_SERVICE: 'the service is not available',
}


@dataclass(frozen=True, eq=False)
class Request:
    """One request to one service. No two are equal, so a late reply does not count for a later request."""

    service: Service
    tag_id: str
    deadline_seconds: float


@dataclass
class Visit:
    """The visit to one tag: its phase, its pose, and what has failed so far."""

    tag_id: str
    phase: Phase = Phase.NAVIGATING
    pose: int = 1
    failures: list[str] = field(default_factory=list)  # why each earlier pose failed
    miss: str = ''  # how far the robot is from its pose, if that is too far
    seen: bool | None = None  # the last reply of the camera
    requests: int = 0

    def observation(self, outcome: Outcome, detail: str, reading: Reading | None) -> Observation:
        """Return the observation that closes this visit, with the reasons of all poses."""
        # NOT_CONFIRMED is the more useful outcome for a person.
        if outcome is Outcome.UNREACHABLE and self.seen is False:
            outcome = Outcome.NOT_CONFIRMED
        if self.failures and outcome is not Outcome.OK:
            details = [*self.failures, detail]
            detail = '; '.join(f'pose {number}: {reason}' for number, reason in enumerate(details, start=1))
        detail = '; '.join(filter(None, (detail, self.miss)))
        return Observation(self.tag_id, outcome, detail, self.requests, reading, self.seen, self.pose)


@dataclass
class Attempts:
    """The attempts to drive to one goal, or to get a reply from one service."""

    due_seconds: float
    delay_seconds: float
    count: int = 0

    def try_again(self, now_seconds: float) -> None:
        """Plan another attempt, and double the delay of the one after it."""
        self.due_seconds = now_seconds + self.delay_seconds
        self.delay_seconds = min(2 * self.delay_seconds, LONGEST_RETRY_DELAY_SECONDS)
