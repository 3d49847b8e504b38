"""Draw each tag in the colour of its subset of sensors, over one sensor's field: all, or a part."""

import argparse
import itertools
import random
import textwrap
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np
from lupin_greenhouse_bridge import units
from lupin_greenhouse_bridge.display import colours, drawings, placing
from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import natural_order
from lupin_greenhouse_bridge.units import clock_time, label_of
from matplotlib import pyplot
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from simulated import Greenhouse

# Of subsets of sensors, the most frequent first: those of Okabe and Ito, and others that protanopes and
# deuteranopes can tell from them.
SUBSET_COLOURS = (
    *('#e69f00', '#0072b2', '#009e73', '#cc79a7', '#56b4e9', '#f0e442', '#d55e00'),
    *('#8900ff', '#002700', '#b1ffb1', '#4e144e', '#270089', '#89ffff'),
)
OTHER, FIELD_END = '0.5', '0.6'
TABLE = '#b5936b'  # no shade of the field, in either scheme
INKED = ('text.color', 'axes.labelcolor', 'axes.edgecolor', 'xtick.color', 'ytick.color', 'patch.edgecolor')
SCHEMES: dict[str, dict[Any, Any]] = {
    name: dict.fromkeys(INKED, ink) | {'figure.facecolor': paper, 'axes.facecolor': paper}
    for name, ink, paper in (('light', '#1f2328', 'white'), ('dark', '#e6edf3', '#0d1117'))
}
FIELD_STEPS = 100
README_SEED = 42  # whose values the README shows
PART_M, PART_POINTS = 4.0, 16.0  # its size, and that of its texts: 11 px on a phone 328 px wide


def colours_of(subsets: Collection[str]) -> dict[str, str]:
    """Return the colour of each subset, the most frequent first; those beyond the palette share OTHER."""
    ordered = [subset for subset, _ in Counter(subsets).most_common()]
    return dict(itertools.zip_longest(ordered, SUBSET_COLOURS[: len(ordered)], fillvalue=OTHER))


def in_scheme(scheme: str, draw: Callable[..., Figure], *arguments: Any) -> Figure:
    """Return a figure in the light or the dark scheme."""
    pads = dict.fromkeys(('figure.constrained_layout.w_pad', 'figure.constrained_layout.h_pad'), 0.1)
    with pyplot.rc_context(SCHEMES[scheme] | pads):
        return draw(*arguments)


def draw_layout(greenhouse: Greenhouse, options: argparse.Namespace) -> Figure:
    """Return the figure of the tags, coloured by the subset of sensors of each, over one sensor's field."""
    layout, walls, subset_of = greenhouse.layout, greenhouse.walls, greenhouse.subset_of
    width_m, height_m, scale = drawings.scale_of(layout, walls)
    width, height = (size_m * drawings.INCHES_PER_M / scale for size_m in (width_m, height_m))
    figure = pyplot.figure(figsize=(width + 3.0, max(height, 5.0) + 1.8), layout='constrained')
    axes = figure.add_subplot()
    draw_field(axes, greenhouse, options, walls, bands=8)
    axes.set_ylabel('y (m)')
    draw_tags(axes, greenhouse, list(layout.tags), drawings.LABELS.times(scale), 8)
    colour_of = colours_of(subset_of.values())
    counts = Counter(subset_of.values())
    key = {
        f'{each}: {pluralized(counts[each], "tag")}': colour
        for each, colour in colour_of.items()
        if colour != OTHER
    }
    if rest := sum(counts[each] for each, colour in colour_of.items() if colour == OTHER):
        key[f'other subsets: {pluralized(rest, "tag")}'] = OTHER
    letters = '\n'.join(names_of_letters(greenhouse))
    write_key(figure, key, f'{letters}\n\n{len(colour_of)} subsets of sensors')
    title = f'{pluralized(len(layout.tags), "tag")} in the colours of their sensors; tables are brown'
    axes.set_title(title, fontsize=11)
    return figure


def draw_part(greenhouse: Greenhouse, options: argparse.Namespace) -> Figure:
    """Return the figure of a square part for a phone: large texts, and a robot that reads the first tag."""
    walls, tags = greenhouse.walls, greenhouse.layout.tags
    read_id = min(greenhouse.approaches.poses or tags, key=natural_order)
    side_m = min(PART_M, walls.x1 - walls.x0, walls.y1 - walls.y0)
    ends = zip(tags[read_id][:2], walls[:2], walls[2:], strict=True)
    x, y = (min(max(at - side_m / 2, low), high - side_m) for at, low, high in ends)
    part = Walls(x, y, x + side_m, y + side_m)
    pyplot.rcParams['font.size'] = pyplot.rcParams['figure.titlesize'] = PART_POINTS  # until the scheme ends
    figure = pyplot.figure(figsize=(6.4, 8.2), layout='constrained')
    axes = figure.add_subplot()
    draw_field(axes, greenhouse, options, part, bands=4)
    axes.set(xlim=part[::2], ylim=part[1::2], xticks=[], yticks=[], xlabel='')
    size = drawings.LABELS.times(2 * drawings.INCHES_PER_M * side_m / 6.0)
    seen = [tag_id for tag_id, tag in tags.items() if part.has_inside(*tag[:2])]
    taken = draw_reading(axes, greenhouse, read_id, options.hour, size)
    draw_tags(axes, greenhouse, seen, size, PART_POINTS, taken)
    letters = textwrap.fill(', '.join(names_of_letters(greenhouse)), 34)
    figure.supxlabel(letters, fontsize=PART_POINTS)
    figure.suptitle(f'A robot asks for the climate at tag {read_id}')
    return figure


