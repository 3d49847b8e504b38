"""The greenhouse as a drawing: footprint, tables, tags at their places. No ROS here."""

from typing import Any, NamedTuple

from matplotlib.patches import Rectangle

from lupin_mission.errors import StartUpError
from lupin_mission.layout import Layout, shipped_file
from lupin_mission.units import unit_of

COLOURS = 'viridis'  # even in brightness: it reads in black and white, and for colour-blind people
MARGIN_M = 0.15


class Footprint(NamedTuple):
    """The walls, in metres from the origin."""

    width_m: float
    length_m: float


def read_footprint(layout: Layout, sim_config_file: str = '') -> Footprint:
    """
    Return the walls that the greenhouse config names; without a config they go around tags and tables.

    '' stands for the config of mdp-greenhouse where it is installed. Raises StartUpError.
    """
    path = sim_config_file or shipped_file('greenhouse_config.yaml')
    if not path:
        corners = [
            *(tag[:2] for tag in layout.tags.values()),
            *(table[2:] for table in layout.tables.values()),
        ]
        return Footprint(*map(max, zip(*corners, strict=True)))
    try:
        import yaml  # comes with ROS

        with open(path, encoding='utf-8') as file:
            walls = yaml.safe_load(file)['visualization']
        return Footprint(float(walls['greenhouse_width_m']), float(walls['greenhouse_height_m']))
    except Exception as error:  # PyYAML's constructors leak KeyError, IndexError and others on bad scalars
        raise StartUpError(
            f"'{path}' names no walls ({type(error).__name__}: {error}):"
            ' name the greenhouse_config.yaml that the bridge loads'
        ) from error


def draw_footprint(axes: Any, layout: Layout, footprint: Footprint) -> None:
    """Draw walls, tables and a scale in metres; the view holds every tag, also one outside the walls."""
    axes.add_patch(Rectangle((0, 0), *footprint, fill=False, linewidth=1.5))
    for x0, y0, x1, y1 in layout.tables.values():
        axes.add_patch(
            Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor='0.92', edgecolor='0.55', linewidth=0.8)
        )
    xs = [0.0, footprint.width_m, *(tag.x for tag in layout.tags.values())]
    ys = [0.0, footprint.length_m, *(tag.y for tag in layout.tags.values())]
    axes.set_xlim(min(xs) - MARGIN_M, max(xs) + MARGIN_M)
    axes.set_ylim(min(ys) - MARGIN_M, max(ys) + MARGIN_M)
    axes.set_aspect('equal')
    axes.set_xlabel('x (m)')


def label_of(sensor: str) -> str:
    """Return a sensor's name with its unit, such as `co2 (ppm)`."""
    unit = unit_of(sensor)
    return f'{sensor.replace("_", " ")} ({unit})' if unit else sensor.replace('_', ' ')
