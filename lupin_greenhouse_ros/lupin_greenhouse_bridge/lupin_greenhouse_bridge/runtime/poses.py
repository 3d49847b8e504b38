# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Poses in the plane, as numbers and as messages. Does not import ROS at the top, for those who only plan."""

import math
from typing import NamedTuple


class PoseInPlane(NamedTuple):
    """A pose on the floor: metres, and radians counter-clockwise from the x axis."""

    x: float
    y: float
    yaw: float


def quaternion_of(yaw: float) -> tuple[float, float, float, float]:
    """Return x, y, z and w of a turn by radians around the z axis."""
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


def pose_message(x: float, y: float, yaw: float, z: float = 0.0):
    """Return the geometry_msgs/Pose at metres, turned by radians around the z axis."""
    from geometry_msgs.msg import Point, Pose, Quaternion

    orientation = Quaternion(**dict(zip('xyzw', quaternion_of(yaw), strict=True)))
    return Pose(position=Point(x=x, y=y, z=z), orientation=orientation)


def pose_in_plane(message) -> PoseInPlane:
    """Return what a geometry_msgs/Pose says about the plane."""
    x, y, z, w = (getattr(message.orientation, axis) for axis in 'xyzw')
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return PoseInPlane(message.position.x, message.position.y, yaw)
