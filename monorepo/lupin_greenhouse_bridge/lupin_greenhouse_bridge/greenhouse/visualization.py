"""What the greenhouse config says about drawings: the walls and the colour scales. Does not import ROS."""

from typing import NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.greenhouse.files import shipped_file
from lupin_greenhouse_bridge.greenhouse.layout import Layout


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
    try:
        import yaml  # part of every ROS installation

        with open(path, encoding='utf-8') as file:
            section = yaml.safe_load(file)['visualization']
        footprint = Footprint(float(section['greenhouse_width_m']), float(section['greenhouse_height_m']))
        ranges = section.get('colorbar_ranges') or {}
        return Visualization(
            footprint, {sensor: (float(each['min']), float(each['max'])) for sensor, each in ranges.items()}
        )
    except Exception as error:  # PyYAML's constructors leak KeyError, IndexError and others on bad scalars
        raise StartUpError(
            f"'{path}' has no walls or invalid colour ranges ({type(error).__name__}: {error}):"
            ' name the greenhouse_config.yaml that the bridge loads'
        ) from error
