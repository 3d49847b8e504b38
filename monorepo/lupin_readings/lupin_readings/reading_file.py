"""A file of readings, or a mission's report, and its greenhouse. Does not import ROS."""

import csv
import math
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError, escaped, pluralized, reason_of
from lupin_greenhouse_bridge.simulator.layout import (
    Layout,
    Tag,
    find_layout,
    find_places,
    natural_order,
    require_layout,
)
from lupin_planning.walls import Walls, find_walls

from lupin_readings.report_line import Observation, parse_report
from lupin_readings.rows import Row
from lupin_readings.store import SQLITE_HEAD, ReadingFileError, read_rows

MOST_ROUNDING_M = 0.01  # between the positions of one tag in the file and in its layout
# Options, and the endings of the files beside a report NAME.jsonl that are their defaults.
COMPANION_ENDINGS = {
    'route': '-route.csv',
    'tag_file': '-tag_locations.json',
    'sim_config_file': '-greenhouse_config.yaml',
}
Point = tuple[float, float]


class ReadingFile(NamedTuple):
    """The contents of a file."""

    rows: list[Row]  # in the order of their stamps
    visits: list[Observation]  # of a report, in its order; a continued mission visits a tag again


class Recording(NamedTuple):
    """A file of readings, and its greenhouse."""

    path: Path
    rows: list[Row]
    visits: list[Observation]
    layout: Layout
    walls: Walls
    route: list[Point]
    sim_config_file: str  # '' for the shipped one


def read_file(path: Path | str, tag_file: str = '') -> ReadingFile:
    """
    Return the contents of a report, or of a file of record_readings; raises ReadingFileError.

    A row without a position gets the position of its tag in `tag_file`, or in the shipped layout for ''.
    Raises StartUpError for a bad tag_file.
    """
    path = Path(path)
    try:
        with path.open('rb') as file:
            is_database = file.read(len(SQLITE_HEAD)) == SQLITE_HEAD
        if is_database:
            return ReadingFile(_with_places(read_rows(path), tag_file), [])
        visits, _ = parse_report(path.read_bytes())
    except (OSError, ValueError) as error:
        raise ReadingFileError(path, error) from error
    rows = [row for visit in visits if visit.reading for row in visit.reading.rows]
    return ReadingFile(_with_places(sorted(rows, key=attrgetter('stamp_ns')), tag_file), visits)


def _with_places(rows: list[Row], tag_file: str) -> list[Row]:
    """Return the rows with the positions of their tags where they lack one."""
    if all(row.x_m is not None for row in rows):
        return rows
    places_m = find_places(tag_file)
    return [
        row._replace(x_m=place_m[0], y_m=place_m[1])
        if row.x_m is None and (place_m := places_m.get(row.tag_id))
        else row
        for row in rows
    ]


def read_recording(
    path: Path,
    tag_file: str = '',
    sim_config_file: str = '',
    walls: object = None,
    route_file: str = '',
) -> Recording:
    """
    Return a file with its greenhouse. '' stands for the file that a mission keeps beside its report, if any.

    `walls` is what find_walls() takes. Raises ReadingFileError and StartUpError.
    """
    named = {'route': route_file, 'tag_file': tag_file, 'sim_config_file': sim_config_file}
    for option, ending in COMPANION_ENDINGS.items():
        companion = path.parent / f'{path.stem}{ending}'
        named[option] = named[option] or str(companion if companion.is_file() else '')
    file = read_file(path, named['tag_file'])
    layout = _layout_of(path, file, named['tag_file'])
    found_walls = find_walls(layout, named['sim_config_file'], walls)
    route = read_route(named['route'])
    return Recording(path, *file, layout, found_walls, route, named['sim_config_file'])


def _layout_of(path: Path, file: ReadingFile, tag_file: str) -> Layout:
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
    if tag_file and (unknown := tag_ids - set(layout.tags)):
        raise StartUpError(
            f"--tag-file '{tag_file}' lacks {len(unknown)} of the {pluralized(len(tag_ids), 'tag')} in"
            f" '{path}', such as '{escaped(min(unknown, key=natural_order), 64)}':"
            ' name the tag_file of its bridge'
        )
    for tag_id in sorted(layout.tags.keys() & placed.keys(), key=natural_order):
        (x, y), (layout_x, layout_y) = placed[tag_id][:2], layout.tags[tag_id][:2]
        if math.dist((x, y), (layout_x, layout_y)) > MOST_ROUNDING_M:
            raise StartUpError(
                f"tag '{escaped(tag_id, 64)}' is at ({x:g}, {y:g}) in '{path}', but at ({layout_x:g},"
                f' {layout_y:g}) in {tag_file or "the shipped tag file"}: name the tag_file of its bridge'
                ' with --tag-file'
            )
    new = {tag_id: tag for tag_id, tag in placed.items() if tag_id not in layout.tags}
    return layout._replace(tags=layout.tags | new)


def read_route(name: str | Path) -> list[Point]:
    """Return x and y in metres of each point of a CSV file, or none for ''; raises StartUpError."""
    if not name:
        return []
    try:
        lines = Path(name).read_text(encoding='utf-8').splitlines()
        route = [(float(row['x']), float(row['y'])) for row in csv.DictReader(lines)]
    except OSError as error:
        raise StartUpError(f"--route '{name}': {reason_of(error)}: name another file") from error
    except (KeyError, TypeError, ValueError, csv.Error):
        route = []
    if not route or not all(math.isfinite(coordinate) for point in route for coordinate in point):
        raise StartUpError(f"--route '{name}' is not a CSV file of x,y in metres: name another file")
    return route
