# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Print readings as a table, as CSV or as JSON. Does not import ROS."""

import json
import os
import stat
import sys

from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.recording.rows import HEADER as CSV_HEADER
from lupin_greenhouse_bridge.recording.rows import csv_text, rows_of
from lupin_greenhouse_bridge.runtime.output import aligned_table, column_widths, print_line
from lupin_greenhouse_bridge.units import sensor_order, unit_of, value_text

HEADER = ('tag', 'sim time', 'sensor', 'value', 'unit')


class Screen:
    """Prints tables one below the other. With --watch at a terminal, each table replaces the last."""

    def __init__(self, is_watched: bool):
        self._is_watched = is_watched
        self._updates_in_place = is_watched and sys.stdout.isatty()
        self._lines_shown = 0
        self._widths = [0] * len(HEADER)

    def show(self, responses: dict, status_names: dict[int, str]) -> None:
        """Print readings by tag id. Failures go to standard error, or into a table that replaces another."""
        good, failures = _sorted_out(responses, status_names)
        rows = [row for tag_id, reading in good.items() for row in _rows(tag_id, reading)]
        lines = self._aligned(rows, is_first=not self._lines_shown or self._updates_in_place)
        if len(responses) > 1 and not self._is_watched:
            lines.append(f'{len(responses) - len(failures)}/{len(responses)} tags read')
        if self._updates_in_place:
            self._replace([*lines, *failures])
        else:
            self._lines_shown += len(lines)
            _print_lines(lines)
            _print_lines(failures, sys.stderr)

    def _aligned(self, rows: list[tuple], *, is_first: bool) -> list[str]:
        """Return the rows under one header, in columns that never get narrower."""
        if not rows:
            return []
        rows = [HEADER, *rows] if is_first else rows
        self._widths = column_widths(rows, self._widths)
        return aligned_table(rows, [HEADER.index('value')], self._widths)

    def _replace(self, lines: list[str]) -> None:
        """Erase the last table, and print as many lines as the terminal holds."""
        columns, rows = terminal_size(sys.stdout)
        if len(lines) >= rows:
            hidden = len(lines) - rows + 2
            lines = [*lines[:-hidden], f'... {hidden} more lines in a taller window']
        up = f'\x1b[{self._lines_shown}F' if self._lines_shown else ''
        print_line(up + '\x1b[J' + '\n'.join(line[: columns - 1] for line in lines))
        self._lines_shown = len(lines)


class Sheet:
    """Prints the rows that record_readings keeps as CSV, under one header."""

    def __init__(self, places_m: dict[str, tuple[float, float]]):
        self._places_m = places_m
        output = os.fstat(sys.stdout.fileno())
        is_continued = stat.S_ISREG(output.st_mode) and output.st_size > 0  # by >> FILE
        self._header = '' if is_continued else f'{CSV_HEADER}\n'

    def show(self, responses: dict, status_names: dict[int, str]) -> None:
        """Print readings by tag id. Failures go to standard error."""
        good, failures = _sorted_out(responses, status_names)
        rows = [
            row
            for each in good.values()
            for row in rows_of(each, 'read_tag', self._places_m.get(each.tag_id))
        ]
        print_line(self._header + csv_text(rows), end='')
        self._header = ''
        _print_lines(failures, sys.stderr)


def _sorted_out(responses: dict, status_names: dict[int, str]) -> tuple[dict, list[str]]:
    """Return the readings by tag id, and a line for each response that has none."""
    good, failures = {}, []
    for tag_id, response in responses.items():
        status = status_names.get(response.status, response.status)
        if status == 'OK':
            good[tag_id] = response.reading
        else:
            failures.append(f'read_tag: {status}: {escaped(response.error_message, 1000)}')
    return good, failures


def _print_lines(lines: list[str], stream=None) -> None:
    print_line('\n'.join(lines), stream, end='\n' if lines else '')


def terminal_size(stream) -> tuple[int, int]:
    """Return the columns and rows of the window, not of COLUMNS and LINES; 80 and 24 without a terminal."""
    columns, rows = os.get_terminal_size(stream.fileno())
    return columns or 80, rows or 24


def _rows(tag_id: str, reading) -> list[tuple[str, str, str, str, str]]:
    hours, seconds = divmod(int(reading.sim_time_of_day_seconds), 3600)
    sim_time = f'{hours:02}:{seconds // 60:02}:{seconds % 60:02}'
    return [
        (escaped(tag_id, 40), sim_time, each.name, value_text(each.name, each.value), unit_of(each.name))
        for each in sorted(reading.readings, key=lambda each: sensor_order(each.name))
    ]


def json_line(tag_id: str, response, status_names: dict[int, str]) -> str:
    """Return a response as one JSON object on one line; the fields of a missing reading are null."""
    status = status_names.get(response.status, response.status)
    reading = response.reading if status == 'OK' else None
    return json.dumps(
        {
            'tag_id': tag_id,
            'status': status,
            'error_message': response.error_message,
            'stamp': reading and {'sec': reading.stamp.sec, 'nanosec': reading.stamp.nanosec},
            'sim_time_of_day_seconds': reading and reading.sim_time_of_day_seconds,
            'readings': reading and {each.name: each.value for each in reading.readings},
        },
        ensure_ascii=False,
    )
