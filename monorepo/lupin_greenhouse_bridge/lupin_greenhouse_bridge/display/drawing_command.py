# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""A command that draws a file of readings: its options, its inputs and its errors. Does not import ROS."""

import argparse
import csv
import math
import sqlite3
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.display.colours import read_colour_ranges
from lupin_greenhouse_bridge.display.report_line import Observation, has_report, parse_report
from lupin_greenhouse_bridge.display.summary import tags_text
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped, pluralized
from lupin_greenhouse_bridge.planning.walls import Walls, add_wall_options, find_walls
from lupin_greenhouse_bridge.recording.reading_files import ReadingFileError, parse_rows, with_places
from lupin_greenhouse_bridge.recording.rows import Row
from lupin_greenhouse_bridge.runtime.output import print_line
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, find_layout, natural_order, require_layout

DONE, NO_ROWS, USAGE = 0, 1, 2
MOST_ROUNDING_M = 0.01  # between the positions of one tag in two files
# A mission keeps these files beside its report NAME.jsonl, each for the option that names another one.
COMPANION_ENDINGS = {
    'route': '-route.csv',
    'tag_file': '-tag_locations.json',
    'sim_config_file': '-greenhouse_config.yaml',
}
MOST_NAMED = 4  # tags outside the walls in a warning


class NothingToDraw(OneLineError):
    """A file has no reading that can be drawn."""


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


def parser_of(prog: str, description: str, output_help: str) -> argparse.ArgumentParser:
    """Return the parser of a command that draws a file of readings."""
    parser = argparse.ArgumentParser(prog=prog, description=description)
    parser.set_defaults(prog=prog)
    parser.add_argument(
        'file',
        metavar='FILE',
        type=Path,
        help="a mission's report NAME.jsonl, or a file NAME.sqlite or NAME.csv of record_readings or"
        ' read_tag --csv',
    )
    parser.add_argument(
        '--tag-file',
        default='',
        metavar='FILE',
        help="the bridge's tag_file, if you set one; default: NAME-tag_locations.json beside FILE",
    )
    add_wall_options(parser)
    parser.add_argument(
        '--route',
        default='',
        metavar='FILE',
        help='a CSV file of x and y along the path that a robot drove; default: NAME-route.csv beside FILE',
    )
    parser.add_argument('-o', '--output', type=Path, metavar='FILE', help=output_help)
    return parser


def draw_file(
    parser: argparse.ArgumentParser,
    arguments: list[str] | None,
    suffix: str,
    draw: Callable[[argparse.Namespace, ReadingFile], bytes],
) -> int:
    """Run a command of parser_of(): write what draw() returns to --output, and return the exit code."""
    options = parser.parse_args(arguments)
    folder, name = options.file.parent, options.file.stem
    for option, ending in COMPANION_ENDINGS.items():
        companion = folder / f'{name}{ending}'
        if not getattr(options, option) and companion.is_file() and companion != options.file:
            setattr(options, option, str(companion))
    output = options.output = options.output or folder / f'{name}{suffix}'
    try:
        file = read_file(options.file, options.tag_file)
        if output.exists() and output.samefile(options.file):
            raise StartUpError(f"--output '{output}' is the file of readings itself: name another")
        drawing = draw(options, file)
        try:
            output.write_bytes(drawing)
        except OSError as error:
            raise StartUpError(f"--output '{output}': {error.strerror}: name another file") from error
    except (OneLineError, ImportError) as error:
        hint = ': sudo apt install python3-matplotlib' if isinstance(error, ImportError) else ''
        print(f'{parser.prog}: {error}{hint}', file=sys.stderr)
        return NO_ROWS if isinstance(error, NothingToDraw) else USAGE
    print_line(f'{"page" if suffix == ".html" else "picture"}: {escaped(str(output), 500)}')
    return DONE


def greenhouse_of(
    options: argparse.Namespace, file: ReadingFile
) -> tuple[Layout, Walls, dict[str, tuple[float, float]]]:
    """Return the layout, the walls and the ranges of the colours; warn of tags outside the walls."""
    layout = _layout_of(file, options.tag_file)
    walls = find_walls(layout, options.sim_config_file, options.walls)
    if outside := [tag_id for tag_id, tag in layout.tags.items() if not walls.has_inside(tag.x, tag.y)]:
        named = tags_text(outside, MOST_NAMED)
        problem = f'outside the walls ({walls}): {named}: set --walls or --sim-config-file'
        print(f'{options.prog}: {problem}', file=sys.stderr)
    return layout, walls, read_colour_ranges(options.sim_config_file)


def _layout_of(file: ReadingFile, tag_file: str) -> Layout:
    """
    Return the layout of tag_file, or the shipped one for '', with the positions of tags that the rows have.

    Raises StartUpError for a bad tag_file, for a layout of another greenhouse, and if no position is known.
    """
    placed = {
        row.tag_id: Tag(row.x_m, row.y_m, [])
        for row in file.rows
        if row.x_m is not None and row.y_m is not None
    }
    layout = (find_layout(tag_file) or Layout({}, {})) if placed else require_layout(tag_file)
    tag_ids = {row.tag_id for row in file.rows} | {visit.tag_id for visit in file.visits}
    if tag_file and (strangers := tag_ids - set(layout.tags)):
        raise StartUpError(
            f"--tag-file '{tag_file}': {len(strangers)} of the file's {pluralized(len(tag_ids), 'tag')} are"
            f" not in it, such as '{escaped(min(strangers, key=natural_order), 64)}':"
            ' name the tag_file of its bridge'
        )
    for tag_id in layout.tags.keys() & placed.keys():
        here, there = placed[tag_id][:2], layout.tags[tag_id][:2]
        if math.dist(here, there) > MOST_ROUNDING_M:
            raise StartUpError(
                f"tag '{escaped(tag_id, 64)}' is at ({here[0]:g}, {here[1]:g}) in the file, and at"
                f' ({there[0]:g}, {there[1]:g}) in {tag_file or "the shipped tag file"}: name the tag_file'
                ' of its bridge with --tag-file'
            )
    return layout._replace(tags=layout.tags | placed)


def read_route(name: str | Path) -> list[tuple[float, float]]:
    """Return x and y in metres of each point of a CSV file, or none for ''; raises StartUpError."""
    if not name:
        return []
    path = Path(name)
    if path.exists() and not path.is_file():  # a pipe would wait for its writer
        raise StartUpError(f"--route '{path}': is not a regular file: name another")
    try:
        with path.open(encoding='utf-8', newline='') as file:
            route = [(float(row['x']), float(row['y'])) for row in csv.DictReader(file)]
    except OSError as error:
        raise StartUpError(f"--route '{path}': {error.strerror}: name another") from error
    except (KeyError, TypeError, ValueError, csv.Error):
        route = []
    if not route or not all(math.isfinite(each) for point in route for each in point):
        raise StartUpError(f"--route '{path}': is not a CSV file of x,y in metres: name another")
    return route
