"""
A camera for tests and simulations: publishes rendered images of the tag that the mission stands at.

Subscribes to `mission/at_tag`. Between two tags, and for an id outside tag36h11, it shows a bare wall.
"""

import sys
from dataclasses import dataclass

import cv2
import numpy as np
from lupin_greenhouse_bridge.node.parameters import check_parameters, declare_parameters, parameter
from lupin_greenhouse_bridge.node.run import run
from lupin_greenhouse_bridge.on_sight.detections import detection_messages
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import String

from lupin_perception import scene
from lupin_perception.confirmation import TAG_COUNT
from lupin_perception.settings import TOPICS, check_source

NODE_NAME = 'camera'
FRAMES_PER_SECOND = 8
JPEG_QUALITY = 80
AT_TAG_TOPIC = 'mission/at_tag'


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    publishes: str = parameter(
        'image', 'image, compressed (JPEG), or detections (of AprilTag 3 in the image).'
    )

    def __post_init__(self):
        check_parameters(self)
        check_source('publishes', self.publishes)


class CameraStandIn(Node):
    """Publishes images that vary in distance, angle, blur and noise."""

    def __init__(self):
        super().__init__(NODE_NAME)
        publishes = declare_parameters(self, Settings).publishes
        self._random = np.random.default_rng(0)
        self._camera = scene.Camera()
        self._tag_id = ''
        message_type, self._message_of = {
            'image': lambda: (Image, image_of),
            'compressed': lambda: (CompressedImage, compressed_image_of),
            'detections': detections,
        }[publishes]()
        self._publisher = self.create_publisher(message_type, TOPICS[publishes], qos_profile_sensor_data)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(String, AT_TAG_TOPIC, self._on_tag, latched)
        self.create_timer(1.0 / FRAMES_PER_SECOND, self._publish)

    def _on_tag(self, message) -> None:
        self._tag_id = message.data

    def _publish(self) -> None:
        has_tag = self._tag_id.isdecimal() and int(self._tag_id) < TAG_COUNT
        picture = self._camera.look_at(
            scene.marker(int(self._tag_id), module_pixels=30) if has_tag else None,
            self._random,
            distance_m=self._random.uniform(0.3, 1.0),
            angle_degrees=self._random.uniform(0.0, 40.0),
            blur_pixels=self._random.uniform(0.3, 1.2),
            noise_levels=self._random.uniform(2.0, 8.0),
        )
        message = self._message_of(picture)
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = 'camera'
        self._publisher.publish(message)


def image_of(picture: np.ndarray) -> Image:
    """Return the message of a grey picture."""
    height, width = picture.shape
    return Image(height=height, width=width, encoding='mono8', step=width, data=picture.tobytes())


def compressed_image_of(picture: np.ndarray) -> CompressedImage:
    """Return the message of a grey picture as JPEG."""
    _, data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return CompressedImage(format='mono8; jpeg compressed ', data=data.tobytes())


def detections():
    """Return the message type, and the function that makes a message of the tags in a grey picture."""
    messages = detection_messages()
    from lupin_perception.detector import FAMILY, TagDetector

    detect = TagDetector().detect

    def detections_of(picture):
        array = messages.AprilTagDetectionArray()
        for tag in detect(picture):
            x, y = np.mean(tag.corners, axis=0)
            array.detections.append(
                messages.AprilTagDetection(
                    family=FAMILY,
                    id=tag.tag_number,
                    hamming=tag.hamming,
                    decision_margin=tag.decision_margin,
                    centre=messages.Point(x=x, y=y),
                    corners=[messages.Point(x=float(x), y=float(y)) for x, y in tag.corners],
                )
            )
        return array

    return messages.AprilTagDetectionArray, detections_of


def main(args=None) -> int:
    """Publish until Ctrl-C or SIGTERM."""
    return run(NODE_NAME, CameraStandIn, args)


if __name__ == '__main__':
    sys.exit(main())
