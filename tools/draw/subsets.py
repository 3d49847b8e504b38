"""Draw each tag in the colours of its subset of sensors, over one sensor's field: all, or a part."""

import argparse
import itertools
import math
import random
from collections.abc import Callable
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from lupin_greenhouse_bridge import units
from lupin_greenhouse_bridge.display import drawings, placing
from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import natural_order
from lupin_greenhouse_bridge.units import clock_time
from matplotlib import pyplot
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Wedge
from simulated import Greenhouse

# Of the sensors in the order of the key. Protanopes and deuteranopes can tell them apart too.
SENSOR_COLOURS = '#d55e00', '#3c69b4', '#a52dff', '#f0e442', '#009e73'
OTHER = '0.5'  # of any more sensors
INKED = ('text.color', 'axes.labelcolor', 'axes.edgecolor', 'xtick.color', 'ytick.color', 'patch.edgecolor')
SCHEMES: dict[str, dict[Any, Any]] = {
    name: dict.fromkeys(INKED, ink) | {'figure.facecolor': paper, 'axes.facecolor': paper}
    for name, ink, paper in (('light', '#1f2328', 'white'), ('dark', '#e6edf3', '#0d1117'))
}
# By the paper: the other end of the field's shades, and the tables without such a shade.
FIELD_END = {'white': '0.7', '#0d1117': '0.44'}
TABLE = {'white': '#b5936b', '#0d1117': '#a28157'}
LINES, NEAR_END = 3, 0.12  # of equal values, at most about; and where the bar has no room for their numbers
SHORTEST_LINE_M = 0.3
FIELD_CELLS = 80_000  # where two components meet, a coarser field has frayed lines
README_SEED = 42  # whose values the README shows
PART_M, PART_POINTS = 2.5, 16.0  # its size, and that of its texts: 11 px on a phone 328 px wide
TITLE_PAD, LAYOUT_POINTS, CHARACTER_M = 56.0, 12.5, 0.083  # above the axes of all tags, and of its texts
TAG_AT = 0.3, 0.5  # the place in the part of the tag that is read, as shares of its sides
Field: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]  # x, y and the values, row by row


def colours_of(greenhouse: Greenhouse) -> dict[str, str]:
    """Return the colour of the letter of each sensor."""
    return dict(itertools.zip_longest(greenhouse.letters.values(), SENSOR_COLOURS, fillvalue=OTHER))


def in_style(scheme: str, points: float, draw: Callable[..., Figure], *arguments: Any) -> Figure:
    """Return a figure in the light or the dark scheme with texts of this size."""
    pads = dict.fromkeys(('figure.constrained_layout.w_pad', 'figure.constrained_layout.h_pad'), 0.1)
    sizes = dict.fromkeys(('font.size', 'axes.titlesize', 'figure.titlesize'), points)
    with pyplot.rc_context({'figure.dpi': 220} | SCHEMES[scheme] | pads | sizes):
        return draw(*arguments)


def draw_layout(greenhouse: Greenhouse, options: argparse.Namespace) -> Figure:
    """Return the figure of the tags, coloured by the subset of sensors of each, over one sensor's field."""
    layout, walls = greenhouse.layout, greenhouse.walls
    width_m, height_m, scale = drawings.scale_of(layout, walls)
    width, height = (size_m * drawings.INCHES_PER_M / scale for size_m in (width_m, height_m))
    figure, axes = pyplot.subplots(figsize=(max(width, 4.3) + 0.8, height + 2.75), layout='constrained')
    size = drawings.LABELS._replace(character_m=CHARACTER_M).times(scale * LAYOUT_POINTS / drawings.POINTS)
    taken = draw_field(axes, greenhouse, options, walls, size, [])
    axes.set(xlabel='x (m)', ylabel='y (m)')
    draw_tags(axes, greenhouse, list(layout.tags), size, taken)
    write_key(axes, greenhouse, 3, borderaxespad=3.6)  # below the label of the x axis
    title = f'{pluralized(len(layout.tags), "tag")}, each in the colours of its sensors'
    axes.set_title(title, weight='bold', pad=TITLE_PAD)
    low, high = axes.images[0].get_clim()
    (lines,) = (each for each in axes.get_children() if isinstance(each, ContourSet))
    inner = [each for each in lines.levels if min(each - low, high - each) > NEAR_END * (high - low)]
    ends = sorted({low, high})  # one, if the field has one value
    bar = drawings.draw_colour_bar(axes, axes.images[0], walls)
    texts = [*(units.value_text(options.sensor, each) for each in ends), *(f'{each:g}' for each in inner)]
    bar.set_ticks([*ends, *inner], labels=texts)
    bar.ax.set_title(f'{name_at(options)} ({units.unit_of(options.sensor)})', pad=6)
    return figure


