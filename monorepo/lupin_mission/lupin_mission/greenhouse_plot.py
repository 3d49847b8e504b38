"""The greenhouse as a drawing: footprint, tables, tags at their places. No ROS here."""

from pathlib import Path
from typing import Any, NamedTuple

from greenhouse_sim.tools.layout_utils import load_layout, load_visualization_settings
from lupin_greenhouse_bridge.errors import BridgeError
from lupin_greenhouse_bridge.units import unit_of
from matplotlib.patches import Rectangle

COLOURS = 'viridis'  # even in brightness: it reads in black and white, and for colour-blind people


class DrawingError(BridgeError):
    """There is nothing that could be drawn, or nowhere to put it."""


class Layout(NamedTuple):
    """What stands where in the greenhouse, in metres."""

    width_m: float
    length_m: float
    tags: dict[str, dict]  # id -> x, y, sensors
    tables: dict[str, dict]  # name -> x0, y0, x1, y1


def read_layout(tag_file: str = '', sim_config_file: str = '') -> Layout:
    """Return the layout as the simulator reads it; '' names its shipped files. Raises DrawingError."""
    for path in filter(None, (tag_file, sim_config_file)):
        if not Path(path).is_file():
            raise DrawingError(
                f"'{path}' is no file: give the one that the mission's bridge was started with"
            )
    try:
        tags, tables = load_layout(tag_file or None)
        settings = load_visualization_settings(Path(sim_config_file) if sim_config_file else None)
        layout = Layout(settings.greenhouse_width_m, settings.greenhouse_height_m, tags, tables)
        for tag in tags.values():
            float(tag['x']), float(tag['y'])
        for table in tables.values():
            [float(table[key]) for key in ('x0', 'y0', 'x1', 'y1')]
    except Exception as error:  # whatever upstream makes of a file that is none
        files = ' and '.join(filter(None, (tag_file, sim_config_file)))
        raise DrawingError(f'{files}: cannot be drawn ({type(error).__name__}: {error})') from error
    if not layout.tags:
        raise DrawingError(f"tag_file '{tag_file}': holds no tags to draw")
    return layout


def draw_footprint(axes: Any, layout: Layout) -> None:
    """Draw walls, tables and a scale in metres; the view holds every tag, also one outside the walls."""
    axes.add_patch(Rectangle((0, 0), layout.width_m, layout.length_m, fill=False, linewidth=1.5))
    for table in layout.tables.values():
        axes.add_patch(
            Rectangle(
                (table['x0'], table['y0']),
                table['x1'] - table['x0'],
                table['y1'] - table['y0'],
                facecolor='0.92',
                edgecolor='0.55',
                linewidth=0.8,
            )
        )
    margin = 0.15
    xs = [0.0, layout.width_m, *(float(tag['x']) for tag in layout.tags.values())]
    ys = [0.0, layout.length_m, *(float(tag['y']) for tag in layout.tags.values())]
    axes.set_xlim(min(xs) - margin, max(xs) + margin)
    axes.set_ylim(min(ys) - margin, max(ys) + margin)
    axes.set_aspect('equal')
    axes.set_xlabel('x (m)')


def label_of(sensor: str) -> str:
    """Return a sensor's name with its unit, such as `co2 (ppm)`."""
    unit = unit_of(sensor)
    return f'{sensor.replace("_", " ")} ({unit})' if unit else sensor.replace('_', ' ')
