"""`ros2 run lupin_greenhouse_bridge plot_report FILE`: draw the last readings of a file."""

import argparse
import math
import textwrap
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lupin_greenhouse_bridge.display import colours, drawings, placing, summary
from lupin_greenhouse_bridge.display import drawing_command as command
from lupin_greenhouse_bridge.display.drawing_command import Limits, Recording
from lupin_greenhouse_bridge.display.drawings import LabelSize, Style, point_style
from lupin_greenhouse_bridge.display.placing import Box, Point, box_of, ends_of_path, length_m, steps_of
from lupin_greenhouse_bridge.errors import StartUpError, escaped, names_text, pluralized
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.recording.rows import Row, last_reading_of_each_tag
from lupin_greenhouse_bridge.runtime.arguments import number_type
from lupin_greenhouse_bridge.runtime.output import said_if_slow
from lupin_greenhouse_bridge.simulator.layout import Layout, natural_order
from lupin_greenhouse_bridge.units import clock_time, label_of, name_of, sensor_order, value_text

# In inches: from the left of a panel to that of the next one, between them, and of all columns.
SMALLEST_PANEL, SMALLEST_GAP, WIDEST, INCHES_PER_M = 2.55, 0.3, 11.0, 0.52
LEFT, BELOW, ABOVE = 0.37, 0.57, 1.41  # inches for the labels of the axes, and between two rows
MOST_COLUMNS, MOST_WIDER = 3, 3.0  # panels in a row; by what a wide greenhouse is wider than a usual one
ZOOM, ONE_COLUMN_ZOOM = 1.1, 1.25  # of a usual greenhouse; with the second it fills a column of a paper
# The sizes of marks, which scale_of() scales.
LANE_M, GAP_M, LABELS = 0.083, 0.125, LabelSize(0.125, 0.095, 0.283)
RING_M, DOT_M, CROSS_M, SMALL_DOT_M = 0.4, 0.31, 0.24, 0.21
AWAY_M = 0.17  # that dots are larger for a label that is not theirs
POINTS = 9.0  # of the labels and the key
# Points from a map, and from its bar, to a key; to a title without lines below it, and of a line.
ABOVE_MAP, ABOVE_BAR, ABOVE_LINES, LINE = 18, 38, 43, 13
STOP = point_style('o', colours.ROUTE, 3.5)
READ = point_style('o', '0.5', 4.5)
WITHOUT = READ | {'markerfacecolor': 'white'}  # a reading, or a value
CROSS = point_style('X', colours.FAILED, 8, markeredgecolor='white')
UNREACHED = WITHOUT | {'color': colours.FAILED}
TO_TAG: Style = {'color': colours.FAILED, 'linewidth': 0.8, 'linestyle': (0, (3, 2)), 'zorder': 1.6}
GOAL = TO_TAG, point_style(drawings.DOT_ASIDE, 'white', 17, markeredgecolor=colours.FAILED)
RING = point_style('o', 'black', 13, markerfacecolor='none', markeredgewidth=1.4)
# Drawn as the discs are: Matplotlib moves the markers of lines to whole pixels.
RINGS: Style = {'s': 13**2, 'facecolor': 'none', 'edgecolor': 'black', 'linewidth': 1.4}
KEY: Style = {
    'fontsize': POINTS,
    'handletextpad': 0.75,
    'borderpad': 0,
    'borderaxespad': 0,
    'handlelength': 1.4,
    'columnspacing': 0.8,
}
MOST_NAMED = 30  # tags in a line of failures
NO_BREAK = '\xa0'  # a space


@dataclass(frozen=True)
class Greenhouse:
    """What the panels show."""

    layout: Layout
    walls: Walls
    scale: float  # of the sizes of marks in metres
    inches: tuple[float, float]  # the size of a panel
    route: list[Point]
    readings: dict[str, dict[str, Row]]  # the last rows by tag id and sensor, of tags that did not fail
    failed: dict[str, str]  # why not, in a word, by tag id
    goals: dict[str, Point]  # where the robot could not stand, by the id of a failed tag
    has_times: bool  # whether tags were read at different times of day


