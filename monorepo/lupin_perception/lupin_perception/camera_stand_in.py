"""
A camera for a robot that has none: publishes what it would see of the tag that the mission stands at.

Follows `/mission/at_tag`. Between two tags, and at a tag that is no tag36h11 id, it sees a bare wall.
"""

import sys

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String

from lupin_perception import life_cycle, scene

NODE_NAME = 'camera'
FRAMES_PER_SECOND = 8
TAG_COUNT = 587


class CameraStandIn(Node):
    """Publishes `/camera/image_raw`: another distance, angle, blur and noise in each image."""

    def __init__(self):
        super().__init__(NODE_NAME)
        self._random = np.random.default_rng(0)
        self._camera = scene.Camera()
        self._tag_id = ''
        self._images = self.create_publisher(Image, '/camera/image_raw', qos_profile_sensor_data)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(String, '/mission/at_tag', self._on_tag, latched)
        self.create_timer(1.0 / FRAMES_PER_SECOND, self._publish)

    def _on_tag(self, message) -> None:
        self._tag_id = message.data

    def _publish(self) -> None:
        is_tag = self._tag_id.isdecimal() and int(self._tag_id) < TAG_COUNT
        picture = self._camera.look_at(
            scene.marker(int(self._tag_id), module_pixels=30) if is_tag else None,
            self._random,
            distance_m=self._random.uniform(0.4, 1.0),
            angle_degrees=self._random.uniform(0.0, 40.0),
            blur_pixels=self._random.uniform(0.3, 1.2),
            noise_levels=self._random.uniform(2.0, 8.0),
        )
        image = Image(
            height=picture.shape[0],
            width=picture.shape[1],
            encoding='mono8',
            step=picture.shape[1],
            data=picture.tobytes(),
        )
        image.header.stamp = self.get_clock().now().to_msg()
        image.header.frame_id = 'camera'
        self._images.publish(image)


def main(args=None) -> int:
    """Publish until Ctrl-C or SIGTERM."""
    return life_cycle.run(NODE_NAME, CameraStandIn, args)


if __name__ == '__main__':
    sys.exit(main())
