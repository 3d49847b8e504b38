"""
A camera for tests and simulations: publishes rendered images of the tag that the mission stands at.

Subscribes to `mission/at_tag`. Between two tags, and for an id outside tag36h11, it shows a bare wall. With
`from_odometry` it is on the robot instead: it subscribes to `odom`, and shows the tags in view from there.

    ros2 run lupin_simulation fake_camera --ros-args -p publishes:=compressed
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import names_text
from lupin_greenhouse_bridge.runtime.parameters import declare_parameters, parameter
from lupin_greenhouse_bridge.runtime.run import run
from lupin_planning.poses import PoseInPlane, pose_in_plane
from lupin_planning.tag_poses import TagPose, find_tag_poses
from lupin_readings.detections import detection_messages
from lupin_tag_confirmation.confirmation import TAG_NUMBERS, Detection
from lupin_tag_confirmation.settings import TOPICS, check_source
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import String

from lupin_simulation.pinhole_camera import PinholeCamera
from lupin_simulation.settings import LayoutSettings

NODE_NAME = 'camera'
FRAMES_PER_SECOND = 8


@dataclass(frozen=True)
class Settings(LayoutSettings):
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    publishes: str = parameter('image', 'What the camera publishes: image, compressed, or detections.')
    from_odometry: bool = parameter(
        False, 'Show the view from the pose in `odom`; false: the tag that `mission/at_tag` names.'
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_source('publishes', self.publishes)

    def tag_poses(self) -> dict[int, TagPose]:
        """Return the pose of each tag of tag36h11 in the layout by its number; raises StartUpError."""
        poses = find_tag_poses(*self.read_layout())
        return {TAG_NUMBERS[tag_id]: pose for tag_id, pose in poses.items() if tag_id in TAG_NUMBERS}


class FakeCamera(Node):
    """Publishes images that vary in distance, angle, blur and noise."""

    def __init__(self) -> None:
        """Read the layout for a camera on the robot; raises StartUpError."""
        super().__init__(NODE_NAME)
        settings = declare_parameters(self, Settings)
        self._camera, self._random = PinholeCamera(), np.random.default_rng(0)
        self._tag_poses: dict[int, TagPose] = {}
        self._tag_id = ''  # from mission/at_tag; stays empty with from_odometry
        self._eye: PoseInPlane | None = None  # the pose in the last odometry
        message_type, self._message_of = message_maker(settings.publishes)
        topic = TOPICS[settings.publishes]
        self._publisher: Any = self.create_publisher(message_type, topic, qos_profile_sensor_data)
        if settings.from_odometry:
            self._tag_poses = settings.tag_poses()
            tag_ids = settings.read_layout()[0].tags
            if outside := [tag_id for tag_id in tag_ids if tag_id not in TAG_NUMBERS]:
                shown = names_text('tag', outside, 3)
                self.get_logger().warning(f'no image shows {shown}: not in tag36h11, which has 0 to 586')
            newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # fits every publisher
            source = self.create_subscription(Odometry, 'odom', self._on_odometry, newest)
        else:
            source = self.create_subscription(String, 'mission/at_tag', self._on_tag, latched())
        self.create_timer(1.0 / FRAMES_PER_SECOND, self._on_timer)
        seen = 'the tags ahead of the pose in' if settings.from_odometry else 'the tag that is named on'
        self.get_logger().info(f'ready: {self._publisher.topic_name} shows {seen} {source.topic_name}')

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

    def _picture_message(self) -> Any:
        """Return the message of what the camera sees now, without its header."""
        random = self._random
        blur_pixels, noise_levels = random.uniform(0.3, 1.2), random.uniform(2.0, 8.0)
        if self._eye:
            scene = self._camera.scene_from(self._eye, self._tag_poses, random)
        elif self._tag_id in TAG_NUMBERS:
            distance_m, angle_degrees = random.uniform(0.3, 1.0), random.uniform(0.0, 40.0)
            number = TAG_NUMBERS[self._tag_id]
            scene = self._camera.scene_of_tag(number, random, distance_m, angle_degrees)
        else:
            scene = self._camera.wall(random)
        return self._message_of(self._camera.expose(scene, random, blur_pixels, noise_levels))


def message_maker(publishes: str) -> tuple[type, Callable[[np.ndarray], Any]]:
    """
    Return the type of the messages, and the function that makes one from a grey picture.

    Raises StartUpError if apriltag_msgs is missing, which detections need.
    """
    if publishes == 'detections':
        from lupin_tag_confirmation.detector import TagDetector  # late: only detections need AprilTag 3

        detector = TagDetector()
        message_type = detection_messages().AprilTagDetectionArray
        return message_type, lambda picture: detections_of(detector.detect(picture))
    return {'image': (Image, image_of), 'compressed': (CompressedImage, compressed_image_of)}[publishes]


def image_of(picture: np.ndarray) -> Image:
    """Return the message of a grey picture."""
    height, width = picture.shape
    return Image(height=height, width=width, encoding='mono8', step=width, data=picture.tobytes())


def compressed_image_of(picture: np.ndarray) -> CompressedImage:
    """Return the message of a grey picture as JPEG."""
    data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
    return CompressedImage(format='mono8; jpeg compressed ', data=data)


def detections_of(tags: list[Detection]) -> Any:
    """Return the message of detected tags."""
    messages = detection_messages()
    array = messages.AprilTagDetectionArray()
    for number, hamming, margin, corners in tags:
        centre, *points = (
            messages.Point(x=float(x), y=float(y)) for x, y in [corners.mean(axis=0), *corners]
        )
        detection = messages.AprilTagDetection(
            family='tag36h11',
            id=number,
            hamming=hamming,
            decision_margin=margin,
            centre=centre,
            corners=points,
        )
        array.detections.append(detection)
    return array


def main(args: list[str] | None = None) -> int:
    """Publish until Ctrl-C or SIGTERM."""
    return run(NODE_NAME, FakeCamera, args)
