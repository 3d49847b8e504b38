"""The simulated robot: a disc that follows a path, and does not arrive exactly at its goal. No ROS."""

import itertools
import math
import random
from collections.abc import Iterable

import numpy as np
from lupin_planning.grid import Grid
from lupin_planning.poses import PoseInPlane

from lupin_simulation.settings import Settings

TURN_RAD_PER_S = 1.5

Point = tuple[float, float]


class DiscRobot:
    """Turns on the spot, and drives straight from one point of its path to the next."""

    def __init__(self, start: PoseInPlane, speed_m_per_s: float) -> None:
        """Stand at the start."""
        # The path until the last stop. A point that occurs twice in a row is a place where the robot stood.
        self.route: list[Point] = [start[:2]]
        self._speed_m_per_s, self._seconds = speed_m_per_s, 0.0
        self._plan(start, [], start.yaw)

    def follow(self, path: Iterable[Point], yaw: float) -> None:
        """Follow a new path, which begins where the robot is, and turn to this direction at its end."""
        start, is_passed = self.pose, self._times[::2] <= self._seconds
        self.route += [*itertools.compress(self._points[1:], is_passed[1:]), start[:2]]
        self._plan(start, path, yaw)

    def stop(self) -> None:
        """Stand still."""
        self.follow([], self.pose.yaw)

    def advance(self, seconds: float) -> None:
        """Move for this time, or until the end of the path."""
        self._seconds = min(self._seconds + seconds, self._times[-1])

    @property
    def is_moving(self) -> bool:
        """Whether the robot still drives, or turns at the end of its path."""
        return bool(self._seconds < self._times[-1])

    @property
    def pose(self) -> PoseInPlane:
        """Where the robot is."""
        if not self.is_moving:
            return self._end
        x, y, yaw = (float(np.interp(self._seconds, self._times, column)) for column in self._poses.T)
        return PoseInPlane(x, y, yaw)

    @property
    def left_m(self) -> float:
        """The length of the rest of the path in metres."""
        return float(self._driven_m[-1] - np.interp(self._seconds, self._times, self._driven_m))

    def _plan(self, start: PoseInPlane, path: Iterable[Point], yaw: float) -> None:
        """Compute the times of a drive, with two poses at each point: before and after the turn there."""
        self._points = [point for point, _ in itertools.groupby([start[:2], *path])]
        self._end = PoseInPlane(*self._points[-1], yaw)
        x, y = np.array(self._points).T
        headings = np.arctan2(np.diff(y), np.diff(x))
        yaws = np.unwrap([start.yaw, *headings, yaw])  # takes the shorter turn
        self._poses = np.column_stack([np.repeat(x, 2), np.repeat(y, 2), np.repeat(yaws, 2)[1:-1]])
        dx, dy, turn = np.diff(self._poses, axis=0).T
        steps_m = np.hypot(dx, dy)
        self._driven_m = np.cumsum([0.0, *steps_m])
        self._times = np.cumsum([0.0, *(steps_m / self._speed_m_per_s + np.abs(turn) / TURN_RAD_PER_S)])
        self._seconds = 0.0


def arrival_at(goal: PoseInPlane, settings: Settings, chance: random.Random, grid: Grid) -> PoseInPlane:
    """Return the pose at which a robot stops, with a random error. An obstacle stops it earlier."""
    distance_m = chance.uniform(0.0, settings.arrival_error_m)
    direction = chance.uniform(-math.pi, math.pi)
    yaw = goal.yaw + chance.uniform(-settings.arrival_error_rad, settings.arrival_error_rad)
    step_m = distance_m * np.array([math.cos(direction), math.sin(direction)])
    points = goal[:2] + np.linspace(0.0, 1.0, 50)[:, None] * step_m
    is_free = grid.are_free(points)
    x, y = points[-1] if is_free.all() else points[max(np.argmin(is_free) - 1, 0)]
    return PoseInPlane(float(x), float(y), yaw)
