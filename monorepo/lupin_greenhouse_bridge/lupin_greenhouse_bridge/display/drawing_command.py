# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""A command that draws files of readings: its options, its inputs and its errors. Does not import ROS."""

import argparse
import csv
import math
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.display.colours import colour_limits, read_colour_ranges
from lupin_greenhouse_bridge.display.placing import Point
from lupin_greenhouse_bridge.display.report_line import Observation, has_report, parse_report
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, UsageError, escaped, pluralized
from lupin_greenhouse_bridge.planning.walls import Walls, add_wall_options, find_walls, warning_of_outside
from lupin_greenhouse_bridge.recording.reading_files import ReadingFileError, read_rows, with_places
from lupin_greenhouse_bridge.recording.rows import Row, key_of, last_reading_of_each_tag
from lupin_greenhouse_bridge.runtime.arguments import Parser
from lupin_greenhouse_bridge.runtime.output import check_output_file, print_line
from lupin_greenhouse_bridge.simulator.json_yaml import read_text
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, find_layout, natural_order, require_layout
from lupin_greenhouse_bridge.units import sensor_order

DONE, NO_ROWS, USAGE = 0, 1, 2
MOST_ROUNDING_M = 0.01  # between the positions of one tag in two files
# A mission keeps these files beside its report NAME.jsonl, each for the option that names another one.
COMPANION_ENDINGS = {
    'route': '-route.csv',
    'tag_file': '-tag_locations.json',
    'sim_config_file': '-greenhouse_config.yaml',
}
MOST_SENSORS = 20  # more panels than this are no picture to look at
LONGEST_NAME = 64  # characters
LARGEST_ROUTE_BYTES = 2**30
LARGEST_VALUE, LARGEST_M = 1e20, 1e12  # no program that draws fails at sums and squares of these
DRAWABLE = f'values must be within {LARGEST_VALUE:g}, and positions within {LARGEST_M:g} m, of 0'


class NothingToDraw(OneLineError):
    """A file has no reading that can be drawn."""


class ReadingFile(NamedTuple):
    """The contents of a file."""

    rows: list[Row]  # in the order of their stamps
    visits: list[Observation]  # of a report, in its order; a continued mission visits a tag again


Limits = dict[str, tuple[float, float]]  # the values at the ends of the colours, by sensor


class Recording(NamedTuple):
    """A file of readings, and the greenhouse that they are from."""

    path: Path
    name: str  # of the file, after as many folders as tell it from the other files
    rows: list[Row]
    visits: list[Observation]
    layout: Layout
    walls: Walls
    route: list[Point]
    colour_ranges: Limits  # of its config


def read_file(path: Path | str, tag_file: str = '') -> ReadingFile:
    """
    Return the contents of a report, or of a file that read_rows() takes, whose errors it raises.

    A row without a position gets the position of its tag in `tag_file`, or in the shipped layout for ''.
    """
    path = Path(path)
    try:
        if not (path.is_file() and has_report(path)):
            return ReadingFile(read_rows(path, tag_file), [])
        visits, _ = parse_report(path.read_bytes())
    except (OSError, ValueError) as error:
        raise ReadingFileError(path, error) from error
    rows = [row for each in visits if each.reading for row in each.reading.rows]
    return ReadingFile(with_places(rows, tag_file), visits)


def parser_of(prog: str, description: str, output_help: str) -> argparse.ArgumentParser:
    """Return the parser of a command that draws files of readings."""
    parser = Parser(prog=prog, description=description)
    parser.set_defaults(prog=prog)
    add = parser.add_argument
    add(
        'files',
        metavar='FILE',
        type=Path,
        nargs='+',
        help="a mission's report NAME.jsonl, or a file NAME.sqlite or NAME.csv of record_readings or"
        ' read_tag --csv; name several to compare them',
    )
    add(
        '--sensor',
        metavar='NAME',
        action='append',
        default=[],
        help='show this sensor only; repeat the option for more; default: all',
    )
    add(
        '--tag-file',
        default='',
        metavar='FILE',
        help="the bridge's tag_file, if you set one; default: NAME-tag_locations.json beside FILE",
    )
    add_wall_options(parser)
    add(
        '--route',
        default='',
        metavar='FILE',
        help='a CSV file of x and y along the path that a robot drove; default: NAME-route.csv beside FILE',
    )
    add('-o', '--output', type=Path, metavar='FILE', help=output_help)
    return parser


