# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Rows as CSV in UTF-8: what the recorder and `read_tag --csv` write. Does not import ROS."""

import csv
import io
from collections.abc import Iterable
from types import SimpleNamespace

from lupin_greenhouse_bridge.recording.rows import Row, fault_of

HEADER = ','.join(Row._fields)
LONGEST_FIELD = 2**31 - 1  # characters; ROS does not limit the name of a sensor


def csv_text(rows: Iterable[Row]) -> str:
    r"""Return rows as lines of CSV that end in \n, without the header."""
    lines = []
    # The writer quotes each character of its own line end, \r\n: no tag id can end a line.
    csv.writer(SimpleNamespace(write=lines.append)).writerows(rows)
    return ''.join(f'{line[:-2]}\n' for line in lines)


def parse_csv(content: bytes) -> tuple[list[Row], int]:
    """
    Return the rows of a CSV with its header, and the size in bytes of its complete lines.

    The rest is a row that was torn when its writer was killed. Raises ValueError for anything else.
    """
    whole = content[: content.rfind(b'\n') + 1]
    line_count = whole.count(b'\n')
    csv.field_size_limit(LONGEST_FIELD)
    reader = csv.reader(io.StringIO(whole.decode('utf-8-sig'), newline='\n'), strict=True)
    if ','.join(next(reader, [])) != HEADER:
        raise ValueError(f'the first line is not {HEADER}')
    rows, complete_lines = [], 1
    try:
        for record in reader:
            rows.append(_row_of(record))
            complete_lines = reader.line_num
    except (ValueError, csv.Error) as error:
        if reader.line_num < line_count or not isinstance(error, csv.Error):
            raise ValueError(f'line {complete_lines + 1}: {error}') from error
    torn = whole.split(b'\n')[complete_lines:-1]
    return rows, len(whole) - sum(len(line) + 1 for line in torn)


def _row_of(record: list[str]) -> Row:
    if len(record) != len(Row._fields):
        raise ValueError(f'{len(record)} values in place of {len(Row._fields)}')
    stamp_ns, stamp_utc, tag_id, sensor, value, unit, x_m, y_m, sim_time, source = record
    row = Row(
        int(stamp_ns),
        stamp_utc,
        tag_id,
        sensor,
        float(value),
        unit,
        float(x_m) if x_m else None,
        float(y_m) if y_m else None,
        float(sim_time),
        source,
    )
    if fault := fault_of(row):
        raise ValueError(fault)
    return row
