"""
Draw the simulated greenhouse: its layout over one sensor's field, a day at a tag, and a robot's route.

    make figure                      the shipped greenhouse, into the documents of both trees
    make figure ARGS=--check         checks that those are up to date
    make figure ARGS="--output /tmp --tag-file tags.json --sensor co2 --hour 6 --tag 21"

Each figure is a PNG. Its metadata names what it was drawn from: the simulator's two files, the options, the
route and the code that draws. --check compares these and not the pixels, which differ a little with each
release of matplotlib.
"""

import argparse
import hashlib
import io
import itertools
import random
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib
import numpy as np
from greenhouse_sim.simulator import GreenhouseSimulator
from lupin_greenhouse_bridge import units
from lupin_greenhouse_bridge.display import colours, drawings, placing
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, pluralized
from lupin_greenhouse_bridge.planning.approach import find_approaches
from lupin_greenhouse_bridge.planning.route import plan_route
from lupin_greenhouse_bridge.planning.viewpoints import ViewingLimits
from lupin_greenhouse_bridge.planning.walls import Walls, find_walls
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator.layout import natural_order, require_layout, shipped_file
from lupin_greenhouse_bridge.simulator.simulation import load
from lupin_greenhouse_bridge.units import clock_time, label_of
from matplotlib import pyplot
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image, PngImagePlugin

COMMITTED = Path(__file__).resolve().parents[1] / 'core/lupin_greenhouse_bridge/doc'
# Of subsets of sensors, the most frequent first: those of Okabe and Ito, and others that protanopes and
# deuteranopes can tell from them.
SUBSET_COLOURS = (
    *('#e69f00', '#0072b2', '#009e73', '#cc79a7', '#56b4e9', '#f0e442', '#d55e00'),
    *('#8900ff', '#002700', '#b1ffb1', '#4e144e', '#270089', '#89ffff'),
)
OTHER, FIELD_END = '0.5', '0.6'
INKED = ('text.color', 'axes.labelcolor', 'axes.edgecolor', 'xtick.color', 'ytick.color', 'patch.edgecolor')
SCHEMES: dict[str, dict[Any, Any]] = {
    name: dict.fromkeys(INKED, ink) | {'figure.facecolor': paper, 'axes.facecolor': paper}
    for name, ink, paper in (('light', '#1f2328', 'white'), ('dark', '#e6edf3', '#0d1117'))
}
FIELD_STEPS = 100
PART_M, PART_POINTS = 4.0, 16.0  # its size, and that of its texts: 11 px on a phone 328 px wide
BAND_COLOUR = '#c9d8ea'
SAMPLES = 300  # of the noise, at each time of the day
Picture: TypeAlias = tuple[str, Callable[[], Any]]  # fingerprint of its data; what draws a Figure or an Image


def draw_or_check(name: str, pictures: dict[Path, Picture], *, is_check: bool) -> int:
    """Write pictures with their fingerprints, or compare these with the files'; return the exit code."""
    stale = 0
    for path, (fingerprint, draw) in pictures.items():
        if not is_check:
            save(draw(), path, fingerprint)
            print(path)
        elif fingerprint_of(path) != fingerprint:
            print(f'{name}: {path} is not up to date: make figure')
            stale = 1
    return stale


def save(drawing: Any, path: Path, fingerprint: str) -> None:
    """Write a Figure or an Image as PNG with its fingerprint; a palette makes the file of a figure small."""
    if isinstance(drawing, Figure):
        picture = io.BytesIO()
        drawing.savefig(picture, dpi=110)
        pyplot.close(drawing)
        drawing = Image.open(picture).convert('RGB').quantize(256, Image.Quantize.MAXCOVERAGE)
    metadata = PngImagePlugin.PngInfo()
    metadata.add_text('Description', fingerprint)
    drawing.save(path, pnginfo=metadata)


def fingerprint_of(path: Path) -> str:
    """Return the fingerprint in a committed picture; '' if it has none or is missing."""
    if not path.exists():
        return ''
    with Image.open(path) as image:
        return str(image.info.get('Description', ''))


def hash_of(*contents: bytes) -> str:
    """Return the fingerprint of what a picture is drawn from."""
    return hashlib.sha256(b'\0'.join(contents)).hexdigest()