def draw_files(
    parser: argparse.ArgumentParser,
    arguments: list[str] | None,
    draw: Callable[[argparse.Namespace, list[Recording], Limits], Iterable[tuple[Path, bytes]]],
) -> int:
    """Run a command of parser_of(): write each file that draw() returns, and return the exit code."""
    options = parser.parse_args(arguments)
    inputs = [*(('FILE', each) for each in options.files), ('--tag-file', options.tag_file)]
    inputs += [('--sim-config-file', options.sim_config_file), ('--route', options.route)]
    try:
        for each in options.files:
            if ':=' in str(each):
                raise UsageError(f"'{each}' is no file of readings: write options such as --tag-file FILE")
        if options.output:
            check_output_file(options.output, '--output', inputs)
        if options.route and len(options.files) > 1:
            raise StartUpError(f"--route '{options.route}' is for one FILE: name one FILE only")
        for each in options.files:
            if sum(other.resolve() == each.resolve() for other in options.files) > 1:
                raise UsageError(f"'{each}' is named twice: name each file once")
        named = zip(options.files, _names_of(options.files), strict=True)
        recordings = [_read_recording(path, name, options) for path, name in named]
        for output, drawing in draw(options, recordings, _limits_of(recordings, options.sensor)):
            check_output_file(output, '--output', inputs)
            try:
                output.write_bytes(drawing)
            except OSError as error:
                raise StartUpError(f"--output '{output}': {error.strerror}: name another file") from error
            kind = 'page' if options.prog == 'readings_page' else 'picture'
            print_line(f'{kind}: {escaped(str(output), 500)}')
    except (OneLineError, ImportError) as error:
        hint = ': sudo apt install python3-matplotlib' if isinstance(error, ImportError) else ''
        print(f'{parser.prog}: {error}{hint}', file=sys.stderr)
        return NO_ROWS if isinstance(error, NothingToDraw) else USAGE
    return DONE


def _names_of(paths: list[Path]) -> list[str]:
    """Return the names of files, with as many of their folders as make them differ."""
    depth, deepest = 1, max(len(path.parts) for path in paths)
    while len({path.parts[-depth:] for path in paths}) < len(paths) and depth < deepest:
        depth += 1
    return [escaped(str(Path(*path.parts[-depth:])), LONGEST_NAME) for path in paths]


def _read_recording(path: Path, name: str, options: argparse.Namespace) -> Recording:
    """Return a file with its greenhouse; warn of hidden values, and of what is outside the walls."""
    companions = {}
    for option, ending in COMPANION_ENDINGS.items():
        companion = path.parent / f'{path.stem}{ending}'
        companions[option] = getattr(options, option) or str(companion if companion.is_file() else '')
    sim_config_file = companions['sim_config_file']
    file = read_file(path, companions['tag_file'])
    rows = {key_of(row) for row in file.rows}
    if hidden := len(rows) - len({each[:3] for each in rows}):
        problem = f'{path}: {pluralized(hidden, "value")} with the stamp, tag and sensor of another value'
        print(f'{options.prog}: {problem}: the last one is shown', file=sys.stderr)
    layout = _layout_of(path, file, companions['tag_file'])
    walls = find_walls(layout, sim_config_file, options.walls)
    if max(map(abs, walls)) > LARGEST_M:
        raise StartUpError(f'the walls are {walls}: {DRAWABLE}')
    if warning := warning_of_outside(layout, walls):
        print(f'{options.prog}: {warning}', file=sys.stderr)
    colour_ranges = read_colour_ranges(sim_config_file)
    return Recording(path, name, *file, layout, walls, read_route(companions['route']), colour_ranges)


