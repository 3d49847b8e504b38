"""ROS 2 node `/perception/confirm_tag`: tells whether the camera sees the tag that the robot expects."""

import sys
import time
from dataclasses import fields

import rclpy
from lupin_msgs.srv import ConfirmTag
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image

from lupin_perception.confirmation import CannotServe, Confirmer, Criteria, Frame
from lupin_perception.images import UnusableImage, grey_picture

NODE_NAME = 'confirm_tag'
LONGEST_WAIT_SECONDS = 0.5
MOST_REFUSALS_LOGGED = 10
SERVICE_QOS = QoSProfile(depth=1000)  # ROS's default of 10 drops requests that come at once


class ConfirmTagNode(Node):
    """Listens to a camera, and looks for a tag in its last images when the service asks for one."""

    def __init__(self):
        """Offer the service; raises CannotServe."""
        super().__init__(NODE_NAME, namespace='perception')
        topic = self._parameter('image_topic', '/camera/image_raw', "The camera's sensor_msgs/Image topic.")
        if not isinstance(topic, str):
            raise CannotServe(f'parameter image_topic is {topic!r}: give the name of a topic')
        criteria = Criteria(
            **{
                each.name: self._parameter(each.name, each.default, each.metadata['description'])
                for each in fields(Criteria)
            }
        )
        for name in getattr(self, '_parameter_overrides', ()):  # private to rclpy: it may go one day
            if not self.has_parameter(name):  # ROS says nothing of a mistyped name
                self.get_logger().warning(f'parameter {name!r} is unknown, and ignored')
        self._confirmer = Confirmer(_detector().detect, criteria)
        self._refusals = set()
        # Best effort: hears every camera, whatever it offers.
        self.create_subscription(Image, topic, self._on_image, qos_profile_sensor_data)
        self.create_service(ConfirmTag, 'confirm_tag', self._confirm, qos_profile=SERVICE_QOS)
        self.get_logger().info(f'ready: images from {self.resolve_topic_name(topic)}')

    def _parameter(self, name: str, default, description: str):
        # Typed by Criteria and not by ROS, which would refuse 1 for a double.
        descriptor = ParameterDescriptor(description=description, read_only=True, dynamic_typing=True)
        return self.declare_parameter(name, default, descriptor).value

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

    def _confirm(self, request, response):
        stamp_now_seconds = self.get_clock().now().nanoseconds * 1e-9
        response.detection_confidence, response.error_message = self._confirmer.confirm(
            request.expected_tag_id, stamp_now_seconds, time.monotonic()
        )
        response.detected = not response.error_message
        return response


def _detector():
    try:
        from lupin_perception.detector import TagDetector  # here, so that a missing OpenCV is one line

        return TagDetector()
    except (ImportError, AttributeError) as error:
        raise CannotServe(
            f'OpenCV with its aruco module is needed ({error}): sudo apt install python3-opencv'
        ) from error


def main(args=None):
    """Serve until Ctrl-C or SIGTERM (exit 0); what cannot be served is one FATAL line (exit 1)."""
    try:
        rclpy.init(args=args)
    except RuntimeError as error:
        return _refuse(f'the ROS arguments are not understood: {error}')
    try:
        executor = SingleThreadedExecutor()
        executor.add_node(ConfirmTagNode())
        # Not spin(): a SIGTERM that falls between two of its endless waits is never noticed.
        while rclpy.ok():
            executor.spin_once(timeout_sec=LONGEST_WAIT_SECONDS)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (CannotServe, NameValidationException, ParameterException) as error:
        return _refuse(str(error))
    except Exception:
        if rclpy.ok():  # else a signal took the context away during start-up
            raise
    finally:
        rclpy.try_shutdown()
    return 0


def _refuse(reason: str) -> int:
    get_logger(NODE_NAME).fatal(' '.join(reason.split()))
    return 1


if __name__ == '__main__':
    sys.exit(main())