def parser_of(name: str, document: str | None) -> argparse.ArgumentParser:
    """Return a parser with the first line of a module's docstring, and the option --check."""
    parser = argparse.ArgumentParser(prog=name, description=(document or '').strip().splitlines()[0])
    parser.add_argument('--check', action='store_true', help='compare the committed pictures; draw nothing')
    return parser


class Greenhouse:
    """The simulator with a settable clock and noise, its layout, and the route of a robot of default size."""

    def __init__(self, tag_file: str, sim_config_file: str):
        """Validate the files like the bridge; raises StartUpError. '' selects the shipped file."""
        self.files = [
            Path(given or shipped_file(name) or name)
            for given, name in ((tag_file, 'tag_locations.json'), (sim_config_file, 'greenhouse_config.yaml'))
        ]
        load(Settings(), *self.files)
        self.layout = require_layout(tag_file)
        self.walls = find_walls(self.layout, sim_config_file)
        self.approaches = find_approaches(self.layout, self.walls, ViewingLimits())
        self.route = plan_route(self.approaches.free_space, self.approaches.poses, None, 'shortest')
        self._noisy, self._silent = (GreenhouseSimulator(*self.files) for _ in range(2))
        for components in self._silent.sim_config['sensors'].values():
            for component in components:
                component['noise_sigma'] = 0.0
        self.sensors: list[str] = sorted(self._noisy.sensors(), key=units.sensor_order)
        self.letters = letters_of(self.sensors)
        self.subset_of = {
            tag_id: ''.join(letter for name, letter in self.letters.items() if name in tag.sensors)
            for tag_id, tag in self.layout.tags.items()
        }

    def value(self, sensor: str, position_m: placing.Point, hour: float, *, is_noisy: bool = False) -> float:
        """Return the value of a sensor at a position, in its unit."""
        simulator = self._noisy if is_noisy else self._silent
        return float(simulator.sensor_registry.get_sensor(sensor).retrieve_data(position_m, hour * 3600.0))

    def fingerprint(self, options: argparse.Namespace) -> str:
        """Return a hash of everything that a figure is drawn from."""
        code = [
            Path(str(each.__file__)) for each in (sys.modules[__name__], colours, drawings, placing, units)
        ]
        route = ' '.join(f'{x:.2f},{y:.2f}' for x, y in self.route.points_m)
        choices = f'{options.sensor} {options.hour} {options.tag} {self.walls} {route}'
        return hash_of(*(path.read_bytes() for path in [*self.files, *code]), choices.encode())


def letters_of(sensors: list[str]) -> dict[str, str]:
    """Return for each sensor the shortest start of its name that no other name has, such as T."""
    starts = {each: [each[:length].capitalize() for length in range(1, len(each) + 1)] for each in sensors}
    shared = Counter(itertools.chain.from_iterable(starts.values()))
    return {each: next((text for text in starts[each] if shared[text] == 1), each) for each in sensors}


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
    write_key(figure, key, title=f'{len(colour_of)} subsets of sensors', loc='outside right upper')
    names = [f'{letter}  {name.replace("_", " ")}' for name, letter in greenhouse.letters.items()]
    place: dict[str, Any] = {'loc': 'outside right lower', 'frameon': False, 'handlelength': 0.0}
    figure.legend([Line2D([], [])] * len(names), names, title='sensors', **place)
    title = f'{pluralized(len(layout.tags), "tag")} in the colours of their sensors; tables are outlined'
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
    figure = pyplot.figure(figsize=(6.4, 8.8), layout='constrained')
    axes = figure.add_subplot()
    draw_field(axes, greenhouse, options, part, bands=4)
    axes.set(xlim=part[::2], ylim=part[1::2], xticks=[], yticks=[], xlabel='')
    size = drawings.LABELS.times(2 * drawings.INCHES_PER_M * side_m / 6.0)
    seen = [tag_id for tag_id, tag in tags.items() if part.has_inside(*tag[:2])]
    taken = draw_reading(axes, greenhouse, read_id, options.hour, size)
    draw_tags(axes, greenhouse, seen, size, PART_POINTS, taken)
    names = '  '.join(f'{letter} {name.replace("_", " ")}' for name, letter in greenhouse.letters.items())
    shown = {greenhouse.subset_of[each] for each in seen}
    colour_of = colours_of(greenhouse.subset_of.values())
    key = {each: colour for each, colour in colour_of.items() if each in shown and colour != OTHER}
    place = {'loc': 'outside lower center', 'ncols': 5, 'columnspacing': 1.0}
    write_key(figure, key, title=textwrap.fill(names, 34), **place)
    figure.suptitle(f'a robot asks for the climate at tag {read_id}')
    return figure


