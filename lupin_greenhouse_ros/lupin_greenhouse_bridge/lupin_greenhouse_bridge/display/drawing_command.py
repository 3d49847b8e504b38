# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""A command that draws a file of readings: its options, its inputs and its errors. Does not import ROS."""

import argparse
import csv
import itertools
import math
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.display.input_file import ReadingFile, read_file
from lupin_greenhouse_bridge.display.report_line import Observation
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped, pluralized
from lupin_greenhouse_bridge.planning.walls import Walls, add_wall_options, find_walls, read_visualization
from lupin_greenhouse_bridge.recording.rows import Row
from lupin_greenhouse_bridge.runtime.output import print_line
from lupin_greenhouse_bridge.simulator.files import mapping_of, number
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, find_layout, natural_order, require_layout
from lupin_greenhouse_bridge.units import unit_of, value_text

DONE, NO_ROWS, USAGE = 0, 1, 2
SAME_M = 0.01  # between two positions of one tag, in files that round them
# What a mission keeps beside its report NAME.jsonl, for each option that names another file.
BESIDE = {
    'route': '-route.csv',
    'tag_file': '-tag_locations.json',
    'sim_config_file': '-greenhouse_config.yaml',
}
LONGEST_REASON = 300  # characters
LEAST_SPAN = 0.01  # of colours without a range in the config
MOST_EXTREME = 4  # tags that a text about the lowest or the highest value names
LONGEST_GAP_SECONDS = 5  # between two readings that tell the speed of the clock


class NothingToDraw(OneLineError):
    """A file has no reading that can be drawn."""


class Failures(NamedTuple):
    """The tags that were not read, all for the same reason."""

    word: str  # the outcome, such as `not confirmed`
    reason: str
    tag_ids: list[str]


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


def greenhouse_of(
    options: argparse.Namespace, file: ReadingFile
) -> tuple[Layout, Walls, dict[str, tuple[float, float]]]:
    """Return the layout, the walls and the ranges of the colours; warn of tags outside the walls."""
    layout = layout_of(file, options.tag_file)
    walls = find_walls(layout, options.sim_config_file, options.walls)
    if outside := [tag_id for tag_id, tag in layout.tags.items() if not walls.has_inside(tag.x, tag.y)]:
        print(
            f'{options.prog}: outside the walls ({walls}): {named(outside, MOST_EXTREME)}: set --walls or'
            ' --sim-config-file',
            file=sys.stderr,
        )
    return layout, walls, read_colour_ranges(options.sim_config_file)


def layout_of(file: ReadingFile, tag_file: str) -> Layout:
    """
    Return the layout of tag_file, or the shipped one for '', with the positions of tags that the rows have.

    Raises StartUpError for a bad tag_file, for a layout of another greenhouse, and if no position is known.
    """
    placed = {row.tag_id: Tag(row.x_m, row.y_m, []) for row in file.rows if row.x_m is not None}
    layout = (find_layout(tag_file) or Layout({}, {})) if placed else require_layout(tag_file)
    tag_ids = {each.tag_id for each in (*file.rows, *file.visits)}
    strangers = tag_ids - set(layout.tags)
    if tag_file and strangers:
        raise StartUpError(
            f"--tag-file '{tag_file}': {len(strangers)} of the file's {pluralized(len(tag_ids), 'tag')} are"
            f" not in it, such as '{escaped(min(strangers, key=natural_order), 64)}':"
            ' name the tag_file of its bridge'
        )
    for tag_id in layout.tags.keys() & placed.keys():
        here, there = placed[tag_id][:2], layout.tags[tag_id][:2]
        if math.dist(here, there) > SAME_M:
            raise StartUpError(
                f"tag '{escaped(tag_id, 64)}' is at ({here[0]:g}, {here[1]:g}) in the file, and at"
                f' ({there[0]:g}, {there[1]:g}) in {tag_file or "the shipped tag file"}: name the tag_file'
                ' of its bridge with --tag-file'
            )
    return layout._replace(tags=layout.tags | placed)


