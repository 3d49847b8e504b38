# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
`ros2 run lupin_greenhouse_bridge readings_page FILE`: make a page of the readings in a file.

The page is one HTML file that needs no server and no network. Does not import ROS.
"""

import argparse
import base64
import hashlib
import html
import itertools
import json
import statistics
from collections import Counter, defaultdict
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from lupin_greenhouse_bridge.display import drawing_command as command
from lupin_greenhouse_bridge.display import placing, summary
from lupin_greenhouse_bridge.display.colours import STOPS, hex_colours_of
from lupin_greenhouse_bridge.display.drawing_command import LONGEST_NAME, Limits, Recording
from lupin_greenhouse_bridge.errors import UsageError, escaped
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.recording.rows import Row, last_reading_of_each_tag
from lupin_greenhouse_bridge.simulator.layout import Layout, natural_order
from lupin_greenhouse_bridge.units import clock_time, decimals_of, label_of, name_of, unit_of, value_text

MOST_TAGS, MOST_NAMED = 1000, 50  # in the table, and in a line of failures
UNREAD = 'not visited', 'not in the file'  # of tags without a row in the table
WALL_BINS, DAY_BINS = 150, 48  # of a line: one for two pixels of a chart, and the half hours of a day
MOST_BINS = 60_000  # in all lines of one clock, so that the page stays below 5 MB
DAY_SECONDS = 86_400
ARROWS_ACROSS = 40  # of a route, which are as long as the greenhouse
NS_PER_MS = 1_000_000
TO, SPACE = '\u00a0to ', '\u00a0'  # no unit is alone on a line
TEMPLATE = Path(__file__).with_suffix('.html')
SCRIPT = Path(__file__).with_suffix('.js')


def main(arguments: list[str] | None = None) -> int:
    """Write the page beside the file, or to --output; return the exit code."""
    parser = command.parser_of(
        'readings_page',
        'Make a page of readings.',
        'page to write; default: NAME.html beside FILE, or comparison.html for several',
    )
    return command.draw_files(parser, arguments, _page_of)


def _page_of(
    options: argparse.Namespace, recordings: list[Recording], limits: Limits
) -> list[tuple[Path, bytes]]:
    if options.output and options.output.suffix.lower() not in ('.html', '.htm'):
        raise UsageError(f"--output '{options.output}' is a page: its name must end in .html")
    for each in recordings:
        if not (each.rows or each.visits):
            raise command.NothingToDraw(f"'{each.path}': holds no readings: there is no page")
    first = recordings[0].path
    output = first.with_suffix('.html') if len(recordings) == 1 else Path('comparison.html')
    return [(options.output or output, fill(recordings, limits).encode())]


def fill(recordings: list[Recording], limits: Limits) -> str:
    """Return the page. No text in a file can close the element with the data, or run as a script."""
    script = SCRIPT.read_text(encoding='utf-8')
    differences = differences_of(recordings, limits) if len(recordings) > 1 else []
    data = {'files': [data_of(each, limits) for each in recordings], 'differences': differences}
    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(',', ':'))
    return Template(TEMPLATE.read_text(encoding='utf-8')).substitute(
        hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        title=html.escape(', '.join(each.name for each in recordings)),
        several_times=summary.SEVERAL_TIMES,
        data=text.replace('<', '\\u003c'),
        script=script,
    )


def differences_of(recordings: list[Recording], limits: Limits) -> list[dict[str, Any]]:
    """
    Return the last value of each tag and sensor in each file: by sensor, the largest difference first.

    `farthest` is the place of the file whose value is farthest from the median of at least three.
    """
    tags_by_file = [tags_of(each, list(limits)) for each in recordings]
    tag_ids = sorted({tag_id for tags in tags_by_file for tag_id in tags}, key=natural_order)
    differences = []
    for sensor in limits:
        of_sensor = []
        for tag_id in tag_ids:
            tags = [each.get(tag_id) for each in tags_by_file]
            values = [tag['values'][sensor] if tag else None for tag in tags]
            known = [value for value in values if value is not None]
            if len(known) > 1:
                of_sensor.append(
                    {
                        'tag': escaped(tag_id, LONGEST_NAME),
                        'sensor': escaped(label_of(sensor), LONGEST_NAME),
                        'cells': [_cell_of(sensor, tag) for tag in tags],
                        'farthest': _farthest_of(values),
                        'spread': max(known) - min(known),
                        'difference': value_text(sensor, max(known) - min(known)),
                    }
                )
        differences += sorted(of_sensor, key=lambda each: -each['spread'])
    return differences


def _cell_of(sensor: str, tag: dict[str, Any] | None) -> tuple[str, str]:
    """Return the value of a tag and its time of day in the greenhouse, or why there is none."""
    if tag is None or tag['values'][sensor] is None:
        return (tag['outcome'] if tag and tag['outcome'] != 'read' else 'none'), ''
    return value_text(sensor, tag['values'][sensor]), clock_time(tag['time_of_day'])


def _farthest_of(values: list[float | None]) -> int | None:
    """Return the place of the value that is farthest from the median; None for a tie or fewer than three."""
    known = [value for value in values if value is not None]
    middle = statistics.median(known)
    distances = [0.0 if value is None else abs(value - middle) for value in values]
    is_clear = len(known) > 2 and distances.count(max(distances)) == 1
    return distances.index(max(distances)) if is_clear else None


def data_of(recording: Recording, limits: Limits) -> dict[str, Any]:
    """Return what the page shows of a file. Stamps are in milliseconds, everything else is as in Row."""
    rows, layout, walls, route = recording.rows, recording.layout, recording.walls, recording.route
    failures = summary.failures_of(recording.visits)
    values = {sensor: [row.value for row in rows if row.sensor == sensor] for sensor in limits}
    sensors = [sensor for sensor in limits if values[sensor]]
    all_tags = tags_of(recording, sensors)
    tags = dict(itertools.islice(all_tags.items(), MOST_TAGS))
    lines = lines_of(rows, {tag_id: number for number, tag_id in enumerate(tags)}, sensors)
    points = [*(tag[:2] for tag in layout.tags.values()), *route]
    boxes = np.array([walls, *layout.tables.values(), *(point * 2 for point in points)])
    read_tags = [tag for tag in all_tags.values() if tag['outcome'] == 'read']
    times_of_day = {clock_time(tag['time_of_day']) for tag in read_tags if tag['time_of_day'] is not None}
    values_of = {
        tag_id: [sensor for sensor, value in tag['values'].items() if value is not None]
        for tag_id, tag in all_tags.items()
        if tag['outcome'] == 'read'
    }
    notes = []
    if len(all_tags) > MOST_TAGS:
        notes.append(f'The map, the table and the charts show {MOST_TAGS:,} of {len(all_tags):,} tags.')
    if lost := [tag['id'] for tag in all_tags.values() if tag['x'] is None]:
        notes.append(
            f'Tags without a position: {len(lost):,}, such as {lost[0]}. Name the layout with --tag-file.'
        )
    return {
        'title': recording.name,
        'colours': STOPS,
        'sensors': [
            {
                **_sensor_data(each, tags, limits[each], layout),
                'extent': (min(values[each]), max(values[each])),
                'lines': lines[each],
            }
            for each in sensors
        ],
        'tags': [tag | {'values': list(tag['values'].values())} for tag in tags.values()],
        'counts': _counts_of(all_tags, failures),
        'failures': [_failure_data(each, tags) for each in failures],
        'unread': [_failure_data(each, tags) for each in _unread_of(all_tags)],
        'span_ms': [row.stamp_ns // NS_PER_MS for row in (*rows[:1], *rows[-1:])],
        'duration': summary.duration_text(rows[0].stamp_ns, rows[-1].stamp_ns) if rows else '',
        'greenhouse_times': summary.greenhouse_times(rows) if rows else '',
        'is_of_several_times': len(times_of_day) > 1,
        'is_complete': summary.is_complete(values_of, sensors, layout),
        'unused_numbers': summary.unused_numbers(layout),
        'speed': summary.speed_text(rows),
        'clock': summary.clock_text(rows),
        'is_binned': any(line['is_binned'] for each in lines.values() for line in each),
        'closest_m': placing.closest_m([tag[:2] for tag in layout.tags.values()]),
        'walls': walls,
        'tables': list(layout.tables.values()),
        'view': [*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0)],
        'notes': notes,
        'fewest_attempts': min((tag['attempts'] or 0 for tag in read_tags), default=1),
        **_route_data(route, walls),
    }


def _sensor_data(
    sensor: str, tags: dict[str, dict[str, Any]], limits: tuple[float, float], layout: Layout
) -> dict[str, Any]:
    """Return the texts, the colours and the limits of a sensor."""
    values = {tag_id: tag['values'][sensor] for tag_id, tag in tags.items()}
    known = {tag_id: value for tag_id, value in values.items() if value is not None}
    colours = dict(zip(known, hex_colours_of(list(known.values()), *limits), strict=True))
    ends = dict.fromkeys(value_text(sensor, pick(known.values())) for pick in (min, max) if known)
    return {
        'name': escaped(name_of(sensor), LONGEST_NAME),
        'label': escaped(label_of(sensor), LONGEST_NAME),
        'unit': unit_of(sensor),
        'decimals': decimals_of(sensor),
        'limits': limits,
        'colours': [colours.get(tag_id) for tag_id in tags],
        'failed': [
            tag['has_failed'] and tag_id in layout.tags and sensor in layout.tags[tag_id].sensors
            for tag_id, tag in tags.items()
        ],
        'value_range': f'{TO.join(ends)}{SPACE}{unit_of(sensor)}'.strip() if known else 'no value',
        'extremes': [
            (text, [tags[tag_id]['id'] for tag_id in tag_ids])
            for text, tag_ids in summary.extremes_of(sensor, known)
        ],
    }


def _counts_of(tags: dict[str, dict[str, Any]], failures: list[summary.Failures]) -> list[tuple[str, bool]]:
    """Return how many tags were read and how many were not, each as a text and whether it is bad."""
    failed = summary.failure_counts(failures)
    unread = Counter(tag['outcome'] for tag in tags.values() if not tag['has_failed'])
    read = unread.pop('read', 0)
    return [
        (f'{read:,} of {len(tags):,} tags read', False),
        *((f'{count:,} {word}', True) for word, count in failed.items()),
        *((f'{count:,} {word}', False) for word, count in unread.items()),
    ]


def _unread_of(tags: dict[str, dict[str, Any]]) -> list[summary.Failures]:
    """Return the tags that nobody tried to read, by why there is nothing of them."""
    return [
        summary.Failures(word, '', [tag_id for tag_id, tag in tags.items() if tag['outcome'] == word])
        for word in UNREAD
        if any(tag['outcome'] == word for tag in tags.values())
    ]


def _failure_data(failure: summary.Failures, tags: dict[str, dict[str, Any]]) -> dict[str, Any]:
    shown = [tags[tag_id]['id'] for tag_id in failure.tag_ids if tag_id in tags][:MOST_NAMED]
    more = len(failure.tag_ids) - len(shown)
    return {
        'word': failure.word,
        'reason': failure.reason,
        'tags': shown,
        'more': f' and {more:,} more' if more else '',
    }


def _route_data(route: list[placing.Point], walls: Walls) -> dict[str, Any]:
    """Return the line, the arrows and the stops of a route in metres: each point with its shift."""
    if len(route) < 2:
        return {'route': [], 'arrows': [], 'stops': [], 'route_ends': {}}
    arrow_m = max(placing.ARROW_M, (walls.y1 - walls.y0) / ARROWS_ACROSS)
    arrows = placing.arrows_between(route, placing.marks_of(route, arrow_m), arrow_m)
    lanes = placing.lanes_of(route)
    nearest = [np.abs(lanes[:, :3] - each).sum(axis=1).argmin() for each in arrows]
    return {
        'route': [row[:2] + row[3:] if any(row[3:]) else row[:2] for row in lanes.round(3).tolist()],
        'arrows': lanes[nearest].round(3).tolist(),
        'stops': placing.stops_of(route),
        'route_ends': {word: (box.x, box.y) for word, box in placing.ends_of_path(route).items()},
    }


def tags_of(file: Recording, sensors: list[str]) -> dict[str, dict[str, Any]]:
    """Return the last reading and visit of each tag: failures first, and what the file does not have last."""
    readings, visits = last_reading_of_each_tag(file.rows), {each.tag_id: each for each in file.visits}
    goals = summary.goals_of(file.visits, file.walls)
    tags: dict[str, dict[str, Any]] = {}
    for tag_id in sorted({*file.layout.tags, *readings, *visits}, key=natural_order):
        place, visit, reading = file.layout.tags.get(tag_id), visits.get(tag_id), readings.get(tag_id, {})
        row = next(iter(reading.values()), None)
        has_failed = visit is not None and visit.outcome != 'OK'
        if visit or row:
            outcome = summary.outcome_text(visit.outcome if visit else 'OK')
        else:
            outcome = UNREAD[0] if file.visits else UNREAD[1]
        shown = {} if has_failed else reading  # which is of an earlier visit
        tags[tag_id] = {
            'id': escaped(tag_id, LONGEST_NAME),
            'x': place and place.x,
            'y': place and place.y,
            'has_failed': has_failed,
            'outcome': outcome,
            'reason': summary.failure_reason(visit.detail) if visit else '',
            'attempts': visit and visit.attempts,
            'goal': goals.get(tag_id),
            'stamp_ms': row and row.stamp_ns // NS_PER_MS,
            'time_of_day': row and row.sim_time_of_day_seconds,
            'values': {each: shown[each].value if each in shown else None for each in sensors},
        }
    order = {'not visited': 1, 'read': 2, 'not in the file': 3}  # after the failures
    return dict(sorted(tags.items(), key=lambda item: order.get(item[1]['outcome'], 0)))


def lines_of(rows: list[Row], numbers: dict[str, int], sensors: list[str]) -> dict[str, list[dict[str, Any]]]:
    """
    Return the lines of the charts by sensor, one for each tag: over wall time and over the time of day.

    A point is [time, value], or [mean time, median, lowest, highest] of the values in a bin. Wall time is in
    milliseconds since the first row. A bin of it is a millisecond, or longer if there are too many values.
    """
    groups = defaultdict(list)
    for row in rows:
        if row.tag_id in numbers and row.sensor in sensors:
            ms = (row.stamp_ns - rows[0].stamp_ns) // NS_PER_MS
            groups[row.sensor, row.tag_id].append((ms, row.sim_time_of_day_seconds, row.value))
    most_bins = max(MOST_BINS // max(len(groups), 1), 1)
    wall_bins, day_bins = min(WALL_BINS, most_bins), min(DAY_BINS, most_bins)
    lines = defaultdict(list)
    for (sensor, tag_id), group in sorted(groups.items(), key=lambda item: numbers[item[0][1]]):
        stamps_ms, times_of_day, values = np.array(group).T
        is_binned = len(group) > wall_bins
        line = {
            'tag': numbers[tag_id],
            'is_binned': is_binned,
            'wall': binned(stamps_ms, values, (stamps_ms[-1] + 1) / wall_bins if is_binned else 1),
            'day': binned(times_of_day, values, DAY_SECONDS / day_bins),
        }
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
        # With six digits, which are more than any pixel shows.
        middle, low, high = (float(f'{value:.6g}') for value in (np.median(each), each.min(), each.max()))
        points.append([at, middle, low, high] if low < high else [at, middle])
    return points