def draw_reading(
    axes: Any, greenhouse: Greenhouse, tag_id: str, hour: float, size: drawings.LabelSize
) -> list[placing.Box]:
    """Draw the robot at its pose with the values of the tag, if it has a pose; return what is covered."""
    tags, found = greenhouse.layout.tags, greenhouse.approaches
    if tag_id not in found.poses:
        return []
    pose, tag, radius_m = found.poses[tag_id], tags[tag_id], found.free_space.robot_radius_m
    drawings.draw_robot(axes, pose, radius_m)
    robot = placing.Box(*pose[:2], 2 * radius_m, 2 * radius_m)
    sight = pose[:2], tag[:2]
    ray = {'color': pyplot.rcParams['text.color'], 'linestyle': drawings.DASHED, 'zorder': 1.9}
    axes.plot(*zip(*sight, strict=True), **ray)
    random.seed(README_SEED)
    values = {name: greenhouse.value(name, tag[:2], hour, is_noisy=True) for name in tag.sensors}
    lines = [f'{units.value_text(name, value)} {units.unit_of(name)}' for name, value in values.items()]
    width_m, height_m = size.height_m / 2 + max(map(size.width_m, lines)), size.height_m * (len(lines) + 0.5)
    dots = [placing.Box(*each[:2], size.height_m, size.height_m) for each in tags.values()]
    tables = [placing.box_of(Walls(*each)) for each in greenhouse.layout.tables.values()]
    step_m = size.height_m / 2
    drawn = [robot, *(placing.Box(x, y, step_m, step_m) for x, y, _ in placing.steps_of(sight, step_m))]
    labels = [(robot, width_m, height_m), (robot, size.width_m('robot'), size.height_m)]
    place, name_place = placing.place_labels([*dots, *tables, *drawn], labels, view_of(axes))
    frame = {'boxstyle': 'round,pad=0.3', 'facecolor': colours.ROUTE, 'edgecolor': 'none'}
    style = {'color': 'white', 'weight': 'bold', 'bbox': frame, 'zorder': 6, **drawings.CENTRED}
    axes.text(*place, '\n'.join(lines), **style)
    axes.text(*name_place, 'robot', weight='bold', zorder=4, **drawings.CENTRED)
    return [*drawn, placing.Box(*place, width_m, height_m), placing.Box(*name_place, *labels[1][1:])]


def draw_field(
    axes: Any, greenhouse: Greenhouse, options: argparse.Namespace, part: Walls, bands: int
) -> None:
    """Draw the tables, the walls, and the values of a sensor in shades of grey with their scale."""
    paper, ink = axes.get_facecolor(), pyplot.rcParams['text.color']
    xs, ys = (np.linspace(*ends, FIELD_STEPS) for ends in (part[::2], part[1::2]))
    field = [[greenhouse.value(options.sensor, (x, y), options.hour) for x in xs] for y in ys]
    shades = LinearSegmentedColormap.from_list('shades', [paper, FIELD_END])
    field_bands = axes.contourf(xs, ys, field, bands, cmap=shades)
    table = {'facecolor': TABLE, 'edgecolor': ink, 'linewidth': 0.6}
    drawings.draw_greenhouse(axes, greenhouse.layout, greenhouse.walls, table)
    label = f'{label_of(options.sensor)} at {clock_time(options.hour * 3600)}'
    axes.figure.colorbar(field_bands, ax=axes, location='bottom', label=label, shrink=0.9, pad=0.02)


def draw_tags(
    axes: Any,
    greenhouse: Greenhouse,
    tag_ids: list[str],
    size: drawings.LabelSize,
    points: float,
    taken: Sequence[placing.Box] = (),
) -> None:
    """Draw each tag in the colour of its subset, with its id and its letters beside it."""
    ink = pyplot.rcParams['text.color']
    colour_of = colours_of(greenhouse.subset_of.values())
    labels = []
    for tag_id in tag_ids:
        x, y, _ = greenhouse.layout.tags[tag_id]
        subset = greenhouse.subset_of[tag_id]
        axes.plot(x, y, 'o', color=colour_of[subset], markeredgecolor=ink, markersize=1.3 * points, zorder=5)
        labels.append((f'{tag_id} {subset}', placing.Box(x, y, size.height_m, size.height_m), ink))
    box = {'boxstyle': 'round,pad=0.1', 'facecolor': axes.get_facecolor(), 'edgecolor': 'none', 'alpha': 0.8}
    taken = [*taken, *(dot for _, dot, _ in labels)]
    style = {'weight': 'bold', 'bbox': box, 'fontsize': points, 'zorder': 4}
    drawings.write_labels(axes, labels, size, taken, view_of(axes), **style)


def view_of(axes: Any) -> placing.Box:
    """Return the rectangle that the axes show."""
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    return placing.box_of(Walls(x0, y0, x1, y1))


def names_of_letters(greenhouse: Greenhouse) -> list[str]:
    """Return the meaning of each letter, such as `T temperature`."""
    return [f'{letter} {name.replace("_", " ")}' for name, letter in greenhouse.letters.items()]


def write_key(figure: Figure, key: dict[str, str], title: str) -> None:
    """Write the texts of a key beside dots of these colours, at the right."""
    ink = pyplot.rcParams['text.color']
    styles = [drawings.point_style('o', colour, 10, markeredgecolor=ink) for colour in key.values()]
    handles = [Line2D([], [], label=text, **style) for text, style in zip(key, styles, strict=True)]
    place: dict[str, Any] = {'loc': 'outside right upper', 'alignment': 'left'}
    figure.legend(handles=handles, title=title, frameon=False, handletextpad=0.2, **place)