def draw_file(
    parser: argparse.ArgumentParser,
    arguments: list[str] | None,
    suffix: str,
    draw: Callable[[argparse.Namespace, ReadingFile], bytes],
) -> int:
    """Run a command of parser_of(): write what draw() returns to --output, and return the exit code."""
    options, exit_code = parser.parse_args(arguments), USAGE
    for name, end in BESIDE.items():
        kept = options.file.with_name(f'{options.file.stem}{end}') if options.file.name else options.file
        if not getattr(options, name) and kept.is_file() and kept != options.file:
            setattr(options, name, str(kept))
    options.output = options.output or beside(options.file, suffix)
    try:
        check_output(options.output, options.file)
        drawing = draw(options, read_file(options.file, options.tag_file))
        write_output(options.output, drawing)
    except NothingToDraw as error:
        problem, exit_code = str(error), NO_ROWS
    except ImportError as error:
        problem = f'{error}: sudo apt install python3-matplotlib'
    except OneLineError as error:
        problem = str(error)
    else:
        kind = 'page' if suffix == '.html' else 'picture'
        print_line(f'{kind}: {escaped(str(options.output), 500)}')
        return DONE
    print(f'{parser.prog}: {problem}', file=sys.stderr)
    return exit_code


def words_of(outcome: str) -> str:
    """Return the outcome of a visit in words, such as `not confirmed`."""
    return 'read' if outcome == 'OK' else escaped(outcome.lower().replace('_', ' '), 64)


def beside(file: Path, suffix: str) -> Path:
    """Return the path of the drawing of a file: its name with this suffix, or `readings` if it has none."""
    return file.with_suffix(suffix) if file.name else Path(f'readings{suffix}')


def check_output(output: Path, file: Path) -> None:
    """Raise StartUpError for a drawing that would replace the file that it shows."""
    if output.exists() and file.exists() and output.samefile(file):
        raise StartUpError(f"--output '{output}' is the file of readings itself: name another")


def write_output(output: Path, drawing: bytes) -> None:
    """Write a drawing; raises StartUpError if the file cannot be written."""
    try:
        output.write_bytes(drawing)
    except OSError as error:
        raise StartUpError(f"--output '{output}': {error.strerror}: name another file") from error


def failures_of(visits: Iterable[Observation]) -> list[Failures]:
    """Return the tags whose last visit failed, by reason: the largest group first."""
    groups: dict[tuple[str, str], list[str]] = {}
    for visit in {each.tag_id: each for each in visits}.values():
        if visit.outcome != 'OK':
            groups.setdefault((words_of(visit.outcome), reason_of(visit.detail)), []).append(visit.tag_id)
    largest_first = sorted(groups.items(), key=lambda item: -len(item[1]))
    return [Failures(*key, sorted(tag_ids, key=natural_order)) for key, tag_ids in largest_first]


def reason_of(detail: str) -> str:
    """Return why a visit failed: what happened, and then who says so with which code."""
    return re.sub(r'([^\s:;][^:;]*\bcode \d+): ([^;]+)', r'\2 (\1)', escaped(detail, LONGEST_REASON))


def named(tag_ids: list[str], most: int) -> str:
    """Return `tag 7`, `tags 7 and 8` or, with more tags than `most`, `tags 7, 8 and 3 more`."""
    more = [f'{len(tag_ids) - most:,} more'] if len(tag_ids) > most else []
    *first, last = [*(escaped(tag_id, 64) for tag_id in tag_ids[:most]), *more]
    return f'tags {", ".join(first)} and {last}' if first else f'tag {last}'


