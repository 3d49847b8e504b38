# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What the greenhouse config says about drawings: the walls and the colour scales. Does not import ROS."""

from typing import NamedTuple

from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.simulator.files import mapping_of, number, read_yaml, shipped_file
from lupin_greenhouse_bridge.simulator.layout import Layout


class Footprint(NamedTuple):
    """The walls, in metres from the origin."""

    width_m: float
    length_m: float


class Visualization(NamedTuple):
    """What the greenhouse config says about drawings."""

    footprint: Footprint
    colour_ranges: dict[str, tuple[float, float]]  # lowest and highest value by sensor, in its unit


def read_visualization(layout: Layout, sim_config_file: str = '') -> Visualization:
    """
    Return the walls and the colour scales of the greenhouse config, which are the same in every run.

    '' selects the config of mdp-greenhouse if it is installed. Without a config, the walls enclose the tags
    and tables, and no sensor has a colour scale. Raises StartUpError.
    """
    path = sim_config_file or shipped_file('greenhouse_config.yaml')
    if not path:
        corners = [
            *(tag[:2] for tag in layout.tags.values()),
            *(table[2:] for table in layout.tables.values()),
        ]
        return Visualization(Footprint(*map(max, zip(*corners, strict=True))), {})
    where = f"sim_config_file '{path}'"
    config = read_yaml(path, where, 'a greenhouse config has 4 levels')
    section = mapping_of(config if isinstance(config, dict) else {}, 'visualization', where)
    where += ': visualization'
    walls = [number(section, f'greenhouse_{side}_m', where, 'metres') for side in ('width', 'height')]
    ranges = {}
    if section.get('colorbar_ranges'):
        ranges = mapping_of(section, 'colorbar_ranges', where)
        where += ': colorbar_ranges'
    return Visualization(
        Footprint(*map(float, walls)), {str(sensor): _range(ranges, sensor, where) for sensor in ranges}
    )


def _range(ranges: dict, sensor, where: str) -> tuple[float, float]:
    limits = mapping_of(ranges, sensor, where)
    here = f'{where}: {escaped(str(sensor), 64)}'
    lowest, highest = (number(limits, key, here, 'the unit of the sensor') for key in ('min', 'max'))
    return float(lowest), float(highest)
