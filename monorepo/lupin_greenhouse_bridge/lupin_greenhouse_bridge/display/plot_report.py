# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""`ros2 run lupin_greenhouse_bridge plot_report FILE`: draw the last readings of a file."""

import argparse
import itertools
import math
import sys
import time
from pathlib import Path

from lupin_greenhouse_bridge.display.drawing_command import (
    Failures,
    NothingToDraw,
    draw_file,
    failures_of,
    find_route,
    layout_of,
    parser_of,
    read_colour_ranges,
)
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.drawing import COLOURS, Box, draw_greenhouse, place_labels
from lupin_greenhouse_bridge.planning.walls import find_walls
from lupin_greenhouse_bridge.recording.reading_files import ReadingFile
from lupin_greenhouse_bridge.recording.rows import Row, last_of_each_tag
from lupin_greenhouse_bridge.simulator.layout import Layout, natural_order
from lupin_greenhouse_bridge.units import clock_time, label_of, sensor_order, value_text

# Sizes in the picture, where a metre is about 0.6 inch: a dot, and a character of a label.
DOT_M, CHARACTER_M, LINE_M, GAP_M = 0.24, 0.095, 0.19, 0.1
ROUTE_COLOUR, FAILED_COLOUR = '#3d6fa8', '#b3261e'
ARROW_EVERY_M = 1.2
MOST_NAMED = 30  # tags in a line of failures


def main(arguments: list[str] | None = None) -> int:
    """Write the picture beside the report, or to --output; return the exit code."""
    parser = parser_of(
        'plot_report',
        'Draw readings into the greenhouse.',
        'picture to write, also .svg or .pdf; default: FILE.png',
    )
    return draw_file(parser, arguments, '.png', _draw)


def _draw(options: argparse.Namespace, file: ReadingFile, output: Path) -> None:
    if not file.rows:
        reason = 'no tag was read' if file.visits else 'holds no readings'
        raise NothingToDraw(f"'{options.file}': {reason}: there is no picture")
    import matplotlib  # imported late: a missing library is a one-line error

    matplotlib.use('Agg')
    from matplotlib import pyplot

    layout = layout_of(file, options.tag_file)
    walls = find_walls(layout, options.sim_config_file, options.walls)
    colour_ranges = read_colour_ranges(options.sim_config_file)
    route, failures = find_route(options), failures_of(file.visits)
    failed = {tag_id: each.word for each in failures for tag_id in each.tag_ids}
    readings = {tag_id: each for tag_id, each in last_of_each_tag(file.rows).items() if tag_id not in failed}
    if strangers := sorted(set(readings) - set(layout.tags), key=natural_order):
        raise StartUpError(
            f"'{options.file}': tag '{escaped(strangers[0], 64)}' has no position in the tag file:"
            " name the bridge's own with --tag-file"
        )
    sensors = sorted({sensor for each in readings.values() for sensor in each}, key=sensor_order)
    has_ways = bool(route or failed)
    columns = len(sensors) + has_ways
    figure, ((*all_axes,),) = pyplot.subplots(
        1, columns, sharey=True, squeeze=False, layout='constrained', figsize=(2.9 * columns, 7.4)
    )
    for axes in all_axes:
        draw_greenhouse(axes, layout, walls)
        axes.spines[:].set_visible(False)  # the walls are the frame
        axes.tick_params(length=0)
    all_axes[0].set_ylabel('y (m)')
    if has_ways:
        _draw_ways(all_axes[0], layout, route, failed)
    for axes, sensor in zip(all_axes[has_ways:], sensors, strict=True):
        _draw_readings(figure, axes, sensor, layout, readings, colour_ranges.get(sensor))
        _cross(axes, layout, failed, 30)
    for axes in all_axes:
        axes.set_anchor('N')  # the panel of the route has no colour bar below it
    caption = _caption(options.file, readings, failures, route)
    _draw_legend(figure, caption, has_route=bool(route), has_failures=bool(failed))
    figure.suptitle(_headline(readings, failures, len(layout.tags)), fontsize=14, fontweight='bold', y=1.04)
    figure.savefig(output, dpi=130, bbox_inches='tight', pad_inches=0.15)
    pyplot.close(figure)


