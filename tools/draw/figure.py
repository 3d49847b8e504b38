"""
Draw the simulated greenhouse for the documents, on light and on dark paper.

    make figure                          greenhouse_light.png and greenhouse_dark.png of the documents
    make figure ARGS="--output /tmp"     the same two, elsewhere

Each tag is a disc with one sector for each of its sensors. Below lies the field of one sensor.
"""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from greenhouse_sim.simulator import GreenhouseSimulator
from lupin_greenhouse_bridge.runtime.arguments import Parser
from lupin_greenhouse_bridge.simulator.layout import Layout, require_layout
from lupin_greenhouse_bridge.units import UNITS, clock_time, name_of, unit_of, value_text
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle, Wedge
from matplotlib.transforms import Bbox

COMMITTED = Path(__file__).resolve().parents[1] / 'core/lupin_greenhouse_bridge/doc'
SENSOR, HOUR = 'temperature', 12.0  # of the field
PAD_PIXELS = 5  # around a label
LINES = 3  # of equal values, at most about
# Protanopes and deuteranopes can tell them apart too.
COLOURS = dict(zip(UNITS, ('#d55e00', '#3c69b4', '#a52dff', '#f0e442', '#009e73'), strict=True))
# By scheme: the colours of ink, paper, the highest values of the field, and tables.
SCHEMES = {'light': ('#1f2328', 'white', '0.7', '#b5936b'), 'dark': ('#e6edf3', '#0d1117', '0.44', '#a28157')}
INKED = 'text.color', 'axes.labelcolor', 'axes.edgecolor', 'xtick.color', 'ytick.color', 'patch.edgecolor'
LEFT, RIGHT, BELOW, ABOVE = 0.7, 0.4, 1.5, 1.3  # margins in inches; an inch is a metre of the greenhouse
RADIUS_M, CELL_M, SHORTEST_M = 0.11, 0.02, 0.5  # of a tag's disc, of the field, and of a line with a number
STYLE = {'font.size': 12.5, 'axes.titlesize': 12.5, 'figure.titlesize': 12.5, 'figure.dpi': 220}


def silent_simulator() -> GreenhouseSimulator:
    """Return the simulator without noise."""
    simulator = GreenhouseSimulator(None, None)
    for components in simulator.sim_config['sensors'].values():
        for component in components:
            component['noise_sigma'] = 0.0
    return simulator


def value(simulator: GreenhouseSimulator, sensor: str, position_m: tuple[float, float], hour: float) -> float:
    """Return the value of a sensor at a position, in its unit."""
    return float(simulator.sensor_registry.get_sensor(sensor).retrieve_data(position_m, 3600.0 * hour))


def draw(scheme: str) -> Figure:
    """Return the figure in one of the schemes."""
    ink, paper, shade, wood = SCHEMES[scheme]
    style: dict[Any, Any] = {**STYLE, 'figure.facecolor': paper, 'axes.facecolor': paper}
    style |= dict.fromkeys(INKED, ink)
    simulator, layout = silent_simulator(), require_layout('')
    area = simulator.sim_config['visualization']
    width, height = area['greenhouse_width_m'], area['greenhouse_height_m']
    with pyplot.rc_context(style):
        size = np.array([LEFT + width + RIGHT, BELOW + height + ABOVE])
        figure = pyplot.figure(figsize=tuple(size))
        axes = figure.add_axes((*([LEFT, BELOW] / size), *([width, height] / size)))
        axes.set(
            xlim=(0, width), ylim=(0, height), xticks=range(round(width) + 1), xlabel='x (m)', ylabel='y (m)'
        )
        tables = draw_tables(axes, layout, wood)
        taken = draw_tags(axes, layout, tables)
        scale = figure.add_axes((*([LEFT, BELOW + height + 0.45] / size), *([width, 0.14] / size)))
        draw_field(axes, scale, simulator, shade, [*taken, *tables])
        title = f'{len(layout.tags)} tags, each in the colours of its sensors'
        figure.suptitle(title, weight='bold', y=1 - 0.1 / size[1])
        marks = [(f'{letter_of(name)} {name_of(name)}', 'o', colour) for name, colour in COLOURS.items()]
        mark_style: dict[str, Any] = {'linestyle': '', 'markersize': 15, 'markeredgecolor': ink}
        keys = [
            Line2D([], [], label=label, marker=mark, color=colour, **mark_style)
            for label, mark, colour in [*marks, ('table', 's', wood)]
        ]
        place: dict[str, Any] = {'loc': 'lower center', 'ncols': 3, 'frameon': False}
        figure.legend(handles=keys, columnspacing=1.0, handletextpad=0.2, **place)
    return figure


def draw_tables(axes: Axes, layout: Layout, colour: str) -> list[Bbox]:
    """Draw the tables; return what they cover."""
    boxes = [Bbox([[x0, y0], [x1, y1]]) for x0, y0, x1, y1 in layout.tables.values()]
    for box in boxes:
        axes.add_patch(
            Rectangle(
                box.p0,
                box.width,
                box.height,
                facecolor=colour,
                edgecolor=pyplot.rcParams['text.color'],
                linewidth=0.6,
            )
        )
    return [box.transformed(axes.transData) for box in boxes]