def draw_reading(
    axes: Any, greenhouse: Greenhouse, tag_id: str, hour: float, size: drawings.LabelSize
) -> list[placing.Box]:
    """Draw the robot at its pose with the values of the tag, if it has a pose; return what they cover."""
    tags, found = greenhouse.layout.tags, greenhouse.approaches
    if tag_id not in found.poses:
        return []
    pose, tag, radius_m = found.poses[tag_id], tags[tag_id], found.free_space.robot_radius_m
    drawings.draw_robot(axes, pose, radius_m)
    robot = placing.Box(*pose[:2], 2 * radius_m, 2 * radius_m)
    values = {name: greenhouse.value(name, (tag.x, tag.y), hour) for name in tag.sensors}
    lines = [f'{units.value_text(name, value)} {units.unit_of(name)}' for name, value in values.items()]
    width_m, height_m = size.height_m / 2 + max(map(size.width_m, lines)), size.height_m * (len(lines) + 0.5)
    dots = [placing.Box(*each[:2], size.height_m, size.height_m) for each in tags.values()]
    (place,) = placing.place_labels([*dots, robot], [(robot, width_m, height_m)], view_of(axes))
    frame = {'boxstyle': 'round,pad=0.3', 'facecolor': colours.ROUTE, 'edgecolor': 'none'}
    style = {'color': 'white', 'weight': 'bold', 'bbox': frame, 'zorder': 6, **drawings.CENTRED}
    axes.text(*place, '\n'.join(lines), **style)
    return [robot, placing.Box(*place, width_m, height_m)]


def draw_field(
    axes: Any, greenhouse: Greenhouse, options: argparse.Namespace, part: Walls, bands: int
) -> None:
    """Draw the tables, the walls, and the values of a sensor in shades of grey with their scale."""
    paper, ink = axes.get_facecolor(), pyplot.rcParams['text.color']
    xs, ys = (np.linspace(*ends, FIELD_STEPS) for ends in (part[::2], part[1::2]))
    field = [[greenhouse.value(options.sensor, (x, y), options.hour) for x in xs] for y in ys]
    shades = LinearSegmentedColormap.from_list('shades', [paper, FIELD_END])
    field_bands = axes.contourf(xs, ys, field, bands, cmap=shades)
    table = {'facecolor': paper, 'edgecolor': ink, 'linewidth': 0.6}
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


def write_key(figure: Figure, key: dict[str, str], **style: Any) -> None:
    """Write the texts of a key beside dots of these colours."""
    ink = pyplot.rcParams['text.color']
    styles = [drawings.point_style('o', colour, 10, markeredgecolor=ink) for colour in key.values()]
    handles = [Line2D([], [], label=text, **style) for text, style in zip(key, styles, strict=True)]
    figure.legend(handles=handles, frameon=False, handletextpad=0.2, **style)


