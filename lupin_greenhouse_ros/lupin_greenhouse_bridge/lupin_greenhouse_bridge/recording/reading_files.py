# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Read a file of rows: that of a recorder, or of `read_tag --csv`. Does not import ROS."""

import contextlib
import sqlite3
from operator import attrgetter
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError
from lupin_greenhouse_bridge.recording.rows import (
    HEADER,
    Row,
    WrongValueError,
    fault_of,
    has_header,
    parse_csv,
)
from lupin_greenhouse_bridge.recording.store import HEAD_BYTES, file_error_text, is_sqlite_of_readings
from lupin_greenhouse_bridge.simulator.layout import find_places

WANTED = "name a file of record_readings or read_tag --csv, or a mission's report"
SELECT = f'SELECT rowid, {HEADER} FROM readings'  # noqa: S608 (no text of a user)


class ReadingFileError(OneLineError):
    """A file holds no readings, or cannot be read."""

    def __init__(self, path: Path | str, error: Exception) -> None:
        """Tell which file to name instead, unless only a value in this one is wrong."""
        hint = '' if isinstance(error, WrongValueError) else f': {WANTED}'
        super().__init__(f"'{path}': {file_error_text(error)}{hint}")


def read_rows(path: Path | str, tag_file: str = '') -> list[Row]:
    """
    Return the rows of a SQLite or CSV file, sorted by stamp, without torn lines.

    A row without a position gets the position of its tag in `tag_file`, or in the shipped layout for ''.
    Raises ReadingFileError for a file in another format or with a wrong value, and StartUpError for a bad
    tag_file.
    """
    try:
        rows = parse_rows(Path(path))
    except (OSError, sqlite3.Error, ValueError) as error:
        raise ReadingFileError(path, error) from error
    return with_places(rows, tag_file)


def parse_rows(path: Path) -> list[Row]:
    """Return the rows of a SQLite or CSV file; raises OSError, sqlite3.Error and ValueError."""
    if path.exists() and not path.is_file():
        raise ValueError('not a regular file')
    with path.open('rb') as file:
        head = file.read(HEAD_BYTES)
    if is_sqlite_of_readings(head):
        return _rows_of_sqlite(path)
    if not has_header(head):
        raise ValueError('not a file of readings' if head else 'empty')
    return parse_csv(path.read_bytes())


def with_places(rows: list[Row], tag_file: str = '') -> list[Row]:
    """Return the rows, sorted by stamp, with the positions of their tags where they lack one."""
    if any(row.x_m is None for row in rows):
        places_m = find_places(tag_file)
        for index, row in enumerate(rows):
            if row.x_m is None and (place_m := places_m.get(row.tag_id)):
                rows[index] = row._replace(x_m=place_m[0], y_m=place_m[1])
    return sorted(rows, key=attrgetter('stamp_ns'))


def _rows_of_sqlite(path: Path) -> list[Row]:
    rows = []
    # Writable: of a recorder that was killed in the middle of a commit, SQLite first restores the file.
    with contextlib.closing(sqlite3.connect(f'{path.resolve().as_uri()}?mode=rw', uri=True)) as connection:
        for number, *values in connection.execute(SELECT):
            rows.append(Row(*values))
            if fault := fault_of(rows[-1]):  # SQLite keeps values of any type
                raise WrongValueError(f'row {number}: {fault}')
    return rows
