# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Read a file of rows, also one that another program has saved again. Does not import ROS."""

import codecs
import contextlib
import csv
import datetime
import io
import re
import sqlite3
import sys
from operator import attrgetter
from pathlib import Path
from typing import Any

from lupin_greenhouse_bridge.errors import OneLineError, pluralized, reason_of
from lupin_greenhouse_bridge.recording.rows import (
    FORMULAS,
    HEADER,
    NUMBERS,
    PLACE,
    TEXTS,
    Row,
    WrongValueError,
    fault_of,
)
from lupin_greenhouse_bridge.recording.store import SQLITE_HEAD
from lupin_greenhouse_bridge.runtime.output import print_line
from lupin_greenhouse_bridge.simulator.layout import find_places

WANTED = "name a file of record_readings or read_tag --csv, or a mission's report"
OPTIONS = {'.json': 'name a tag file with --tag-file'} | dict.fromkeys(
    ('.yaml', '.yml'), 'name a greenhouse config with --sim-config-file'
)
SELECT = f'SELECT {HEADER} FROM readings'  # noqa: S608 (no text of a user)
LONGEST_FIELD = 2**31 - 1  # characters; ROS does not limit the name of a sensor
DELIMITERS = ',;\t|'
STAMP_UTC = re.compile(r'(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)\.(\d{9})Z', re.ASCII)
ROUNDED_NS = 10**4  # at least the error of a stamp of 19 digits of which a spreadsheet keeps 15


class ReadingFileError(OneLineError):
    """A file holds no readings, or cannot be read."""

    def __init__(self, path: Path | str, error: Exception) -> None:
        """Tell which file to name instead, or which option takes it, unless only a value in it is wrong."""
        other = OPTIONS.get(Path(path).suffix.lower()) if isinstance(error, ValueError) else None
        hint = '' if isinstance(error, WrongValueError) else f': {other or WANTED}'
        super().__init__(f"'{path}': {reason_of(error)}{hint}")


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
        if file.read(len(SQLITE_HEAD)) == SQLITE_HEAD:
            return _rows_of_sqlite(path)
    return parse_csv(path.read_bytes(), path)


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
        for number, values in enumerate(connection.execute(SELECT), start=1):
            row = Row(*map(_of_type, Row._fields, values))
            if fault := fault_of(row):  # SQLite keeps values of any type
                raise WrongValueError(f'row {number}: {fault}')
            rows.append(row)
    return rows


def _of_type(column: str, value: Any) -> Any:
    """Return a value of a database; a column of another program can have text or integers for our type."""
    if isinstance(value, int) and column != 'stamp_ns':
        return float(value) if column in NUMBERS else str(value)
    return _parsed(column, value) if isinstance(value, str) and column not in TEXTS else value


def parse_csv(content: bytes, path: Path | str = '') -> list[Row]:
    """
    Return the rows of a CSV file.

    The columns can be in any order and in quotes, between commas, semicolons, tabs or bars, and beside other
    columns. Ignores headers, and lines with fewer values than columns. A killed writer can leave one of them
    at the end, or before the header of the next writer; this tells of all others on standard error.
    Raises WrongValueError for any other line that is not a row, and ValueError for another header.
    """
    csv.field_size_limit(LONGEST_FIELD)
    is_utf_16 = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    # A torn line can end within a character: surrogates stand for its bytes.
    text = content.decode('utf-16' if is_utf_16 else 'utf-8-sig', errors='surrogateescape')
    delimiter, names = _header_of(text)
    reader, rows = csv.reader(io.StringIO(text, newline=''), delimiter=delimiter), []
    indices = [names.index(column) for column in Row._fields]
    short: list[int] = []  # numbers of lines
    is_torn = False  # whether a writer can have left the line before this one
    try:
        for cells in reader:
            if len(cells) > len(names):
                raise ValueError(f'{len(cells)} values in place of {len(names)}')
            if len(cells) == len(names) and cells != names:
                rows.append(_row_of([cells[index] for index in indices], has_commas=delimiter == ';'))
            if is_torn and cells == names:
                short.pop()
            if is_torn := 0 < len(cells) < len(names):
                short.append(reader.line_num)
        if len(short) > 1 and not rows:
            raise ValueError(f'no line has {len(names)} values, as the header')
    except (ValueError, csv.Error) as error:
        raise WrongValueError(f'line {reader.line_num}: {error}') from error
    if lost := short[: len(short) - is_torn]:
        lines = f'{pluralized(len(lost), "line")} with fewer values than the {len(names)} of the header'
        print_line(f'{path}: left out {lines}, first line {lost[0]}', sys.stderr)
    return rows


def _header_of(text: str) -> tuple[str, list[str]]:
    """Return the delimiter and the names of the columns; raises ValueError if one of ours is missing."""
    if not text:
        raise ValueError('empty')
    line = io.StringIO(text, newline='').readline()
    headers = {each: _cells_of(line, each) for each in DELIMITERS}
    delimiter = max(headers, key=lambda each: len(set(headers[each]).intersection(Row._fields)))
    missing = [column for column in Row._fields if column not in headers[delimiter]]
    if len(missing) == len(Row._fields):
        raise ValueError(f'not a file of readings, which is SQLite or CSV with the header {HEADER}')
    if missing:
        raise ValueError(f'its header lacks {", ".join(missing)}')
    return delimiter, headers[delimiter]


def _cells_of(line: str, delimiter: str) -> list[str]:
    with contextlib.suppress(csv.Error):  # before Python 3.11, of a file that is no text
        return next(csv.reader([line], delimiter=delimiter), [])
    return []


def _row_of(cells: list[str], *, has_commas: bool) -> Row:
    stamp_ns, stamp_utc, *_ = cells
    if has_commas:
        cells = [
            cell.replace(',', '.') if column in NUMBERS else cell
            for column, cell in zip(Row._fields, cells, strict=True)
        ]
    row = Row(*map(_parsed, Row._fields, cells))._replace(stamp_ns=_unrounded(stamp_ns, stamp_utc))
    if fault := fault_of(row):
        raise ValueError(fault)
    return row


def _parsed(column: str, cell: str) -> Any:
    """Return the value in a cell, or the cell itself if it must be a number and is none."""
    if column in TEXTS:
        return cell[1:] if cell.startswith("'") and cell.startswith(FORMULAS, 1) else cell
    if column in PLACE and cell in ('', 'NA'):  # of R
        return None
    try:
        return int(cell) if column == 'stamp_ns' else float(cell)
    except ValueError:
        return cell


def _unrounded(cell: str, stamp_utc: str) -> Any:
    """Return a stamp; from stamp_utc if a program has taken stamp_ns for a float, and has rounded it."""
    is_float = not cell.isdecimal() and re.fullmatch(r'\d+[.,]?\d*(E\+?\d+)?', cell, re.IGNORECASE)
    if (is_float or cell.endswith('0000')) and (match := STAMP_UTC.fullmatch(stamp_utc)):
        moment = datetime.datetime.fromisoformat(f'{match[1]}+00:00')
        stamp_ns = int(moment.timestamp()) * 10**9 + int(match[2])
        if is_float or (cell.isdecimal() and abs(int(cell) - stamp_ns) < ROUNDED_NS):
            return stamp_ns
    if is_float:
        raise ValueError(f"stamp_ns is rounded to '{cell}': save it as text, with all of its digits")
    return _parsed('stamp_ns', cell)
