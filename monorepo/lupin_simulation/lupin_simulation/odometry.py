"""Where the robot of a simulation stands, by its odometry."""

import math
from typing import NamedTuple

from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy

ODOMETRY_TOPIC = 'odom'  # relative: a namespace moves it


class PoseInPlane(NamedTuple):
    """A pose on the floor."""

    x: float  # metres
    y: float
    yaw: float  # radians to the x axis


class RobotPose:
    """Listens to `odom`. Its frame is the layout's: a simulated robot does not slip."""

    def __init__(self, node):
        self.newest: PoseInPlane | None = None  # None before the first message
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # fits every publisher
        node.create_subscription(Odometry, ODOMETRY_TOPIC, self._on_odometry, newest)

    def _on_odometry(self, message) -> None:
        self.newest = pose_in_plane(message.pose.pose)


def pose_in_plane(message) -> PoseInPlane:
    """Return what a geometry_msgs/Pose says about the plane."""
    x, y, z, w = (getattr(message.orientation, axis) for axis in 'xyzw')
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return PoseInPlane(message.position.x, message.position.y, yaw)
