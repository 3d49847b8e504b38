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
from pathlib import Path

import numpy as np

from lupin_greenhouse_bridge.display.drawing_command import (
    Failures,
    NothingToDraw,
    colour_limits,
    days_of,
    draw_file,
    extremes_of,
    failures_of,
    greenhouse_of,
    lasting,
    parser_of,
    read_route,
    reason_of,
    speed_of,
    words_of,
)
from lupin_greenhouse_bridge.display.input_file import ReadingFile
from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.recording.rows import Row, last_reading_of_each_tag
from lupin_greenhouse_bridge.simulator.layout import Layout, natural_order
from lupin_greenhouse_bridge.units import decimals_of, label_of, sensor_order, unit_of

MOST_TAGS, MOST_NAMED = 1000, 50  # in the table, and in a line of failures
WALL_BINS, DAY_BINS = 150, 48  # of a line: one for two pixels of a chart, and the half hours of a day
MOST_BINS = 60_000  # in all lines of one clock, so that the page stays below 5 MB
DAY_SECONDS = 86_400
LONGEST_NAME = 64  # characters
NS_PER_MS = 1_000_000
TEMPLATE = Path(__file__).with_suffix('.html')
SCRIPT = Path(__file__).with_suffix('.js')


def main(arguments: list[str] | None = None) -> int:
    """Write the page beside the file, or to --output; return the exit code."""
    parser = parser_of(
        'readings_page', 'Make a page of readings.', 'page to write; default: NAME.html beside FILE'
    )
    return draw_file(parser, arguments, '.html', _page_of)


def _page_of(options: argparse.Namespace, file: ReadingFile) -> bytes:
    if not (file.rows or file.visits):
        raise NothingToDraw(f"'{options.file}': holds no readings: there is no page")
    data = data_of(file, *greenhouse_of(options, file))
    data |= {'title': escaped(options.file.name, LONGEST_NAME), 'route': read_route(options.route)}
    return fill(data).encode()


def fill(data: dict) -> str:
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


