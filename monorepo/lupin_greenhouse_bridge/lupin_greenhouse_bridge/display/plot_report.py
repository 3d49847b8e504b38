# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""`ros2 run lupin_greenhouse_bridge plot_report FILE`: draw the last readings of a file."""

import argparse
import math
import sys
import time
from pathlib import Path

from lupin_greenhouse_bridge.display.drawing_command import (
    draw_file,
    layout_of,
    parser_of,
    read_colour_ranges,
    read_route,
)
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.drawing import COLOURS, Box, draw_greenhouse, place_labels
from lupin_greenhouse_bridge.planning.walls import find_walls
from lupin_greenhouse_bridge.recording.reading_files import read_file
from lupin_greenhouse_bridge.recording.rows import Row, last_of_each_tag
from lupin_greenhouse_bridge.simulator.layout import natural_order
from lupin_greenhouse_bridge.units import clock_time, label_of, sensor_order

# Sizes in the picture, where a metre is about 0.6 inch: a dot, and a character of a label.
DOT_M, CHARACTER_M, LINE_M, GAP_M = 0.24, 0.095, 0.19, 0.1


def main(arguments: list[str] | None = None) -> int:
    """Write the picture beside the report, or to --output; return the exit code."""
    parser = parser_of('plot_report', 'Draw readings into the greenhouse.')
    parser.add_argument(
        '--output', type=Path, metavar='FILE', help='picture to write, also .svg or .pdf; default: FILE.png'
    )
    return draw_file(parser, arguments, '.png', 'sudo apt install python3-matplotlib', _draw)


def _draw(options: argparse.Namespace, output: Path) -> None:
    import matplotlib  # imported late: a missing library is a one-line error

    matplotlib.use('Agg')
    from matplotlib import pyplot

    rows, visits = read_file(options.file, options.tag_file)
    layout = layout_of(rows, options.tag_file)
    walls = find_walls(layout, options.sim_config_file, options.walls)
    colour_ranges = read_colour_ranges(options.sim_config_file)
    route = read_route(options.route) if options.route else []
    outcomes = {visit.tag_id: visit.outcome for visit in visits}  # the last one of each tag
    failed = {tag_id for tag_id, outcome in outcomes.items() if outcome != 'OK'}
    readings = {tag_id: each for tag_id, each in last_of_each_tag(rows).items() if tag_id not in failed}
    if strangers := sorted(set(readings) - set(layout.tags), key=natural_order):
        raise StartUpError(
            f"'{options.file}': tag '{escaped(strangers[0], 64)}' has no position in the tag file:"
            " name the bridge's own with --tag-file"
        )
    sensors = sorted({name for values in readings.values() for name in values}, key=sensor_order)
    if not sensors:
        raise StartUpError(f"'{options.file}': no tag was read, so there is nothing to draw")

    figure, all_axes = pyplot.subplots(
        1, len(sensors), sharey=True, squeeze=False, layout='constrained', figsize=(2.9 * len(sensors), 6.6)
    )
    for axes, sensor in zip(all_axes[0], sensors, strict=True):
        draw_greenhouse(axes, layout, walls)
        if route:
            _draw_route(axes, route)
        _draw_readings(figure, axes, sensor, layout, readings, colour_ranges.get(sensor))
        _draw_failures(axes, layout, failed)
        axes.set_title(label_of(sensor))
    all_axes[0][0].set_ylabel('y (m)')
    figure.suptitle(_headline(readings, len(failed), len(layout.tags), route))
    figure.savefig(output, dpi=130)
    pyplot.close(figure)


def _draw_route(axes, route: list[tuple[float, float]]) -> None:
    """Draw the path of the robot, with all of it in view."""
    xs, ys = zip(*route, strict=True)
    axes.plot(xs, ys, color='tab:blue', linewidth=1.0, zorder=1.5)
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    axes.set_xlim(min(x0, min(xs) - GAP_M), max(x1, max(xs) + GAP_M))
    axes.set_ylim(min(y0, min(ys) - GAP_M), max(y1, max(ys) + GAP_M))


def _draw_readings(figure, axes, sensor: str, layout, readings, colours) -> None:
    measured = {tag_id: each[sensor].value for tag_id, each in readings.items() if sensor in each}
    others = [tag for tag_id, tag in layout.tags.items() if tag_id not in measured]
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
        zorder=3,
    )
    dots = {tag_id: Box(tag.x, tag.y, DOT_M, DOT_M) for tag_id, tag in layout.tags.items()}
    texts = [f'{tag_id}: {value:.3g}' for tag_id, value in measured.items()]
    labels = [
        (dots[tag_id], CHARACTER_M * len(text) + GAP_M, LINE_M)
        for tag_id, text in zip(measured, texts, strict=True)
    ]
    for place, text in zip(place_labels(list(dots.values()), labels), texts, strict=True):
        axes.text(*place, text, ha='center', va='center', fontsize=7, zorder=4)
    figure.colorbar(points, ax=axes, location='bottom', shrink=0.9, pad=0.02, extend='both')


def _draw_failures(axes, layout, failed: set[str]) -> None:
    tags = [layout.tags[tag_id] for tag_id in failed if tag_id in layout.tags]  # an unknown tag has no place
    axes.scatter([tag.x for tag in tags], [tag.y for tag in tags], marker='x', s=60, color='red', zorder=5)


def _headline(readings: dict[str, dict[str, Row]], failed_count: int, tag_count: int, route) -> str:
    rows = [row for each in readings.values() for row in each.values()]
    first, last = (time.localtime(pick(row.stamp_ns for row in rows) / 1e9) for pick in (min, max))
    hours = [row.sim_time_of_day_seconds for row in rows]
    failed = f', {failed_count} failed (x)' if failed_count else ''
    driven = f'; the robot drove {sum(map(math.dist, route, route[1:])):.1f} m' if route else ''
    return (
        f'{len(readings)} of {tag_count} tags read{failed}{driven}\n'
        f'{time.strftime("%Y-%m-%d %H:%M:%S", first)} to {time.strftime("%H:%M:%S", last)};'
        f' greenhouse time of day {clock_time(min(hours))} to {clock_time(max(hours))}'
    )


if __name__ == '__main__':
    sys.exit(main())