def main(arguments: list[str] | None = None) -> int:
    """Write the pictures beside the files, or one to --output; return the exit code."""
    parser = command.parser_of(
        'plot_report',
        'Draw the last reading of each tag: a picture for each file, all with the same colours.',
        'picture to write for one FILE, in the format of its ending, such as .svg or .pdf; default: NAME.png'
        ' beside FILE',
    )
    parser.add_argument(
        '--columns',
        metavar='N',
        type=number_type('1, 2 or 3', int, above=0, below=MOST_COLUMNS + 1),
        default=MOST_COLUMNS,
        help='most panels in a row, such as 1 for a phone or a column of a paper; default: 3',
    )
    return command.draw_files(parser, arguments, pictures_of)


def pictures_of(
    options: argparse.Namespace, recordings: list[Recording], limits: Limits
) -> Iterator[tuple[Path, bytes]]:
    """Yield the path and the picture of each recording, with the sensors that have limits."""
    if options.output and len(recordings) > 1:
        raise StartUpError(f"--output '{options.output}' is one picture: leave it out, or name one FILE")
    outputs = [options.output or each.path.with_suffix('.png') for each in recordings]
    for output, count in Counter(outputs).items():
        if count > 1:
            raise StartUpError(
                f"'{output}' is the picture of {count} FILEs: draw them one by one, with --output"
            )
    endings = [drawings.picture_format(output) for output in outputs]
    for each, output, ending in zip(recordings, outputs, endings, strict=True):
        with said_if_slow('plot_report', f'drawing {escaped(str(output), 500)}'):
            picture = _picture_of(each, limits, ending, options.columns)
        yield output, picture


