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
from lupin_greenhouse_bridge.planning.tag_poses import TagPose, find_tag_poses
from lupin_greenhouse_bridge.planning.walls import find_walls, parse_walls, walls_parameter
from lupin_greenhouse_bridge.reading.detections import detection_messages
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, parameter
from lupin_greenhouse_bridge.runtime.run import run
from lupin_greenhouse_bridge.simulator.layout import require_layout
from lupin_tag_confirmation.confirmation import TAG_NUMBERS, Detection
from lupin_tag_confirmation.settings import TOPICS, check_source
from sensor_msgs.msg import CompressedImage, Image

from lupin_simulation.camera_node import NODE_NAME, CameraNode, from_odometry_parameter, image_of
from lupin_simulation.pinhole_camera import PinholeCamera

FRAMES_PER_SECOND = 8
JPEG_QUALITY = 80


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    publishes: str = parameter('image', 'What the camera publishes: image, compressed, or detections.')
    from_odometry: bool = from_odometry_parameter()
    tag_file: str = parameter('', "The bridge's tag_locations.json; empty: the simulator's.")
    sim_config_file: str = parameter('', "The bridge's greenhouse_config.yaml; empty: the simulator's.")
    walls: str = walls_parameter()

    def __post_init__(self) -> None:
        check_parameters(self)
        parse_walls(self.walls)
        check_source('publishes', self.publishes)


class FakeCamera(CameraNode):
    """Publishes images that vary in distance, angle, blur and noise."""

    def __init__(self) -> None:
        """Read the layout for a camera on the robot; raises StartUpError."""
        super().__init__(Settings)
        self._camera = PinholeCamera()
        self._tag_poses = tag_poses_by_number(self._settings) if self._settings.from_odometry else {}
        message_type, self._message_of = message_maker(self._settings.publishes)
        self._start(message_type, TOPICS[self._settings.publishes], FRAMES_PER_SECOND)

    def _picture_message(self) -> Any:
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


def tag_poses_by_number(settings: Settings) -> dict[int, TagPose]:
    """Return the pose of each tag of tag36h11 in a layout by its number; raises StartUpError."""
    layout = require_layout(settings.tag_file, 'tag_file')
    walls = find_walls(layout, settings.sim_config_file, settings.walls)
    tag_poses = find_tag_poses(layout, walls)
    return {TAG_NUMBERS[tag_id]: each for tag_id, each in tag_poses.items() if tag_id in TAG_NUMBERS}


def message_maker(publishes: str) -> tuple[type, Callable[[np.ndarray], Any]]:
    """
    Return the type of the messages, and the function that makes one from a grey picture.

    Raises StartUpError if apriltag_msgs is missing, which detections need.
    """
    if publishes == 'detections':
        from lupin_tag_confirmation.detector import TagDetector  # late: only detections need AprilTag 3

        detector = TagDetector()
        return detection_messages().AprilTagDetectionArray, lambda each: detections_of(detector.detect(each))
    return {'image': (Image, image_of), 'compressed': (CompressedImage, compressed_image_of)}[publishes]


def compressed_image_of(picture: np.ndarray) -> CompressedImage:
    """Return the message of a grey picture as JPEG."""
    _, data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return CompressedImage(format='mono8; jpeg compressed ', data=data.tobytes())


def detections_of(tags: list[Detection]) -> Any:
    """Return the message of detected tags."""
    messages = detection_messages()
    array = messages.AprilTagDetectionArray()
    for tag in tags:
        x, y = np.mean(tag.corners, axis=0)
        detection = messages.AprilTagDetection(
            family='tag36h11',
            id=tag.tag_number,
            hamming=tag.hamming,
            decision_margin=tag.decision_margin,
            centre=messages.Point(x=x, y=y),
            corners=[messages.Point(x=float(x), y=float(y)) for x, y in tag.corners],
        )
        array.detections.append(detection)
    return array


def main(args: list[str] | None = None) -> int:
    """Publish until Ctrl-C or SIGTERM."""
    return run(NODE_NAME, FakeCamera, args)
