"""
`ros2 run lupin_simulation world_camera`: publishes images of the tag that the mission stands at.

Subscribes to `mission/at_tag`. Between two tags it shows the sky. The position, angle and distance vary from
image to image. With `from_odometry` it is on the robot instead: it subscribes to `odom`.

    ros2 run lupin_simulation world_camera --ros-args -p world_file:=.world/greenhouse.sdf
"""

import math
import sys
from dataclasses import dataclass

import cv2
import numpy as np
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, declare_parameters, parameter
from lupin_greenhouse_bridge.runtime.run import run
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String

from lupin_simulation.fake_camera import RobotPose, image_of
from lupin_simulation.view import Tag, ahead, open_world, viewpoint

NODE_NAME = 'camera'
IMAGE_TOPIC, AT_TAG_TOPIC = 'camera/color/image_raw', 'mission/at_tag'  # relative: a namespace moves them
FRAMES_PER_SECOND = 5
STANDOFF_M = (0.3, 1.0)  # from, to
LARGEST_ANGLE_DEGREES = 30.0
LARGEST_OFFSET_M = 0.03
LARGEST_YAW = math.radians(4.0)


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    world_file: str = parameter('', 'The SDF world.')
    from_odometry: bool = parameter(
        False, 'Show what is in view from where `odom` says that the robot is; false: the tag of the mission.'
    )

    def __post_init__(self):
        check_parameters(self)


class WorldCamera(Node):
    """Publishes rendered images."""

    def __init__(self):
        super().__init__(NODE_NAME)
        settings = declare_parameters(self, Settings)
        self._world = open_world(settings.world_file)
        self._tags = {str(number): tag for number, tag in self._world.tags.items()}
        self._random = np.random.default_rng(0)
        self._tag_id = ''
        self._images = self.create_publisher(Image, IMAGE_TOPIC, qos_profile_sensor_data)
        self._robot = RobotPose(self) if settings.from_odometry else None
        self.create_subscription(String, AT_TAG_TOPIC, self._on_tag, latched())
        self.create_timer(1.0 / FRAMES_PER_SECOND, self._publish)
        self.get_logger().info(f'ready: {len(self._tags)} tags in the world')

    def _on_tag(self, message) -> None:
        self._tag_id = message.data

    def _viewpoint(self) -> tuple[np.ndarray, np.ndarray]:
        if self._robot and self._robot.newest:
            return ahead(*self._robot.newest)
        return approach(None if self._robot else self._tags.get(self._tag_id), self._random)

    def _publish(self) -> None:
        picture = self._world.look(*self._viewpoint())
        # Grey: on a busy machine, best effort loses images of 900 kB.
        image = image_of(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
        image.header.stamp = self.get_clock().now().to_msg()
        image.header.frame_id = NODE_NAME
        self._images.publish(image)


def approach(tag: Tag | None, random) -> tuple[np.ndarray, np.ndarray]:
    """Return the position of the camera, and the point that it looks at: in the sky without a tag."""
    if tag is None:
        return np.array([0.0, 0.0, 1.0]), np.array([-1.0, 0.0, 2.0])
    distance_m = random.uniform(*STANDOFF_M)
    angle = random.uniform(-LARGEST_ANGLE_DEGREES, LARGEST_ANGLE_DEGREES)
    offset = random.uniform(-LARGEST_OFFSET_M, LARGEST_OFFSET_M) * tag.to_right
    yaw = math.tan(random.uniform(-LARGEST_YAW, LARGEST_YAW)) * distance_m * tag.to_right
    return viewpoint(tag, distance_m, angle) + offset, tag.centre + offset + yaw


def main(args=None) -> int:
    """Publish until Ctrl-C or SIGTERM."""
    return run(NODE_NAME, WorldCamera, args)


if __name__ == '__main__':
    sys.exit(main())
