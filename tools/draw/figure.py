"""
Draw the simulated greenhouse: its layout over one sensor's field, a day at a tag, and a robot's route.

    make figure                      the shipped greenhouse, into the documents of both trees
    make figure ARGS=--check         checks that those are up to date
    make figure ARGS="--output /tmp --tag-file tags.json --sensor co2 --hour 6 --tag 21"

Each figure is a PNG. Its metadata names what it was drawn from: the simulator's two files, the options and
the code. --check compares these and not the pixels, which differ a little with each release of matplotlib.
"""

import argparse
import hashlib
import math
import random
import sys
from pathlib import Path

import matplotlib
from greenhouse_sim.simulator import GreenhouseSimulator
from lupin_greenhouse_bridge import units
from lupin_greenhouse_bridge.display import colours, drawings, placing
from lupin_greenhouse_bridge.display.placing import Box, box_of
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, pluralized
from lupin_greenhouse_bridge.planning import (
    approach,
    free_space,
    grid,
    route,
    surroundings,
    tag_poses,
    walls,
)
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator.files import shipped_file
from lupin_greenhouse_bridge.simulator.layout import read_layout
from lupin_greenhouse_bridge.simulator.simulation import load
from lupin_greenhouse_bridge.units import clock_time, label_of
from matplotlib import pyplot
from PIL import Image

COMMITTED = Path(__file__).resolve().parents[1] / 'core/lupin_greenhouse_bridge/doc'
LETTERS = {'temperature': 'T', 'humidity': 'H', 'co2': 'C', 'light': 'L', 'soil_moisture': 'S'}
FIELD_STEP_M = 0.05
BAND_COLOUR = '#c9d8ea'
SAMPLES = 300  # of the noise, at each time of the day
TAG_RADIUS_M = 0.085
CHARACTER_M, LINE_M = 0.085, 0.17  # of a label in the picture
STUB_M = 1.0  # a shorter contour line is not drawn

DRAWN_BY = (
    approach,
    colours,
    drawings,
    free_space,
    grid,
    placing,
    route,
    surroundings,
    tag_poses,
    units,
    walls,
)


class Greenhouse:
    """The simulator with a settable clock and noise."""

    def __init__(self, options):
        self.tag_file = options.tag_file or shipped_file('tag_locations.json')
        self.sim_config_file = options.sim_config_file or shipped_file('greenhouse_config.yaml')
        paths = Path(self.tag_file), Path(self.sim_config_file)
        load(Settings(), *paths)  # validated like the bridge's
        self.layout = read_layout(self.tag_file)
        self.walls = walls.find_walls(self.layout, self.sim_config_file)
        self._noisy, self._silent = (GreenhouseSimulator(*paths) for _ in range(2))
        for components in self._silent.sim_config['sensors'].values():
            for component in components:
                component['noise_sigma'] = 0.0
        self.sensors = self._noisy.sensors()

    def value(self, sensor: str, position: tuple[float, float], hour: float, *, is_noisy=False) -> float:
        """Return the value of a sensor at a position, in its unit."""
        simulator = self._noisy if is_noisy else self._silent
        return simulator.sensor_registry.get_sensor(sensor).retrieve_data(position, hour * 3600.0)

    def fingerprint(self, options) -> str:
        """Return a hash of everything that a figure is drawn from."""
        files = (self.tag_file, self.sim_config_file, __file__, *(each.__file__ for each in DRAWN_BY))
        choices = f'{options.sensor} {options.hour} {options.tag}'.encode()
        return hash_of(*(Path(file).read_bytes() for file in files), choices)


def hash_of(*contents: bytes) -> str:
    """Return the fingerprint of what a picture is drawn from."""
    return hashlib.sha256(b'\0'.join(contents)).hexdigest()


