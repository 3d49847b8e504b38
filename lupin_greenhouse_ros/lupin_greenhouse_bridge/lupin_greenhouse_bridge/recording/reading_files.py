# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
Read a file that holds readings: a recorder's, that of `read_tag --csv`, or a mission's report.

Does not import ROS.
"""

import contextlib
import sqlite3
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import OneLineError, escaped
from lupin_greenhouse_bridge.recording.report_line import Observation, is_start_of_report, parse_report
from lupin_greenhouse_bridge.recording.rows import HEADER, Row, fault_of, has_header, parse_csv
from lupin_greenhouse_bridge.recording.store import HEAD_BYTES, is_sqlite_of_readings, reason_of
from lupin_greenhouse_bridge.simulator.layout import find_places

WANTED = "name a file of record_readings or read_tag --csv, or a mission's report"
SELECT = f'SELECT {HEADER} FROM readings'  # noqa: S608 (no text of a user)


class ReadingFileError(OneLineError):
    """A file holds no readings, or cannot be read."""


class ReadingFile(NamedTuple):
    """The contents of a file."""

    rows: list[Row]  # in the order of their stamps
    visits: list[Observation]  # of a report, in its order; a continued mission visits a tag again


def read_rows(path: Path | str, tag_file: str = '') -> list[Row]:
    """Return the rows of a file, sorted by stamp; the arguments and errors are those of read_file()."""
    return read_file(path, tag_file).rows


def read_file(path: Path | str, tag_file: str = '') -> ReadingFile:
    """
    Return the contents of a file in one of the three formats, without an incomplete last line.

    A row without a position gets the position of its tag in `tag_file`, or in the shipped layout for ''.
    Raises ReadingFileError for a file in another format, and StartUpError for a bad tag_file.
    """
    try:
        rows, visits = _parse(Path(path))
    except (OSError, sqlite3.Error, ValueError) as error:  # of values: also what is not UTF-8 or not JSON
        raise ReadingFileError(f"'{path}': {reason_of(error)}: {WANTED}") from error
    if any(row.x_m is None for row in rows):
        places_m = find_places(tag_file)
        for index, row in enumerate(rows):
            if row.x_m is None and (place_m := places_m.get(row.tag_id)):
                rows[index] = row._replace(x_m=place_m[0], y_m=place_m[1])
    return ReadingFile(sorted(rows, key=attrgetter('stamp_ns')), visits)


def _parse(path: Path) -> tuple[list[Row], list[Observation]]:
    if path.exists() and not path.is_file():
        raise ValueError('not a regular file')
    with path.open('rb') as file:
        head = file.read(HEAD_BYTES)
    if is_sqlite_of_readings(head):
        return _rows_of_sqlite(path), []
    content = path.read_bytes()
    if has_header(content):
        return parse_csv(content)[0], []
    if not (content and is_start_of_report(content)):
        raise ValueError('not a file of readings' if content else 'empty')
    visits, _ = parse_report(content)
    return [row for each in visits if each.reading for row in each.reading.rows], visits


def _rows_of_sqlite(path: Path) -> list[Row]:
    # Writable: of a recorder that was killed in the middle of a commit, SQLite first restores the file.
    with contextlib.closing(sqlite3.connect(f'{path.resolve().as_uri()}?mode=rw', uri=True)) as connection:
        rows = list(map(Row._make, connection.execute(SELECT)))
    if fault := next(filter(None, map(_wrong_type_of, rows)), '') or fault_of(rows):
        raise ValueError(fault)
    return rows


def _wrong_type_of(row: Row) -> str:
    """Return which value of a row has another type than its column, as SQLite lets it; '' if none."""
    for (name, kind), value in zip(Row.__annotations__.items(), row, strict=True):
        if not isinstance(value, kind):
            return f'{name} is {escaped(repr(value), 60)}'
    return ''