def _limits_of(recordings: list[Recording], wanted: list[str]) -> Limits:
    """
    Return the ends of the colours of these sensors, or of all, which are the same for all files.

    Raises StartUpError for a sensor that no file has, and for more than a person can look at.
    """
    values, last_values, colour_ranges = defaultdict(list), defaultdict(list), Limits()
    for each in recordings:
        colour_ranges |= each.colour_ranges
        for row in each.rows:
            values[row.sensor].append(row.value)
        for reading in last_reading_of_each_tag(each.rows).values():
            for row in reading.values():
                last_values[row.sensor].append(row.value)
    found = sorted(values, key=sensor_order)
    named = ', '.join(escaped(each, LONGEST_NAME) for each in found[:MOST_SENSORS])
    if unknown := [each for each in wanted if each not in found]:
        shown = escaped(unknown[0], LONGEST_NAME)
        several = ', and repeat --sensor for each' if re.search('[,; ]', shown) else ''
        raise StartUpError(f"--sensor '{shown}': no FILE has it: choose from {named or 'none'}{several}")
    sensors = [each for each in found if each in (wanted or found)]
    if len(sensors) > MOST_SENSORS:
        raise StartUpError(
            f'{len(sensors)} sensors are too many to look at: choose up to {MOST_SENSORS} with --sensor, from'
            f' {named} and others'
        )
    # Only the last values have a colour: those of a whole day would leave them alike.
    return {
        each: colour_limits(last_values[each] or values[each], colour_ranges.get(each)) for each in sensors
    }


def _layout_of(path: Path, file: ReadingFile, tag_file: str) -> Layout:
    """
    Return the layout of tag_file, or the shipped one for '', with the positions of tags that the rows have.

    Raises StartUpError for a bad tag_file, for a layout of another greenhouse, if no position is known, and
    for a number that is too large to be drawn.
    """
    placed = {
        row.tag_id: Tag(row.x_m, row.y_m, [])
        for row in file.rows
        if row.x_m is not None and row.y_m is not None
    }
    layout = (find_layout(tag_file) or Layout({}, {})) if placed else require_layout(tag_file)
    for row in file.rows:
        if abs(row.value) > LARGEST_VALUE or max(abs(row.x_m or 0.0), abs(row.y_m or 0.0)) > LARGEST_M:
            raise StartUpError(
                f"'{path}': the row of {escaped(row.sensor, 64)} of tag '{escaped(row.tag_id, 64)}' at"
                f' {row.stamp_utc} has value {row.value:g}, x_m {row.x_m} and y_m {row.y_m}: {DRAWABLE}'
            )
    tag_ids = {row.tag_id for row in file.rows} | {visit.tag_id for visit in file.visits}
    if tag_file and (strangers := tag_ids - set(layout.tags)):
        raise StartUpError(
            f"--tag-file '{tag_file}': {len(strangers)} of the file's {pluralized(len(tag_ids), 'tag')} are"
            f" not in it, such as '{escaped(min(strangers, key=natural_order), 64)}':"
            ' name the tag_file of its bridge'
        )
    for tag_id in sorted(layout.tags.keys() & placed.keys(), key=natural_order):
        here, there = placed[tag_id][:2], layout.tags[tag_id][:2]
        if math.dist(here, there) > MOST_ROUNDING_M:
            raise StartUpError(
                f"'{path}': tag '{escaped(tag_id, 64)}' is at ({here[0]:g}, {here[1]:g}) in it, and at"
                f' ({there[0]:g}, {there[1]:g}) in {tag_file or "the shipped tag file"}: name the tag_file'
                ' of its bridge with --tag-file, and compare only files of one greenhouse'
            )
    new = {tag_id: tag for tag_id, tag in placed.items() if tag_id not in layout.tags}
    return layout._replace(tags=layout.tags | new)


def read_route(name: str | Path) -> list[Point]:
    """Return x and y in metres of each point of a CSV file, or none for ''; raises StartUpError."""
    if not name:
        return []
    where = f"--route '{name}'"
    lines = read_text(name, where, LARGEST_ROUTE_BYTES).splitlines()
    try:
        route = [(float(row['x']), float(row['y'])) for row in csv.DictReader(lines)]
    except (KeyError, TypeError, ValueError, csv.Error):
        route = []
    if not route or not all(abs(each) <= LARGEST_M for point in route for each in point):
        raise StartUpError(f'{where}: is not a CSV file of x,y in metres: name another')
    return route
