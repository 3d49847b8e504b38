# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
Read a file that holds readings: a recorder's, that of `read_tag --csv`, or a mission's report.

Does not import ROS.
"""

import contextlib
import json
import sqlite3
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import OneLineError, escaped
from lupin_greenhouse_bridge.recording.csv_rows import HEADER, parse_csv
from lupin_greenhouse_bridge.recording.rows import Row, fault_of, utc_of
from lupin_greenhouse_bridge.recording.store import HEAD_BYTES, is_sqlite_of_readings
from lupin_greenhouse_bridge.simulator.layout import find_layout
from lupin_greenhouse_bridge.units import unit_of

REPORT_SOURCE = 'mission report'
WANTED = "name a file of record_readings or read_tag --csv, or a mission's report"
SELECT = f'SELECT {HEADER} FROM readings'  # noqa: S608 (no text of a user)
_START_OF_VISIT = b'{"tag_id": '


class ReadingFileError(OneLineError):
    """A file holds no readings, or cannot be read."""


class Visit(NamedTuple):
    """What a mission reported of one tag."""

    tag_id: str
    outcome: str  # OK, or why there is no reading
    detail: str  # '' if OK
    attempts: int
    stamp_ns: int | None  # wall clock of the reading; None if there is none


class ReadingFile(NamedTuple):
    """The contents of a file."""

    rows: list[Row]  # in the order of their stamps
    visits: list[Visit]  # of a report, in its order; a mission that was continued visits a tag again


def read_rows(path: Path | str, tag_file: str = '') -> list[Row]:
    """Return the rows of a file in the order of their stamps; arguments and errors as of read_file()."""
    return read_file(path, tag_file).rows


def read_file(path: Path | str, tag_file: str = '') -> ReadingFile:
    """
    Return what a file of any of the three formats holds; an incomplete last line is left out.

    A row without a position gets that of its tag in `tag_file`, or in the shipped layout for ''. Raises
    ReadingFileError with one line for anything else, and StartUpError for a bad tag_file.
    """
    try:
        rows, visits = _parse(Path(path))
    except (OSError, sqlite3.Error, ValueError) as error:  # of values: also what is not UTF-8 or not JSON
        reason = getattr(error, 'strerror', None) or error
        raise ReadingFileError(f"'{path}': {reason}: {WANTED}") from error
    if any(row.x_m is None for row in rows):
        layout = find_layout(tag_file)
        tags = layout.tags if layout else {}
        rows = [
            row._replace(x_m=tags[row.tag_id].x, y_m=tags[row.tag_id].y)
            if row.x_m is None and row.tag_id in tags
            else row
            for row in rows
        ]
    return ReadingFile(sorted(rows, key=attrgetter('stamp_ns')), visits)


def _parse(path: Path) -> tuple[list[Row], list[Visit]]:
    if path.exists() and not path.is_file():
        raise ValueError('not a regular file')
    with path.open('rb') as file:
        head = file.read(HEAD_BYTES)
    if is_sqlite_of_readings(head):
        return _rows_of_sqlite(path), []
    content = path.read_bytes()
    if content.removeprefix(b'\xef\xbb\xbf').startswith(HEADER.encode()):
        return parse_csv(content)[0], []
    if content and content[: len(_START_OF_VISIT)] == _START_OF_VISIT[: len(content)]:
        return _parse_report(content)
    raise ValueError('not a file of readings' if content else 'empty')


def _rows_of_sqlite(path: Path) -> list[Row]:
    # Writable: of a recorder that was killed in the middle of a commit, SQLite first restores the file.
    with contextlib.closing(sqlite3.connect(f'{path.resolve().as_uri()}?mode=rw', uri=True)) as connection:
        rows = list(map(Row._make, connection.execute(SELECT)))
    if fault := next(filter(None, (_wrong_type_of(row) or fault_of(row) for row in rows)), ''):
        raise ValueError(fault)
    return rows


def _wrong_type_of(row: Row) -> str:
    """Return which value of a row has another type than its column, as SQLite lets it; '' if none."""
    for (name, kind), value in zip(Row.__annotations__.items(), row, strict=True):
        if not isinstance(value, kind):
            return f'{name} is {escaped(repr(value), 60)}'
    return ''


def _parse_report(content: bytes) -> tuple[list[Row], list[Visit]]:
    rows, visits = [], []
    *lines, last = content.split(b'\n')
    with contextlib.suppress(ValueError, RecursionError):  # of a mission that was killed in this line
        json.loads(last)
        lines.append(last)
    for number, line in enumerate(lines, start=1):
        try:
            _add_visit(json.loads(line), rows, visits)
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
            raise ValueError(
                f'line {number} is not an observation ({type(error).__name__}: {error})'
            ) from error
    return rows, visits


def _add_visit(data: dict, rows: list[Row], visits: list[Visit]) -> None:
    """Add one observation of a report: its format is that of `Observation.to_line` of lupin_mission."""
    tag_id, stamp_ns = str(data['tag_id']), None
    if data['outcome'] == 'OK':
        stamp_ns = int(data['stamp']['sec']) * 1_000_000_000 + int(data['stamp']['nanosec'])
        stamp_utc, sim_time = utc_of(stamp_ns), float(data['sim_time_of_day_seconds'])
        found = [
            Row(
                stamp_ns,
                stamp_utc,
                tag_id,
                name,
                float(value),
                unit_of(name),
                None,
                None,
                sim_time,
                REPORT_SOURCE,
            )
            for name, value in data['readings'].items()
        ]
        if fault := next(filter(None, map(fault_of, found)), ''):
            raise ValueError(fault)
        rows += found
    visits.append(Visit(tag_id, str(data['outcome']), str(data['detail']), int(data['attempts']), stamp_ns))