def extremes_of(sensor: str, values: Mapping[str, float]) -> list[tuple[str, list[str]]]:
    """Return the lowest and the highest value as texts, with all their tags; one text if all are equal."""
    found, is_one = [], len({value_text(sensor, value) for value in values.values()}) == 1
    for word, pick in (('lowest', min), ('highest', max)) if values else ():
        text = value_text(sensor, pick(values.values()))
        tag_ids = [tag_id for tag_id, value in values.items() if value_text(sensor, value) == text]
        value = f'{text} {unit_of(sensor)}'.rstrip()
        text = f'{value} at {named(tag_ids, MOST_EXTREME)}'
        found.append((text if is_one else f'{word} {text}', tag_ids))
    return found[:1] if is_one else found


def colour_limits(values: list[float], limits: tuple[float, float] | None) -> tuple[float, float]:
    """
    Return the values at the ends of the colours: the fifths of the config's range in which all values lie.

    So similar values differ in colour, noise hardly does, and the next mission mostly has the same colours.
    """
    if not (values and limits and limits[0] < limits[1]):
        low, high = limits or (min(values), max(values))
        least_span = max(LEAST_SPAN, 1e-6 * abs(low))  # beside 1e16, a fixed one makes no difference
        margin = 0.0 if high - low >= least_span else 50 * least_span
        return low - margin, high + margin
    fifth = (limits[1] - limits[0]) / 5
    low, high = (round((pick(values) - limits[0]) / fifth, 9) for pick in (min, max))
    first = min(max(math.floor(low), 0), 4)
    last = min(max(math.ceil(high), first + 1), 5)
    return round(limits[0] + first * fifth, 9), round(limits[0] + last * fifth, 9)


def lasting(first_ns: int, last_ns: int) -> str:
    """Return the time between two stamps, as both are shown in whole seconds, such as `7 s`."""
    seconds = last_ns // 10**9 - first_ns // 10**9
    if seconds < 120:
        return f'{seconds} s'
    return f'{seconds / 60:.0f} min' if seconds < 7200 else f'{seconds / 3600:.1f} h'


def speed_of(rows: list[Row]) -> str:
    """
    Return a text about a clock of the greenhouse that ran faster than ours; '' if the rows have none.

    The clock can have passed more than a day between two rows, so this is the least speed that fits.
    """
    seconds = np.array([row.stamp_ns // 10**9 for row in rows])
    if len(rows) < 2 or not 0 <= np.diff(seconds).min() <= np.diff(seconds).max() <= LONGEST_GAP_SECONDS:
        return ''
    passed = np.unwrap([row.sim_time_of_day_seconds for row in rows], period=86_400)
    speed = (passed[-1] - passed[0]) / max(seconds[-1] - seconds[0], 1)
    return f'greenhouse clock at least about {float(f"{speed:.2g}"):,.0f} times faster' if speed > 1.5 else ''


def days_of(rows: list[Row]) -> int:
    """Return on how many days of the greenhouse rows lie, at least: a pause can hide a midnight."""
    return 1 + int((np.diff([row.sim_time_of_day_seconds for row in rows]) < 0.0).sum())


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
    if not (route and all(map(math.isfinite, itertools.chain(*route)))):
        raise StartUpError(f"--route '{path}': is not a CSV file of x,y in metres: name another")
    return route


def read_colour_ranges(sim_config_file: str = '') -> dict[str, tuple[float, float]]:
    """
    Return the lowest and highest value of each sensor's colour scale in the greenhouse config, in its unit.

    '' selects the config of mdp-greenhouse; {} if that is not installed. Raises StartUpError.
    """
    found = read_visualization(sim_config_file)
    if not found or not found[0].get('colorbar_ranges'):
        return {}
    section, where = found
    ranges = mapping_of(section, 'colorbar_ranges', where, '{co2: {min: 400, max: 600}}')
    return {str(sensor): _range(ranges, sensor, f'{where}: colorbar_ranges') for sensor in ranges}


def _range(ranges: dict, sensor, where: str) -> tuple[float, float]:
    limits = mapping_of(ranges, sensor, where, '{min: 400, max: 600}')
    here = f'{where}: {escaped(str(sensor), 64)}'
    lowest, highest = (number(limits, key, here, 'the unit of the sensor') for key in ('min', 'max'))
    return float(lowest), float(highest)
