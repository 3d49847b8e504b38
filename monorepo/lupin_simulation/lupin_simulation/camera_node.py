"""A simulated camera: it looks at the tag that the mission stands at, or ahead from where the robot is."""

from abc import abstractmethod
from typing import Any

import numpy as np
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.runtime.parameters import declare_parameters, parameter
from lupin_greenhouse_bridge.runtime.poses import PoseInPlane, pose_in_plane
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String

NODE_NAME = 'camera'


def from_odometry_parameter() -> Any:
    """Return the field of a settings dataclass that puts a camera on the robot."""
    return parameter(
        False, 'Show the view from the pose in `odom`; false: the tag that `mission/at_tag` names.'
    )


class CameraNode(Node):
    """Knows the tag of the mission or, with the parameter from_odometry, the pose of the robot."""

    def __init__(self, settings_type: type) -> None:
        super().__init__(NODE_NAME)
        self._settings: Any = declare_parameters(self, settings_type)
        self._random = np.random.default_rng(0)
        self._tag_id = ''  # of the mission; on the robot it stays empty
        self._eye: PoseInPlane | None = None  # of the robot, once its odometry has arrived

    @abstractmethod
    def _picture_message(self) -> Any:
        """Return the message of what the camera sees now, without its header."""

    def _start(self, message_type: type, topic: str, frames_per_second: int) -> str:
        """Publish from now on; return the topic that tells what to show."""
        self._publisher: Any = self.create_publisher(message_type, topic, qos_profile_sensor_data)
        if self._settings.from_odometry:
            newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # fits every publisher
            source = self.create_subscription(Odometry, 'odom', self._on_odometry, newest)
        else:
            source = self.create_subscription(String, 'mission/at_tag', self._on_tag, latched())
        self.create_timer(1.0 / frames_per_second, self._on_timer)
        return source.topic_name

    def _on_tag(self, message: String) -> None:
        self._tag_id = message.data

    def _on_odometry(self, message: Odometry) -> None:
        """Take the pose. Its frame is that of the layout, because a simulated robot does not slip."""
        self._eye = pose_in_plane(message.pose.pose)

    def _on_timer(self) -> None:
        message = self._picture_message()
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = NODE_NAME
        self._publisher.publish(message)


def image_of(picture: np.ndarray) -> Image:
    """Return the message of a grey picture."""
    height, width = picture.shape
    return Image(height=height, width=width, encoding='mono8', step=width, data=picture.tobytes())