def draw_part(greenhouse: Greenhouse, options: argparse.Namespace) -> Figure:
    """Return the figure of a square part for a phone: large texts, and a robot that reads the first tag."""
    walls, tags = greenhouse.walls, greenhouse.layout.tags
    read_id = min(greenhouse.approaches.poses or tags, key=natural_order)
    side_m = min(PART_M, walls.x1 - walls.x0, walls.y1 - walls.y0)
    ends = zip(tags[read_id][:2], TAG_AT, walls[:2], walls[2:], strict=True)
    x, y = (min(max(at - share * side_m, low), high - side_m) for at, share, low, high in ends)
    part = Walls(x, y, x + side_m, y + side_m)
    figure, axes = pyplot.subplots(figsize=(6.4, 8.6), layout='constrained')
    size = drawings.LABELS.times(PART_POINTS / drawings.POINTS * drawings.INCHES_PER_M * side_m / 6.0)
    seen = [tag_id for tag_id, tag in tags.items() if part.has_inside(*tag[:2])]
    taken = draw_reading(axes, greenhouse, read_id, options.hour, size, placing.box_of(part))
    taken.append(draw_metre(axes, part, field_of(greenhouse, options.sensor, options.hour, part), size))
    taken = draw_field(axes, greenhouse, options, part, size, taken)
    axes.set(xlim=part[::2], ylim=part[1::2], xticks=[], yticks=[], xlabel='')
    axes.spines[:].set(visible=True, linewidth=144 / figure.dpi)
    draw_tags(axes, greenhouse, seen, size, [*taken, *greenhouse.tables])
    write_key(figure, greenhouse, 2, loc='outside lower center', bbox_to_anchor=None)
    figure.suptitle(f'A robot reads tag {read_id} in the simulator', weight='bold')
    shade = 'darker' if axes.get_facecolor()[:3] == (1.0, 1.0, 1.0) else 'lighter'
    more = 'warmer' if options.sensor == 'temperature' else 'higher'
    shown = 'Part of the' if side_m < max(walls.x1 - walls.x0, walls.y1 - walls.y0) else 'The'
    shades = f'Shades: {name_at(options)}, {shade} = {more}'
    axes.set_title(f'{shown} greenhouse, tags in sensor colours\n{shades}')
    return figure


def name_at(options: argparse.Namespace) -> str:
    """Return the name of the field's sensor and its time."""
    return f'{units.name_of(options.sensor)} at {clock_time(options.hour * 3600)}'


def draw_metre(axes: Any, part: Walls, field: Field, size: drawings.LabelSize) -> placing.Box:
    """Draw a bar of 1 m at the lower edge, where the field changes least; return what it covers."""
    y, margin_m = part.y0 + size.height_m / 2, min(size.height_m, part.x1 - part.x0 - 1.0) / 2
    starts = np.linspace(part.x0 + margin_m, part.x1 - margin_m - 1.0, 50)
    xs, _, values = field
    x = min(starts, key=lambda start: np.ptp(values[0, (start <= xs) & (xs <= start + 1.0)]))
    axes.plot([x, x + 1.0], [y, y], color=pyplot.rcParams['text.color'], linewidth=3, zorder=4)
    axes.text(x + 0.5, y + 0.7 * size.height_m, '1 m', zorder=4, **drawings.CENTRED)
    return placing.Box(x + 0.5, y + size.height_m / 2, 1.0, 1.5 * size.height_m)


