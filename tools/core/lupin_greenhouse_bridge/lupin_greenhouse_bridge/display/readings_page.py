"""
`ros2 run lupin_greenhouse_bridge readings_page FILE`: make a page of the readings in a file.

The page is one HTML file that needs no server and no network. Does not import ROS.
"""

import argparse
import base64
import hashlib
import json
import re
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lupin_greenhouse_bridge.display import drawing_command as command
from lupin_greenhouse_bridge.display import placing, summary
from lupin_greenhouse_bridge.display.colours import STOPS, colour_limits, hex_colours_of
from lupin_greenhouse_bridge.display.input_file import ReadingFile
from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.recording.rows import Row, last_reading_of_each_tag
from lupin_greenhouse_bridge.simulator.layout import Layout, natural_order
from lupin_greenhouse_bridge.units import decimals_of, label_of, sensor_order, unit_of, value_text

MOST_TAGS, MOST_NAMED = 1000, 50  # in the table, and in a line of failures
WALL_BINS, DAY_BINS = 150, 48  # of a line: one for two pixels of a chart, and the half hours of a day
MOST_BINS = 60_000  # in all lines of one clock, so that the page stays below 5 MB
DAY_SECONDS = 86_400
MOST_ARROWS_ACROSS = 10  # of a route, along the greenhouse
LABEL_STEP_M, MOST_STEPS = 0.1, 1000  # between the points of a route that labels avoid
LONGEST_NAME = 64  # characters
NS_PER_MS = 1_000_000
TEMPLATE = Path(__file__).with_suffix('.html')
SCRIPT = Path(__file__).with_suffix('.js')


def main(arguments: list[str] | None = None) -> int:
    """Write the page beside the file, or to --output; return the exit code."""
    parser = command.parser_of(
        'readings_page', 'Make a page of readings.', 'page to write; default: NAME.html beside FILE'
    )
    return command.draw_file(parser, arguments, '.html', _page_of)


def _page_of(options: argparse.Namespace, file: ReadingFile) -> bytes:
    if not (file.rows or file.visits):
        raise command.NothingToDraw(f"'{options.file}': holds no readings: there is no page")
    layout, walls, colour_ranges = command.greenhouse_of(options, file)
    data = data_of(file, layout, walls, colour_ranges) | route_data(command.read_route(options.route), walls)
    data['title'] = escaped(options.file.name, LONGEST_NAME)
    return fill(data).encode()


def fill(data: dict[str, Any]) -> str:
    """Return the page. No text in a file can close the element with the data, or run as a script."""
    script = SCRIPT.read_text(encoding='utf-8')
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(',', ':'))
    parts = {'HASH': digest, 'SCRIPT': script, 'DATA': text.replace('<', '\\u003c')}
    return re.sub(
        r'(?<=sha256-)HASH|(?<=>)(SCRIPT|DATA)(?=<)',
        lambda match: parts[match[0]],
        TEMPLATE.read_text(encoding='utf-8'),
    )


