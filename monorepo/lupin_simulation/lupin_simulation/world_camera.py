"""
`ros2 run lupin_simulation world_camera`: publishes images of the tag that the mission stands at.

Subscribes to `mission/at_tag`. Between two tags it shows the sky. The position, angle and distance vary from
image to image. With `from_odometry` it is on the robot instead: it subscribes to `odom`.

    ros2 run lupin_simulation world_camera --ros-args -p world_file:=.world/greenhouse.sdf
"""

from dataclasses import dataclass

import cv2
import numpy as np
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, parameter
from lupin_greenhouse_bridge.runtime.run import run
from lupin_tag_confirmation.settings import TOPICS
from sensor_msgs.msg import Image

from lupin_simulation.camera_node import NODE_NAME, CameraNode, from_odometry_parameter, image_of
from lupin_simulation.rendered_world import RenderedWorld, TagModel, View, view_ahead, viewpoint

FRAMES_PER_SECOND = 5
NEAREST_M, FARTHEST_M = 0.3, 1.0
LARGEST_ANGLE_DEGREES, LARGEST_OFFSET_M = 30.0, 0.03


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    world_file: str = parameter('', 'The SDF world.')
    from_odometry: bool = from_odometry_parameter()

    def __post_init__(self) -> None:
        check_parameters(self)


class WorldCamera(CameraNode):
    """Publishes rendered images."""

    def __init__(self) -> None:
        """Open the world; raises StartUpError."""
        super().__init__(Settings)
        self._world = RenderedWorld(self._settings.world_file)
        self._tags = {str(number): tag for number, tag in self._world.tags.items()}
        self._start(Image, TOPICS['image'], FRAMES_PER_SECOND)
        self.get_logger().info(f'ready: {len(self._tags)} tags in the world')

    def _picture_message(self) -> Image:
        tag = self._tags.get(self._tag_id)
        view = view_ahead(*self._eye) if self._eye else view_of(tag, self._random)
        # Grey: on a busy machine, best effort loses images of 900 kB.
        return image_of(cv2.cvtColor(self._world.look(*view), cv2.COLOR_RGB2GRAY))


def view_of(tag: TagModel | None, random: np.random.Generator) -> View:
    """Return a random view of a tag, or one of the sky if there is no tag."""
    if tag is None:
        return View(np.array([0.0, 0.0, 1.0]), np.array([-1.0, 0.0, 2.0]))
    distance_m = random.uniform(NEAREST_M, FARTHEST_M)
    angle = random.uniform(-LARGEST_ANGLE_DEGREES, LARGEST_ANGLE_DEGREES)
    eye_offset_m, at_offset_m = random.uniform(-LARGEST_OFFSET_M, LARGEST_OFFSET_M, 2)
    eye = viewpoint(tag, distance_m, angle) + eye_offset_m * tag.to_right
    return View(eye, tag.centre + at_offset_m * tag.to_right)


def main(args: list[str] | None = None) -> int:
    """Publish until Ctrl-C or SIGTERM."""
    return run(NODE_NAME, WorldCamera, args)
