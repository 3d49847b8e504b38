"""Messages of cameras and detectors, and the real node in the test's process, with a camera and a client."""

import io
import threading

import numpy as np
import pytest
from apriltag_msgs.msg import AprilTagDetection, AprilTagDetectionArray
from geometry_msgs.msg import Pose, Quaternion
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_msgs.srv import ConfirmTag
from lupin_tag_confirmation.confirm_tag import ConfirmTagNode
from lupin_tag_confirmation.settings import TOPICS
from PIL import Image as PictureFile
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image

PATIENCE_SECONDS = 30.0
# The tags with these numbers, with their black borders: 8 x 8 modules of one bit.
MODULES = {7: '0014703a14301000', 8: '005a2e7c706a0800'}


def marker(tag_number: int) -> np.ndarray:
    """Return a tag36h11, uint8 of the shape (80, 80), with its black border and without its white one."""
    bits = np.unpackbits(np.frombuffer(bytes.fromhex(MODULES[tag_number]), np.uint8)).reshape(8, 8)
    return np.kron(255 * bits, np.ones((10, 10), np.uint8))


def picture_of_tag(tag_number: int) -> np.ndarray:
    """Return a picture of a tag, uint8 of the shape (240, 320): on a busy machine, large images get lost."""
    return np.pad(marker(tag_number), ((80, 80), (120, 120)), constant_values=200)


def image_of(picture: np.ndarray, **fields) -> Image:
    """Return a message of a grey picture, with other values of these fields."""
    height, width = picture.shape
    grey = {'height': height, 'width': width, 'encoding': 'mono8', 'step': width, 'data': picture.tobytes()}
    return Image(**{**grey, **fields})


def compressed(picture: np.ndarray, kind: str) -> CompressedImage:
    data = io.BytesIO()
    PictureFile.fromarray(picture).save(data, kind)
    return CompressedImage(format=f'mono8; {kind.lower()} compressed ', data=data.getvalue())


def detections(*tags: tuple, family='tag36h11') -> AprilTagDetectionArray:
    """Return the message of a detector for tags of (number, hamming, margin)."""
    return AprilTagDetectionArray(
        detections=[
            AprilTagDetection(family=family, id=number, hamming=hamming, decision_margin=margin)
            for number, hamming, margin in tags
        ]
    )


class Perception:
    """A camera and a client of a confirm_tag that runs."""

    def __init__(self, node, namespace=''):
        # Here, because pytest must load the plug-in first.
        from lupin_greenhouse_bridge.testing.helpers import greet, wait_until

        self.node, self._wait_until = node, wait_until
        self._images = node.create_publisher(Image, f'{namespace}/{TOPICS["image"]}', qos_profile_sensor_data)
        service = f'{namespace}/perception/confirm_tag'
        self._client = node.create_client(ConfirmTag, service, qos_profile=SERVICE_QOS)
        assert self._client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
        wait_until(lambda: self._images.get_subscription_count() == 1)
        greet(self._client, ConfirmTag.Request())  # an empty id is refused at once

    def show(self, image, is_stamped=True) -> None:
        """Publish an image, as taken now."""
        if is_stamped:
            image.header.stamp = self.node.get_clock().now().to_msg()
        self._images.publish(image)

    def ask(self, tag_id: str):
        return self._client.call_async(ConfirmTag.Request(expected_tag_id=tag_id))

    def confirm(self, tag_id: str, image=None, *, is_stamped=True) -> ConfirmTag.Response:
        """Call the service, and show an image repeatedly until the reply arrives."""
        future, replied = self.ask(tag_id), threading.Event()
        future.add_done_callback(lambda _future: replied.set())
        # At the rate of a camera.
        self._wait_until(lambda: (image and self.show(image, is_stamped)) or replied.wait(0.05))
        response = future.result()
        assert response.detected == (response.detection_confidence == 1.0) == (not response.error_message)
        assert response.tag_pose_in_map == Pose(orientation=Quaternion(w=0.0))  # never populated
        return response

    def confirm_until(self, fragment: str, image=None, tag_id: str = '7') -> str:
        """Show an image and call the service until the reason has this text; return the reason."""
        reasons = []

        def is_told():
            reasons.append(self.confirm(tag_id, image).error_message)
            return fragment in reasons[-1]

        self._wait_until(is_told)
        return reasons[-1]


@pytest.fixture
def start(run_nodes):
    """
    Return a function that runs confirm_tag with these parameters, between a camera and a client.

    By default no image gets too old, and a call waits for the tag longer than a test does.
    """

    def start_perception(**parameters):
        patient = {'max_image_age_seconds': 3600.0, 'timeout_seconds': 2 * PATIENCE_SECONDS}
        _, node = run_nodes(ConfirmTagNode, **{**patient, **parameters})
        return Perception(node)

    return start_perception