def draw_day(greenhouse: Greenhouse, tag_id: str) -> Figure:
    """Return the figure of a day at one tag: the median and the band of 90 % of each sensor's readings."""
    tag = greenhouse.layout.tags[tag_id]
    hours = [n / 4 for n in range(97)]
    rows = len(tag.sensors)
    figure = pyplot.figure(figsize=(6.4, 1.2 + 1.7 * rows), layout='constrained')
    all_axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    random.seed(0)
    for axes, name in zip(all_axes, tag.sensors, strict=True):
        samples = [
            sorted(greenhouse.value(name, (tag.x, tag.y), hour, is_noisy=True) for _ in range(SAMPLES))
            for hour in hours
        ]
        low, middle, high = ([each[int(share * SAMPLES)] for each in samples] for share in (0.05, 0.5, 0.95))
        band = axes.fill_between(
            hours, low, high, color=BAND_COLOUR, linewidth=0, label='90 % of these readings'
        )
        text = f'median of {SAMPLES:,} readings at each time'
        (line,) = axes.plot(hours, middle, color=colours.ROUTE, linewidth=1.6, label=text)
        curve = [greenhouse.value(name, (tag.x, tag.y), hour) for hour in hours]
        noise = ', without noise' if low == high else ''
        axes.set_title(f'{label_of(name)}, {extremes_of(curve, hours)}{noise}', loc='left', fontsize=9)
        axes.grid(alpha=0.3)
    all_axes[-1].set(xlabel='greenhouse time of day (h)', xlim=(0, 24), xticks=range(0, 25, 3))
    figure.suptitle(f'a day at tag {tag_id} in the simulator\nnot measured: made by a formula', fontsize=11)
    figure.legend(handles=[line, band], loc='outside lower center', ncols=2, frameon=False, fontsize=9)
    return figure


def extremes_of(values: list[float], hours: list[float]) -> str:
    """Return when a curve is highest and lowest, in words."""
    if min(values) == max(values):
        return 'always the same'
    highest, lowest = (clock_time(hours[int(find(values))] * 3600) for find in (np.argmax, np.argmin))
    return f'highest at {highest}, lowest at {lowest}'


def draw_route(greenhouse: Greenhouse) -> Figure:
    """Return the figure of the approach poses and the shortest route of a robot of the default size."""
    figure: Figure = drawings.draw_route(
        greenhouse.layout, greenhouse.walls, greenhouse.approaches, greenhouse.route
    )
    return figure


def check_options(options: argparse.Namespace, greenhouse: Greenhouse) -> None:
    """Choose the tag of the day if none is given; raises StartUpError for an option that cannot be drawn."""
    tags = greenhouse.layout.tags
    options.tag = options.tag or max(tags, key=lambda tag_id: (len(tags[tag_id].sensors), tag_id == '5'))
    if options.sensor not in greenhouse.sensors:
        raise StartUpError(f'--sensor {options.sensor}: there is {", ".join(greenhouse.sensors)}')
    if options.tag not in tags:
        raise StartUpError(f'--tag {options.tag}: no such tag, or one without sensors')
    if not 0.0 <= options.hour <= 24.0:
        raise StartUpError(f'--hour {options.hour:g}: must be between 0 and 24 hours')
    if not options.output.is_dir():
        raise StartUpError(f'--output {options.output}: must be a folder that exists')


def main(arguments: list[str] | None = None) -> int:
    """Draw or check; exit code 0: done, 1: not up to date, 2: cannot be drawn."""
    parser = parser_of('figure', __doc__)
    parser.add_argument(
        '--output', type=Path, default=COMMITTED, metavar='FOLDER', help='default: the documents'
    )
    parser.add_argument('--tag-file', default='', metavar='FILE')
    parser.add_argument('--sim-config-file', default='', metavar='FILE')
    parser.add_argument('--sensor', default='temperature', help='whose field lies under the tags')
    parser.add_argument('--hour', type=float, default=12.0, help='of that field, 0 to 24')
    parser.add_argument('--tag', default='', help='of the day; default: 5, or the tag with most sensors')
    options = parser.parse_args(arguments)
    matplotlib.use('Agg')
    try:
        greenhouse = Greenhouse(options.tag_file, options.sim_config_file)
        check_options(options, greenhouse)
    except OneLineError as error:
        print(f'figure: {error}', file=sys.stderr)
        return 2
    draws: dict[str, Callable[[], Figure]] = {
        **{
            f'{name}_{scheme}': partial(in_scheme, scheme, draw, greenhouse, options)
            for name, draw in (('greenhouse', draw_layout), ('greenhouse_part', draw_part))
            for scheme in SCHEMES
        },
        'day': lambda: draw_day(greenhouse, options.tag),
        'route': lambda: draw_route(greenhouse),
    }
    fingerprint = greenhouse.fingerprint(options)
    pictures = {options.output / f'{name}.png': (fingerprint, draw) for name, draw in draws.items()}
    return draw_or_check('figure', pictures, is_check=options.check)


if __name__ == '__main__':
    sys.exit(main())
