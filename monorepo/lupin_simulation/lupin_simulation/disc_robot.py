"""A disc that follows a path, and the parameters of the navigator around it. Does not import ROS."""

import math
import random
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.free_space import FreeSpace
from lupin_greenhouse_bridge.planning.walls import find_walls, parse_numbers, parse_walls, walls_parameter
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, invalid, parameter
from lupin_greenhouse_bridge.runtime.poses import PoseInPlane
from lupin_greenhouse_bridge.simulator.layout import require_layout

TURN_RAD_PER_S = 1.5  # on the spot, at a speedup of 1


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    nav_action_name: str = parameter('navigate_to_pose', 'The NavigateToPose action to serve.')
    tag_file: str = parameter(
        '', "The bridge's tag_locations.json, for the tables; empty: the one of mdp-greenhouse."
    )
    sim_config_file: str = parameter(
        '', "The bridge's greenhouse_config.yaml, for the walls; empty: the one of mdp-greenhouse."
    )
    walls: str = walls_parameter()  # or an array
    robot_radius_m: float = parameter(0.2, 'The radius of the robot in metres.', smallest=0.01, largest=10.0)
    padding_m: float = parameter(
        0.0,
        "Metres that the planner adds to the radius, like Nav2's footprint_padding: the planner finds no path"
        ' for a robot whose centre is closer to a table than the radius plus this padding.',
        smallest=0.0,
        largest=1.0,
    )
    arrival_error_m: float = parameter(
        0.0,
        'The robot arrives up to this far from its goal, in metres, as within xy_goal_tolerance of Nav2.',
        smallest=0.0,
        largest=1.0,
    )
    arrival_error_rad: float = parameter(
        0.0,
        'When the robot stops, its direction differs by up to this angle from that of its goal, in radians,'
        " as Nav2's yaw_goal_tolerance allows.",
        smallest=0.0,
        largest=math.pi,
    )
    arrival_seed: int = parameter(0, 'Seed of the arrival errors.', smallest=0, largest=2**31 - 1)
    wedged_after: int = parameter(
        -1,
        'After it has reached this many goals, the robot cannot move any more; -1: it always can. The service'
        ' ~/set_wedged wedges or frees the robot at any time.',
        smallest=-1,
        largest=2**31 - 1,
    )
    autostart: bool = parameter(
        True, 'Configure and activate the node at its start; false: wait for ~/change_state.'
    )
    speed_m_per_s: float = parameter(0.5, 'The speed in metres per second.', smallest=0.001, largest=10.0)
    speedup: float = parameter(
        1.0, 'Seconds of driving and turning per second.', smallest=0.001, largest=1000.0
    )
    start_pose: str = parameter(
        '0.5 0.5 0.0',
        'x and y in metres and yaw in radians, where the robot starts, as text or as an array.',
        of_any_type=True,
    )
    blocked: str = parameter(
        '',
        'Obstacles that the mission does not know, x0 y0 x1 y1 in metres each, as text or as an array.',
        of_any_type=True,
    )
    route_file: str = parameter(
        '', 'A CSV file to write, with x and y in metres of the points of the driven path.'
    )

    def __post_init__(self):
        check_parameters(self)
        parse_walls(self.walls)
        if len(parse_numbers(self.start_pose)) != 3:
            raise invalid('start_pose', self.start_pose, 'x, y and yaw: "0.5 0.5 0.0", or an array')
        edges = parse_numbers(self.blocked)
        if (
            (not edges and self.blocked)
            or len(edges) % 4
            or not all(x0 < x1 and y0 < y1 for x0, y0, x1, y1 in self.obstacles)
        ):
            accepted = 'empty, or x0 y0 x1 y1 of each rectangle: "0.0 2.0 1.0 2.5", with x0 < x1 and y0 < y1'
            raise invalid('blocked', self.blocked, accepted)

    @property
    def start(self) -> PoseInPlane:
        """Where the robot starts."""
        return PoseInPlane(*parse_numbers(self.start_pose))

    @property
    def obstacles(self) -> list[tuple[float, float, float, float]]:
        """x0, y0, x1 and y1 of each obstacle."""
        edges = iter(parse_numbers(self.blocked))
        return list(zip(edges, edges, edges, edges, strict=False))

    def free_space(self, padding_m: float = 0.0) -> FreeSpace:
        """Return the free space, with the obstacles; raises StartUpError if it cannot start there."""
        layout = require_layout(self.tag_file, 'tag_file')
        obstacles = {f'blocked {number}': edges for number, edges in enumerate(self.obstacles, 1)}
        walls = find_walls(layout, self.sim_config_file, self.walls)
        layout = layout._replace(tables={**layout.tables, **obstacles})
        free_space = FreeSpace(layout, walls, self.robot_radius_m + padding_m)
        if not free_space.is_free(*self.start[:2]):
            raise StartUpError(
                f'parameter start_pose is {self.start_pose}: a robot of radius {self.robot_radius_m:g} m'
                ' does not fit there: choose another, or change blocked'
            )
        return free_space