def draw_reading(
    axes: Any, greenhouse: Greenhouse, tag_id: str, hour: float, size: drawings.LabelSize, bounds: placing.Box
) -> list[placing.Box]:
    """Draw the robot at its pose with the values of the tag, if it has a pose; return what is covered."""
    tags, found = greenhouse.layout.tags, greenhouse.approaches
    if tag_id not in found.poses:
        return []
    pose, tag, radius_m = found.poses[tag_id], tags[tag_id], found.free_space.robot_radius_m
    ink, paper = pyplot.rcParams['text.color'], pyplot.rcParams['axes.facecolor']
    ray = {'color': ink, 'linewidth': 3.5, 'zorder': 2.2}
    axes.add_patch(Circle(pose[:2], radius_m, facecolor=paper, edgecolor=ink, linewidth=3, zorder=1.7))
    robot = placing.Box(*pose[:2], 2 * radius_m, 2 * radius_m)
    sight, rim = (pose[:2], tag[:2]), drawings.ahead_of(pose, radius_m)
    axes.plot(*zip(pose[:2], rim, strict=True), **ray)
    drawings.draw_head(axes, pose[:2], rim, radius_m, ink)
    axes.plot(*zip(rim, tag[:2], strict=True), linestyle=(0, (2, 0.6)), **ray)
    random.seed(README_SEED)
    lines = [f'tag {tag_id}:']
    for name in tag.sensors:
        value = greenhouse.value(name, tag[:2], hour, is_noisy=True)
        lines.append(f'{units.name_of(name)} {units.value_text(name, value)} {units.unit_of(name)}')
    width_m, height_m = max(map(size.width_m, lines)), size.height_m * (len(lines) + 0.5)
    dots = [placing.Box(*each[:2], size.height_m, size.height_m) for each in tags.values()]
    step_m = size.height_m / 2
    drawn = [robot, *(placing.Box(x, y, step_m, step_m) for x, y, _ in placing.steps_of(sight, step_m))]
    around = placing.Box(*pose[:2], robot.width + step_m, robot.height + step_m)  # room for the tail
    labels = [(around, width_m, height_m), (robot, size.width_m('robot'), size.height_m)]
    place, name_place = placing.place_labels([*dots, *greenhouse.tables, *drawn], labels, bounds)
    frame = {'boxstyle': 'round,pad=0.65', 'mutation_aspect': 0.5, 'facecolor': ink, 'edgecolor': 'none'}
    style = {'color': paper, 'weight': 'bold', 'bbox': frame, 'zorder': 6, **drawings.CENTRED}
    # It begins below the text and not at the frame, where a seam would be seen.
    tail = {'arrowstyle': 'wedge,tail_width=2.5', 'color': ink, 'linewidth': 0, 'patchA': None, 'shrinkB': 0}
    share = radius_m / math.dist(pose[:2], place)
    edge = [at + share * (to - at) for at, to in zip(pose[:2], place, strict=True)]
    axes.annotate('\n'.join(lines), edge, place, arrowprops=tail, **style)
    axes.text(*name_place, 'robot', weight='bold', zorder=4, bbox=plate_of(axes), **drawings.CENTRED)
    return [around, *drawn, placing.Box(*place, width_m, height_m), placing.Box(*name_place, *labels[1][1:])]


def plate_of(axes: Any) -> drawings.Style:
    """Return the style of the plate under a label."""
    return {'boxstyle': 'round,pad=0.1', 'facecolor': axes.get_facecolor(), 'edgecolor': 'none'}


def draw_field(
    axes: Any,
    greenhouse: Greenhouse,
    options: argparse.Namespace,
    part: Walls,
    size: drawings.LabelSize,
    taken: list[placing.Box],
) -> list[placing.Box]:
    """Draw the tables, the walls, and the values of a sensor in greys with lines; return what is covered."""
    paper, ink = pyplot.rcParams['axes.facecolor'], pyplot.rcParams['text.color']
    xs, ys, field = field_of(greenhouse, options.sensor, options.hour, part)
    shades = LinearSegmentedColormap.from_list('shades', [paper, FIELD_END[paper]])
    extent = (*part[::2], *part[1::2])
    axes.imshow(field, shades, extent=extent, origin='lower', interpolation='bilinear')
    lines = axes.contour(xs, ys, field, LINES, colors='none')
    for path in itertools.chain(*lines.allsegs):
        if placing.length_m(path.tolist()) >= SHORTEST_LINE_M:
            axes.plot(*path.T, color=ink, linewidth=0.6, alpha=0.6, zorder=0.5)
    table = {'facecolor': TABLE[paper], 'edgecolor': ink, 'linewidth': 0.6}
    drawings.draw_greenhouse(axes, greenhouse.layout, greenhouse.walls, table)
    dots = [placing.Box(*tag[:2], size.height_m, size.height_m) for tag in greenhouse.layout.tags.values()]
    around = [dot._replace(width=5 * dot.width, height=3 * dot.height) for dot in dots]
    covered = [*taken, *around, *greenhouse.tables]
    values = write_values(axes, lines, part, units.unit_of(options.sensor), size, covered)
    return [*taken, *dots, *values]


