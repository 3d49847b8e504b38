# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""A command that draws a file of readings: its options, its inputs and its errors. Does not import ROS."""

import argparse
import csv
import itertools
import math
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped
from lupin_greenhouse_bridge.planning.walls import add_wall_options, read_visualization
from lupin_greenhouse_bridge.recording.rows import Row
from lupin_greenhouse_bridge.simulator.files import mapping_of, number
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, find_layout

DONE, USAGE = 0, 2


def parser_of(prog: str, description: str) -> argparse.ArgumentParser:
    """Return the parser of a command that draws a file of readings, without its --output."""
    parser = argparse.ArgumentParser(prog=prog, description=description)
    parser.add_argument(
        'file',
        metavar='FILE',
        type=Path,
        help="a mission's report, or a file of record_readings or read_tag --csv",
    )
    parser.add_argument(
        '--tag-file', default='', metavar='FILE', help="the bridge's tag_file, if you set one"
    )
    add_wall_options(parser)
    parser.add_argument(
        '--route', type=Path, metavar='FILE', help='a CSV file of x and y along the path that a robot drove'
    )
    return parser


def layout_of(rows: Iterable[Row], tag_file: str) -> Layout:
    """
    Return the layout of tag_file, or the shipped one for '', with the tags where the rows have them.

    Raises StartUpError for a bad tag_file, and if no position is known at all.
    """
    layout = find_layout(tag_file) or Layout({}, {})
    placed = {row.tag_id: Tag(row.x_m, row.y_m, []) for row in rows if row.x_m is not None}
    if not (layout.tags or placed):
        raise StartUpError('mdp-greenhouse is not installed here: name the layout with --tag-file')
    return layout._replace(tags=layout.tags | placed)


def draw_file(
    parser: argparse.ArgumentParser, arguments: list[str] | None, suffix: str, library: str, draw: Callable
) -> int:
    """
    Run a command of parser_of(): call draw(options, output) and print the output; return the exit code.

    `library` says how to install the library that `draw` imports.
    """
    options = parser.parse_args(arguments)
    output = options.output or beside(options.file, suffix)
    try:
        check_output(output, options.file)
        draw(options, output)
    except ImportError as error:
        problem = f'{error}: {library}'
    except OneLineError as error:
        problem = str(error)
    except (OSError, ValueError) as error:  # unknown to matplotlib, or not writable
        problem = f"--output '{output}': {getattr(error, 'strerror', None) or error}"
    else:
        kind = 'page' if suffix == '.html' else 'picture'
        print(f'{kind}: {escaped(str(output), 500)}')
        return DONE
    print(f'{parser.prog}: {problem}', file=sys.stderr)
    return USAGE


def beside(file: Path, suffix: str) -> Path:
    """Return the path of a drawing of a file, with the file's name; a folder such as / has none."""
    return file.with_suffix(suffix) if file.name else Path(f'readings{suffix}')


def check_output(output: Path, file: Path) -> None:
    """Raise StartUpError for a drawing that would replace the file that it shows."""
    if output.exists() and file.exists() and output.samefile(file):
        raise StartUpError(f"--output '{output}' is the file of readings itself: name another")


def read_route(path: Path) -> list[tuple[float, float]]:
    """Return x and y in metres of each point of a CSV file with a header; raises StartUpError."""
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
    Return the lowest and highest value of each sensor's colours, in its unit, of the greenhouse config.

    '' selects the config of mdp-greenhouse; {} if that is not installed. Raises StartUpError.
    """
    found = read_visualization(sim_config_file)
    if not found or not found[0].get('colorbar_ranges'):
        return {}
    section, where = found
    ranges = mapping_of(section, 'colorbar_ranges', where)
    return {str(sensor): _range(ranges, sensor, f'{where}: colorbar_ranges') for sensor in ranges}


def _range(ranges: dict, sensor, where: str) -> tuple[float, float]:
    limits = mapping_of(ranges, sensor, where)
    here = f'{where}: {escaped(str(sensor), 64)}'
    lowest, highest = (number(limits, key, here, 'the unit of the sensor') for key in ('min', 'max'))
    return float(lowest), float(highest)