def data_of(file: ReadingFile, layout: Layout, walls: Walls, colour_ranges: dict) -> dict:
    """Return what the page shows. Stamps are in milliseconds, everything else is as in Row."""
    sensors = sorted({row.sensor for row in file.rows}, key=sensor_order)
    tags = tags_of(file, layout, sensors)
    shown = dict(list(tags.items())[:MOST_TAGS])
    numbers = {tag_id: number for number, tag_id in enumerate(shown)}
    lines = lines_of(file.rows, numbers)
    failures = failures_of(file.visits)
    notes = []
    if len(tags) > MOST_TAGS:
        notes.append(f'The map, the table and the charts show {MOST_TAGS:,} of {len(tags):,} tags.')
    if lost := [tag['id'] for tag in tags.values() if tag['x'] is None]:
        notes.append(
            f'Tags without a position: {len(lost):,}, such as {lost[0]}. Name the layout with --tag-file.'
        )
    return {
        'sensors': [
            {
                'name': escaped(sensor.replace('_', ' '), LONGEST_NAME),
                'label': escaped(label_of(sensor), LONGEST_NAME),
                'unit': unit_of(sensor),
                'decimals': decimals_of(sensor),
                'range': colour_limits(
                    [row.value for row in file.rows if row.sensor == sensor], colour_ranges.get(sensor)
                ),
                'extremes': _extremes(sensor, shown, place),
                'lines': lines[sensor],
            }
            for place, sensor in enumerate(sensors)
        ],
        'tags': list(shown.values()),
        'read_count': sum(tag['stamp_ms'] is not None and not tag['has_failed'] for tag in tags.values()),
        'tag_count': len(tags),
        'counts': _counts(tags, failures),
        'failures': [
            {
                'word': word,
                'reason': reason,
                'count': len(tag_ids),
                'tags': [numbers[tag_id] for tag_id in tag_ids if tag_id in numbers][:MOST_NAMED],
            }
            for word, reason, tag_ids in failures
        ],
        'span_ms': [row.stamp_ns // NS_PER_MS for row in (*file.rows[:1], *file.rows[-1:])],
        'day_span': [row.sim_time_of_day_seconds for row in (*file.rows[:1], *file.rows[-1:])],
        'days': days_of(file.rows),
        'speed': speed_of(file.rows),
        'lasting': lasting(file.rows[0].stamp_ns, file.rows[-1].stamp_ns) if file.rows else '',
        'is_binned': any('is_binned' in line for each in lines.values() for line in each),
        'walls': walls,
        'tables': list(layout.tables.values()),
        'notes': notes,
    }


def _extremes(sensor: str, tags: dict[str, dict], place: int) -> list[tuple[str, list[int]]]:
    """Return the texts of extremes_of() and the numbers of the tags."""
    values = {tag_id: tag['values'][place] for tag_id, tag in tags.items() if not tag['has_failed']}
    known = {tag_id: value for tag_id, value in values.items() if value is not None}
    numbers = {tag_id: number for number, tag_id in enumerate(tags)}
    return [(text, [numbers[tag_id] for tag_id in tag_ids]) for text, tag_ids in extremes_of(sensor, known)]


def tags_of(file: ReadingFile, layout: Layout, sensors: list[str]) -> dict[str, dict]:
    """Return the last reading and the last visit of each tag: failures first, then tags without a reading."""
    tags = {tag_id: _tag(tag_id, tag.x, tag.y) for tag_id, tag in layout.tags.items()}
    last = last_reading_of_each_tag(file.rows)
    for tag_id, reading in last.items():
        tag = tags.setdefault(tag_id, _tag(tag_id, None, None))
        row = next(iter(reading.values()))
        tag |= {
            'outcome': words_of('OK'),
            'stamp_ms': row.stamp_ns // NS_PER_MS,
            'time_of_day': row.sim_time_of_day_seconds,
        }
    for visit in file.visits:
        tag = tags.setdefault(visit.tag_id, _tag(visit.tag_id, None, None))
        tag |= {'outcome': words_of(visit.outcome), 'attempts': visit.attempts}
        tag |= {'reason': reason_of(visit.detail), 'has_failed': visit.outcome != 'OK'}
    for tag_id, tag in tags.items():
        reading = last.get(tag_id, {})
        tag['values'] = [reading[sensor].value if sensor in reading else None for sensor in sensors]
        tag['outcome'] = tag['outcome'] or ('not visited' if file.visits else 'not in the file')
    return dict(sorted(tags.items(), key=_urgency))


def _tag(tag_id: str, x_m: float | None, y_m: float | None) -> dict:
    nothing = {'stamp_ms': None, 'time_of_day': None, 'outcome': '', 'reason': '', 'attempts': None}
    return {'id': escaped(tag_id, LONGEST_NAME), 'x': x_m, 'y': y_m, 'has_failed': False, **nothing}


def _urgency(item: tuple[str, dict]) -> tuple:
    """Return what sorts tags: failures first, then those without a reading, then by number."""
    tag_id, tag = item
    return not tag['has_failed'], tag['stamp_ms'] is not None, natural_order(tag_id)


def _counts(tags: dict[str, dict], failures: list[Failures]) -> list[tuple[str, int, bool]]:
    """Return each outcome but a reading, its number of tags, and if it is a failure: the largest first."""
    failed, unread = Counter(), Counter()
    for each in failures:
        failed[each.word] += len(each.tag_ids)
    unread.update(
        tag['outcome'] for tag in tags.values() if not tag['has_failed'] and tag['stamp_ms'] is None
    )
    return [
        (word, count, counter is failed)
        for counter in (failed, unread)
        for word, count in counter.most_common()
    ]


def lines_of(rows: list[Row], numbers: dict[str, int]) -> dict[str, list[dict]]:
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
        line = {'tag': numbers[tag_id]}
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
