"""A line of a mission's report: the outcome at one tag, as JSON. Does not import ROS."""

import json
import math
from dataclasses import dataclass
from enum import Enum

from lupin_readings.rows import Row, fault_of, make_rows

SOURCE = 'mission report'
_START = b'{"tag_id"'  # the start of each line, and of an incomplete line of a killed mission
# int() raises OverflowError for 1e999.
_NO_OBSERVATION = (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError)
_FAULTS: dict[type[Exception], str] = {  # in place of messages for Python programmers
    json.JSONDecodeError: 'it is not JSON',
    KeyError: '{} is missing',
    TypeError: 'a value has the wrong type',
    AttributeError: 'a value has the wrong type',
}


class Outcome(str, Enum):
    """The outcome of the scan of one tag."""

    OK = 'OK'
    UNKNOWN_TAG = 'UNKNOWN_TAG'  # the bridge does not know the tag
    SIMULATOR_ERROR = 'SIMULATOR_ERROR'  # the bridge knows the tag and cannot read it
    NOT_CONFIRMED = 'NOT_CONFIRMED'  # the camera did not see it
    BAD_READING = 'BAD_READING'  # the reply is invalid, such as a reading of another tag
    TIMEOUT = 'TIMEOUT'  # no reply before the timeout
    NO_SERVICE = 'NO_SERVICE'  # the service was not available
    UNREACHABLE = 'UNREACHABLE'  # the drive to the tag failed
    SKIPPED = 'SKIPPED'  # skipped by a person, or not visited before an abort


@dataclass(frozen=True)
class Reading:
    """The climate at a tag, with its two clocks."""

    tag_id: str
    stamp: tuple[int, int]  # wall clock of the bridge: seconds and nanoseconds since 1970
    sim_time_of_day_seconds: float  # greenhouse clock, in [0, 86400)
    values: dict[str, float]  # by sensor name

    @property
    def rows(self) -> list[Row]:
        """The reading as rows without a position."""
        seconds, nanoseconds = self.stamp
        stamp_ns = seconds * 1_000_000_000 + nanoseconds
        return make_rows(stamp_ns, self.tag_id, self.values.items(), self.sim_time_of_day_seconds, SOURCE)

    @property
    def fault(self) -> str:
        """Why the reading cannot be used; '' if it can."""
        return next(filter(None, map(fault_of, self.rows)), '') if self.values else 'it has no value'


@dataclass(frozen=True)
class Observation:
    """The outcome at one tag; `reading` is set if and only if the outcome is OK."""

    tag_id: str
    outcome: Outcome
    detail: str  # why it failed; if OK, empty or how far the robot was from its pose
    attempts: int  # number of requests, from all poses
    reading: Reading | None = None
    seen: bool | None = None  # whether the camera saw the tag; None without a camera
    pose: int = 1  # the last approach pose that the robot was sent to
    drive: str = ''  # 'simulated' if no robot moved
    goal: tuple[float, float] | None = None  # x and y of this pose in the layout, if UNREACHABLE

    def to_line(self) -> str:
        """Return the observation as JSON on one line; raises ValueError if a number is not finite."""
        reading = self.reading
        return json.dumps(
            {
                'tag_id': self.tag_id,
                'outcome': self.outcome.value,
                'detail': self.detail,
                'attempts': self.attempts,
                'stamp': reading and {'sec': reading.stamp[0], 'nanosec': reading.stamp[1]},
                'sim_time_of_day_seconds': reading and reading.sim_time_of_day_seconds,
                'readings': reading and reading.values,
                'seen': self.seen,  # older reports have none of these three
                'pose': self.pose,
                **({'goal': self.goal} if self.goal else {}),
                **({'drive': self.drive} if self.drive else {}),
            },
            allow_nan=False,
            ensure_ascii=False,
        )

    @classmethod
    def from_line(cls, line: bytes) -> 'Observation':
        """Return the observation in a line; raises ValueError if there is none."""
        try:
            data = json.loads(line.decode())
            tag_id, outcome, reading = str(data['tag_id']), Outcome(data['outcome']), None
            if outcome is Outcome.OK:
                stamp = int(data['stamp']['sec']), int(data['stamp']['nanosec'])
                values = {str(name): float(value) for name, value in data['readings'].items()}
                if not values:
                    raise ValueError('it has no value')
                reading = Reading(tag_id, stamp, float(data['sim_time_of_day_seconds']), values)
            seen, pose, drive = data.get('seen'), int(data.get('pose', 1)), str(data.get('drive', ''))
            if seen not in (None, True, False):
                raise ValueError(f'seen is {seen!r}: must be true, false or null')
            detail, attempts = str(data['detail']), int(data['attempts'])
            goal = None if data.get('goal') is None else [float(coordinate) for coordinate in data['goal']]
            if goal is not None and not (len(goal) == 2 and all(map(math.isfinite, goal))):
                raise ValueError(f'goal is {goal}: must be x and y in metres')
        except _NO_OBSERVATION as error:
            reason = next((text for kind, text in _FAULTS.items() if isinstance(error, kind)), '{}')
            raise ValueError(f'is not an observation ({reason.format(error)})') from error
        if reading and reading.fault:
            raise ValueError(f'has a wrong value: {reading.fault}')
        place = (goal[0], goal[1]) if goal else None
        return cls(tag_id, outcome, detail, attempts, reading, seen, pose, drive, place)


def parse_report(content: bytes) -> tuple[list[Observation], int]:
    """
    Return the observations of a report and their size in bytes; the rest is an incomplete line.

    The last line may lack its newline, which an editor can remove. Raises ValueError for anything else.
    """
    observations, lines = [], content.splitlines(keepends=True)
    for number, line in enumerate(lines, start=1):
        try:
            observations.append(Observation.from_line(line))
        except ValueError as error:
            is_torn = isinstance(error.__cause__, (json.JSONDecodeError, UnicodeDecodeError))
            if is_torn and not line.endswith(b'\n') and _START.startswith(line[: len(_START)]):
                return observations, len(content) - len(line)
            raise ValueError(f'line {number} {error}') from error
    return observations, len(content)