def draw_tags(axes: Axes, layout: Layout, tables: list[Bbox]) -> list[Bbox]:
    """Draw each tag as a disc, and write its id and its letters beside it; return what they cover."""
    taken = []
    for x, y, sensors in layout.tags.values():
        for number, name in enumerate(sectors := [sensor for sensor in COLOURS if sensor in sensors]):
            ends = (-90 - 360 * (number + after) / len(sectors) for after in (1, 0))  # clockwise
            style = {
                'facecolor': COLOURS[name],
                'edgecolor': pyplot.rcParams['text.color'],
                'linewidth': 1.5,
                'zorder': 5,
            }
            axes.add_patch(Wedge((x, y), RADIUS_M, *ends, **style))
        disc = Bbox.from_bounds(x - RADIUS_M, y - RADIUS_M, 2 * RADIUS_M, 2 * RADIUS_M)
        taken.append(disc.transformed(axes.transData))
    for tag_id, (x, y, sensors) in sorted(layout.tags.items(), key=lambda item: item[1].y):
        label = f'{tag_id}: {"".join(letter_of(sensor) for sensor in COLOURS if sensor in sensors)}'
        aside = 0.18 + 0.05 * len(label)
        places = [(x + aside, y), (x - aside, y), (x, y + 0.25), (x, y - 0.25)]
        taken.append(write(axes, label, places, taken, tables, weight='bold'))
    return taken


def draw_field(
    axes: Axes, scale: Axes, simulator: GreenhouseSimulator, shade: str, taken: list[Bbox]
) -> None:
    """Draw the values of the sensor in greys with lines of equal values, and the scale of both."""
    (_, width), (_, height) = axes.get_xlim(), axes.get_ylim()
    xs, ys = (np.linspace(0.0, side, round(side / CELL_M) + 1) for side in (width, height))
    field = np.array([[value(simulator, SENSOR, (x, y), HOUR) for x in xs] for y in ys])
    shades = LinearSegmentedColormap.from_list('shades', [axes.get_facecolor(), shade])
    image = axes.imshow(field, shades, extent=(0, width, 0, height), origin='lower', interpolation='bilinear')
    lines = axes.contour(
        xs, ys, field, LINES, colors=pyplot.rcParams['text.color'], linewidths=0.6, alpha=0.6
    )
    lines.set_zorder(0.5)
    for level, paths in zip(lines.levels, lines.allsegs, strict=True):
        for path in paths:
            if not len(path) or np.ptp(path, axis=0).max() <= SHORTEST_M:
                continue
            places = np.clip(path, (0.3, 0.12), (width - 0.3, height - 0.12))
            far_right_first = places[np.argsort(-places[:, 0], kind='stable')]
            taken = [*taken, write(axes, f'{level:g} {unit_of(SENSOR)}', far_right_first, taken)]
    low, high = image.get_clim()
    levels = [level for level in lines.levels if min(level - low, high - level) > (high - low) / 10]
    texts = [value_text(SENSOR, low), *(f'{level:g}' for level in levels), value_text(SENSOR, high)]
    bar = pyplot.colorbar(image, scale, orientation='horizontal')
    bar.set_ticks([low, *levels, high], labels=texts)
    scale.set_title(f'{name_of(SENSOR)} at {clock_time(3600 * HOUR)} ({unit_of(SENSOR)})', pad=6)


def write(
    axes: Axes,
    text: str,
    places: Iterable[Any],
    taken: list[Bbox],
    avoided: Sequence[Bbox] = (),
    **style: Any,
) -> Bbox:
    """Write a text at the first place where it overlaps the taken boxes least; return its box."""
    plate = {'boxstyle': 'round,pad=0.1', 'facecolor': axes.get_facecolor(), 'edgecolor': 'none'}
    label = axes.text(0, 0, text, ha='center', va='center_baseline', zorder=4, bbox=plate, **style)

    def box_at(place: Any) -> Bbox:
        label.set_position(place)
        return label.get_window_extent().padded(PAD_PIXELS)

    def hidden(place: Any) -> tuple[int, int]:
        box = box_at(place)
        return box.count_overlaps(taken), box.count_overlaps(avoided)

    return box_at(min(places, key=hidden))


def letter_of(sensor: str) -> str:
    """Return the letter of a sensor in the figure, such as T."""
    return sensor[0].upper()


def main(arguments: list[str] | None = None) -> int:
    """Draw both pictures; return the exit code."""
    parser = Parser(prog='figure', description=(__doc__ or '').strip().splitlines()[0])
    folder: dict[str, Any] = {'type': Path, 'default': COMMITTED, 'metavar': 'FOLDER'}
    parser.add_argument('--output', **folder, help='default: that of the documents')
    options = parser.parse_args(arguments)
    matplotlib.use('Agg')
    options.output.mkdir(parents=True, exist_ok=True)
    for scheme in SCHEMES:
        path = options.output / f'greenhouse_{scheme}.png'
        draw(scheme).savefig(path)
        print(path)
    return 0


if __name__ == '__main__':
    sys.exit(main())
