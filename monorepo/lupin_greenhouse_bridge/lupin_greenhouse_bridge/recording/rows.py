# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The rows of recorded readings, with one value each, and their CSV form in UTF-8. Does not import ROS."""

import csv
import datetime
import io
import math
from collections.abc import Iterable
from types import SimpleNamespace
from typing import NamedTuple

from lupin_greenhouse_bridge.units import unit_of

LATEST_STAMP_NS = 2**63 - 1  # the year 2262
FORMULAS = ('=', '+', '-', '@', '\t', '\r', "'")  # a text cell that starts so gets an apostrophe before it
LONGEST_FIELD = 2**31 - 1  # characters; ROS does not limit the name of a sensor


class Row(NamedTuple):
    """One value of one reading. Its key is the wall clock stamp, the tag id and the sensor."""

    stamp_ns: int  # wall clock of the bridge, since 1970
    stamp_utc: str  # the same, as ISO 8601
    tag_id: str
    sensor: str
    value: float
    unit: str  # '' for a sensor that is not one of the simulator's
    x_m: float | None  # position of the tag in the layout; None if it is unknown
    y_m: float | None
    sim_time_of_day_seconds: float  # in [0, 86400); it repeats, so it identifies nothing
    source: str  # the topic or the command that the reading came from


HEADER = ','.join(Row._fields)


def rows_of(reading, source: str, place_m: tuple[float, float] | None = None) -> list[Row]:
    """Return the rows of a TagReading, in the order of its sensors."""
    stamp_ns = reading.stamp.sec * 1_000_000_000 + reading.stamp.nanosec
    values = ((each.name, each.value) for each in reading.readings)
    return make_rows(stamp_ns, reading.tag_id, values, reading.sim_time_of_day_seconds, source, place_m)


def make_rows(stamp_ns, tag_id, values, sim_time_of_day_seconds, source, place_m=None) -> list[Row]:
    """Return a row for each name and value. The other arguments are columns; place_m is x and y or None."""
    head = stamp_ns, utc_of(stamp_ns), tag_id
    tail = *(place_m or (None, None)), sim_time_of_day_seconds, source
    return [Row(*head, sensor, value, unit_of(sensor), *tail) for sensor, value in values]


def fault_of(rows: Iterable[Row]) -> str:
    """Return the first invalid number in rows that come from outside; '' if there is none."""
    for row in rows:
        if not 0 <= row.stamp_ns <= LATEST_STAMP_NS:
            return f'stamp_ns is {row.stamp_ns}'
        for name in ('value', 'x_m', 'y_m', 'sim_time_of_day_seconds'):
            number = getattr(row, name)
            if number is not None and not math.isfinite(number):
                return f'{name} of {row.sensor} is {number}'
    return ''


def utc_of(stamp_ns: int) -> str:
    """Return a stamp as ISO 8601 in UTC with nanoseconds, such as 2026-05-04T09:30:00.000000000Z."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    moment = datetime.datetime.fromtimestamp(seconds, tz=datetime.timezone.utc)
    return f'{moment:%Y-%m-%dT%H:%M:%S}.{nanoseconds:09}Z'


def last_reading_of_each_tag(rows: Iterable[Row]) -> dict[str, dict[str, Row]]:
    """Return the last reading of each tag as its rows by sensor; rows come in the order of their stamps."""
    last: dict[str, dict[str, Row]] = {}
    for row in rows:
        reading = last.setdefault(row.tag_id, {})
        if any(each.stamp_ns != row.stamp_ns for each in reading.values()):
            reading.clear()
        reading[row.sensor] = row
    return last


def csv_text(rows: Iterable[Row]) -> str:
    r"""Return rows as lines of CSV that end in \n, without the header."""
    lines = []
    # The writer quotes each character of its own line end, \r\n: no tag id can end a line.
    csv.writer(SimpleNamespace(write=lines.append)).writerows(map(_escaped, row) for row in rows)
    return ''.join(f'{line[:-2]}\n' for line in lines)


def _escaped(cell):
    """Return a cell that no spreadsheet takes for a formula."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULAS) else cell


def _unescaped(cell: str) -> str:
    return cell[1:] if cell.startswith("'") and cell.startswith(FORMULAS, 1) else cell


def has_header(content: bytes) -> bool:
    """Return whether content starts as a CSV file of rows does."""
    return content.removeprefix(b'\xef\xbb\xbf').startswith(HEADER.encode())


def parse_csv(content: bytes, lines_before: int = 0) -> tuple[list[Row], int]:
    """
    Return the rows of a CSV with its header, and the size in bytes of its complete lines.

    A repeated header is ignored. With `lines_before`, the content starts with the row after that many lines.
    An incomplete last line, which a killed writer can leave, is not parsed. Raises ValueError for any other
    fault.
    """
    whole = content[: content.rfind(b'\n') + 1]
    line_count = whole.count(b'\n')
    csv.field_size_limit(LONGEST_FIELD)
    reader = csv.reader(io.StringIO(whole.decode('utf-8-sig'), newline='\n'), strict=True)
    if not lines_before and ','.join(next(reader, [])) != HEADER:
        raise ValueError(f'the first line is not {HEADER}')
    rows, complete_lines = [], reader.line_num
    try:
        for record in reader:
            if tuple(record) != Row._fields:
                rows.append(_row_of(record))
            complete_lines = reader.line_num
    except (ValueError, csv.Error) as error:
        if reader.line_num < line_count or not isinstance(error, csv.Error):
            raise ValueError(f'line {lines_before + complete_lines + 1}: {error}') from error
    torn = whole.split(b'\n')[complete_lines:-1]
    return rows, len(whole) - sum(len(line) + 1 for line in torn)


def _row_of(record: list[str]) -> Row:
    if len(record) != len(Row._fields):
        raise ValueError(f'{len(record)} values in place of {len(Row._fields)}')
    stamp_ns, stamp_utc, tag_id, sensor, value, unit, x_m, y_m, sim_time, source = map(_unescaped, record)
    head = int(stamp_ns), stamp_utc, tag_id, sensor, float(value), unit
    place_m = (float(x_m) if x_m else None, float(y_m) if y_m else None)
    row = Row(*head, *place_m, float(sim_time), source)
    if fault := fault_of([row]):
        raise ValueError(fault)
    return row
