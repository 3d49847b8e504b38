"""The report of a mission: a JSON Lines file and a table. Does not import ROS."""

import contextlib
import errno
import fcntl
import json
import math
import os
import stat
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError, escaped
from lupin_greenhouse_bridge.units import clock_time, unit_of


class ReportError(OneLineError):
    """A report cannot be read or written."""


class Outcome(str, Enum):
    """The outcome of the scan of one tag."""

    OK = 'OK'
    UNKNOWN_TAG = 'UNKNOWN_TAG'  # the bridge does not know the tag
    SIMULATOR_ERROR = 'SIMULATOR_ERROR'  # the bridge knows the tag and cannot read it
    NOT_CONFIRMED = 'NOT_CONFIRMED'  # the camera did not see it
    WRONG_TAG = 'WRONG_TAG'  # the reply was for another tag
    BAD_READING = 'BAD_READING'  # the reading was empty, or had a value that is not a finite number
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


@dataclass(frozen=True)
class Observation:
    """The outcome at one tag; `reading` is set if and only if the outcome is OK."""

    tag_id: str
    outcome: Outcome
    detail: str  # why it failed; empty if OK
    attempts: int  # number of requests
    reading: Reading | None = None
    drive: str = ''  # 'simulated' if no robot moved

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
                **({'drive': self.drive} if self.drive else {}),
            },
            allow_nan=False,
            ensure_ascii=False,
        )

    @classmethod
    def from_line(cls, line: str) -> 'Observation':
        """Return the observation in a line; raises one of NO_OBSERVATION if there is none."""
        data = json.loads(line)
        outcome, reading = Outcome(data['outcome']), None
        if outcome is Outcome.OK:
            reading = Reading(
                data['tag_id'],
                (int(data['stamp']['sec']), int(data['stamp']['nanosec'])),
                float(data['sim_time_of_day_seconds']),
                {str(name): float(value) for name, value in data['readings'].items()},
            )
            if not all(map(math.isfinite, (reading.sim_time_of_day_seconds, *reading.values.values()))):
                raise ValueError('it has a number that is not finite')
        drive = str(data.get('drive', ''))
        return cls(str(data['tag_id']), outcome, str(data['detail']), int(data['attempts']), reading, drive)


def fault_of(reading: Reading) -> str:
    """Return why a reading cannot be used; '' if it can."""
    if not reading.values:
        return 'it has no value'
    for name, value in (*reading.values.items(), ('sim time of day', reading.sim_time_of_day_seconds)):
        if not math.isfinite(value):
            return f'{name} is {value}'
    return ''


# Of from_line(); int() raises OverflowError for 1e999.
NO_OBSERVATION = (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError)


def read_report(path: Path | str) -> list[Observation]:
    """Return the observations of a report, without an incomplete last line."""
    try:
        if Path(path).exists() and not Path(path).is_file():
            raise ReportError(f"report '{path}' is not a regular file: name the report of a mission")
        content = Path(path).read_bytes()
    except OSError as error:
        raise ReportError(f"report '{path}': {error.strerror}: name the report of a mission") from error
    return _parse(content, path)[0]


def _parse(content: bytes, path) -> tuple[list[Observation], int]:
    """
    Return the observations and their size in bytes; the rest is an incomplete line.

    The last observation may lack its newline, which an editor can remove.
    """
    whole, _, torn = content.rpartition(b'\n')
    size = len(content) - len(torn)
    observations = []
    for number, line in enumerate(whole.split(b'\n') if size else [], start=1):
        try:
            observations.append(Observation.from_line(line.decode('utf-8')))
        except NO_OBSERVATION as error:
            raise ReportError(
                f"report '{path}': line {number} is not an observation ({type(error).__name__}: {error}):"
                ' name the report of a mission, or a new file'
            ) from error
    with contextlib.suppress(*NO_OBSERVATION):
        observations.append(Observation.from_line(torn.decode('utf-8')))
        return observations, len(content)
    start = b'{"tag_id": '
    if torn[: len(start)] != start[: len(torn)]:
        raise ReportError(f"report '{path}' has a last line that is not an observation: name another file")
    return observations, size


class Report:
    """
    A report open for writing. It continues an existing file.

    Each line is on the disk before record() returns. Opening a report removes an incomplete last line, which
    a killed mission can leave. Only one mission at a time can open a report.
    """

    def __init__(self, path: Path | str):
        """Open or make the file; raises ReportError."""
        self.path = Path(path)
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        except (OSError, ValueError) as error:
            reason = getattr(error, 'strerror', error)
            raise ReportError(f"report_file '{path}': {reason}: name a file that can be written") from error
        try:
            if not stat.S_ISREG(os.fstat(self._file).st_mode):  # /dev/zero is endless
                raise ReportError(f"report_file '{path}' is not a regular file: name another file")
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            content = self.path.read_bytes()
            self.observations, self._size = _parse(content, path)
            os.ftruncate(self._file, self._size)
            if self._size and content[self._size - 1 : self._size] != b'\n':
                self._size += os.write(self._file, b'\n')
        except OSError as error:
            self.close()
            cause = 'another mission is writing it' if error.errno == errno.EWOULDBLOCK else error.strerror
            raise ReportError(f"report_file '{path}': {cause}: name another file") from error
        except ReportError:
            self.close()
            raise

    def record(self, observation: Observation) -> None:
        """Append one observation and wait until it is on the disk; raises ReportError."""
        line = f'{observation.to_line()}\n'.encode()
        try:
            if os.write(self._file, line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file)
        except OSError as error:
            os.ftruncate(self._file, self._size)
            raise ReportError(f"report_file '{self.path}': {error.strerror}") from error
        self._size += len(line)
        self.observations.append(observation)

    def close(self) -> None:
        """Close the file, so that another mission can open it."""
        os.close(self._file)


def last_of_each_tag(observations: Iterable[Observation]) -> dict[str, Observation]:
    """Return the last observation of each tag. It counts, because a failed tag is tried again later."""
    return {each.tag_id: each for each in observations}


def summary_table(observations: Iterable[Observation], tag_ids: Iterable[str]) -> str:
    """Return a table, one row for each of `tag_ids`, and a last line such as `29/29 tags read`."""
    found = last_of_each_tag(observations)
    tag_ids = list(tag_ids)
    sensors = list(
        dict.fromkeys(name for each in found.values() if each.reading for name in each.reading.values)
    )
    rows = [('tag', 'sim time', *sensors, 'outcome'), ('', 'h:min', *(unit_of(name) for name in sensors), '')]
    for tag_id in tag_ids:
        observation = found.get(tag_id)
        reading = observation and observation.reading
        rows.append(
            (
                escaped(tag_id, 40),
                clock_time(reading.sim_time_of_day_seconds) if reading else '',
                *(
                    f'{reading.values[name]:.2f}' if reading and name in reading.values else ''
                    for name in sensors
                ),
                f'{observation.outcome.value} {escaped(observation.detail, 200)}'.strip()
                if observation
                else 'not visited',
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        '  '.join(
            # Align words left and numbers right.
            cell.ljust(width) if column in (0, len(widths) - 1) else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    read = sum(tag_id in found and found[tag_id].outcome is Outcome.OK for tag_id in tag_ids)
    return '\n'.join([*lines, f'{read}/{len(tag_ids)} tags read'])