def _draw_ways(axes, layout: Layout, route: list[tuple[float, float]], failed: dict[str, str]) -> None:
    """Draw the way of the robot with its direction, and name the tags that were not read."""
    axes.set_title(' and '.join(['route'] * bool(route) + ['tags not read'] * bool(failed)))
    tags = layout.tags
    others = [tag for tag_id, tag in tags.items() if tag_id not in failed]
    axes.scatter([tag.x for tag in others], [tag.y for tag in others], s=12, color='0.6', zorder=2)
    way = [Box(x, y, GAP_M, GAP_M) for x, y in _steps(route, GAP_M)]
    dots = {tag_id: Box(tag.x, tag.y, DOT_M, DOT_M) for tag_id, tag in tags.items()}
    texts = {tag_id: f'{tag_id} {word}' for tag_id, word in failed.items() if tag_id in tags}
    boxes = {tag_id: dots[tag_id] for tag_id in texts}
    if route:
        _draw_route(axes, route)
        for word, (x, y) in (('start', route[0]), ('end', route[-1])):
            texts[word, 'of the route'], boxes[word, 'of the route'] = word, Box(x, y, DOT_M, DOT_M)
    labels = [(boxes[key], CHARACTER_M * len(text) + GAP_M, LINE_M) for key, text in texts.items()]
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    room = Box((x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0)
    places = place_labels([*dots.values(), *way], labels, room)
    for (key, text), place in zip(texts.items(), places, strict=True):
        _label(axes, place, text, FAILED_COLOUR if key in failed else ROUTE_COLOUR)
    _cross(axes, layout, failed, 60)


def _draw_route(axes, route: list[tuple[float, float]]) -> None:
    """Draw a thin line with arrows, a circle at its start and a square at its end, all of it in view."""
    xs, ys = zip(*route, strict=True)
    axes.plot(xs, ys, color=ROUTE_COLOUR, linewidth=0.8, zorder=1.5)
    steps = list(_steps(route, ARROW_EVERY_M))[1:]  # a circle marks the start
    for (x, y), (to_x, to_y) in itertools.pairwise(steps):
        near = x + (to_x - x) * 0.01, y + (to_y - y) * 0.01
        style = {'arrowstyle': '-|>', 'color': ROUTE_COLOUR, 'linewidth': 0, 'mutation_scale': 11}
        axes.annotate('', near, (x, y), arrowprops=style, zorder=1.6)
    for marker, x, y in (('o', xs[0], ys[0]), ('s', xs[-1], ys[-1])):
        axes.scatter(x, y, s=28, marker=marker, color='white', edgecolor=ROUTE_COLOUR, zorder=2.5)
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    axes.set_xlim(min(x0, min(xs) - GAP_M), max(x1, max(xs) + GAP_M))
    axes.set_ylim(min(y0, min(ys) - GAP_M), max(y1, max(ys) + GAP_M))


def _steps(route: list[tuple[float, float]], length_m: float):
    """Yield points along a route, each as far from the last one."""
    rest = 0.0
    for (x, y), (to_x, to_y) in itertools.pairwise(route):
        leg_m, at = math.dist((x, y), (to_x, to_y)), rest
        while at < leg_m:
            yield x + (to_x - x) * at / leg_m, y + (to_y - y) * at / leg_m
            at += length_m
        rest = at - leg_m


def _draw_readings(figure, axes, sensor: str, layout, readings, colours) -> None:
    measured = {tag_id: each[sensor].value for tag_id, each in readings.items() if sensor in each}
    others = [tag for tag_id, tag in layout.tags.items() if tag_id not in measured]
    axes.set_title(label_of(sensor))
    axes.scatter([tag.x for tag in others], [tag.y for tag in others], s=12, color='0.75', zorder=2)
    points = axes.scatter(
        [layout.tags[tag_id].x for tag_id in measured],
        [layout.tags[tag_id].y for tag_id in measured],
        c=list(measured.values()),
        cmap=COLOURS,
        vmin=colours and colours[0],  # from the config, so that two missions can be compared
        vmax=colours and colours[1],
        s=90,
        edgecolor='black',
        zorder=5,
    )
    dots = {tag_id: Box(tag.x, tag.y, DOT_M, DOT_M) for tag_id, tag in layout.tags.items()}
    texts = [f'{tag_id}: {value_text(sensor, value)}' for tag_id, value in measured.items()]
    labels = [
        (dots[tag_id], CHARACTER_M * len(text) + GAP_M, LINE_M)
        for tag_id, text in zip(measured, texts, strict=True)
    ]
    for place, text in zip(place_labels(list(dots.values()), labels), texts, strict=True):
        _label(axes, place, text, 'black')
    figure.colorbar(points, ax=axes, location='bottom', shrink=0.9, pad=0.02, extend='both')


def _label(axes, place: tuple[float, float], text: str, colour: str) -> None:
    """Write a text on a ground of its own, so that no line crosses it."""
    ground = {'facecolor': 'white', 'edgecolor': 'none', 'pad': 0.6}
    axes.text(*place, text, ha='center', va='center', fontsize=7, color=colour, bbox=ground, zorder=4)


def _cross(axes, layout: Layout, failed: dict[str, str], size: float) -> None:
    tags = [layout.tags[tag_id] for tag_id in failed if tag_id in layout.tags]  # an unknown tag has no place
    xs, ys = [tag.x for tag in tags], [tag.y for tag in tags]
    axes.scatter(xs, ys, marker='x', s=size, color=FAILED_COLOUR, zorder=5)


def _draw_legend(figure, caption: str, *, has_route: bool, has_failures: bool) -> None:
    from matplotlib.lines import Line2D

    def entry(label: str, colour: str, **style) -> Line2D:
        return Line2D([], [], color=colour, label=label, **{'linestyle': '', **style})

    entries = [
        entry('wall', 'black', linestyle='-', linewidth=1.5),
        entry('table', '0.92', marker='s', markersize=11, markeredgecolor='0.55'),
        entry('tag: value', 'tab:green', marker='o', markersize=9, markeredgecolor='black'),
        entry('tag without this sensor', '0.75', marker='o', markersize=4),
    ]
    if has_failures:
        entries.append(entry('tag that was not read', FAILED_COLOUR, marker='x'))
    if has_route:
        entries.append(entry('route, in the direction of the arrows', ROUTE_COLOUR, linestyle='-'))
    # Below the figure, in the words of Matplotlib 3.5: Ubuntu 22.04 has no `ncols` and no `outside`.
    figure.legend(
        handles=entries,
        loc='upper center',
        bbox_to_anchor=(0.5, 0.0),
        ncol=len(entries),
        frameon=False,
        title=caption,
    )


def _headline(readings: dict[str, dict[str, Row]], failures: list[Failures], tag_count: int) -> str:
    rows = [row for each in readings.values() for row in each.values()]
    first, last = (pick(rows, key=lambda row: row.stamp_ns) for pick in (min, max))
    counts = {}
    for each in failures:
        counts[each.word] = counts.get(each.word, 0) + len(each.tag_ids)
    return ' · '.join(
        [
            f'{len(readings)} of {tag_count} tags read',
            *(f'{count} {word}' for word, count in counts.items()),
            f'{_clock(first)} to {_clock(last)}',
            f'greenhouse {clock_time(first.sim_time_of_day_seconds)}'
            f' to {clock_time(last.sim_time_of_day_seconds)}',
        ]
    )


def _clock(row: Row) -> str:
    return time.strftime('%H:%M:%S', time.localtime(row.stamp_ns / 1e9))


def _caption(path: Path, readings: dict[str, dict[str, Row]], failures: list[Failures], route) -> str:
    """Return what the picture shows in one line, and a line for each reason of failures."""
    latest = max(row.stamp_ns for each in readings.values() for row in each.values())
    parts = [escaped(path.name, 64), time.strftime('%d %b %Y, times in %Z', time.localtime(latest / 1e9))]
    if route:
        parts.append(f'the robot drove {sum(map(math.dist, route, route[1:])):.1f} m')
    lines = [' · '.join(parts)]
    for word, reason, tag_ids in failures:
        named = ', '.join(escaped(tag_id, 64) for tag_id in tag_ids[:MOST_NAMED])
        more = f' and {len(tag_ids) - MOST_NAMED} more' if len(tag_ids) > MOST_NAMED else ''
        lines.append(f'{len(tag_ids)} {word}{f" ({reason})" if reason else ""}: {named}{more}')
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
