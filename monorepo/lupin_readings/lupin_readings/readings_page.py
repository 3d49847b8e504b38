"""
`ros2 run lupin_readings readings_page FILE`: make a page of the readings in a file.

The page is one HTML file that needs no server and no network. Does not import ROS.
"""

import argparse
import base64
import hashlib
import html
import itertools
import json
import math
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from lupin_greenhouse_bridge.errors import (
    OneLineError,
    StartUpError,
    UsageError,
    escaped,
    pluralized,
    reason_of,
)
from lupin_greenhouse_bridge.runtime.arguments import Parser
from lupin_greenhouse_bridge.runtime.output import check_output_file, print_line
from lupin_greenhouse_bridge.simulator.layout import Layout, natural_order
from lupin_greenhouse_bridge.units import (
    clock_time,
    decimals_of,
    label_of,
    name_of,
    sensor_order,
    unit_of,
    value_text,
)
from lupin_planning.walls import add_wall_options, warning_of_outside

from lupin_readings import summary
from lupin_readings.colours import STOPS, colour_limits, hex_colours_of, read_colour_ranges
from lupin_readings.reading_file import Point, Recording, read_recording
from lupin_readings.rows import Row, key_of, last_reading_of_each_tag

DONE, NO_ROWS, USAGE = 0, 1, 2
LONGEST_NAME = 64  # characters
MOST_TAGS, MOST_NAMED = 1000, 50  # in the table, and in a line of failures
UNREAD = 'not visited', 'not in the file'  # of tags without a row in the table
WALL_BINS, DAY_BINS = 150, 48  # of a line: one for two pixels of a chart, and one for half an hour
MOST_BINS = 60_000  # in all lines of one clock, so that the page stays below 5 MB
DAY_SECONDS = 86_400
ARROW_EVERY_M, SHORTEST_LEG_M = 5.0, 0.25  # a shorter leg of a route has no arrow
NS_PER_MS = 1_000_000
TO, SPACE = '\u00a0to ', '\u00a0'  # no unit is alone on a line
PAGE = Path(__file__).parent / 'page'
# In the order of their imports.
SCRIPTS = 'data', 'drawing', 'labels', 'choice', 'map', 'table', 'charts', 'page'
MARK = b'<meta name="generator" content="readings_page">'  # in the head of each page
Limits = dict[str, tuple[float, float]]  # the values at the ends of the colours, by sensor


def main(arguments: list[str] | None = None) -> int:
    """Write the page beside the file, or to --output; return the exit code."""
    options = _parser().parse_args(arguments)
    output = options.output or options.file.parent / f'{options.file.stem}.html'
    inputs = [('FILE', options.file), ('--tag-file', options.tag_file), ('--route', options.route)]
    try:
        check_output_file(output, '--output', [*inputs, ('--sim-config-file', options.sim_config_file)], MARK)
        if output.suffix.lower() not in ('.html', '.htm'):
            raise UsageError(f"--output '{output}' is a page: its name must end in .html")
        recording = read_recording(
            options.file, options.tag_file, options.sim_config_file, options.walls, options.route
        )
        if not (recording.rows or recording.visits):
            print(f"readings_page: '{options.file}' holds no readings: no page is made", file=sys.stderr)
            return NO_ROWS
        page = fill(recording, _limits_of(recording, options.sensor))
        output.write_text(page, encoding='utf-8')
    except OneLineError as error:
        print(f'readings_page: {error}', file=sys.stderr)
        return USAGE
    except OSError as error:
        print(f"readings_page: --output '{output}': {reason_of(error)}: name another file", file=sys.stderr)
        return USAGE
    rows = {key_of(row) for row in recording.rows}
    if hidden := len(rows) - len({key[:3] for key in rows}):
        hidden_values = (
            f'not shown: {pluralized(hidden, "value")} with the stamp, tag and sensor of a later value'
        )
        print(f"readings_page: '{options.file}': {hidden_values}", file=sys.stderr)
    if warning := warning_of_outside(recording.layout, recording.walls):
        print(f'readings_page: {warning}', file=sys.stderr)
    print_line(f'page: {escaped(str(output), 500)}')
    return DONE


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog='readings_page', description='Make a page of readings.')
    add = parser.add_argument
    add(
        'file',
        metavar='FILE',
        type=Path,
        help="a mission's report NAME.jsonl, or a file NAME.sqlite of record_readings",
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
    add('-o', '--output', type=Path, metavar='FILE', help='page to write; default: NAME.html beside FILE')
    return parser


def _limits_of(recording: Recording, wanted: Sequence[str] = ()) -> Limits:
    """Return the ends of the colours of the wanted sensors, or of all. Raises StartUpError for others."""
    values, last_values = defaultdict(list), defaultdict(list)
    for row in recording.rows:
        values[row.sensor].append(row.value)
    for reading in last_reading_of_each_tag(recording.rows).values():
        for row in reading.values():
            last_values[row.sensor].append(row.value)
    if unknown := [sensor for sensor in wanted if sensor not in values]:
        known = ', '.join(escaped(sensor, LONGEST_NAME) for sensor in sorted(values, key=sensor_order))
        shown = escaped(unknown[0], LONGEST_NAME)
        raise StartUpError(f"--sensor '{shown}' is not in FILE, which has {known or 'no values'}")
    ranges = read_colour_ranges(recording.sim_config_file)
    # Only the last values have a colour. The range of a whole day would make their colours alike.
    return {
        sensor: colour_limits(last_values[sensor] or values[sensor], ranges.get(sensor))
        for sensor in sorted(values, key=sensor_order)
        if not wanted or sensor in wanted
    }


def fill(recording: Recording, limits: Limits) -> str:
    """Return the page. No text in a file can close the element with the data, or run as a script."""
    script, data = _script(), data_of(recording, limits)
    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(',', ':'))
    return Template((PAGE / 'page.html').read_text(encoding='utf-8')).substitute(
        hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        title=html.escape(data['title']),
        style=(PAGE / 'page.css').read_text(encoding='utf-8'),
        data=text.replace('<', '\\u003c'),
        script=script,
    )


