"""The report of a mission: a JSON Lines file and a table. Does not import ROS."""

import contextlib
import errno
import fcntl
import os
import stat
from collections.abc import Iterable
from pathlib import Path

from lupin_greenhouse_bridge.display.report_line import Observation, Outcome, parse_report
from lupin_greenhouse_bridge.errors import OneLineError, escaped
from lupin_greenhouse_bridge.runtime.output import aligned_table
from lupin_greenhouse_bridge.units import clock_time, sensor_order, unit_of, value_text


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
            reason = getattr(error, 'strerror', error)
            raise ReportError(f"report_file '{path}': {reason}: name a file that can be written") from error
        try:
            if not stat.S_ISREG(os.fstat(self._file).st_mode):  # /dev/zero is endless
                raise OSError(errno.EINVAL, 'it is not a regular file')
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            content = self.path.read_bytes()
            self.observations, self._size = parse_report(content)
            os.ftruncate(self._file, self._size)
            if self._size and content[self._size - 1 : self._size] != b'\n':
                self._size += os.write(self._file, b'\n')
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
        line = f'{observation.to_line()}\n'.encode()
        try:
            os.ftruncate(self._file, self._size)  # what a write that failed has left
            if os.write(self._file, line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file)
        except OSError as error:
            with contextlib.suppress(OSError):  # the next line, or the next mission, removes it too
                os.ftruncate(self._file, self._size)
            raise ReportError(f"report_file '{self.path}': {error.strerror}") from error
        self._size += len(line)
        self.observations.append(observation)

    def is_in_place(self) -> bool:
        """Return whether the file was neither deleted nor replaced."""
        try:
            return os.path.samestat(os.fstat(self._file), self.path.stat())
        except OSError:
            return False

    def close(self) -> None:
        """Close the file, so that another mission can open it."""
        os.close(self._file)


def last_observation_of_each_tag(observations: Iterable[Observation]) -> dict[str, Observation]:
    """Return the last observation of each tag. It counts, because a failed tag is tried again later."""
    return {each.tag_id: each for each in observations}


def summary_table(observations: Iterable[Observation], tag_ids: Iterable[str]) -> str:
    """Return a table, one row for each of `tag_ids`, and a last line such as `29/29 tags read`."""
    found = last_observation_of_each_tag(observations)
    tag_ids = list(tag_ids)
    names = {name for each in found.values() if each.reading for name in each.reading.values}
    sensors = sorted(names, key=sensor_order)
    seen = ['seen'] if any(each.seen is not None for each in found.values()) else []  # by the camera
    rows = [
        ('tag', 'sim time', *sensors, *seen, 'outcome'),
        ('', 'h:min', *(unit_of(name) for name in sensors), *('' for _ in seen), ''),
    ]
    for tag_id in tag_ids:
        observation = found.get(tag_id)
        reading = observation and observation.reading
        rows.append(
            (
                escaped(tag_id, 40),
                clock_time(reading.sim_time_of_day_seconds) if reading else '',
                *(
                    value_text(name, reading.values[name]) if reading and name in reading.values else ''
                    for name in sensors
                ),
                *(_SEEN[observation.seen if observation else None] for _ in seen),
                _outcome_text(observation) if observation else 'not visited',
            )
        )
    lines = aligned_table(rows, range(1, len(sensors) + 2))
    read = sum(tag_id in found and found[tag_id].outcome is Outcome.OK for tag_id in tag_ids)
    return '\n'.join([*lines, f'{read}/{len(tag_ids)} tags read'])


_SEEN = {True: 'yes', False: 'no', None: ''}


def _outcome_text(observation: Observation) -> str:
    pose = f'from pose {observation.pose}' if observation.reading and observation.pose > 1 else ''
    return ' '.join(filter(None, (observation.outcome.value, pose, escaped(observation.detail, 200))))
