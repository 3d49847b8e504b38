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
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib
import numpy as np
import simulated
import subsets
from lupin_greenhouse_bridge import units
from lupin_greenhouse_bridge.display import colours, drawings, placing
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError
from lupin_greenhouse_bridge.runtime.arguments import Parser, folder_type, number_type
from lupin_greenhouse_bridge.units import clock_time, label_of, value_text
from matplotlib import pyplot
from matplotlib.figure import Figure
from PIL import Image, PngImagePlugin
from simulated import Greenhouse

COMMITTED = Path(__file__).resolve().parents[1] / 'core/lupin_greenhouse_bridge/doc'
BAND_COLOUR = '#c9d8ea'
SKEWED = 0.2  # the difference of its halves, as a share of the band
Picture: TypeAlias = tuple[str, Callable[[], Any]]  # fingerprint of its data; what draws a Figure or an Image


def draw_or_check(command: str, pictures: dict[Path, Picture], *, is_check: bool) -> int:
    """Write pictures with their fingerprints, or say what draws the stale ones; return the exit code."""
    stale = 0
    for path, (fingerprint, draw) in pictures.items():
        if not is_check:
            save(draw(), path, fingerprint)
            print(path)
        elif fingerprint_of(path) != fingerprint:
            print(f'{path} is not up to date: {command}')
            stale = 1
    return stale


def save(drawing: Any, path: Path, fingerprint: str) -> None:
    """Write a Figure or an Image as PNG with its fingerprint."""
    if isinstance(drawing, Figure):
        picture = io.BytesIO()
        drawing.savefig(picture)
        pyplot.close(drawing)
        drawing = Image.open(picture).convert('RGB')
    metadata = PngImagePlugin.PngInfo()
    metadata.add_text('Description', fingerprint)
    drawing.save(path, pnginfo=metadata, optimize=True)


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
    parser = Parser(prog=name, description=(document or '').strip().splitlines()[0])
    parser.add_argument('--check', action='store_true', help='compare the committed pictures; draw nothing')
    return parser


def fingerprint_of_data(greenhouse: Greenhouse, options: argparse.Namespace) -> str:
    """Return a hash of everything that a figure is drawn from."""
    modules = (sys.modules[__name__], simulated, subsets, colours, drawings, placing, units)
    code = [Path(str(each.__file__)) for each in modules]
    route = ' '.join(f'{x:.2f},{y:.2f}' for x, y in greenhouse.route.points_m)
    choices = f'{options.sensor} {options.hour} {options.tag} {greenhouse.walls} {route}'
    return hash_of(*(path.read_bytes() for path in [*greenhouse.files, *code]), choices.encode())


def draw_day(greenhouse: Greenhouse, tag_id: str) -> Figure:
    """Return the figure of a day at one tag: each sensor without noise, and 9 of 10 readings."""
    tag = greenhouse.layout.tags[tag_id]
    hours = np.linspace(0.0, 24.0, 97)
    rows = len(tag.sensors)
    figure = pyplot.figure(figsize=(6.4, 2.3 + 2.1 * rows), layout='constrained')
    all_axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for axes, name in zip(all_axes, tag.sensors, strict=True):
        quantiles = [greenhouse.quantiles(name, tag[:2], hour, (0.05, 0.95)) for hour in hours]
        low, high = np.transpose(quantiles)
        values = np.array([greenhouse.value(name, tag[:2], hour) for hour in hours])
        band = axes.fill_between(hours, low, high, color=BAND_COLOUR, linewidth=0)
        (line,) = axes.plot(hours, values, color=colours.ROUTE, linewidth=2)
        note = 'reading = value, no noise' if (low == high).all() else 'reading = value + noise'
        if (np.abs(low + high - 2 * values) > SKEWED * (high - low)).any():
            note = 'reading = highest of noisy sources'
        axes.set_title(label_of(name), loc='left')
        axes.set_title(note, loc='right', fontsize=0.85 * subsets.PART_POINTS, color='0.35')
        extremes = {values.argmin(): (low, -4, 'top'), values.argmax(): (high, 4, 'bottom')}
        for at, (edge, aside, side) in extremes.items():
            when = clock_time(3600 * hours[at]) if len(extremes) > 1 else 'any time'
            text = f'{value_text(name, values[at])} at {when}'
            place = {'ha': 'center' if at else 'left', 'va': side, 'textcoords': 'offset points'}
            axes.annotate(text, (hours[at], edge[at]), (0 if at else 5, aside), **place)
            axes.plot(hours[at], values[at], 'o', color=colours.ROUTE, clip_on=False)
        axes.margins(y=0.4)
        axes.locator_params(axis='y', nbins=4)
        axes.grid(alpha=0.3)
    ticks = range(0, 25, 6)
    all_axes[-1].set_xlabel('time of day in the greenhouse')
    all_axes[-1].set(xlim=(0, 24), xticks=ticks, xticklabels=[f'{hour:02}:00' for hour in ticks])
    title = f'A day at tag {tag_id} in the simulator,\nmade by a formula, not measured'
    figure.suptitle(title, weight='bold')
    names = 'the value without noise', '9 of 10 readings'
    figure.legend([line, band], names, loc='outside lower center', ncols=2, frameon=False)
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
        '--output', type=folder_type, default=COMMITTED, metavar='FOLDER', help='default: the documents'
    )
    parser.add_argument('--tag-file', default='', metavar='FILE')
    parser.add_argument('--sim-config-file', default='', metavar='FILE')
    parser.add_argument('--sensor', default='temperature', help='whose field lies under the tags')
    hour = number_type('a number of hours from 0 to 24, such as 12.5', float)
    parser.add_argument('--hour', type=hour, default=12.0, help='of that field, 0 to 24')
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
            f'{name}_{scheme}': partial(subsets.in_style, scheme, points, draw, greenhouse, options)
            for name, points, draw in (
                ('greenhouse', subsets.LAYOUT_POINTS, subsets.draw_layout),
                ('greenhouse_part', subsets.PART_POINTS, subsets.draw_part),
            )
            for scheme in subsets.SCHEMES
        },
        'day': partial(subsets.in_style, 'light', subsets.PART_POINTS, draw_day, greenhouse, options.tag),
        'route': lambda: drawings.draw_route(
            greenhouse.layout, greenhouse.walls, greenhouse.approaches, greenhouse.route
        ),
    }
    fingerprint = fingerprint_of_data(greenhouse, options)
    pictures = {options.output / f'{name}.png': (fingerprint, draw) for name, draw in draws.items()}
    return draw_or_check('make figure', pictures, is_check=options.check)


if __name__ == '__main__':
    sys.exit(main())
