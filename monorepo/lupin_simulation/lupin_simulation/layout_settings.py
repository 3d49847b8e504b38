"""The parameters by which a simulated node finds the greenhouse. Does not import ROS."""

from dataclasses import dataclass

from lupin_greenhouse_bridge.planning.walls import Walls, find_walls, parse_walls, walls_parameter
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, parameter
from lupin_greenhouse_bridge.simulator.layout import Layout, require_layout


@dataclass(frozen=True)
class LayoutSettings:
    """The validated files and walls of a greenhouse. Raises StartUpError for an invalid value."""

    tag_file: str = parameter('', "The bridge's tag_locations.json; empty: the simulator's.")
    sim_config_file: str = parameter(
        '', "The bridge's greenhouse_config.yaml, for the walls; empty: the simulator's."
    )
    walls: str = walls_parameter()

    def __post_init__(self) -> None:
        check_parameters(self)
        parse_walls(self.walls)

    def read_layout(self) -> tuple[Layout, Walls]:
        """Return the layout and its walls, both in metres; raises StartUpError for a malformed file."""
        layout = require_layout(self.tag_file, 'tag_file')
        return layout, find_walls(layout, self.sim_config_file, self.walls)
