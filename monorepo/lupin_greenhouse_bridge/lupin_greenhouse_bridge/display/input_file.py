# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The file that a command draws: a file of rows, or a mission's report. Does not import ROS."""

import sqlite3
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.display.report_line import Observation, has_report, parse_report
from lupin_greenhouse_bridge.recording.reading_files import ReadingFileError, parse_rows, with_places
from lupin_greenhouse_bridge.recording.rows import Row


class ReadingFile(NamedTuple):
    """The contents of a file."""

    rows: list[Row]  # in the order of their stamps
    visits: list[Observation]  # of a report, in its order; a continued mission visits a tag again


def read_file(path: Path | str, tag_file: str = '') -> ReadingFile:
    """
    Return the contents of a report, or of a file that read_rows() takes, whose errors it raises.

    A row without a position gets the position of its tag in `tag_file`, or in the shipped layout for ''.
    """
    path = Path(path)
    try:
        if path.is_file() and has_report(path):
            visits, _ = parse_report(path.read_bytes())
            rows = [row for each in visits if each.reading for row in each.reading.rows]
        else:
            rows, visits = parse_rows(path), []
    except (OSError, sqlite3.Error, ValueError) as error:
        raise ReadingFileError(path, error) from error
    return ReadingFile(with_places(rows, tag_file), visits)