def _script() -> str:
    """Return the modules of the page as one script: no page can import from a file."""
    modules = [(PAGE / f'{name}.js').read_text(encoding='utf-8') for name in SCRIPTS]
    code = re.sub(r'^(import [^;]*;\n|export )', '', ''.join(modules), flags=re.MULTILINE)
    return f"'use strict';\n{code}"


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
        'title': escaped(recording.path.name, LONGEST_NAME),
        'colours': STOPS,
        'sensors': [
            {
                **_sensor_data(sensor, tags, limits[sensor], layout),
                'extent': (min(values[sensor]), max(values[sensor])),
                'lines': lines[sensor],
            }
            for sensor in sensors
        ],
        'tags': [tag | {'values': list(tag['values'].values())} for tag in tags.values()],
        'counts': _counts_of(all_tags, failures),
        'failures': [_failure_data(failure, tags) for failure in failures],
        'unread': [_failure_data(unread, tags) for unread in _unread_of(all_tags)],
        'span_ms': [row.stamp_ns // NS_PER_MS for row in (*rows[:1], *rows[-1:])],
        'duration': summary.duration_text(rows[0].stamp_ns, rows[-1].stamp_ns) if rows else '',
        'greenhouse_times': summary.greenhouse_times(rows) if rows else '',
        'is_of_several_times': len(times_of_day) > 1,
        'is_complete': summary.is_complete(values_of, sensors, layout),
        'is_binned': any(line['is_binned'] for line in itertools.chain(*lines.values())),
        'closest_m': closest_m([tag[:2] for tag in layout.tags.values()]),
        'walls': walls,
        'tables': list(layout.tables.values()),
        'view': [*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0)],
        'notes': notes,
        'fewest_attempts': min((tag['attempts'] or 0 for tag in read_tags), default=1),
        'route': route,
        'stops': stops_of(route),
        'arrows': arrows_of(route),
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
    """Return the tags that nobody tried to read, by reason."""
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


def stops_of(route: Sequence[Point]) -> list[Point]:
    """Return where a robot stood on its path: points that occur twice in a row."""
    return list(dict.fromkeys(point for point, following in itertools.pairwise(route) if point == following))


def arrows_of(route: Sequence[Point]) -> list[tuple[float, float, float]]:
    """Return x, y and heading of the arrows on a path: at even distances between two stops."""
    if len(route) < 2:
        return []
    points = np.array(route)
    pieces = np.diff(points, axis=0)
    along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*pieces.T))])
    is_stop = np.concatenate([[True], ~pieces.any(axis=1)])
    is_stop[-1] = True
    arrows = []
    for start_m, end_m in itertools.pairwise(along_m[is_stop].tolist()):
        count = max(round((end_m - start_m) / ARROW_EVERY_M), 1) if end_m - start_m >= SHORTEST_LEG_M else 0
        for number in range(count):
            at_m = start_m + (end_m - start_m) * (number + 0.5) / count
            x, y = (float(np.interp(at_m, along_m, places)) for places in points.T)
            step = pieces[np.searchsorted(along_m, at_m) - 1]
            arrows.append((round(x, 3), round(y, 3), round(math.atan2(step[1], step[0]), 3)))
    return arrows


def closest_m(points: Sequence[Point]) -> float:
    """Return the distance of the two closest points that are not at the same place; 1.0 if there are none."""
    places = np.unique(np.reshape(points, (-1, 2)), axis=0)
    apart_m = [float(np.hypot(*(places[n + 1 :] - place).T).min()) for n, place in enumerate(places[:-1])]
    return min(apart_m, default=1.0)


def tags_of(file: Recording, sensors: list[str]) -> dict[str, dict[str, Any]]:
    """Return the last reading and visit of each tag: failures first, tags that are not in the file last."""
    readings, visits = last_reading_of_each_tag(file.rows), {visit.tag_id: visit for visit in file.visits}
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
        shown = {} if has_failed else reading  # a failed tag may have a reading of an earlier visit
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
            'values': {sensor: shown[sensor].value if sensor in shown else None for sensor in sensors},
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
    """Return the mean time, median, lowest and highest value of each bin of this width that has values."""
    bins = (times // width).astype(int)
    order = np.argsort(bins, kind='stable')
    starts = np.flatnonzero(np.diff(bins[order])) + 1
    points = []
    for group in np.split(order, starts):
        in_bin, at = values[group], round(float(times[group].mean()))
        # Six digits are more than the charts can show.
        middle, low, high = (
            float(f'{value:.6g}') for value in (np.median(in_bin), in_bin.min(), in_bin.max())
        )
        points.append([at, middle, low, high] if low < high else [at, middle])
    return points