class ArrivalError:
    """The error between the pose at which a robot stops and the pose of its goal."""

    def __init__(self, settings: Settings):
        """Take the sizes of the errors, their seed, and the tables; raises StartUpError."""
        self._largest_m, self._largest_rad = settings.arrival_error_m, settings.arrival_error_rad
        self._random = random.Random(settings.arrival_seed)  # noqa: S311 - not for cryptography
        self._free_space = settings.free_space()  # without the padding: only a table stops the robot

    def applied_to(self, goal: PoseInPlane) -> PoseInPlane:
        """Return the pose at which the robot stops, which is never in a table."""
        distance_m = self._random.uniform(0.0, self._largest_m)
        direction = self._random.uniform(-math.pi, math.pi)
        yaw = goal.yaw + self._random.uniform(-self._largest_rad, self._largest_rad)
        step_m = distance_m * np.array([math.cos(direction), math.sin(direction)])
        points = goal[:2] + np.linspace(0.0, 1.0, 50)[:, None] * step_m
        is_free = self._free_space.are_free(points)
        reached = points[-1] if is_free.all() else points[max(np.argmin(is_free) - 1, 0)]
        return PoseInPlane(*reached.tolist(), yaw)


class DiscRobot:
    """Turns on the spot, and drives straight from one point of its path to the next."""

    def __init__(self, start: PoseInPlane, speed_m_per_s: float):
        self.pose = start
        self.route: list[tuple[float, float]] = [start[:2]]  # where it has driven
        self._speed_m_per_s = speed_m_per_s
        self._path: deque[tuple[float, float]] = deque()
        self._yaw = start.yaw  # at the end of the path

    @property
    def left_m(self) -> float:
        """The length of the rest of the path in metres."""
        return float(FreeSpace.length_m([self.pose[:2], *self._path]))

    @property
    def is_moving(self) -> bool:
        """Whether the robot has not yet reached the end of its path, or not yet its direction there."""
        return bool(self._path) or self.pose.yaw != self._yaw

    def follow(self, path: Iterable[tuple[float, float]], yaw: float) -> None:
        """Follow a new path, and turn to this direction at its end."""
        self.stop()
        self._path.extend(path)
        self._yaw = yaw

    def stop(self) -> None:
        """Stand still."""
        self._path.clear()
        self._yaw = self.pose.yaw
        self._note_point()

    def advance(self, seconds: float) -> None:
        """Move for this time, or until the end of the path."""
        while self._path and seconds > 0.0:
            x, y = self._path[0]
            dx, dy = x - self.pose.x, y - self.pose.y
            left_m = math.hypot(dx, dy)
            if left_m > 0.0:
                seconds = self._turn(math.atan2(dy, dx), seconds)
            step_m = min(seconds * self._speed_m_per_s, left_m)
            seconds -= step_m / self._speed_m_per_s
            if step_m == left_m:
                self.pose = PoseInPlane(x, y, self.pose.yaw)
                self._path.popleft()
                self._note_point()
            else:
                share = step_m / left_m
                self.pose = PoseInPlane(self.pose.x + share * dx, self.pose.y + share * dy, self.pose.yaw)
        if not self._path:
            self._turn(self._yaw, seconds)

    def _turn(self, yaw: float, seconds: float) -> float:
        """Turn for at most this time; return what is left of it."""
        angle = math.remainder(yaw - self.pose.yaw, 2 * math.pi)
        turned = min(seconds * TURN_RAD_PER_S, abs(angle))
        self.pose = self.pose._replace(
            yaw=yaw if turned == abs(angle) else self.pose.yaw + math.copysign(turned, angle)
        )
        return max(seconds - turned / TURN_RAD_PER_S, 0.0)

    def _note_point(self) -> None:
        if self.pose[:2] != self.route[-1]:
            self.route.append(self.pose[:2])
