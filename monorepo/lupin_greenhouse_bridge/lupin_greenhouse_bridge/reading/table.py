# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Print the answers of a bridge as a table, CSV or JSON. Imports ROS only for the answers."""

import csv
import datetime
import io
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TextIO

from lupin_greenhouse_bridge.contract import Answer
from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.interfaces import TagReading
from lupin_greenhouse_bridge.runtime.output import aligned_table, print_line
from lupin_greenhouse_bridge.units import sensor_order, unit_of, value_text

HEADER = ('tag', 'sim time', 'sensor', 'value', 'unit')
# The columns of a recorded reading.
CSV_COLUMNS = (
    *('stamp_ns', 'stamp_utc', 'tag_id', 'sensor', 'value', 'unit', 'x_m', 'y_m'),
    *('sim_time_of_day_seconds', 'source'),
)


def print_table(answers: Sequence[Answer]) -> None:
    """Print a table of the readings. Failures go to standard error."""
    rows = [row for answer in answers if answer.reading for row in _rows(answer.tag_id, answer.reading)]
    lines = aligned_table([HEADER, *rows], [HEADER.index('value')]) if rows else []
    if len(answers) > 1:
        lines.append(f'{sum(answer.is_ok for answer in answers)}/{len(answers)} tags read')
    _print_lines(lines)
    print_failures(answers)


class CsvPrinter:
    """Prints one line per value, and the header once."""

    def __init__(self, positions_m: Mapping[str, tuple[float, float]]) -> None:
        """Take x and y of the tags in metres, by id."""
        self._positions_m = positions_m
        self._rows: list[tuple[object, ...]] = [CSV_COLUMNS]

    def __call__(self, answers: Sequence[Answer]) -> None:
        """Print readings. Failures go to standard error."""
        for answer in answers:
            if answer.reading:
                self._rows += self._csv_rows(answer.reading)
        text = io.StringIO()
        csv.writer(text, lineterminator='\n').writerows(self._rows)
        print_line(text.getvalue(), end='')
        self._rows = []
        print_failures(answers)

    def _csv_rows(self, reading: TagReading) -> list[tuple[object, ...]]:
        stamp = datetime.datetime.fromtimestamp(reading.stamp.sec, tz=datetime.timezone.utc)
        x, y = self._positions_m.get(reading.tag_id, ('', ''))
        return [
            (
                reading.stamp.sec * 10**9 + reading.stamp.nanosec,
                f'{stamp:%Y-%m-%dT%H:%M:%S}.{reading.stamp.nanosec:09}Z',
                reading.tag_id,
                value.name,
                value.value,
                unit_of(value.name),
                x,
                y,
                reading.sim_time_of_day_seconds,
                'read_tag',
            )
            for value in reading.readings
        ]


def print_json(answers: Sequence[Answer]) -> None:
    """Print one JSON object per answer and line; the fields of a missing reading are null."""
    _print_lines(map(_json_line, answers))


def print_failures(answers: Sequence[Answer]) -> None:
    """Print a line on standard error for each tag that was not read."""
    _print_lines(
        (
            f'read_tag: {answer.status}: {escaped(answer.error_message, 1000)}'
            for answer in answers
            if not answer.is_ok
        ),
        sys.stderr,
    )


def _print_lines(lines: Iterable[str], stream: TextIO | None = None) -> None:
    print_line(''.join(f'{line}\n' for line in lines), stream, end='')


def _rows(tag_id: str, reading: TagReading) -> list[tuple[str, ...]]:
    hours, seconds = divmod(int(reading.sim_time_of_day_seconds), 3600)
    sim_time = f'{hours:02}:{seconds // 60:02}:{seconds % 60:02}'
    return [
        (
            escaped(tag_id, 40),
            sim_time,
            value.name,
            value_text(value.name, value.value),
            unit_of(value.name),
        )
        for value in sorted(reading.readings, key=lambda value: sensor_order(value.name))
    ]


def _json_line(answer: Answer) -> str:
    reading = answer.reading
    return json.dumps(
        {
            'tag_id': answer.tag_id,
            'status': answer.status,
            'error_message': answer.error_message,
            'stamp': reading and {'sec': reading.stamp.sec, 'nanosec': reading.stamp.nanosec},
            'sim_time_of_day_seconds': reading and reading.sim_time_of_day_seconds,
            'readings': reading and {value.name: value.value for value in reading.readings},
        },
        ensure_ascii=False,
    )