def draw_layout(greenhouse: Greenhouse, sensor: str, hour: float):
    """Return the figure of the layout: each tag and the letters of its sensors, over one sensor's field."""
    layout = greenhouse.layout
    figure, axes = pyplot.subplots(figsize=(6.4, 8.4), layout='constrained')
    x0, y0, x1, y1 = greenhouse.walls
    width, length = x1 - x0, y1 - y0
    xs, ys = (
        [start + FIELD_STEP_M * n for n in range(int(side / FIELD_STEP_M) + 1)]
        for start, side in ((x0, width), (y0, length))
    )
    field = [[greenhouse.value(sensor, (x, y), hour) for x in xs] for y in ys]
    extent = (xs[0], xs[-1], ys[0], ys[-1])
    shades = axes.imshow(
        field, colours.COLOUR_MAP, alpha=0.55, origin='lower', extent=extent, interpolation='bilinear'
    )
    lines = axes.contour(xs, ys, field, colors='0.3', linewidths=0.6)
    lines.set_visible(False)  # each is drawn below, but for short stubs at the walls
    dots = [(tag.x, tag.y) for tag in layout.tags.values()]
    drawings.draw_greenhouse(axes, layout, greenhouse.walls)
    marks = {
        'color': 'white',
        'markeredgecolor': 'black',
        'markersize': 9,
        'label': 'tag: its id, and letters for its sensors',
    }
    axes.plot(*zip(*dots, strict=True), 'o', **marks, zorder=3)
    places = _draw_labels(axes, layout, box_of(greenhouse.walls))
    _draw_contours(axes, lines, [*dots, *places], greenhouse.walls)
    scale = {'location': 'right', 'shrink': 0.7, 'ticks': lines.levels}
    when = clock_time(hour * 3600)
    figure.colorbar(shades, ax=axes, label=f'{label_of(sensor)} at {when}', **scale).add_lines(lines)
    for name in greenhouse.sensors:
        count = sum(name in tag.sensors for tag in layout.tags.values())
        text = f'{LETTERS[name]}  {name.replace("_", " ")}: {pluralized(count, "tag")}'
        axes.plot([], [], ' ', label=text)
    axes.plot([], [], 's', color=colours.TABLE, markersize=9, label='table')
    figure.legend(loc='outside lower center', ncols=3, frameon=False, fontsize=8)
    axes.set_ylabel('y (m)')
    name = sensor.replace('_', ' ')
    axes.set_title(f"the simulator's model: {name} at {when},\nand the sensors of each tag", fontsize=11)
    return figure


def _draw_contours(axes, lines, taken: list[tuple[float, float]], walls) -> None:
    """Draw each contour that is no stub, with its level where most room is."""
    box = {'facecolor': 'white', 'alpha': 0.5, 'edgecolor': 'none', 'pad': 0.5}
    style = {'ha': 'center', 'va': 'center', 'fontsize': 7, 'bbox': box}
    for level, paths in zip(lines.levels, lines.allsegs, strict=True):
        for path in paths:
            if sum(map(math.dist, path, path[1:])) < STUB_M:
                continue
            axes.plot(*path.T, color='0.3', linewidth=0.6)
            room_m = [
                min(
                    *(math.hypot((x - u) / 2, y - v) for u, v in taken),
                    *(each * 2 for each in (x - walls.x0, walls.x1 - x, y - walls.y0, walls.y1 - y)),
                )
                for x, y in path
            ]
            x, y = path[room_m.index(max(room_m))]
            axes.text(x, y, f'{level:g}', color='0.3', **style)
            taken.append((x, y))


