"""The report of a mission: a JSON Lines file and a table. Does not import ROS."""

import contextlib
import errno
import fcntl
import os
import stat
from collections.abc import Iterable
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError, escaped, reason_of
from lupin_greenhouse_bridge.runtime.output import aligned_table
from lupin_greenhouse_bridge.units import clock_time, sensor_order, unit_of, value_text
from lupin_readings.report_line import Observation, Outcome, Reading, parse_report

SEEN = {True: 'yes', False: 'no', None: ''}


class ReportError(OneLineError):
    """A report cannot be read or written."""


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
            folder = self.path.parent
            remedy = 'name a file that can be written' if folder.is_dir() else f"make the folder '{folder}'"
            raise ReportError(f"report_file '{path}': {reason_of(error)}: {remedy}") from error
        try:
            if not stat.S_ISREG(os.fstat(self._file).st_mode):  # /dev/zero is endless.
                raise OSError(errno.EINVAL, 'it is not a regular file')
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.observations = self._end_last_line()
        except OSError as error:
            self.close()
            cause = 'another mission is writing it' if error.errno == errno.EWOULDBLOCK else error.strerror
            raise ReportError(f"report_file '{path}': {cause}: name another file") from error
        except ValueError as error:
            self.close()
            raise ReportError(
                f"report '{path}': {error}: name the report of a mission, or a new file"
            ) from error

    def record(self, observation: Observation) -> None:
        """Append one observation and wait until it is on the disk; raises ReportError."""
        if fault := self.fault():
            raise ReportError(fault)
        line = f'{observation.to_line()}\n'.encode()
        try:
            if os.fstat(self._file).st_size < self._size:  # Cut by another program, such as logrotate.
                self._end_last_line()
            if os.write(self._file, line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file)
        except ValueError as error:
            raise ReportError(f"report_file '{self.path}': {error}") from error
        except OSError as error:
            with contextlib.suppress(OSError):  # The next mission removes it too.
                os.ftruncate(self._file, self._size)
            raise ReportError(f"report_file '{self.path}': {error.strerror}") from error
        self._size += len(line)
        self.observations.append(observation)

    def _end_last_line(self) -> list[Observation]:
        """Remove an incomplete last line; return the observations. Raises OSError and ValueError."""
        content = os.pread(self._file, os.fstat(self._file).st_size, 0)
        observations, self._size = parse_report(content)
        os.ftruncate(self._file, self._size)
        if self._size and content[self._size - 1 : self._size] != b'\n':
            self._size += os.write(self._file, b'\n')
        return observations

    def fault(self) -> str:
        """Return an error message if the file was deleted or replaced; '' if it was not."""
        with contextlib.suppress(OSError):
            if os.path.samestat(os.fstat(self._file), self.path.stat()):
                return ''
        return f"report_file '{self.path}' was deleted or replaced: start the mission again"

    def close(self) -> None:
        """Close the file, so that another mission can open it."""
        os.close(self._file)


def last_observation_of_each_tag(observations: Iterable[Observation]) -> dict[str, Observation]:
    """Return the last observation of each tag. Only that one counts, because failed tags are tried again."""
    return {observation.tag_id: observation for observation in observations}


def read_tags(observations: Iterable[Observation]) -> set[str]:
    """Return the ids of the tags that have a reading."""
    last = last_observation_of_each_tag(observations)
    return {tag_id for tag_id, observation in last.items() if observation.outcome is Outcome.OK}


def summary_table(observations: Iterable[Observation], tag_ids: Iterable[str]) -> str:
    """Return a table, one row for each of `tag_ids`, and a last line such as `29/29 tags read`."""
    tag_ids = list(tag_ids)
    last = last_observation_of_each_tag(observations)
    found = [last.get(tag_id) for tag_id in tag_ids]
    readings = [observation.reading if observation else None for observation in found]
    all_readings = [observation.reading for observation in last.values() if observation.reading]
    sensors = sorted({name for reading in all_readings for name in reading.values}, key=sensor_order)
    columns = [
        ['tag', '', *(escaped(tag_id, 40) for tag_id in tag_ids)],
        [
            'sim time',
            'h:min',
            *(clock_time(reading.sim_time_of_day_seconds) if reading else '' for reading in readings),
        ],
        *(
            [escaped(name, 40), unit_of(name), *(_value(name, reading) for reading in readings)]
            for name in sensors
        ),
    ]
    if any(observation.seen is not None for observation in last.values()):
        seen = [SEEN[observation.seen if observation else None] for observation in found]
        columns.append(['seen', '', *seen])
    columns.append(['outcome', '', *map(_outcome, found)])
    lines = aligned_table(list(zip(*columns, strict=True)), range(1, len(sensors) + 2))
    read = read_tags(last.values()).intersection(tag_ids)
    return '\n'.join([*lines, f'{len(read)}/{len(tag_ids)} tags read'])


def _value(sensor: str, reading: Reading | None) -> str:
    return value_text(sensor, reading.values[sensor]) if reading and sensor in reading.values else ''


def _outcome(observation: Observation | None) -> str:
    if observation is None:
        return 'not visited'
    pose = f'from pose {observation.pose}' if observation.reading and observation.pose > 1 else ''
    return ' '.join(filter(None, (observation.outcome.value, pose, escaped(observation.detail, 200))))
