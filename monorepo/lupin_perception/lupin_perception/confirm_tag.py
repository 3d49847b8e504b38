"""ROS 2 node `/perception/confirm_tag`: tells whether the camera sees the tag that the robot expects."""

import sys
import time

from lupin_msgs.srv import ConfirmTag
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.task import Future
from sensor_msgs.msg import Image

from lupin_perception import life_cycle
from lupin_perception.confirmation import Confirmer, Frame, UnknownTagId
from lupin_perception.errors import StartUpError
from lupin_perception.images import UnusableImage, grey_picture
from lupin_perception.settings import Settings

NODE_NAME = 'confirm_tag'
MOST_REFUSALS_LOGGED = 10
LOOK_EVERY_SECONDS = 0.05


class ConfirmTagNode(Node):
    """Listens to a camera, and watches it for a tag while the service asks for one."""

    def __init__(self):
        """Offer the service; raises StartUpError."""
        super().__init__(NODE_NAME, namespace='perception')
        self._settings = settings = life_cycle.declare_parameters(self, Settings)
        self._confirmer = Confirmer(_detector().detect, settings)
        self._refusals = set()
        self._news = Future()  # done when there is something new to look at; then there is another one
        self._watchers = 0
        # Best effort: hears every camera, whatever it offers.
        self.create_subscription(Image, settings.image_topic, self._on_image, qos_profile_sensor_data)
        self.create_service(
            ConfirmTag,
            'confirm_tag',
            self._confirm,
            qos_profile=QoSProfile(depth=life_cycle.SERVICE_DEPTH),
            callback_group=ReentrantCallbackGroup(),  # several callers wait at once
        )
        # Runs only while somebody waits; by a clock that neither jumps nor stops.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(LOOK_EVERY_SECONDS, self._tell_news, clock=clock)
        self._timer.cancel()
        self.get_logger().info(f'ready: images from {self.resolve_topic_name(settings.image_topic)}')

    def _on_image(self, image) -> None:
        try:
            picture = grey_picture(image.encoding, image.height, image.width, image.step, image.data)
        except UnusableImage as error:
            self._confirmer.refusal = str(error)
            # Once, and not for every image of a stream, also when the stream invents encodings.
            if image.encoding not in self._refusals and len(self._refusals) < MOST_REFUSALS_LOGGED:
                self._refusals.add(image.encoding)
                self.get_logger().error(f'image refused: {error}')
            return
        stamp_seconds = image.header.stamp.sec + image.header.stamp.nanosec * 1e-9
        self._confirmer.add(Frame(picture, stamp_seconds, time.monotonic()))
        self._tell_news()

    def _tell_news(self) -> None:
        news, self._news = self._news, Future()
        news.set_result(None)
        if not self._watchers:
            self._timer.cancel()

    async def _confirm(self, request, response):
        """Answer as soon as the camera shows the tag; the executor goes on while this waits."""
        response.tag_pose_in_map.orientation.w = 0.0  # never populated; ROS's own default is 1
        deadline = time.monotonic() + self._settings.timeout_seconds
        self._watchers += 1
        self._timer.reset()
        try:
            self._look(request.expected_tag_id, response)
            while not response.detected and time.monotonic() < deadline:
                await self._news
                self._look(request.expected_tag_id, response)
        except UnknownTagId as error:
            response.error_message = str(error)
        finally:
            self._watchers -= 1
        return response

    def _look(self, tag_id: str, response) -> None:
        stamp_now_seconds = self.get_clock().now().nanoseconds * 1e-9
        response.detection_confidence, response.error_message = self._confirmer.confirm(
            tag_id, stamp_now_seconds, time.monotonic()
        )
        response.detected = not response.error_message


def _detector():
    try:
        from lupin_perception.detector import TagDetector  # here, so that a missing OpenCV is one line

        return TagDetector()
    except (ImportError, AttributeError) as error:
        raise StartUpError(
            f'OpenCV with its aruco module is needed ({error}): sudo apt install python3-opencv'
        ) from error


def main(args=None):
    """Serve until Ctrl-C or SIGTERM (exit 0); what cannot be served is one FATAL line (exit 1)."""
    return life_cycle.run(NODE_NAME, ConfirmTagNode, args)


if __name__ == '__main__':
    sys.exit(main())
