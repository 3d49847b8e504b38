"""Where the layout lies in the robot's map: a rotation and a shift in the plane. Does not import ROS."""

import math
from typing import NamedTuple


class Transform(NamedTuple):
    """The pose of the layout's frame in the map: metres, and radians counter-clockwise."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def point(self, x: float, y: float) -> tuple[float, float]:
        """Return a point of the layout in the map."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return self.x + cos * x - sin * y, self.y + sin * x + cos * y

    def heading(self, yaw: float) -> float:
        """Return a direction of the layout in the map, in [-pi, pi]."""
        return math.remainder(yaw + self.yaw, 2 * math.pi)
