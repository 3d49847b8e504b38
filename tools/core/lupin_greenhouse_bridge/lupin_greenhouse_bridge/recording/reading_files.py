"""Read a file of rows: that of a recorder, or of `read_tag --csv`. Does not import ROS."""

import contextlib
import sqlite3
from operator import attrgetter
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError, escaped
from lupin_greenhouse_bridge.recording.rows import HEADER, Row, fault_of, has_header, parse_csv
from lupin_greenhouse_bridge.recording.store import HEAD_BYTES, file_error_text, is_sqlite_of_readings
from lupin_greenhouse_bridge.simulator.layout import find_places

WANTED = "name a file of record_readings or read_tag --csv, or a mission's report"
SELECT = f'SELECT {HEADER} FROM readings'  # noqa: S608 (no text of a user)


class ReadingFileError(OneLineError):
    """A file holds no readings, or cannot be read."""


def read_rows(path: Path | str, tag_file: str = '') -> list[Row]:
    """
    Return the rows of a SQLite or CSV file, sorted by stamp, without an incomplete last line.

    A row without a position gets the position of its tag in `tag_file`, or in the shipped layout for ''.
    Raises ReadingFileError for a file in another format, and StartUpError for a bad tag_file.
    """
    try:
        rows = parse_rows(Path(path))
    except (OSError, sqlite3.Error, ValueError) as error:  # of values: also what is not UTF-8
        raise ReadingFileError(f"'{path}': {file_error_text(error)}: {WANTED}") from error
    return with_places(rows, tag_file)


def parse_rows(path: Path) -> list[Row]:
    """Return the rows of a SQLite or CSV file; raises OSError, sqlite3.Error and ValueError."""
    if path.exists() and not path.is_file():
        raise ValueError('not a regular file')
    with path.open('rb') as file:
        head = file.read(HEAD_BYTES)
    if is_sqlite_of_readings(head):
        return _rows_of_sqlite(path)
    content = path.read_bytes()
    if not has_header(content):
        raise ValueError('not a file of readings' if content else 'empty')
    return parse_csv(content)[0]


def with_places(rows: list[Row], tag_file: str = '') -> list[Row]:
    """Return the rows, sorted by stamp, with the positions of their tags where they lack one."""
    if any(row.x_m is None for row in rows):
        places_m = find_places(tag_file)
        for index, row in enumerate(rows):
            if row.x_m is None and (place_m := places_m.get(row.tag_id)):
                rows[index] = row._replace(x_m=place_m[0], y_m=place_m[1])
    return sorted(rows, key=attrgetter('stamp_ns'))


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
