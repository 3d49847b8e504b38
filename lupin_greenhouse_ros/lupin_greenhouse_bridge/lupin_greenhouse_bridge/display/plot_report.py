# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""`ros2 run lupin_greenhouse_bridge plot_report FILE`: draw the last readings of a file."""

import argparse
import textwrap
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from lupin_greenhouse_bridge.display import colours, drawings, summary
from lupin_greenhouse_bridge.display import drawing_command as command
from lupin_greenhouse_bridge.display.drawings import LabelSize, Style
from lupin_greenhouse_bridge.display.input_file import ReadingFile
from lupin_greenhouse_bridge.display.placing import Box, Point, box_of, ends_of_path, length_m, steps_of
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.recording.rows import Row, last_reading_of_each_tag
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, natural_order
from lupin_greenhouse_bridge.units import label_of, sensor_order, value_text

MOST_COLUMNS, PANEL_INCHES = 3, 3.3
USUAL_WIDTH_M, USUAL_HEIGHT_M = 4.3, 8.3  # of the view of a greenhouse of 4 m x 8 m
DOT_M, GAP_M, LABELS = 0.24, 0.1, LabelSize(0.1, 0.1, 0.2)  # in such a picture; others scale them
READ: Style = {'color': '0.35', 'marker': 'o', 'linestyle': '', 'markersize': 5}
UNKNOWN: Style = {'color': '0.75', 'marker': 'o', 'linestyle': '', 'markersize': 4}
RING: Style = {'markerfacecolor': 'none', 'markeredgewidth': 1.4}
EXTREME: Style = {'color': 'black', 'marker': 'o', 'linestyle': '', 'markersize': 13, **RING}
MOST_NAMED, LONGEST_LINE = 30, 110  # tags in a line of failures, and its characters


def main(arguments: list[str] | None = None) -> int:
    """Write the picture beside the report, or to --output; return the exit code."""
    parser = command.parser_of(
        'plot_report',
        'Draw readings into the greenhouse.',
        'picture to write, in the format of its ending, such as .svg or .pdf; default: NAME.png beside FILE',
    )
    return command.draw_file(parser, arguments, '.png', _picture_of)


def _picture_of(options: argparse.Namespace, file: ReadingFile) -> bytes:
    if not file.rows:
        reason = 'no tag was read' if file.visits else 'holds no readings'
        raise command.NothingToDraw(f"'{options.file}': {reason}: there is no picture")
    from matplotlib.figure import Figure  # imported late: a missing library is a one-line error

    layout, walls, colour_ranges = command.greenhouse_of(options, file)
    route, failures = command.read_route(options.route), summary.failures_of(file.visits)
    failed = {tag_id: each.word for each in failures for tag_id in each.tag_ids}
    last = last_reading_of_each_tag(file.rows)
    readings = {tag_id: reading for tag_id, reading in last.items() if tag_id not in failed}
    if not readings:
        raise command.NothingToDraw(
            f"'{options.file}': the last visit of every tag failed: there is no picture"
        )
    if strangers := sorted(set(readings) - set(layout.tags), key=natural_order):
        raise StartUpError(
            f"'{options.file}': tag '{escaped(strangers[0], 64)}' has no position in the tag file:"
            " name the bridge's own with --tag-file"
        )
    sensors = sorted({sensor for each in readings.values() for sensor in each}, key=sensor_order)
    has_ways = bool(route or failed)
    figure = Figure(layout='constrained')
    all_axes = _panels_of(figure, len(sensors) + has_ways, walls)
    for axes in all_axes:
        drawings.draw_greenhouse(axes, layout, walls)
        axes.set_anchor('N')  # the panel of the route has no colour bar below it
    if has_ways:
        _draw_ways(all_axes[0], layout, walls, route, readings, failed)
    for axes, sensor in zip(all_axes[has_ways:], sensors, strict=True):
        measured = {tag_id: each[sensor].value for tag_id, each in readings.items() if sensor in each}
        values = [row.value for row in file.rows if row.sensor == sensor]
        limits = colours.colour_limits(values, colour_ranges.get(sensor))
        _draw_readings(axes, sensor, layout, walls, measured, limits)
        _draw_crosses(axes, layout, failed, 30)
    _write_key(figure, set(failed.values()), has_route=bool(route))
    shown = sorted((row for each in readings.values() for row in each.values()), key=lambda row: row.stamp_ns)
    origin = [escaped(options.file.name, 64), _time_text('%d %b %Y, times in %Z', shown[-1])]
    _write_head(
        figure,
        _headline(file.rows, shown, failures, f'{len(readings)} of {len(layout.tags)} tags read'),
        failures,
        ' · '.join(filter(None, [*origin, summary.speed_text(file.rows)])),
    )
    return drawings.picture_of(figure, options.output)


