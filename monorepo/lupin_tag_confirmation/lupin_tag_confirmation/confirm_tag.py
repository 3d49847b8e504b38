"""
ROS 2 node `confirm_tag`: confirms that the camera sees the tag that the robot expects.

ros2 run lupin_tag_confirmation confirm_tag --ros-args -p source:=compressed
"""

import time
from typing import Any

from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.runtime.parameters import declare_parameters
from lupin_greenhouse_bridge.runtime.rclpy_internals import steady_timer, take_message
from lupin_greenhouse_bridge.runtime.run import run
from lupin_msgs.srv import ConfirmTag
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.task import Future
from sensor_msgs.msg import Image

from lupin_tag_confirmation.confirmation import Confirmer, Frame, Moment, Sight, UnknownTagId, tag_number
from lupin_tag_confirmation.drawing import draw
from lupin_tag_confirmation.images import UnusableImage
from lupin_tag_confirmation.settings import TOPICS, Settings
from lupin_tag_confirmation.sources import open_source

NODE_NAME = 'confirm_tag'
SERVICE = 'perception/confirm_tag'
LOOK_EVERY_SECONDS = 0.05
LOG_EVERY_SECONDS = 5.0  # a stream of unusable images must not flood the log


class ConfirmTagNode(Node):
    """Subscribes to a camera, and looks for a tag while a request waits."""

    def __init__(self) -> None:
        """Offer the service; raises StartUpError."""
        super().__init__(NODE_NAME)
        self._settings = settings = declare_parameters(self, Settings)
        message_type, self._sight_of = open_source(settings)
        self._confirmer = Confirmer(settings)
        self._requests_waiting = 0
        self._next_look: Future[None] = Future()  # the waiting requests await it
        # Best effort is compatible with every publisher.
        self._camera = self.create_subscription(
            message_type, TOPICS[settings.source], self._on_message, qos_profile_sensor_data
        )
        self._pictures = self.create_publisher(Image, f'{SERVICE}/seen', 1)
        group = ReentrantCallbackGroup()  # several callers can wait at once
        self.create_service(ConfirmTag, SERVICE, self._confirm, qos_profile=SERVICE_QOS, callback_group=group)
        self._timer = steady_timer(self, LOOK_EVERY_SECONDS, self._let_requests_look)
        self._timer.cancel()  # it runs only while a request waits
        self.get_logger().info(f'ready: images from {self._camera.topic_name}')

    def _on_message(self, message: Any) -> None:
        """Keep the message. It is decoded and searched only on request."""
        stamp_seconds = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        self._confirmer.add(Frame(lambda: self._search(message), stamp_seconds, time.monotonic()))
        if self._requests_waiting:
            self._let_requests_look()

    def _search(self, message: Any) -> Sight:
        try:
            return self._sight_of(message)
        except UnusableImage as error:
            reason = escaped(str(error), 200)
            self.get_logger().error(f'image refused: {reason}', throttle_duration_sec=LOG_EVERY_SECONDS)
            raise UnusableImage(f'an image was refused: {reason}') from error

    def _let_requests_look(self) -> None:
        """Resume the requests that wait."""
        look, self._next_look = self._next_look, Future()
        look.set_result(None)
        if not self._requests_waiting:
            self._timer.cancel()

    async def _confirm(
        self, request: ConfirmTag.Request, response: ConfirmTag.Response
    ) -> ConfirmTag.Response:
        """Reply as soon as the camera shows the tag. The executor continues while this waits."""
        response.tag_pose_in_map.orientation.w = 0.0  # marks the pose as unset; ROS's default is 1
        asked_at = self._now()
        deadline = asked_at.arrival_seconds + self._settings.timeout_seconds
        self._requests_waiting += 1
        self._timer.reset()
        try:
            number = tag_number(request.expected_tag_id)
            while time.monotonic() < deadline:
                self._receive()
                has_searched = self._look(number, asked_at, response)
                if response.detected:
                    return response
                if has_searched and self.executor:
                    self.executor.create_task(self._let_requests_look)  # there may be more to search
                await self._next_look
            self._receive()
            while self._look(number, asked_at, response) and not response.detected:
                pass
        except UnknownTagId as error:
            response.error_message = str(error)
        finally:
            self._requests_waiting -= 1
        return response

    def _receive(self) -> None:
        """Take all messages that have arrived. rclpy takes one per callback, which is too slow here."""
        while (message := take_message(self._camera)) is not None:
            self._on_message(message)

    def _now(self) -> Moment:
        return Moment(self.get_clock().now().nanoseconds * 1e-9, time.monotonic())

    def _look(self, number: int, asked_at: Moment, response: ConfirmTag.Response) -> bool:
        """Search one frame, the newest, and judge; return whether there was a frame to search."""
        now = self._now()
        has_searched = self._confirmer.choose(now, asked_at)
        verdict = self._confirmer.judge(number, now, asked_at)
        response.detection_confidence, response.error_message, sight = verdict
        response.detected = not response.error_message
        if sight and (has_searched or response.detected) and self._pictures.get_subscription_count():
            self._publish_picture(sight, number, response.error_message)
        return has_searched

    def _publish_picture(self, sight: Sight, number: int, reason: str) -> None:
        """Publish a picture of the verdict, unless the source has no pictures."""
        if sight.picture is None:
            return
        try:
            picture = draw(sight.picture, sight.detections, number, reason, self._settings)
        except Exception as error:  # a failed drawing must not end the node
            problem = f'cannot draw {self._pictures.topic_name}: {type(error).__name__}: {error}'
            self.get_logger().error(escaped(problem, 300), throttle_duration_sec=LOG_EVERY_SECONDS)
            return
        height, width, channels = picture.shape
        image = Image(height=height, width=width, encoding='rgb8', step=channels * width)
        image.header.stamp = self.get_clock().now().to_msg()
        image.data = picture.tobytes()
        self._pictures.publish(image)


def main(args: list[str] | None = None) -> int:
    """Serve until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, ConfirmTagNode, args)
