"""
A camera for tests and simulations: publishes rendered images of the tag that the mission stands at.

Subscribes to `mission/at_tag`. Between two tags, and for an id outside tag36h11, it shows a bare wall. With
`from_odometry` it is on the robot instead: it subscribes to `odom`, and shows the tags in view from there.

    ros2 run lupin_simulation fake_camera --ros-args -p publishes:=compressed
"""

from dataclasses import dataclass

import cv2
import numpy as np
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.planning.tag_poses import TagPose, find_tag_poses
from lupin_greenhouse_bridge.planning.walls import find_walls, parse_walls, walls_parameter
from lupin_greenhouse_bridge.reading.detections import detection_messages
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, declare_parameters, parameter
from lupin_greenhouse_bridge.runtime.poses import PoseInPlane, pose_in_plane
from lupin_greenhouse_bridge.runtime.run import run
from lupin_greenhouse_bridge.simulator.layout import require_layout
from lupin_tag_confirmation.confirmation import TAG_COUNT
from lupin_tag_confirmation.settings import TOPICS, check_source
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import String

from lupin_simulation import scene

NODE_NAME = 'camera'
FRAMES_PER_SECOND = 8
JPEG_QUALITY = 80


def from_odometry_parameter():
    """Return the field of a settings dataclass that puts a camera on the robot."""
    return parameter(
        False,
        'True: the camera shows what the robot sees from its pose in the topic `odom`; false: it shows the'
        ' tag that `mission/at_tag` names.',
    )


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    publishes: str = parameter(
        'image',
        'What the camera publishes: image, compressed (JPEG), or detections (the tags that AprilTag 3 finds'
        ' in the image).',
    )
    from_odometry: bool = from_odometry_parameter()
    tag_file: str = parameter(
        '', "The bridge's tag_locations.json, for from_odometry; empty: the one of mdp-greenhouse."
    )
    sim_config_file: str = parameter(
        '', "The bridge's greenhouse_config.yaml, for the walls; empty: the one of mdp-greenhouse."
    )
    walls: str = walls_parameter()  # or an array

    def __post_init__(self):
        check_parameters(self)
        parse_walls(self.walls)
        check_source('publishes', self.publishes)


class CameraNode(Node):
    """A camera that knows the tag of the mission, or the pose of the robot. _look() returns its message."""

    def __init__(self, settings_type):
        super().__init__(NODE_NAME)
        self._settings = declare_parameters(self, settings_type)
        self._random = np.random.default_rng(0)
        self._tag_id = ''  # of the mission; it stays empty on the robot
        self._eye: PoseInPlane | None = None  # on the robot, after its first message

    def _publish(self, message_type, topic: str, frames_per_second: int) -> None:
        """Publish from now on."""
        self._publisher = self.create_publisher(message_type, topic, qos_profile_sensor_data)
        if self._settings.from_odometry:
            newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # fits every publisher
            self.create_subscription(Odometry, 'odom', self._on_odometry, newest)
        else:
            self.create_subscription(String, 'mission/at_tag', self._on_tag, latched())
        self.create_timer(1.0 / frames_per_second, self._on_timer)

    def _on_tag(self, message) -> None:
        self._tag_id = message.data

    def _on_odometry(self, message) -> None:
        """Take the pose, whose frame is that of the layout, because a simulated robot does not slip."""
        self._eye = pose_in_plane(message.pose.pose)

    def _on_timer(self) -> None:
        message = self._look()
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = NODE_NAME
        self._publisher.publish(message)


class FakeCamera(CameraNode):
    """Publishes images that vary in distance, angle, blur and noise."""

    def __init__(self):
        super().__init__(Settings)
        publishes = self._settings.publishes
        self._camera = scene.Camera()
        message_type, self._message_of = {
            'image': lambda: (Image, image_of),
            'compressed': lambda: (CompressedImage, compressed_image_of),
            'detections': detections,
        }[publishes]()
        self._tags = tag_poses_by_number(self._settings) if self._settings.from_odometry else {}
        self._publish(message_type, TOPICS[publishes], FRAMES_PER_SECOND)

    def _look(self):
        conditions = {
            'blur_pixels': self._random.uniform(0.3, 1.2),
            'noise_levels': self._random.uniform(2.0, 8.0),
        }
        if self._eye:
            picture = self._camera.look_around(self._tags, self._eye, self._random, **conditions)
            return self._message_of(picture)
        picture = self._camera.look_at(
            scene.marker(int(self._tag_id), scene.MODULE_PIXELS) if has_marker(self._tag_id) else None,
            self._random,
            distance_m=self._random.uniform(0.3, 1.0),
            angle_degrees=self._random.uniform(0.0, 40.0),
            **conditions,
        )
        return self._message_of(picture)


def has_marker(tag_id: str) -> bool:
    """Return whether this is an id of tag36h11."""
    return tag_id.isdecimal() and int(tag_id) < TAG_COUNT


def tag_poses_by_number(settings: Settings) -> dict[int, TagPose]:
    """Return the position and the direction of each tag of a layout by its number; raises StartUpError."""
    layout = require_layout(settings.tag_file, 'tag_file')
    walls = find_walls(layout, settings.sim_config_file, settings.walls)
    tag_poses = find_tag_poses(layout, walls)
    return {int(tag_id): tag_pose for tag_id, tag_pose in tag_poses.items() if has_marker(tag_id)}


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
    from lupin_tag_confirmation.detector import FAMILY, TagDetector

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
    return run(NODE_NAME, FakeCamera, args)
