# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Print the answers of a bridge as a table, as CSV or as JSON. Imports ROS only for the answers."""

import contextlib
import json
import os
import stat
import sys
from collections.abc import Iterable, Sequence
from typing import TextIO

from lupin_greenhouse_bridge.contract import Answer
from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.interfaces import TagReading
from lupin_greenhouse_bridge.recording.rows import HEADER as CSV_HEADER
from lupin_greenhouse_bridge.recording.rows import csv_text, rows_of
from lupin_greenhouse_bridge.runtime.output import aligned_table, column_widths, print_line, terminal_size
from lupin_greenhouse_bridge.units import sensor_order, unit_of, value_text

HEADER = ('tag', 'sim time', 'sensor', 'value', 'unit')


class Table:
    """Prints tables one below the other. With --watch at a terminal, each table replaces the last."""

    def __init__(self, *, is_watched: bool) -> None:
        self._is_watched = is_watched
        self._updates_in_place = is_watched and sys.stdout.isatty()
        self._lines_shown = 0
        self._widths = [0] * len(HEADER)  # never get narrower

    def show(self, answers: Sequence[Answer]) -> None:
        """Print readings. Failures go to standard error, or into a table that replaces another."""
        rows = [row for each in answers if each.reading for row in _rows(each.tag_id, each.reading)]
        if rows and (self._updates_in_place or not self._lines_shown):
            rows.insert(0, HEADER)
        self._widths = column_widths([*rows, ('',) * len(HEADER)], self._widths)
        lines = aligned_table(rows, [HEADER.index('value')], self._widths)
        if len(answers) > 1 and not self._is_watched:
            lines.append(f'{sum(each.is_ok for each in answers)}/{len(answers)} tags read')
        if self._updates_in_place:
            self._replace([*lines, *_failures(answers)])
        else:
            self._lines_shown += len(lines)
            _print_lines(lines)
            _print_lines(_failures(answers), sys.stderr)

    def _replace(self, lines: list[str]) -> None:
        """Erase the last table, and print as many lines as the terminal holds."""
        columns, rows = terminal_size(sys.stdout)
        if len(lines) >= rows:
            hidden = len(lines) - rows + 2
            lines = [*lines[:-hidden], f'... {hidden} more lines in a taller window']
        up = f'\x1b[{self._lines_shown}F' if self._lines_shown else ''
        print_line(up + '\x1b[J' + '\n'.join(line[: columns - 1] for line in lines))
        self._lines_shown = len(lines)


class Csv:
    """Prints the rows that record_readings keeps as CSV, under one header."""

    def __init__(self, places_m: dict[str, tuple[float, float]]) -> None:
        """Take x and y of the tags in metres, by id."""
        self._places_m = places_m
        self._header = '' if _is_added_to_a_file() else f'{CSV_HEADER}\n'

    def show(self, answers: Sequence[Answer]) -> None:
        """Print readings. Failures go to standard error."""
        readings = [each.reading for each in answers if each.reading]
        rows = [
            row for each in readings for row in rows_of(each, 'read_tag', self._places_m.get(each.tag_id))
        ]
        print_line(self._header + csv_text(rows), end='')
        self._header = ''
        _print_lines(_failures(answers), sys.stderr)


class Json:
    """Prints one object for each answer, on a line of its own."""

    def show(self, answers: Sequence[Answer]) -> None:
        """Print readings and failures; the fields of a missing reading are null."""
        _print_lines(map(_json_line, answers))


def _failures(answers: Sequence[Answer]) -> list[str]:
    return [
        f'read_tag: {each.status}: {escaped(each.error_message, 1000)}' for each in answers if not each.is_ok
    ]


def _print_lines(lines: Iterable[str], stream: TextIO | None = None) -> None:
    print_line(''.join(f'{line}\n' for line in lines), stream, end='')


def _is_added_to_a_file() -> bool:
    """Return whether the output is a file that is not empty, as with >> FILE."""
    with contextlib.suppress(OSError, ValueError):
        output = os.fstat(sys.stdout.fileno())
        return stat.S_ISREG(output.st_mode) and output.st_size > 0
    return False


def _rows(tag_id: str, reading: TagReading) -> list[tuple[str, ...]]:
    hours, seconds = divmod(int(reading.sim_time_of_day_seconds), 3600)
    sim_time = f'{hours:02}:{seconds // 60:02}:{seconds % 60:02}'
    return [
        (escaped(tag_id, 40), sim_time, each.name, value_text(each.name, each.value), unit_of(each.name))
        for each in sorted(reading.readings, key=lambda each: sensor_order(each.name))
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
            'readings': reading and {each.name: each.value for each in reading.readings},
        },
        ensure_ascii=False,
    )
