# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""`ros2 run lupin_greenhouse_bridge plot_report FILE`: draw the last readings of a file."""

import argparse
import math
import textwrap
import time
from pathlib import Path

from lupin_greenhouse_bridge.display.drawing_command import (
    MOST_EXTREME,
    Failures,
    NothingToDraw,
    colour_limits,
    days_of,
    draw_file,
    extremes_of,
    failures_of,
    greenhouse_of,
    lasting,
    named,
    parser_of,
    read_route,
    speed_of,
)
from lupin_greenhouse_bridge.display.drawings import (
    BAD_COLOUR,
    COLOURS,
    ROUTE_COLOUR,
    TABLE_COLOUR,
    Box,
    box_of,
    draw_greenhouse,
    draw_path,
    label_path,
    picture_of,
    place_labels,
    steps_of,
)
from lupin_greenhouse_bridge.display.input_file import ReadingFile
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.recording.rows import Row, last_reading_of_each_tag
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, natural_order
from lupin_greenhouse_bridge.units import clock_time, label_of, sensor_order, value_text

MOST_COLUMNS, PANEL_INCHES = 3, 3.3
# Sizes in the picture of a greenhouse of 4 m x 8 m: a dot, a character and a line of a label, a gap.
DOT_M, CHARACTER_M, LINE_M, GAP_M = SIZES_M = 0.24, 0.1, 0.2, 0.1
READ, UNKNOWN, EXTREME = (
    {'color': colour, 'marker': 'o', 'linestyle': '', **style}
    for colour, style in (
        ('0.35', {'markersize': 5}),
        ('0.75', {'markersize': 4}),
        ('black', {'markersize': 13, 'markerfacecolor': 'none', 'markeredgewidth': 1.4}),
    )
)
USUAL_M = (4.3, 8.3)  # what such a picture shows
MOST_NAMED, LONGEST_LINE = 30, 110  # tags in a line of failures, and its characters


def main(arguments: list[str] | None = None) -> int:
    """Write the picture beside the report, or to --output; return the exit code."""
    parser = parser_of(
        'plot_report',
        'Draw readings into the greenhouse.',
        'picture to write, in the format of its ending, such as .svg or .pdf; default: NAME.png beside FILE',
    )
    return draw_file(parser, arguments, '.png', _picture_of)