def _draw_labels(axes, layout, bounds: Box) -> list[tuple[float, float]]:
    """Write each tag's id and sensors beside it; return where."""
    texts = [
        f'{tag_id}  {"".join(LETTERS[name] for name in tag.sensors)}' for tag_id, tag in layout.tags.items()
    ]
    dots = [Box(tag.x, tag.y, 2.2 * TAG_RADIUS_M, 2.2 * TAG_RADIUS_M) for tag in layout.tags.values()]
    labels = [(dot, CHARACTER_M * len(text), LINE_M) for dot, text in zip(dots, texts, strict=True)]
    box = {'boxstyle': 'round,pad=0.12', 'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.9}
    style = {'ha': 'center', 'va': 'center', 'fontsize': 7.5, 'fontweight': 'bold', 'bbox': box, 'zorder': 4}
    places = placing.place_labels(dots, labels, bounds)
    for place, text in zip(places, texts, strict=True):
        axes.text(*place, text, **style)
    return places


def draw_day(greenhouse: Greenhouse, tag_id: str):
    """Return the figure of a day at one tag: the median and the band of 90 % of each sensor's readings."""
    tag = greenhouse.layout.tags[tag_id]
    position = (tag.x, tag.y)
    hours = [n / 4 for n in range(97)]
    rows = len(tag.sensors)
    figure = pyplot.figure(figsize=(6.4, 1.2 + 1.7 * rows), layout='constrained')
    all_axes = figure.subplots(rows, 1, sharex=True, squeeze=False)
    random.seed(0)
    for axes, name in zip(all_axes[:, 0], tag.sensors, strict=True):
        samples = [
            sorted(greenhouse.value(name, position, hour, is_noisy=True) for _ in range(SAMPLES))
            for hour in hours
        ]
        low, middle, high = ([each[int(share * SAMPLES)] for each in samples] for share in (0.05, 0.5, 0.95))
        band = axes.fill_between(
            hours, low, high, color=BAND_COLOUR, linewidth=0, label='90 % of these readings'
        )
        (line,) = axes.plot(
            hours,
            middle,
            color=colours.ROUTE,
            linewidth=1.6,
            label=f'median of {SAMPLES:,} readings at each time',
        )
        axes.set_title(label_of(name) + ': no noise, so no band' * (low == high), loc='left', fontsize=9)
        axes.grid(alpha=0.3)
    all_axes[-1, 0].set(xlabel='greenhouse time of day (h)', xlim=(0, 24), xticks=range(0, 25, 3))
    figure.suptitle(
        f'a day at tag {tag_id} in the simulator\nnot measured: each formula has its peak at noon',
        fontsize=11,
    )
    figure.legend(handles=[line, band], loc='outside lower center', ncols=2, frameon=False, fontsize=9)
    return figure


def draw_route(greenhouse: Greenhouse):
    """Return the figure of the approach poses and the shortest route of a robot of the default size."""
    layout, found = greenhouse.layout, greenhouse.walls
    approaches = approach.find_approaches(layout, found, approach.ViewingLimits())
    planned = route.plan_route(approaches.free_space, approaches.poses, None, 'shortest')
    return drawings.draw_route(layout, found, approaches.poses, approaches.unreachable, planned)


def save(figure, path: Path, fingerprint: str) -> None:
    """Write a figure as PNG with its fingerprint."""
    figure.savefig(path, metadata={'Software': None, 'Description': fingerprint}, dpi=110)
    pyplot.close(figure)


def fingerprint_of(path: Path) -> str:
    """Return the fingerprint in a committed figure; '' if it has none or is missing."""
    if not path.exists():
        return ''
    with Image.open(path) as image:
        return image.info.get('Description', '')


def main(arguments: list[str] | None = None) -> int:
    """Draw or check; exit code 0: done, 1: not up to date, 2: cannot be drawn."""
    parser = argparse.ArgumentParser(prog='figure', description=__doc__.strip().splitlines()[0])
    parser.add_argument('--check', action='store_true', help='compare the committed figures; draw nothing')
    output = {'type': Path, 'default': COMMITTED, 'metavar': 'FOLDER'}
    parser.add_argument('--output', **output, help='default: the documents')
    parser.add_argument('--tag-file', default='', metavar='FILE')
    parser.add_argument('--sim-config-file', default='', metavar='FILE')
    parser.add_argument('--sensor', default='temperature', help='whose field lies under the tags')
    parser.add_argument('--hour', type=float, default=12.0, help='of that field, 0 to 24')
    parser.add_argument('--tag', default='', help='of the day; default: 5, or the tag with most sensors')
    options = parser.parse_args(arguments)
    matplotlib.use('Agg')
    try:
        greenhouse = Greenhouse(options)
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
    except OneLineError as error:
        print(f'figure: {error}', file=sys.stderr)
        return 2
    fingerprint = greenhouse.fingerprint(options)
    paths = {name: options.output / f'{name}.png' for name in ('greenhouse', 'day', 'route')}
    if options.check:
        stale = [str(path) for path in paths.values() if fingerprint_of(path) != fingerprint]
        lines = [f'figure: {each} is not up to date: make figure' for each in stale]
        print(*(lines or [f'figure: {len(paths)} figures are up to date']), sep='\n')
        return int(bool(stale))
    save(draw_layout(greenhouse, options.sensor, options.hour), paths['greenhouse'], fingerprint)
    save(draw_day(greenhouse, options.tag), paths['day'], fingerprint)
    save(draw_route(greenhouse), paths['route'], fingerprint)
    print(*paths.values(), sep='\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