def data_of(
    file: ReadingFile, layout: Layout, walls: Walls, colour_ranges: Mapping[str, tuple[float, float]]
) -> dict[str, Any]:
    """Return what the page shows. Stamps are in milliseconds, everything else is as in Row."""
    sensors = sorted({row.sensor for row in file.rows}, key=sensor_order)
    tags = tags_of(file, layout, sensors)
    shown = dict(list(tags.items())[:MOST_TAGS])
    numbers = {tag_id: number for number, tag_id in enumerate(shown)}
    lines = lines_of(file.rows, numbers)
    values = {sensor: [row.value for row in file.rows if row.sensor == sensor] for sensor in sensors}
    limits = {sensor: colour_limits(values[sensor], colour_ranges.get(sensor)) for sensor in sensors}
    notes = []
    if len(tags) > MOST_TAGS:
        notes.append(f'The map, the table and the charts show {MOST_TAGS:,} of {len(tags):,} tags.')
    if lost := [tag['id'] for tag in tags.values() if tag['x'] is None]:
        notes.append(
            f'Tags without a position: {len(lost):,}, such as {lost[0]}. Name the layout with --tag-file.'
        )
    failed = Counter(tag['outcome'] for tag in tags.values() if tag['has_failed'])
    unread = Counter(
        tag['outcome'] for tag in tags.values() if tag['stamp_ms'] is None and not tag['has_failed']
    )
    return {
        'colours': STOPS,
        'sensors': [
            _sensor_data(sensor, [tag['values'][place] for tag in shown.values()], limits[sensor], numbers)
            | {'lines': lines[sensor], 'extent': (min(values[sensor]), max(values[sensor]))}
            for place, sensor in enumerate(sensors)
        ],
        'tags': list(shown.values()),
        'read_count': len(tags) - failed.total() - unread.total(),
        'tag_count': len(tags),
        'counts': [
            (outcome, count, counter is failed)
            for counter in (failed, unread)
            for outcome, count in counter.most_common()
        ],
        'failures': [
            {
                'word': word,
                'reason': reason,
                'count': len(tag_ids),
                'tags': [numbers[tag_id] for tag_id in tag_ids if tag_id in numbers][:MOST_NAMED],
            }
            for word, reason, tag_ids in summary.failures_of(file.visits)
        ],
        'span_ms': [row.stamp_ns // NS_PER_MS for row in (*file.rows[:1], *file.rows[-1:])],
        'duration': summary.duration_text(file.rows[0].stamp_ns, file.rows[-1].stamp_ns) if file.rows else '',
        'greenhouse_times': summary.greenhouse_times(file.rows) if file.rows else '',
        'speed': summary.speed_text(file.rows),
        'is_binned': any('is_binned' in line for each in lines.values() for line in each),
        'closest_m': placing.closest_m([tag[:2] for tag in layout.tags.values()]),
        'walls': walls,
        'tables': list(layout.tables.values()),
        'notes': notes,
    }


def _sensor_data(
    sensor: str, values: list[float | None], limits: tuple[float, float], numbers: dict[str, int]
) -> dict[str, Any]:
    """Return the texts, the colours and the limits of a sensor, from the value of each tag."""
    known = {tag_id: value for tag_id, value in zip(numbers, values, strict=True) if value is not None}
    colours = dict(zip(known, hex_colours_of(list(known.values()), *limits), strict=True))
    extremes = summary.extremes_of(sensor, known)
    ends = dict.fromkeys(value_text(sensor, pick(known.values())) for pick in (min, max) if known)
    return {
        'name': escaped(sensor.replace('_', ' '), LONGEST_NAME),
        'label': escaped(label_of(sensor), LONGEST_NAME),
        'unit': unit_of(sensor),
        'decimals': decimals_of(sensor),
        'limits': limits,
        'colours': [colours.get(tag_id) for tag_id in numbers],
        'value_range': f'{" to ".join(ends)} {unit_of(sensor)}'.strip() if known else 'no value',
        'extremes': [(text, [numbers[tag_id] for tag_id in tag_ids]) for text, tag_ids in extremes],
    }


def route_data(route: list[placing.Point], walls: Walls) -> dict[str, Any]:
    """Return the route of a robot in metres, with its arrows, and with points that labels avoid."""
    step_m = max(LABEL_STEP_M, placing.length_m(route) / MOST_STEPS)
    arrow_m = max(placing.ARROW_EVERY_M, (walls.y1 - walls.y0) / MOST_ARROWS_ACROSS, step_m)
    ends = placing.ends_of_path(route) if len(route) > 1 else {}
    return {
        'route': route,
        'arrows': placing.arrows_along(route, arrow_m),
        'route_steps': [(x, y) for x, y, _ in placing.steps_of(route, step_m)],
        'route_ends': {word: (box.x, box.y) for word, box in ends.items()},
    }


def tags_of(file: ReadingFile, layout: Layout, sensors: list[str]) -> dict[str, dict[str, Any]]:
    """Return the last reading and the last visit of each tag: failures first, then tags without a reading."""
    readings, visits = last_reading_of_each_tag(file.rows), {each.tag_id: each for each in file.visits}
    tags = {}
    for tag_id in dict.fromkeys([*layout.tags, *readings, *visits]):
        place, visit, reading = layout.tags.get(tag_id), visits.get(tag_id), readings.get(tag_id, {})
        row = next(iter(reading.values()), None)
        has_failed = visit is not None and visit.outcome != 'OK'
        values = [reading[sensor].value if sensor in reading else None for sensor in sensors]
        if visit or row:
            outcome = summary.outcome_text(visit.outcome if visit else 'OK')
        else:
            outcome = 'not visited' if file.visits else 'not in the file'
        tags[tag_id] = {
            'id': escaped(tag_id, LONGEST_NAME),
            'x': place and place.x,
            'y': place and place.y,
            'has_failed': has_failed,
            'outcome': outcome,
            'reason': summary.failure_reason(visit.detail) if visit else '',
            'attempts': visit and visit.attempts,
            'stamp_ms': row and row.stamp_ns // NS_PER_MS,
            'time_of_day': row and row.sim_time_of_day_seconds,
            'values': [None] * len(sensors) if has_failed else values,  # of an earlier visit
        }
    return dict(sorted(tags.items(), key=_urgency))


def _urgency(item: tuple[str, dict[str, Any]]) -> tuple[Any, ...]:
    """Return what sorts tags: failures first, then those without a reading, then by number."""
    tag_id, tag = item
    return not tag['has_failed'], tag['stamp_ms'] is not None, natural_order(tag_id)


def lines_of(rows: list[Row], numbers: dict[str, int]) -> dict[str, list[dict[str, Any]]]:
    """
    Return the lines of the charts by sensor, one for each tag: over wall time and over the time of day.

    A point is [time, value], or [mean time, median, lowest, highest] of the values in a bin. Wall time is in
    milliseconds since the first row. It has bins only if a line has more values than bins.
    """
    groups = defaultdict(list)
    for row in rows:
        if row.tag_id in numbers:
            groups[row.sensor, row.tag_id].append((row.stamp_ns, row.sim_time_of_day_seconds, row.value))
    most_bins = max(MOST_BINS // max(len(groups), 1), 1)
    lines = defaultdict(list)
    for (sensor, tag_id), group in sorted(groups.items(), key=lambda item: numbers[item[0][1]]):
        stamps_ns, times_of_day, values = (np.array(each) for each in zip(*group, strict=True))
        stamps_ms = (stamps_ns - rows[0].stamp_ns) // NS_PER_MS
        line: dict[str, Any] = {'tag': numbers[tag_id]}
        if len(values) > (wall_bins := min(WALL_BINS, most_bins)):
            span_ms = int(stamps_ms[-1]) + 1
            line |= {'wall': binned(stamps_ms, values, span_ms / wall_bins), 'is_binned': True}
        else:
            line['wall'] = [[int(ms), rounded(value)] for ms, value in zip(stamps_ms, values, strict=True)]
        line['day'] = binned(times_of_day, values, DAY_SECONDS / min(DAY_BINS, most_bins))
        lines[sensor].append(line)
    return lines


def binned(times: np.ndarray, values: np.ndarray, width: float) -> list[list[float]]:
    """Return the mean time, median, lowest and highest value of each bin of this width that has any."""
    bins = (times // width).astype(int)
    order = np.argsort(bins, kind='stable')
    starts = np.flatnonzero(np.diff(bins[order])) + 1
    points = []
    for group in np.split(order, starts):
        each, at = values[group], round(float(times[group].mean()))
        if each.min() == each.max():
            points.append([at, rounded(each[0])])
        else:
            points.append([at, *map(rounded, (np.median(each), each.min(), each.max()))])
    return points


def rounded(value: float) -> float:
    """Return a value with six digits, more than any pixel shows."""
    return float(f'{value:.6g}')