def _panels_of(figure: Any, count: int, walls: Walls) -> list[Any]:
    """Return the axes of this many panels, row by row."""
    columns, rows = min(count, MOST_COLUMNS), -(-count // MOST_COLUMNS)
    height = PANEL_INCHES * 0.85 * (walls.y1 - walls.y0) / (walls.x1 - walls.x0)
    figure.set_size_inches(PANEL_INCHES * columns, rows * (min(height, 12.0) + 1.4))
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for axes in grid.flat[count:]:
        axes.remove()
    for axes in grid[:, 0]:
        axes.set_ylabel('y (m)')
    return list(grid.flat[:count])


def _draw_ways(
    axes: Any,
    layout: Layout,
    walls: Walls,
    route: Sequence[Point],
    readings: Mapping[str, Mapping[str, Row]],
    failed: Mapping[str, str],
) -> None:
    """Draw the path of the robot with its direction, and label the tags that were not read."""
    more = [f'the robot drove {length_m(route):.1f} m'] if route else []
    more += [f'not read: {summary.tags_text(list(failed), summary.MOST_EXTREME)}'] if failed else []
    _write_title(axes, 'route' if route else 'tags read or not', '\n'.join(more))
    _draw_dots(axes, [tag for tag_id, tag in layout.tags.items() if tag_id in readings], READ)
    others = layout.tags.keys() - readings.keys() - failed.keys()
    _draw_dots(axes, [layout.tags[tag_id] for tag_id in others], UNKNOWN)
    if route:
        drawings.draw_path(axes, route)
        drawings.show_all(axes, layout, walls, route)
    scale = _scale_of(axes)
    dots = {tag_id: Box(*tag[:2], scale * DOT_M, scale * DOT_M) for tag_id, tag in layout.tags.items()}
    has_one_word = len(set(failed.values())) == 1  # which the key tells
    labels = [
        (tag_id if has_one_word else f'{tag_id} {word}', dots[tag_id], colours.FAILED)
        for tag_id, word in failed.items()
        if tag_id in dots
    ]
    labels += [(word, mark, colours.ROUTE) for word, mark in ends_of_path(route).items()]
    way = [Box(x, y, scale * GAP_M, scale * GAP_M) for x, y, _ in steps_of(route, scale * GAP_M)]
    _write_labels(axes, labels, [*dots.values(), *way], walls)
    _draw_crosses(axes, layout, failed, 60)


def _draw_readings(
    axes: Any,
    sensor: str,
    layout: Layout,
    walls: Walls,
    measured: Mapping[str, float],
    limits: tuple[float, float],
) -> None:
    """Draw the last values of a sensor by tag id, and below them the bar of their colours."""
    from matplotlib.ticker import MaxNLocator

    extremes = summary.extremes_of(sensor, measured)
    ringed = [tag_id for _, tag_ids in extremes for tag_id in tag_ids]
    _write_title(axes, label_of(sensor), '\n'.join(text for text, _ in extremes))
    _draw_dots(axes, [tag for tag_id, tag in layout.tags.items() if tag_id not in measured], UNKNOWN)
    _draw_dots(axes, [layout.tags[tag_id] for tag_id in ringed], EXTREME)
    xs, ys = zip(*(layout.tags[tag_id][:2] for tag_id in measured), strict=True)
    low, high = limits
    style = {
        'cmap': colours.COLOUR_MAP,
        'vmin': low,
        'vmax': high,
        's': 90,
        'edgecolor': 'black',
        'zorder': 5,
    }
    points = axes.scatter(xs, ys, c=list(measured.values()), **style)
    scale = _scale_of(axes)
    sizes_m = {tag_id: scale * DOT_M * (1.4 if tag_id in ringed else 1.0) for tag_id in layout.tags}
    dots = {tag_id: Box(*layout.tags[tag_id][:2], side_m, side_m) for tag_id, side_m in sizes_m.items()}
    texts = {tag_id: f'{tag_id}: {value_text(sensor, value)}' for tag_id, value in measured.items()}
    labels = [(text, dots[tag_id], 'black') for tag_id, text in texts.items()]
    _write_labels(axes, labels, list(dots.values()), walls)
    is_within = low <= min(measured.values()) and max(measured.values()) <= high
    inner = [
        tick for tick in MaxNLocator(4).tick_values(low, high) if 0.15 < (tick - low) / (high - low) < 0.85
    ]
    bar = {'location': 'bottom', 'shrink': 0.9, 'pad': 0.02, 'extend': 'neither' if is_within else 'both'}
    axes.figure.colorbar(points, ax=axes, ticks=[low, *inner, high], **bar)


def _write_title(axes: Any, title: str, more: str) -> None:
    """Write a title, and below it up to two small lines, which must not move the colour bar."""
    axes.set_title(title, fontsize=12, pad=32)
    style = {'xycoords': 'axes fraction', 'textcoords': 'offset points', 'ha': 'center', 'fontsize': 8.5}
    axes.annotate(more, (0.5, 1), (0, 4), **style).set_in_layout(False)


def _scale_of(axes: Any) -> float:
    """Return how many times the view is larger than that of the usual greenhouse."""
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    return float(max((x1 - x0) / USUAL_WIDTH_M, (y1 - y0) / USUAL_HEIGHT_M))


def _write_labels(axes: Any, labels: list[tuple[str, Box, str]], taken: list[Box], walls: Walls) -> None:
    """Write labels with a white outline, so that no line touches them."""
    from matplotlib.patheffects import withStroke

    size = LabelSize(*(_scale_of(axes) * each for each in LABELS))
    outline = [withStroke(linewidth=2, foreground='white')]
    drawings.write_labels(axes, labels, size, taken, box_of(walls), path_effects=outline, zorder=4)


def _draw_dots(axes: Any, tags: Collection[Tag], style: Style) -> None:
    axes.plot([tag.x for tag in tags], [tag.y for tag in tags], **style, zorder=2)


def _draw_crosses(axes: Any, layout: Layout, failed: Mapping[str, str], size: float) -> None:
    tags = [layout.tags[tag_id] for tag_id in failed if tag_id in layout.tags]  # an unknown tag has no place
    style = {'marker': 'x', 's': size, 'color': colours.FAILED, 'zorder': 5}
    axes.scatter([tag.x for tag in tags], [tag.y for tag in tags], **style)


def _write_key(figure: Any, failure_words: set[str], *, has_route: bool) -> None:
    point = {
        'color': colours.STOPS[5],
        'marker': 'o',
        'linestyle': '',
        'markersize': 9,
        'markeredgecolor': 'black',
    }
    marks: list[tuple[str, Style]] = [
        ('wall', {'color': 'black', 'linewidth': 1.5}),
        ('table', {'color': colours.TABLE, 'marker': 's', 'linestyle': '', 'markersize': 11}),
        ('tag: value', point),
        ('lowest or highest value', EXTREME),
        ('tag without a value', UNKNOWN),
    ]
    if has_route or failure_words:
        marks.append(('tag that was read', READ))
    if failure_words:
        word = f': {min(failure_words)}' if len(failure_words) == 1 else ''
        cross = {'color': colours.FAILED, 'marker': 'x', 'linestyle': ''}
        marks.append((f'tag that was not read{word}', cross))
    if has_route:
        marks.append(('route, in the direction of the arrows', {'color': colours.ROUTE}))
    drawings.write_key(figure, marks, columns=3)


def _headline(
    all_rows: list[Row], shown: list[Row], failures: list[summary.Failures], count: str
) -> list[tuple[str, str]]:
    """Return the parts of the first line and their colours; rows come in the order of their stamps."""
    first, last = shown[0], shown[-1]
    between = [row for row in all_rows if first.stamp_ns <= row.stamp_ns <= last.stamp_ns]
    clocks = dict.fromkeys(_time_text('%H:%M:%S', row) for row in (first, last))
    duration = f' ({summary.duration_text(first.stamp_ns, last.stamp_ns)})' if len(clocks) > 1 else ''
    counts: Counter[str] = Counter()
    for each in failures:
        counts[each.word] += len(each.tag_ids)
    return [
        (count, 'black'),
        *((f'{number} {word}', colours.FAILED) for word, number in counts.items()),
        (' to '.join(clocks) + duration, 'black'),
        (summary.greenhouse_times(between), 'black'),
    ]


def _time_text(form: str, row: Row) -> str:
    return time.strftime(form, time.localtime(row.stamp_ns / 1e9))


def _write_head(
    figure: Any, headline: list[tuple[str, str]], failures: list[summary.Failures], origin: str
) -> None:
    """Write above the panels whether it worked, what failed and why, and where the readings are from."""
    from matplotlib.artist import Artist
    from matplotlib.offsetbox import AnnotationBbox, HPacker, TextArea

    lines = []
    for word, reason, tag_ids in failures:
        text = f'T{summary.tags_text(tag_ids, MOST_NAMED)[1:]} {word}{f": {reason}" if reason else ""}'
        lines += [(part, 11, colours.FAILED) for part in textwrap.wrap(text, LONGEST_LINE)]
    lines.append((origin, 10, '0.35'))
    points = 12.0  # above the panels
    for text, size, colour in reversed(lines):
        style = {'fontsize': size, 'color': colour, 'ha': 'center', 'va': 'bottom'}
        figure.text(0.5, 1.0 + points / 72 / figure.get_figheight(), text, **style)
        points += 1.5 * size
    parts = [part for each in headline for part in (each, ('·', 'black'))][:-1]
    bold: Style = {'fontsize': 14, 'fontweight': 'bold'}
    texts: list[Artist] = [TextArea(text, textprops={'color': colour, **bold}) for text, colour in parts]
    line = HPacker(children=texts, align='baseline', pad=0, sep=5)
    place = (0.5, 1.0 + points / 72 / figure.get_figheight())
    at: Style = {'xycoords': figure.transFigure, 'box_alignment': (0.5, 0), 'frameon': False, 'pad': 0}
    figure.add_artist(AnnotationBbox(line, place, **at))