def _picture_of(options: argparse.Namespace, file: ReadingFile) -> bytes:
    if not file.rows:
        reason = 'no tag was read' if file.visits else 'holds no readings'
        raise NothingToDraw(f"'{options.file}': {reason}: there is no picture")
    import matplotlib  # imported late: a missing library is a one-line error

    matplotlib.use('Agg')
    from matplotlib import pyplot

    layout, walls, colour_ranges = greenhouse_of(options, file)
    route, failures = read_route(options.route), failures_of(file.visits)
    failed = {tag_id: each.word for each in failures for tag_id in each.tag_ids}
    readings = {
        tag_id: each for tag_id, each in last_reading_of_each_tag(file.rows).items() if tag_id not in failed
    }
    if not readings:
        raise NothingToDraw(f"'{options.file}': the last visit of every tag failed: there is no picture")
    if strangers := sorted(set(readings) - set(layout.tags), key=natural_order):
        raise StartUpError(
            f"'{options.file}': tag '{escaped(strangers[0], 64)}' has no position in the tag file:"
            " name the bridge's own with --tag-file"
        )
    sensors = sorted({sensor for each in readings.values() for sensor in each}, key=sensor_order)
    has_ways = bool(route or failed)
    count = len(sensors) + has_ways
    columns, rows = min(count, MOST_COLUMNS), -(-count // MOST_COLUMNS)
    height = PANEL_INCHES * 0.85 * (walls.y1 - walls.y0) / (walls.x1 - walls.x0)
    figure, grid = pyplot.subplots(
        rows,
        columns,
        sharey=True,
        squeeze=False,
        layout='constrained',
        figsize=(PANEL_INCHES * columns, rows * (min(height, 12.0) + 1.4)),
    )
    all_axes = list(grid.flat)[:count]
    for axes in list(grid.flat)[count:]:
        axes.remove()
    for axes in all_axes:
        draw_greenhouse(axes, layout, walls)
        axes.spines[:].set_visible(False)  # the walls are the frame
        axes.tick_params(length=0)
    for axes in grid[:, 0]:
        axes.set_ylabel('y (m)')
    if has_ways:
        _draw_ways(all_axes[0], layout, walls, route, readings, failed)
    for axes, sensor in zip(all_axes[has_ways:], sensors, strict=True):
        values = [row.value for row in file.rows if row.sensor == sensor]
        colours = colour_limits(values, colour_ranges.get(sensor))
        _draw_readings(axes, sensor, layout, walls, readings, colours)
        _cross(axes, layout, failed, 30)
    for axes in all_axes:
        axes.set_anchor('N')  # the panel of the route has no colour bar below it
    _draw_legend(figure, set(failed.values()), has_route=bool(route))
    _write_head(
        figure,
        _headline(file.rows, readings, failures, len(layout.tags)),
        failures,
        _origin(options.file, readings, speed_of(file.rows)),
    )
    try:
        return picture_of(figure, options.output)
    finally:
        pyplot.close(figure)


def _draw_ways(
    axes,
    layout: Layout,
    walls: Walls,
    route: list[tuple[float, float]],
    readings: dict[str, dict[str, Row]],
    failed: dict[str, str],
) -> None:
    """Draw the path of the robot with its direction, and label the tags that were not read."""
    more = [f'the robot drove {sum(map(math.dist, route, route[1:])):.1f} m'] if route else []
    more += [f'not read: {named(list(failed), MOST_EXTREME)}'] if failed else []
    _write_title(axes, 'route' if route else 'tags read or not', '\n'.join(more))
    tags = layout.tags
    _dot(axes, [tag for tag_id, tag in tags.items() if tag_id in readings], READ)
    _dot(axes, [tag for tag_id, tag in tags.items() if tag_id not in readings | failed], UNKNOWN)
    dot_m, character_m, line_m, gap_m = _sizes_m(axes)
    way = [Box(x, y, gap_m, gap_m) for x, y, _ in steps_of(route, gap_m)]
    dots = {tag_id: Box(tag.x, tag.y, dot_m, dot_m) for tag_id, tag in tags.items()}
    is_one_word = len(set(failed.values())) == 1  # which the key tells
    texts = {each: each if is_one_word else f'{each} {word}' for each, word in failed.items() if each in tags}
    boxes = {tag_id: dots[tag_id] for tag_id in texts}
    for word, box in label_path(route).items():
        texts[word, 'of the route'], boxes[word, 'of the route'] = word, box
    if route:
        draw_path(axes, route)
        _show_all_of(axes, route)
    labels = [(boxes[key], character_m * len(text) + gap_m, line_m) for key, text in texts.items()]
    places = place_labels([*dots.values(), *way], labels, box_of(walls))
    for (key, text), place in zip(texts.items(), places, strict=True):
        _label(axes, place, text, BAD_COLOUR if key in failed else ROUTE_COLOUR)
    _cross(axes, layout, failed, 60)


def _show_all_of(axes, route: list[tuple[float, float]]) -> None:
    """Widen the view to a route that leads out of it."""
    xs, ys = zip(*route, strict=True)
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    axes.set_xlim(min(x0, min(xs) - GAP_M), max(x1, max(xs) + GAP_M))
    axes.set_ylim(min(y0, min(ys) - GAP_M), max(y1, max(ys) + GAP_M))


def _draw_readings(axes, sensor: str, layout, walls, readings, colours) -> None:
    from matplotlib.ticker import MaxNLocator

    measured = {tag_id: each[sensor].value for tag_id, each in readings.items() if sensor in each}
    others = [tag for tag_id, tag in layout.tags.items() if tag_id not in measured]
    extremes = extremes_of(sensor, measured)
    ringed = [tag_id for _, tag_ids in extremes for tag_id in tag_ids]
    _write_title(axes, label_of(sensor), '\n'.join(text for text, _ in extremes))
    _dot(axes, others, UNKNOWN)
    _dot(axes, [layout.tags[tag_id] for tag_id in ringed], EXTREME)
    points = axes.scatter(
        [layout.tags[tag_id].x for tag_id in measured],
        [layout.tags[tag_id].y for tag_id in measured],
        c=list(measured.values()),
        cmap=COLOURS,
        vmin=colours[0],
        vmax=colours[1],
        s=90,
        edgecolor='black',
        zorder=5,
    )
    dot_m, character_m, line_m, gap_m = _sizes_m(axes)
    sizes_m = {tag_id: dot_m * (1.4 if tag_id in ringed else 1.0) for tag_id in layout.tags}
    dots = {tag_id: Box(*layout.tags[tag_id][:2], size_m, size_m) for tag_id, size_m in sizes_m.items()}
    texts = [f'{tag_id}: {value_text(sensor, value)}' for tag_id, value in measured.items()]
    labels = [
        (dots[tag_id], character_m * len(text) + gap_m, line_m)
        for tag_id, text in zip(measured, texts, strict=True)
    ]
    for place, text in zip(place_labels(list(dots.values()), labels, box_of(walls)), texts, strict=True):
        _label(axes, place, text, 'black')
    low, high = colours
    is_within = low <= min(measured.values()) and max(measured.values()) <= high
    extend = 'neither' if is_within else 'both'
    inner = [
        each for each in MaxNLocator(4).tick_values(*colours) if 0.15 < (each - low) / (high - low) < 0.85
    ]
    ticks = [low, *inner, high]
    axes.figure.colorbar(points, ax=axes, location='bottom', shrink=0.9, pad=0.02, extend=extend, ticks=ticks)


def _write_title(axes, title: str, more: str) -> None:
    """Write a title, and below it up to two small lines, which must not move the colour bar."""
    axes.set_title(title, fontsize=12, pad=32)
    style = {'xycoords': 'axes fraction', 'textcoords': 'offset points', 'ha': 'center', 'fontsize': 8.5}
    axes.annotate(more, (0.5, 1), (0, 4), **style).set_in_layout(False)


def _sizes_m(axes) -> list[float]:
    """Return SIZES_M in the scale of the axes."""
    shown_m = (float(abs(end - start)) for start, end in (axes.get_xlim(), axes.get_ylim()))
    scale = max(each / usual for each, usual in zip(shown_m, USUAL_M, strict=True))
    return [scale * each for each in SIZES_M]


def _label(axes, place: tuple[float, float], text: str, colour: str) -> None:
    """Write a text with a white outline, so that no line touches it."""
    from matplotlib.patheffects import withStroke

    outline = [withStroke(linewidth=2, foreground='white')]
    axes.text(
        *place, text, ha='center', va='center', fontsize=8, color=colour, path_effects=outline, zorder=4
    )


def _dot(axes, tags: list[Tag], style: dict) -> None:
    axes.plot([tag.x for tag in tags], [tag.y for tag in tags], **style, zorder=2)


def _cross(axes, layout: Layout, failed: dict[str, str], size: float) -> None:
    tags = [layout.tags[tag_id] for tag_id in failed if tag_id in layout.tags]  # an unknown tag has no place
    xs, ys = [tag.x for tag in tags], [tag.y for tag in tags]
    axes.scatter(xs, ys, marker='x', s=size, color=BAD_COLOUR, zorder=5)


def _draw_legend(figure, words: set[str], *, has_route: bool) -> None:
    from matplotlib.lines import Line2D

    def entry(label: str, color: str, **style) -> Line2D:
        return Line2D([], [], color=color, label=label, **{'linestyle': '', **style})

    entries = [
        entry('wall', 'black', linestyle='-', linewidth=1.5),
        entry('table', TABLE_COLOUR, marker='s', markersize=11),
        entry('tag: value', '#21918c', marker='o', markersize=9, markeredgecolor='black'),
        entry('lowest or highest value', **EXTREME),
        entry('tag without a value', **UNKNOWN),
    ]
    if has_route or words:
        entries.append(entry('tag that was read', **READ))
    if words:
        word = f': {min(words)}' if len(words) == 1 else ''
        entries.append(entry(f'tag that was not read{word}', BAD_COLOUR, marker='x'))
    if has_route:
        entries.append(entry('route, in the direction of the arrows', ROUTE_COLOUR, linestyle='-'))
    # Below the figure, in the words of Matplotlib 3.5: Ubuntu 22.04 has no `ncols` and no `outside`.
    figure.legend(
        handles=entries,
        loc='upper center',
        bbox_to_anchor=(0.5, 0.0),
        ncol=3,
        frameon=False,
    )


def _headline(
    all_rows: list[Row], readings: dict[str, dict[str, Row]], failures: list[Failures], tag_count: int
) -> list[tuple[str, str]]:
    """Return the parts of the first line and their colours."""
    rows = [row for each in readings.values() for row in each.values()]
    first, last = (pick(rows, key=lambda row: row.stamp_ns) for pick in (min, max))
    counts = {}
    for each in failures:
        counts[each.word] = counts.get(each.word, 0) + len(each.tag_ids)
    times_of_day = dict.fromkeys(clock_time(row.sim_time_of_day_seconds) for row in (first, last))
    days = days_of([row for row in all_rows if first.stamp_ns <= row.stamp_ns <= last.stamp_ns])
    has_more_days = days - 1 > (last.sim_time_of_day_seconds < first.sim_time_of_day_seconds)
    over = f' over at least {days} days' if has_more_days else ''
    clocks = dict.fromkeys(map(_clock, (first, last)))
    length = f' ({lasting(first.stamp_ns, last.stamp_ns)})' if len(clocks) > 1 else ''
    return [
        (f'{len(readings)} of {tag_count} tags read', 'black'),
        *((f'{count} {word}', BAD_COLOUR) for word, count in counts.items()),
        (' to '.join(clocks) + length, 'black'),
        (f'greenhouse {" to ".join(times_of_day)}{over}', 'black'),
    ]


def _clock(row: Row) -> str:
    return time.strftime('%H:%M:%S', time.localtime(row.stamp_ns / 1e9))


def _origin(path: Path, readings: dict[str, dict[str, Row]], speed: str) -> str:
    """Return the name of the file, the day, and how fast the greenhouse's clock ran."""
    latest = max(row.stamp_ns for each in readings.values() for row in each.values())
    parts = [escaped(path.name, 64), time.strftime('%d %b %Y, times in %Z', time.localtime(latest / 1e9))]
    return ' · '.join(filter(None, [*parts, speed]))


def _write_head(figure, headline: list[tuple[str, str]], failures: list[Failures], origin: str) -> None:
    """Write above the panels whether it worked, what failed and why, and where the readings are from."""
    from matplotlib.offsetbox import AnnotationBbox, HPacker, TextArea

    lines = []
    for word, reason, tag_ids in failures:
        text = f'T{named(tag_ids, MOST_NAMED)[1:]} {word}{f": {reason}" if reason else ""}'
        lines += [(part, 11, BAD_COLOUR) for part in textwrap.wrap(text, LONGEST_LINE)]
    lines.append((origin, 10, '0.35'))
    points = 12.0  # above the panels
    for text, size, colour in reversed(lines):
        style = {'fontsize': size, 'color': colour, 'ha': 'center', 'va': 'bottom'}
        figure.text(0.5, 1.0 + points / 72 / figure.get_figheight(), text, **style)
        points += 1.5 * size
    parts = [part for each in headline for part in (each, ('·', 'black'))][:-1]
    texts = [
        TextArea(text, textprops={'fontsize': 14, 'fontweight': 'bold', 'color': colour})
        for text, colour in parts
    ]
    place = (0.5, 1.0 + points / 72 / figure.get_figheight())
    line = HPacker(children=texts, align='baseline', pad=0, sep=5)
    figure.add_artist(
        AnnotationBbox(line, place, xycoords=figure.transFigure, box_alignment=(0.5, 0), frameon=False, pad=0)
    )
