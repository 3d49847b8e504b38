"""ROS 2 node `/perception/confirm_tag`: tells whether the camera sees the tag that the robot expects."""

import sys
import time

from lupin_msgs.srv import ConfirmTag
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image

from lupin_perception import life_cycle
from lupin_perception.confirmation import Confirmer, Frame
from lupin_perception.errors import StartUpError
from lupin_perception.images import UnusableImage, grey_picture
from lupin_perception.settings import Settings

NODE_NAME = 'confirm_tag'
MOST_REFUSALS_LOGGED = 10


class ConfirmTagNode(Node):
    """Listens to a camera, and looks for a tag in its last images when the service asks for one."""

    def __init__(self):
        """Offer the service; raises StartUpError."""
        super().__init__(NODE_NAME, namespace='perception')
        settings = life_cycle.declare_parameters(self, Settings)
        self._confirmer = Confirmer(_detector().detect, settings)
        self._refusals = set()
        # Best effort: hears every camera, whatever it offers.
        self.create_subscription(Image, settings.image_topic, self._on_image, qos_profile_sensor_data)
        service_qos = QoSProfile(depth=life_cycle.SERVICE_DEPTH)
        self.create_service(ConfirmTag, 'confirm_tag', self._confirm, qos_profile=service_qos)
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
        raise StartUpError(
            f'OpenCV with its aruco module is needed ({error}): sudo apt install python3-opencv'
        ) from error


def main(args=None):
    """Serve until Ctrl-C or SIGTERM (exit 0); what cannot be served is one FATAL line (exit 1)."""
    return life_cycle.run(NODE_NAME, ConfirmTagNode, args)


if __name__ == '__main__':
    sys.exit(main())