def _picture_of(recording: Recording, limits: Limits, ending: str, most_columns: int) -> bytes:
    path, rows, layout = recording.path, recording.rows, recording.layout
    if not rows:
        reason = 'no tag was read' if recording.visits else 'holds no readings'
        raise command.NothingToDraw(f"'{path}': {reason}: there is no picture")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure  # imported late: a missing library is a one-line error

    failures = summary.failures_of(recording.visits)
    failed = {tag_id: each.word for each in failures for tag_id in each.tag_ids}
    goals = summary.goals_of(recording.visits, recording.walls)
    goals = {tag_id: goals[tag_id] for tag_id in failed if tag_id in goals and tag_id in layout.tags}
    last = last_reading_of_each_tag(rows)
    readings = {tag_id: reading for tag_id, reading in last.items() if tag_id not in failed}
    if not readings:
        raise command.NothingToDraw(f"'{path}': the last visit of every tag failed: there is no picture")
    if strangers := sorted(set(readings) - set(layout.tags), key=natural_order):
        raise StartUpError(
            f"'{path}': tag '{escaped(strangers[0], 64)}' has no position in the tag file: name the bridge's"
            ' own with --tag-file'
        )
    corners = [recording.walls[:2], recording.walls[2:], *recording.route]
    view = Walls(*np.min(corners, axis=0).tolist(), *np.max(corners, axis=0).tolist())
    width_m, height_m, scale = drawings.scale_of(layout, view)
    wider = width_m / height_m * drawings.USUAL_HEIGHT_M / drawings.USUAL_WIDTH_M
    scale /= min(max(1.0, math.sqrt(wider)), MOST_WIDER)  # so that its labels have as much room
    is_wide = width_m / scale * INCHES_PER_M > SMALLEST_PANEL
    scale /= 1.0 if is_wide else ONE_COLUMN_ZOOM if most_columns == 1 else ZOOM
    inches = width_m / scale * INCHES_PER_M, height_m / scale * INCHES_PER_M
    times = {clock_time(row.sim_time_of_day_seconds) for each in readings.values() for row in each.values()}
    has_times = len(times) > 1
    shown = Greenhouse(
        layout, recording.walls, scale, inches, recording.route, readings, failed, goals, has_times
    )
    sensors = [each for each in limits if any(each in reading for reading in readings.values())]
    has_ways = bool(shown.route or failed)
    figure = Figure()
    FigureCanvasAgg(figure)  # measures texts
    keys = [_marks_of_ways(shown)] * has_ways + [_marks_of_values(shown, sensors)]
    key_columns = [2] * has_ways + [min(len(sensors), 2)]
    # Below a title, beside those of a bar: three about the values, one of times, and the rows of a key.
    about = 3 + has_times
    lines = [-(-len(marks) // columns) for marks, columns in zip(keys, key_columns, strict=True)]
    lines = [*lines[:-1], about + lines[-1], *[about] * (len(sensors) - 1)]
    panels = _panels_of(figure, max(lines), len(lines), shown, most_columns)
    above = [ABOVE_MAP] * has_ways + [ABOVE_BAR]
    if panels[0].get_gridspec().ncols > 1:
        lines, above = [max(lines)] * len(lines), [ABOVE_BAR] * len(above)
    if has_ways:
        _draw_ways(panels[0], shown, lines[0])
    for axes, sensor, count in zip(panels[has_ways:], sensors, lines[has_ways:], strict=True):
        _draw_readings(axes, sensor, shown, limits[sensor], count)
    for axes, marks, columns, points in zip(panels, keys, key_columns, above, strict=False):
        _write_key(axes, shown, marks, columns, points)
    others = set().union(*readings.values()).difference(sensors)
    hidden = f'Not shown: {_listed(sorted(others, key=sensor_order))}.' if others else ''
    _write_texts(panels[0].title, [hidden, escaped(path.name, 64)], rows, failures, shown)
    return drawings.picture_of(figure, ending)


def _panels_of(figure: Any, lines: int, count: int, shown: Greenhouse, most_columns: int) -> list[Any]:
    """Return the axes of this many greenhouses, row by row, with room for these lines below a title."""
    width, height = shown.inches
    gap = max(SMALLEST_PANEL - width, SMALLEST_GAP)
    most = min(max(1, int(WIDEST / (width + gap))), most_columns)
    rows = -(-count // most)
    columns, above = -(-count // rows), ABOVE + LINE / 72 * lines
    right, all_height = LEFT + columns * (width + gap) - gap, BELOW + rows * (height + above) - above
    all_width = max(right + gap - SMALLEST_GAP, LEFT + SMALLEST_PANEL * ONE_COLUMN_ZOOM)
    figure.set_size_inches(all_width, all_height)
    sides = LEFT / all_width, BELOW / all_height, right / all_width, 1.0
    figure.subplots_adjust(*sides, gap / width, above / height)
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False, subplot_kw={'anchor': 'NW'})
    for axes in grid.flat[:count]:
        drawings.draw_greenhouse(axes, shown.layout, shown.walls)
    for axes in grid.flat[count:]:
        axes.axis('off')
    for axes in grid[:, 0]:
        axes.set_ylabel('y (m)')
    return list(grid.flat[:count])


def _draw_ways(axes: Any, shown: Greenhouse, lines: int) -> None:
    """Draw the path of the robot with its direction, and label the tags that were not read."""
    tags, route, failed = shown.layout.tags, shown.route, shown.failed
    _draw_dots(axes, [each for each in tags if each in shown.readings], shown, READ)
    _draw_dots(axes, _unread_of(shown), shown, WITHOUT)
    if route:
        lanes = placing.lanes_of(route)
        points = (lanes[:, :2] + shown.scale * LANE_M * lanes[:, 3:]).tolist()
        drawings.draw_path(axes, points, placing.marks_of(route, shown.scale * placing.ARROW_M))
        axes.plot(*np.reshape(placing.stops_of(route), (-1, 2)).T, **STOP, zorder=1.7)
        drawings.show_all(axes, shown.layout, shown.walls, route)
    more = f'the robot drove {length_m(route):.1f} m' if route else ''
    _write_title(axes, shown, 'route' if route else 'tags read or not', more, lines)
    gap_m = shown.scale * GAP_M
    crosses = [tag_id for tag_id in failed if tag_id in tags]
    dots = _boxes_of(dict.fromkeys(crosses, CROSS_M), shown)
    sights = [(goal, tags[tag_id][:2]) for tag_id, goal in shown.goals.items()]
    for sight in sights:
        axes.plot(*zip(*sight, strict=True), **TO_TAG)
        axes.plot(*sight[0], **UNREACHED)
    ends = []
    for word, end in ends_of_path(route).items():
        (width_m, height_m), (x0, y0, x1, _) = LABELS.times(shown.scale).box(word), shown.walls
        x = min(max(end.x, x0 + width_m / 2), x1 - width_m / 2)  # so that all of it can be below
        is_low = end.y - y0 < end.height / 2 + height_m
        above = end._replace(x=x, height=1.3 * end.height)
        ends.append((word, end if is_low else above, colours.ROUTE))
    way = [Box(x, y, gap_m, gap_m) for each in (route, *sights) for x, y, _ in steps_of(each, gap_m)]
    tables = (box_of(Walls(*table)) for table in shown.layout.tables.values())
    goals = [Box(*goal, gap_m, gap_m) for goal, _ in sights]
    way += _write_labels(axes, ends, [*dots.values()], [*way, *tables], shown)
    labels = [(tag_id, dots[tag_id], colours.FAILED) for tag_id in crosses]
    downwards = sorted(dots.items(), key=lambda each: -each[1].y)
    labels += [(tag_id, dot, '0.35') for tag_id, dot in downwards if tag_id not in failed]
    _write_labels(axes, labels, [*dots.values(), *goals], way, shown)
    _draw_crosses(axes, shown, crosses)


def _draw_readings(
    axes: Any, sensor: str, shown: Greenhouse, limits: tuple[float, float], lines: int
) -> None:
    """Draw the last values of a sensor, and above them the bar of their colours."""
    from matplotlib.ticker import MaxNLocator

    tags, (low, high) = shown.layout.tags, limits
    failed, values = _crosses_of(sensor, shown), _values_of(sensor, shown)
    extremes = summary.extremes_of(sensor, values)
    ringed = [tag_id for _, tag_ids in extremes for tag_id in tag_ids] if len(extremes) > 1 else []
    owners = {tag_id for tag_id, tag in tags.items() if sensor in tag.sensors} | set(values)
    count = f'{len(values)} of {pluralized(len(owners), "tag")} with this sensor'
    times = summary.times_text([each[sensor] for each in shown.readings.values() if sensor in each])
    more = '\n'.join(filter(None, [count, *(text for text, _ in extremes), times]))
    _write_title(axes, shown, label_of(sensor), more, lines)
    _draw_dots(axes, [each for each in tags if each not in {*values, *failed}], shown, WITHOUT)
    style = {'cmap': colours.COLOUR_MAP, 'vmin': low, 'vmax': high, 's': 90, 'edgecolor': 'black'}
    points = axes.scatter(*_places_of(values, shown), c=list(values.values()), zorder=5, snap=False, **style)
    if ringed:
        axes.scatter(*_places_of(ringed, shown), **RINGS, zorder=1.9, snap=False)
    sides_m = dict.fromkeys(failed, CROSS_M) | dict.fromkeys(values, DOT_M) | dict.fromkeys(ringed, RING_M)
    dots = _boxes_of(sides_m, shown)
    labels = [
        (f'{tag_id}: {value_text(sensor, value)}', dots[tag_id], 'black') for tag_id, value in values.items()
    ]
    labels += [(tag_id, dots[tag_id], colours.FAILED) for tag_id in failed]
    _write_labels(axes, labels, [*dots.values()], [], shown)
    is_within = low <= min(values.values()) and max(values.values()) <= high
    ticks, extend = MaxNLocator(5, steps=[1, 2, 5, 10]), 'neither' if is_within else 'both'
    bar = drawings.draw_colour_bar(axes, points, shown.walls, ticks=ticks, extend=extend)
    bar.ax.tick_params(labelsize=POINTS)
    _draw_crosses(axes, shown, failed)


def _left_of(axes: Any, shown: Greenhouse) -> float:
    """Return where the left wall is, as a share of the width of the axes."""
    return float(axes.transLimits.transform((shown.walls.x0, 0.0))[0])


def _write_title(axes: Any, shown: Greenhouse, title: str, more: str, lines: int) -> None:
    """Write above the left wall a title, and the first of the lines below it."""
    left, columns = _left_of(axes, shown), axes.get_gridspec().ncols
    to_end = axes.figure.bbox.x1 - axes.bbox.x0 - left * axes.bbox.width
    room = min(0.96 * axes.figure.bbox.width / columns, to_end)
    above = ABOVE_LINES + LINE * lines
    first = axes.set_title(title, fontsize=12, pad=above, x=left, ha='left')
    style: Style = {'textcoords': 'offset points', 'fontsize': 9, 'color': '0.35', 'ha': 'left'}
    below = axes.annotate(more, (left, 1), (0, above - 5), xycoords='axes fraction', va='top', **style)
    renderer = axes.figure.canvas.get_renderer()
    for text in (first, below):
        width = text.get_window_extent(renderer).width
        if width > room:
            text.set_fontsize(0.9 * text.get_fontsize() * room / width)  # small letters are a little wider


def _write_labels(
    axes: Any, labels: list[tuple[str, Box, str]], dots: list[Box], taken: list[Box], shown: Greenhouse
) -> list[Box]:
    """Write labels with a white outline, away from other dots and where no box is taken."""
    from matplotlib.patheffects import withStroke

    size, bounds, boxes = LABELS.times(shown.scale), box_of(shown.walls), list[Box]()
    outline = [withStroke(linewidth=2, foreground='white')]
    style: Style = {'fontsize': POINTS, 'path_effects': outline}
    solid = np.reshape([*dots, *taken], (-1, 4))
    solid[: len(dots), 2:] += shown.scale * AWAY_M
    for text, dot, colour in labels:
        apart_m, reach_m = np.abs(solid[:, :2] - dot[:2]), dot.width + 3 * size.width_m(text)
        is_near = (apart_m - solid[:, 2:] / 2 < reach_m).all(axis=1) & apart_m.any(axis=1)
        near = [dot, *map(Box._make, solid[is_near].tolist()), *boxes]
        style['weight'] = 'bold' if colour == colours.FAILED else 'normal'
        style['zorder'] = 1.4 if colour == colours.ROUTE else 4  # below the route, which it would cut
        boxes += drawings.write_labels(axes, [(text, dot, colour)], size, near, bounds, **style)
    return boxes


def _boxes_of(sides_m: dict[str, float], shown: Greenhouse) -> dict[str, Box]:
    sides = {tag_id: shown.scale * sides_m.get(tag_id, SMALL_DOT_M) for tag_id in shown.layout.tags}
    return {tag_id: Box(*shown.layout.tags[tag_id][:2], side, side) for tag_id, side in sides.items()}


def _values_of(sensor: str, shown: Greenhouse) -> dict[str, float]:
    return {tag_id: each[sensor].value for tag_id, each in shown.readings.items() if sensor in each}


def _crosses_of(sensor: str, shown: Greenhouse) -> list[str]:
    """Return the failed tags that have this sensor."""
    tags = shown.layout.tags
    return [each for each in shown.failed if each in tags and sensor in tags[each].sensors]


def _unread_of(shown: Greenhouse) -> list[str]:
    return [each for each in shown.layout.tags if each not in {*shown.readings, *shown.failed}]


def _draw_dots(axes: Any, tag_ids: list[str], shown: Greenhouse, style: Style) -> None:
    places = [shown.layout.tags[tag_id][:2] for tag_id in tag_ids]
    if places:  # a line that is not clipped, for tags on a wall, needs points
        axes.plot(*zip(*places, strict=True), **style, zorder=2, clip_on=False)


def _draw_crosses(axes: Any, shown: Greenhouse, tag_ids: list[str]) -> None:
    style = {'marker': 'X', 's': 70, 'color': colours.FAILED, 'edgecolor': 'white', 'zorder': 5}
    axes.scatter(*_places_of(tag_ids, shown), **style)


def _places_of(tag_ids: Iterable[str], shown: Greenhouse) -> Any:
    """Return the x and the y of tags."""
    return np.reshape([shown.layout.tags[tag_id][:2] for tag_id in tag_ids], (-1, 2)).T


def _write_key(
    axes: Any, shown: Greenhouse, marks: list[tuple[str, drawings.Mark]], columns: int, above: float
) -> None:
    """Write what each mark means, these points above the left wall of a panel."""
    from matplotlib.transforms import offset_copy

    place = {'loc': 'lower left', 'bbox_to_anchor': (_left_of(axes, shown), 1.0), **KEY}
    place['bbox_transform'] = offset_copy(axes.transAxes, axes.figure, y=above, units='points')
    drawings.write_key(axes, marks, columns=columns, **place).set_in_layout(False)


def _marks_of_values(shown: Greenhouse, sensors: list[str]) -> list[tuple[str, drawings.Mark]]:
    """Return what the panels of these sensors have."""
    is_complete = not _unread_of(shown) and summary.is_complete(shown.readings, sensors, shown.layout)
    drawn = [(each, _values_of(each, shown), _crosses_of(each, shown)) for each in sensors]
    has_rings = any(len(summary.extremes_of(sensor, values)) > 1 for sensor, values, _ in drawn)
    has_dots = any(len(values) + len(crosses) < len(shown.layout.tags) for _, values, crosses in drawn)
    has_crosses = any(crosses for *_, crosses in drawn)
    name = name_of(sensors[0]) if len(sensors) == 1 else 'such'
    without = f'no {name} sensor' if is_complete else 'no value'
    return [
        ('tag: value', point_style('o', colours.STOPS[5], 9, markeredgecolor='black')),
        *([('lowest, highest', RING)] if has_rings else []),
        *([(without, WITHOUT)] if has_dots else []),
        *([(_word_of(shown.failed), CROSS)] if has_crosses else []),
        *(_marks_of_tables(shown) if not shown.route else []),
    ]


def _marks_of_ways(shown: Greenhouse) -> list[tuple[str, drawings.Mark]]:
    """Return what the panel of the route has, or the one of the tags that were read or not."""
    read = [('tag read', READ), *([('without a reading', WITHOUT)] if _unread_of(shown) else [])]
    route = {'color': colours.ROUTE, 'marker': '>', 'markersize': 5}
    stops = [('stop', STOP)] if placing.stops_of(shown.route) else []
    ways = [('route', route), *stops, *_marks_of_tables(shown)] if shown.route else []
    return [*ways, *read, *_marks_of_failed(shown)]


def _marks_of_failed(shown: Greenhouse) -> list[tuple[str, drawings.Mark]]:
    goals = [('goal not reached', GOAL)] if shown.goals else []
    return [(_word_of(shown.failed), CROSS), *goals] if shown.failed else []


def _word_of(failed: dict[str, str]) -> str:
    """Return the word that all failures share, or else 'not read'."""
    words = set(failed.values())
    return min(words) if len(words) == 1 else 'not read'


def _marks_of_tables(shown: Greenhouse) -> list[tuple[str, drawings.Mark]]:
    return [('table', point_style('s', colours.TABLE, 11))] if shown.layout.tables else []


def _time_text(form: str, row: Row) -> str:
    return time.strftime(form, time.localtime(row.stamp_ns / 1e9))


def _write_texts(
    title: Any, notes: list[str], rows: list[Row], failures: list[summary.Failures], shown: Greenhouse
) -> None:
    """Write above a title what was read, what failed and why, and when; and below the figure the rest."""
    drawn = sorted(
        (row for each in shown.readings.values() for row in each.values()), key=lambda r: r.stamp_ns
    )
    first, last = drawn[0], drawn[-1]
    between = [row for row in rows if first.stamp_ns <= row.stamp_ns <= last.stamp_ns]
    clocks = dict.fromkeys(_time_text('%H:%M:%S', row) for row in (first, last))
    duration = f' ({summary.duration_text(first.stamp_ns, last.stamp_ns)})' if len(clocks) > 1 else ''
    headline = [
        (f'{len(shown.readings)} of {len(shown.layout.tags)} tags read', 'black'),
        *((f'{count} {word}', colours.FAILED) for word, count in summary.failure_counts(failures).items()),
    ]
    figure, small = title.figure, {'fontsize': 10}
    day = _time_text('Simulated readings, %d %b %Y', last)
    lines = _lines_of(headline, figure, {'fontsize': 15, 'fontweight': 'bold'})
    lines += _lines_of([(day, 'black')], figure, {'fontsize': 12, 'fontweight': 'bold'})
    for word, reason, tag_ids in failures:
        told = (f'{word}:' if reason else word).replace(' ', NO_BREAK)
        text = f'T{names_text("tag", tag_ids, MOST_NAMED)[1:]}{_lost_of(tag_ids, shown)} {told} {reason}'
        for part in _wrapped(text, figure, small):
            before, found, after = part.partition(told)
            red, tail = found[: len(word)].replace(NO_BREAK, ' '), found[len(word) :] + after
            pieces = (before, 'black'), (red, colours.FAILED), (tail, 'black')
            lines.append(_line_of([each for each in pieces if each[0]], small, 0))
    when = 'real time ' + ' to '.join(clocks) + _time_text(' %Z', last) + duration
    greenhouse = f'{summary.greenhouse_times(between)} {summary.speed_text(rows)}'.rstrip()
    lines += _lines_of([(greenhouse, '0.35'), (when, '0.35')], figure, small)
    _write_lines(title, lines, title, 1.0, 12)
    rest = [summary.SEVERAL_TIMES * shown.has_times, *notes]
    texts = ([(text, '0.35')] for text in rest if text)
    lines = [line for text in texts for line in _lines_of(text, figure, {'fontsize': 9})]
    _write_lines(title, lines, figure.transFigure, 0.0, -8)


def _lost_of(tag_ids: list[str], shown: Greenhouse) -> str:
    """Return the sensors of a lone failed tag, in parentheses."""
    tag = shown.layout.tags.get(tag_ids[0])
    if tag is None or len(tag_ids) > 1 or not tag.sensors:
        return ''
    return f' ({_listed(tag.sensors)})'


def _listed(sensors: Sequence[str]) -> str:
    """Return the names of sensors, such as `light and soil moisture`."""
    return names_text('sensor', [name_of(each) for each in sensors], MOST_NAMED).partition(' ')[2]


def _write_lines(title: Any, lines: list[Any], of: Any, height: float, above: float) -> None:
    """Write lines below each other, points above (or below, if negative) a height of an artist."""
    from matplotlib.offsetbox import AnnotationBbox, VPacker

    block, where = VPacker(children=lines, align='left', pad=0, sep=4), (title.figure.transFigure, of)
    at: Style = {'box_alignment': (0, above < 0), 'frameon': False, 'pad': 0, 'boxcoords': 'offset points'}
    title.figure.add_artist(AnnotationBbox(block, (0.0, height), (0.0, above), xycoords=where, **at))


def _lines_of(parts: list[tuple[str, str]], figure: Any, style: Style) -> list[Any]:
    """Return texts, each given with its colour, with dots between them in lines as wide as the figure."""
    lines: list[list[tuple[str, str]]] = []
    for text, colour in parts:
        joined = [*lines[-1], ('·', parts[0][1]), (text, colour)] if lines else [(text, colour)]
        if len(_wrapped('   '.join(text for text, _ in joined), figure, style)) == 1:
            lines[-1:] = [joined]
        else:
            lines += [[(line, colour)] for line in _wrapped(text, figure, style)]
    return [_line_of(line, style, 5) for line in lines]


def _line_of(parts: list[tuple[str, str]], style: Style, gap: float) -> Any:
    from matplotlib.offsetbox import HPacker, TextArea

    texts: list[Any] = [TextArea(text, textprops={'color': colour, **style}) for text, colour in parts]
    return HPacker(children=texts, align='baseline', pad=0, sep=gap)


def _wrapped(text: str, figure: Any, style: Style) -> list[str]:
    """Return a text in lines that are alike, and at most as wide as the figure."""
    from matplotlib.font_manager import FontProperties

    font = FontProperties(size=style['fontsize'], weight=style.get('fontweight'))
    width_of = figure.canvas.get_renderer().get_text_width_height_descent
    lines, most = [text], int(200 * figure.get_figwidth() / style['fontsize'])  # of the narrowest characters
    while any(width_of(line, font, False)[0] > 1.03 * figure.bbox.width for line in lines):
        lines, most = textwrap.wrap(text, most), most - 1
    while len(lines) > 1 and len(even := textwrap.wrap(text, most)) == len(lines):
        lines, most = even, most - 1
    return lines
