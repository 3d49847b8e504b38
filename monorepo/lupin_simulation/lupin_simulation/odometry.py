"""Where the robot of a simulation stands, by its odometry."""

from lupin_greenhouse_bridge.runtime.poses import PoseInPlane, pose_in_plane
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy

ODOMETRY_TOPIC = 'odom'  # relative: a namespace moves it


class RobotPose:
    """Listens to `odom`. Its frame is the layout's: a simulated robot does not slip."""

    def __init__(self, node):
        self.newest: PoseInPlane | None = None  # None before the first message
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # fits every publisher
        node.create_subscription(Odometry, ODOMETRY_TOPIC, self._on_odometry, newest)

    def _on_odometry(self, message) -> None:
        self.newest = pose_in_plane(message.pose.pose)
