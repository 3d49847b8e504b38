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
import itertools
import random
import sys
from collections.abc import Callable
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
from lupin_greenhouse_bridge.planning.walls import find_walls
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator.layout import require_layout, shipped_file
from lupin_greenhouse_bridge.simulator.simulation import load
from lupin_greenhouse_bridge.units import clock_time, label_of
from matplotlib import pyplot
from matplotlib.figure import Figure
from PIL import Image, PngImagePlugin

COMMITTED = Path(__file__).resolve().parents[1] / 'core/lupin_greenhouse_bridge/doc'
LETTERS = {'temperature': 'T', 'humidity': 'H', 'co2': 'C', 'light': 'L', 'soil_moisture': 'S'}
FIELD_STEP_M = 0.05
BAND_COLOUR = '#c9d8ea'
SAMPLES = 300  # of the noise, at each time of the day
TAG_M = 0.19  # the diameter of its dot
STUB_M = 1.0
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
    """Write a Figure or an Image as PNG with its fingerprint."""
    if isinstance(drawing, Figure):
        drawing.savefig(path, metadata={'Software': None, 'Description': fingerprint}, dpi=110)
        pyplot.close(drawing)
    else:
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
        self.sensors: list[str] = self._noisy.sensors()

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


def draw_layout(greenhouse: Greenhouse, sensor: str, hour: float) -> Figure:
    """Return the figure of the layout: each tag and the letters of its sensors, over one sensor's field."""
    tags, walls = greenhouse.layout.tags, greenhouse.walls
    figure, axes = pyplot.subplots(figsize=(6.4, 8.4), layout='constrained')
    xs, ys = (
        [start + FIELD_STEP_M * n for n in range(int((end - start) / FIELD_STEP_M) + 1)]
        for start, end in ((walls.x0, walls.x1), (walls.y0, walls.y1))
    )
    field = [[greenhouse.value(sensor, (x, y), hour) for x in xs] for y in ys]
    style: dict[str, Any] = {'alpha': 0.55, 'origin': 'lower', 'interpolation': 'bilinear'}
    shades = axes.imshow(field, colours.COLOUR_MAP, extent=(xs[0], xs[-1], ys[0], ys[-1]), **style)
    lines = axes.contour(xs, ys, field, colors='0.3', linewidths=0.6)
    lines.set_visible(False)  # each is drawn below, except short stubs at the walls
    for path in itertools.chain.from_iterable(lines.allsegs):
        if placing.length_m(path.tolist()) > STUB_M:
            axes.plot(*path.T, color='0.3', linewidth=0.6)
    drawings.draw_greenhouse(axes, greenhouse.layout, walls)
    dots = [placing.Box(tag.x, tag.y, TAG_M, TAG_M) for tag in tags.values()]
    dot_style: dict[str, Any] = {'color': 'white', 'markeredgecolor': 'black', 'markersize': 9, 'zorder': 3}
    key = 'tag: its id, and letters for its sensors'
    axes.plot([dot.x for dot in dots], [dot.y for dot in dots], 'o', label=key, **dot_style)
    letters = [''.join(LETTERS[name] for name in tag.sensors) for tag in tags.values()]
    labels = [
        (f'{tag_id}  {text}', dot, 'black') for tag_id, text, dot in zip(tags, letters, dots, strict=True)
    ]
    box = {'boxstyle': 'round,pad=0.12', 'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.9}
    bounds = placing.box_of(walls)
    drawings.write_labels(axes, labels, drawings.LABELS, dots, bounds, weight='bold', bbox=box, zorder=4)
    name, when = sensor.replace('_', ' '), clock_time(hour * 3600)
    place: dict[str, Any] = {'ax': axes, 'location': 'right', 'shrink': 0.7, 'ticks': lines.levels}
    figure.colorbar(shades, label=f'{label_of(sensor)} at {when}', **place).add_lines(lines)
    for each in greenhouse.sensors:
        count = pluralized(sum(each in tag.sensors for tag in tags.values()), 'tag')
        axes.plot([], [], ' ', label=f'{LETTERS[each]}  {each.replace("_", " ")}: {count}')
    axes.plot([], [], 's', color=colours.TABLE, markersize=9, label='table')
    figure.legend(loc='outside lower center', ncols=3, frameon=False, fontsize=8)
    axes.set_ylabel('y (m)')
    axes.set_title(f"the simulator's model: {name} at {when},\nand the sensors of each tag", fontsize=11)
    return figure


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
        'greenhouse': lambda: draw_layout(greenhouse, options.sensor, options.hour),
        'day': lambda: draw_day(greenhouse, options.tag),
        'route': lambda: draw_route(greenhouse),
    }
    fingerprint = greenhouse.fingerprint(options)
    pictures = {options.output / f'{name}.png': (fingerprint, draw) for name, draw in draws.items()}
    return draw_or_check('figure', pictures, is_check=options.check)


if __name__ == '__main__':
    sys.exit(main())
