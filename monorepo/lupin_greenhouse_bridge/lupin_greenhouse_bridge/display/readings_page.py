# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
`ros2 run lupin_greenhouse_bridge readings_page FILE`: make a page of the readings in a file.

The page is one HTML file that needs no server and no network. Does not import ROS.
"""

import argparse
import json
import math
import sys
from pathlib import Path

from lupin_greenhouse_bridge.display.drawing_command import (
    draw_file,
    layout_of,
    parser_of,
    read_colour_ranges,
    read_route,
)
from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.planning.walls import Walls, find_walls
from lupin_greenhouse_bridge.recording.reading_files import ReadingFile, read_file
from lupin_greenhouse_bridge.recording.rows import Row, last_of_each_tag
from lupin_greenhouse_bridge.simulator.layout import Layout, natural_order
from lupin_greenhouse_bridge.units import label_of, sensor_order, unit_of

MOST_POINTS = 2000  # in a chart: a browser draws them in a moment
MOST_TAGS = 1000
LONGEST_NAME = 64  # characters
NS_PER_MS = 1_000_000
TEMPLATE = Path(__file__).with_suffix('.html')


def main(arguments: list[str] | None = None) -> int:
    """Write the page beside the file, or to --output; return the exit code."""
    parser = parser_of('readings_page', 'Make a page of readings.')
    parser.add_argument('-o', '--output', type=Path, metavar='FILE', help='page to write; default: FILE.html')
    return draw_file(parser, arguments, '.html', 'pip install plotly', _write_page)


def _write_page(options: argparse.Namespace, output: Path) -> None:
    from plotly.offline import get_plotlyjs  # imported late: only this command needs it

    file = read_file(options.file, options.tag_file)
    layout = layout_of(file.rows, options.tag_file)
    walls = find_walls(layout, options.sim_config_file, options.walls)
    data = data_of(file, layout, walls, read_colour_ranges(options.sim_config_file))
    data |= {
        'title': escaped(options.file.name, LONGEST_NAME),
        'route': read_route(options.route) if options.route else [],
    }
    page = fill(TEMPLATE.read_text(encoding='utf-8'), data, get_plotlyjs())
    output.write_text(page, encoding='utf-8')


def fill(template: str, data: dict, script: str) -> str:
    """Return the page. No text of a file can end the element that holds the data."""
    text = json.dumps(data, allow_nan=False, ensure_ascii=False).replace('<', '\\u003c')
    return template.replace('PLOTLY', script, 1).replace('DATA', text, 1)


def data_of(file: ReadingFile, layout: Layout, walls: Walls, colour_ranges: dict) -> dict:
    """Return what the page shows. Stamps are in milliseconds, everything else is as in Row."""
    sensors = sorted({row.sensor for row in file.rows}, key=sensor_order)
    tags = tags_of(file, layout, sensors)
    shown_tags = list(tags.values())[:MOST_TAGS]
    charts, thin = [], []
    for sensor in sensors:
        rows = [row for row in file.rows if row.sensor == sensor]
        points = thinned(rows)
        name = escaped(label_of(sensor), LONGEST_NAME)
        if len(points) < len(rows):
            thin.append(f'{len(points):,} of {len(rows):,} values of {name}')
        charts.append(
            {
                'name': name,
                'unit': unit_of(sensor),
                'range': colour_ranges.get(sensor),
                'points': [
                    (
                        row.stamp_ns // NS_PER_MS,
                        row.sim_time_of_day_seconds,
                        row.value,
                        escaped(row.tag_id, LONGEST_NAME),
                    )
                    for row in points
                ],
            }
        )
    notes = []
    if thin:
        notes.append(f'The charts show {", ".join(thin)}: the lowest and the highest of each few in a row.')
    if len(tags) > MOST_TAGS:
        notes.append(f'The map and the table show {MOST_TAGS:,} of {len(tags):,} tags.')
    if lost := [tag['id'] for tag in shown_tags if tag['x'] is None]:
        notes.append(
            f'Tags without a position: {len(lost):,}, such as {lost[0]}. Name the layout with --tag-file.'
        )
    return {
        'sensors': charts,
        'tags': shown_tags,
        'span_ms': [row.stamp_ns // NS_PER_MS for row in (*file.rows[:1], *file.rows[-1:])],
        'is_report': bool(file.visits),
        'walls': walls,
        'tables': list(layout.tables.values()),
        'visits': [
            (tag['x'], tag['y']) for visit in file.visits if (tag := tags[visit.tag_id])['x'] is not None
        ],
        'notes': notes,
    }


def tags_of(file: ReadingFile, layout: Layout, sensors: list[str]) -> dict[str, dict]:
    """Return the last reading and the last visit of each tag, failures first, then what was not read."""
    tags = {tag_id: _tag(tag_id, tag.x, tag.y) for tag_id, tag in layout.tags.items()}
    last = last_of_each_tag(file.rows)
    for tag_id, reading in last.items():
        tag = tags.setdefault(tag_id, _tag(tag_id, None, None))
        row = next(iter(reading.values()))
        tag |= {'stamp_ms': row.stamp_ns // NS_PER_MS, 'time_of_day': row.sim_time_of_day_seconds}
    for visit in file.visits:
        tag = tags.setdefault(visit.tag_id, _tag(visit.tag_id, None, None))
        tag |= {
            'outcome': escaped(visit.outcome, LONGEST_NAME),
            'detail': escaped(visit.detail, 300),
            'attempts': visit.attempts,
        }
    for tag_id, tag in tags.items():
        reading = last.get(tag_id, {})
        tag['values'] = [reading[sensor].value if sensor in reading else None for sensor in sensors]
    return dict(sorted(tags.items(), key=_urgency))


def _tag(tag_id: str, x_m: float | None, y_m: float | None) -> dict:
    return {'id': escaped(tag_id, LONGEST_NAME), 'x': x_m, 'y': y_m, 'stamp_ms': None, 'outcome': ''}


def _urgency(item: tuple[str, dict]) -> tuple:
    """Return what sorts tags: failures first, then those without a reading, then in natural order."""
    tag_id, tag = item
    return (
        tag['outcome'] in ('', 'OK'),
        tag['stamp_ms'] is not None,
        natural_order(tag_id),
    )


def thinned(rows: list[Row]) -> list[Row]:
    """Return the rows with the lowest and the highest value of each few in a row, at most MOST_POINTS."""
    if len(rows) <= MOST_POINTS:
        return rows
    size = math.ceil(2 * len(rows) / MOST_POINTS)
    groups = (range(start, min(start + size, len(rows))) for start in range(0, len(rows), size))
    kept = ({pick(group, key=lambda n: rows[n].value) for pick in (min, max)} for group in groups)
    return [rows[n] for each in kept for n in sorted(each)]


if __name__ == '__main__':
    sys.exit(main())