def write_values(
    axes: Any, lines: ContourSet, part: Walls, unit: str, size: drawings.LabelSize, taken: list[placing.Box]
) -> list[placing.Box]:
    """Write its value on each line of equal values, far right where nothing is; return their boxes."""
    covered = list(taken)
    for level, paths in zip(lines.levels, lines.allsegs, strict=True):
        text = f'{level:g} {unit}'
        half = np.array(label := size.box(text)) / 2
        for path in (each for each in paths if placing.length_m(each.tolist()) > label[0]):
            places = np.clip(path, part[:2] + half, part[2:] - half)
            boxes = np.column_stack([places, np.tile(label, (len(places), 1))])
            shares = placing.overlaps(boxes, np.array(covered)).sum(axis=1) / np.prod(label)
            moved_m = np.abs(places - path).sum(axis=1)
            lengths = (np.abs(path[:, None] - places) < half).all(axis=2).sum(axis=0)
            hides_bend = lengths > 1.5 * np.quantile(lengths, 0.25)
            order = np.lexsort((-places[:, 0], moved_m.round(2), hides_bend, shares.round(2)))
            best = placing.Box(*boxes[order[0]])
            axes.text(*best[:2], text, zorder=4, bbox=plate_of(axes), **drawings.CENTRED)
            covered.append(best)
    return covered[len(taken) :]


@cache
def field_of(greenhouse: Greenhouse, sensor: str, hour: float, part: Walls) -> Field:
    """Return x, y and the values of a sensor, row by row."""
    step_m = math.sqrt((part.x1 - part.x0) * (part.y1 - part.y0) / FIELD_CELLS)
    xs, ys = (np.linspace(*ends, round(np.ptp(ends) / step_m) + 2) for ends in (part[::2], part[1::2]))
    return xs, ys, np.array([[greenhouse.value(sensor, (x, y), hour) for x in xs] for y in ys])


def draw_tags(
    axes: Any, greenhouse: Greenhouse, tag_ids: list[str], size: drawings.LabelSize, taken: list[placing.Box]
) -> None:
    """Draw each tag as a disc with a sector in the colour of each sensor, its id and letters beside it."""
    ink, points, colours = pyplot.rcParams['text.color'], pyplot.rcParams['font.size'], colours_of(greenhouse)
    labels = []
    for tag_id in sorted(tag_ids, key=lambda each: greenhouse.layout.tags[each].y):
        (x, y, _), subset = greenhouse.layout.tags[tag_id], greenhouse.subset_of[tag_id]
        for number, letter in enumerate(subset):
            ends = (-90 - 360 * (number + after) / len(subset) for after in (1, 0))  # clockwise
            style = {'facecolor': colours[letter], 'edgecolor': ink, 'linewidth': points / 8, 'zorder': 5}
            axes.add_patch(Wedge((x, y), 0.46 * size.height_m, *ends, **style))
        labels.append((f'{tag_id}: {"".join(subset)}', placing.Box(x, y, size.height_m, size.height_m), ink))
    style = {'weight': 'bold', 'bbox': plate_of(axes), 'fontsize': points, 'zorder': 4}
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    bounds = placing.box_of(Walls(x0, y0, x1, y1))
    drawings.write_labels(axes, labels, size, taken, bounds, greenhouse.tables, **style)


def write_key(owner: Any, greenhouse: Greenhouse, columns: int, **place: Any) -> None:
    """Write below the colour, the letter and the name of each sensor."""
    size, edge = 1.2 * pyplot.rcParams['font.size'], {'markeredgecolor': pyplot.rcParams['text.color']}
    colours = colours_of(greenhouse)
    marks = [
        (f'{letter} {units.name_of(name)}', drawings.point_style('o', colours[letter], size, **edge))
        for name, letter in greenhouse.letters.items()
    ]
    marks.append(('table', drawings.point_style('s', TABLE[pyplot.rcParams['axes.facecolor']], size, **edge)))
    style = {'columnspacing': 1.0, 'handlelength': 1.5, 'handletextpad': 0.2}
    drawings.write_key(owner, marks, columns, **style, **place)
