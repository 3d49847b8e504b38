# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What the drawings of a file share: their arguments, and where tags and route lie. Does not import ROS."""

import argparse
import csv
import itertools
import math
from collections.abc import Iterable
from pathlib import Path

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.recording.rows import Row
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, find_layout


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
    parser.add_argument(
        '--sim-config-file', default='', metavar='FILE', help="the bridge's sim_config_file, if you set one"
    )
    parser.add_argument(
        '--route', type=Path, metavar='FILE', help='a CSV file of x and y along the way that a robot drove'
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
