"""The pose of the robot as a message, and the newest one of its odometry."""

import math

from geometry_msgs.msg import Point, Quaternion
from geometry_msgs.msg import Pose as PoseMessage
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy

from lupin_simulation.disc_robot import Pose

ODOMETRY_TOPIC = 'odom'  # relative: a namespace moves it


class RobotPose:
    """Listens to `odom`. Its frame is the layout's: a simulated robot does not slip."""

    def __init__(self, node):
        self.newest: Pose | None = None  # None before the first message
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # fits every publisher
        node.create_subscription(Odometry, ODOMETRY_TOPIC, self._on_odometry, newest)

    def _on_odometry(self, message) -> None:
        self.newest = pose_of(message.pose.pose)


def pose_of(message: PoseMessage) -> Pose:
    """Return what a message says about the plane."""
    x, y, z, w = (getattr(message.orientation, axis) for axis in 'xyzw')
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return Pose(message.position.x, message.position.y, yaw)


def message_of(pose: Pose) -> PoseMessage:
    """Return the message of a pose in the plane."""
    turn = Quaternion(z=math.sin(pose.yaw / 2), w=math.cos(pose.yaw / 2))
    return PoseMessage(position=Point(x=pose.x, y=pose.y), orientation=turn)
