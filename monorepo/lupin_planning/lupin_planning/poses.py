"""Poses in the plane, as numbers and as messages. The planner can import this module without ROS."""

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from geometry_msgs.msg import Pose


class PoseInPlane(NamedTuple):
    """A pose on the floor: metres, and radians counter-clockwise from the x axis."""

    x: float
    y: float
    yaw: float


def quaternion_of(yaw: float) -> tuple[float, float, float, float]:
    """Return x, y, z and w of the quaternion of a yaw in radians."""
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


def pose_message(x: float, y: float, yaw: float, z: float = 0.0) -> 'Pose':
    """Return the geometry_msgs/Pose at x and y in metres, with a yaw in radians."""
    from geometry_msgs.msg import Point, Pose, Quaternion

    orientation = Quaternion(**dict(zip('xyzw', quaternion_of(yaw), strict=True)))
    return Pose(position=Point(x=x, y=y, z=z), orientation=orientation)


def pose_in_plane(message: 'Pose') -> PoseInPlane:
    """Return the position and the yaw of a geometry_msgs/Pose in the plane."""
    x, y, z, w = (getattr(message.orientation, axis) for axis in 'xyzw')
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return PoseInPlane(message.position.x, message.position.y, yaw)
