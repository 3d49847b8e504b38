"""The parameters of the simulated nodes. Does not import ROS."""

import math
from dataclasses import dataclass

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, invalid, parameter
from lupin_greenhouse_bridge.simulator.layout import Layout, require_layout
from lupin_planning.grid import Grid
from lupin_planning.poses import PoseInPlane
from lupin_planning.walls import (
    Walls,
    find_walls,
    parse_numbers,
    parse_pose,
    parse_walls,
    walls_parameter,
)


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


@dataclass(frozen=True)
class Settings(LayoutSettings):
    """The validated parameters of the fake navigator; raises StartUpError for an invalid value."""

    nav_action_name: str = parameter('navigate_to_pose', 'The NavigateToPose action to serve.')
    robot_radius_m: float = parameter(0.2, 'The radius of the robot in metres.', smallest=0.01, largest=10.0)
    arrival_error_m: float = parameter(
        0.0, 'How far from its goal the robot stops, at most, in metres.', smallest=0.0, largest=1.0
    )
    arrival_error_rad: float = parameter(
        0.0, 'How far the robot is turned from its goal, at most, in radians.', smallest=0.0, largest=math.pi
    )
    speed_m_per_s: float = parameter(0.5, 'The speed in metres per second.', smallest=0.001, largest=10.0)
    speedup: float = parameter(1.0, 'Driving seconds per real second.', smallest=0.001, largest=1000.0)
    start_pose: str = parameter(
        '0.5 0.5 0.0', 'Where the robot starts: x and y in metres, yaw in radians.', of_any_type=True
    )
    blocked: str = parameter(
        '', 'Obstacles that the mission does not know: x0 y0 x1 y1 in metres.', of_any_type=True
    )
    route_file: str = parameter('', 'A CSV file to write, with x and y of the driven path in metres.')

    def __post_init__(self) -> None:
        super().__post_init__()
        if not parse_pose(self.start_pose):
            raise invalid(
                'start_pose', self.start_pose, 'x, y and yaw in radians: "0.5 0.5 0.0", or an array'
            )
        numbers = parse_numbers(self.blocked)
        are_rectangles = all(x0 < x1 and y0 < y1 for x0, y0, x1, y1 in self.obstacles)
        if not are_rectangles or len(numbers) % 4 or (self.blocked and not numbers):
            accepted = 'empty, or x0 y0 x1 y1 of each rectangle: "0.0 2.0 1.0 2.5", with x0 < x1 and y0 < y1'
            raise invalid('blocked', self.blocked, accepted)

    @property
    def start(self) -> PoseInPlane:
        """Where the robot starts."""
        return PoseInPlane(*parse_numbers(self.start_pose))

    @property
    def obstacles(self) -> list[tuple[float, float, float, float]]:
        """x0, y0, x1 and y1 of each obstacle in metres."""
        edges = iter(parse_numbers(self.blocked))
        return list(zip(edges, edges, edges, edges, strict=False))

    def grid(self) -> Grid:
        """Return the grid, with the obstacles; raises StartUpError if the robot cannot start there."""
        layout, walls = self.read_layout()
        obstacles = {f'blocked {number}': edges for number, edges in enumerate(self.obstacles, 1)}
        layout = layout._replace(tables=layout.tables | obstacles)
        grid = Grid(layout, walls, self.robot_radius_m)
        if not grid.is_free(*self.start[:2]):
            raise StartUpError(
                f'parameter start_pose is {self.start_pose}: a robot of radius {self.robot_radius_m:g} m'
                ' does not fit there: choose another, or change blocked'
            )
        return grid
