"""The real nodes in the test's process, with a camera and a client that the test controls."""

import threading

import hypothesis
import pytest
from geometry_msgs.msg import Pose, Quaternion
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_msgs.srv import ConfirmTag
from lupin_tag_confirmation.confirm_tag import ConfirmTagNode
from lupin_tag_confirmation.settings import TOPICS
from messages import picture_of_tag
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image

pytest_plugins = ['lupin_greenhouse_bridge.testing']
# No test may depend on the speed of the machine.
hypothesis.settings.register_profile(
    'unhurried', deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile('unhurried')

PATIENCE_SECONDS = 30.0
TOPIC = '/tested/image'


class Perception:
    """A camera and a client of a confirm_tag that runs."""

    def __init__(self, node, message_type=Image, topic=TOPIC, namespace=''):
        # Here, because pytest must load the plug-in first.
        from lupin_greenhouse_bridge.testing._helpers import greet, wait_until

        self.node, self._wait_until = node, wait_until
        self._images = node.create_publisher(message_type, topic, qos_profile_sensor_data)
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
        """Call the service, and return the future of the response."""
        return self._client.call_async(ConfirmTag.Request(expected_tag_id=tag_id))

    def confirm(self, tag_id: str, image=None, *, is_stamped=True) -> ConfirmTag.Response:
        """Call the service, and show an image repeatedly until the reply arrives."""
        future = self.ask(tag_id)
        replied = threading.Event()
        future.add_done_callback(lambda _future: replied.set())
        for _ in range(int(20 * PATIENCE_SECONDS)):
            if image is not None:
                self.show(image, is_stamped)
            if replied.wait(0.05):  # the rate of a camera
                break
        assert replied.is_set(), 'no reply'
        response = future.result()
        assert response.detected == (response.detection_confidence == 1.0) == (not response.error_message)
        assert response.tag_pose_in_map == Pose(orientation=Quaternion(w=0.0))  # never populated
        return response

    def confirm_until(self, fragment: str, image=None, tag_id: str = '7', *, is_stamped=True) -> str:
        """Show an image and call the service until the reason has this text; return the reason."""
        reasons = []

        def is_told():
            reasons.append(self.confirm(tag_id, image, is_stamped=is_stamped).error_message)
            return fragment in reasons[-1]

        self._wait_until(is_told)
        return reasons[-1]


@pytest.fixture
def start(run_nodes):
    """
    Return a function that runs confirm_tag with these parameters, between a camera and a client.

    By default no image gets too old, and a call waits for the tag longer than a test does.
    """

    def start_perception(message_type=Image, source='image', **parameters):
        defaults = {
            'source': source,
            'max_image_age_seconds': 3600.0,
            'timeout_seconds': 2 * PATIENCE_SECONDS,
        }
        remap = ['-r', f'{TOPICS[source]}:={TOPIC}']
        _, node = run_nodes(ConfirmTagNode, arguments=remap, **{**defaults, **parameters})
        return Perception(node, message_type)

    return start_perception


@pytest.fixture(scope='session')
def tag_7():
    return picture_of_tag(7)
