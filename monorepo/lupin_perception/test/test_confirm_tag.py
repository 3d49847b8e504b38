"""The real node, with images and requests over ROS."""

import threading

import numpy as np
import pytest
from lupin_greenhouse_bridge.signalled import MOMENTS, SIGNALS, command
from lupin_greenhouse_bridge.testing import PATIENCE_SECONDS, call, executable, spinning_node, wait_until
from lupin_msgs.srv import ConfirmTag
from lupin_perception.life_cycle import SERVICE_DEPTH
from lupin_perception.scene import Camera, marker
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image

TOPIC = '/tested/image'
COLOURS = {'mono8': 1, 'rgb8': 3, 'bgr8': 3, 'rgba8': 4, 'bgra8': 4}


class Perception:
    """The node, a camera that shows one image again and again, and a client."""

    def __init__(self, process, node):
        self.process = process
        process.wait_for_log(f'ready: images from {TOPIC}')
        self._node = node
        self._images = node.create_publisher(Image, TOPIC, qos_profile_sensor_data)
        name = f'{process.namespace}/confirm_tag'
        self._client = node.create_client(ConfirmTag, name, qos_profile=QoSProfile(depth=SERVICE_DEPTH))
        assert self._client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
        wait_until(lambda: self._images.get_subscription_count() == 1)

    def show(self, image: Image, is_stamped=True) -> None:
        """Publish an image, as taken now."""
        if is_stamped:
            image.header.stamp = self._node.get_clock().now().to_msg()
        self._images.publish(image)

    def confirm(self, tag_id: str) -> tuple[bool, str]:
        """Ask once."""
        response = call(self._client, ConfirmTag.Request(expected_tag_id=tag_id))
        assert response.detected == (response.detection_confidence == 1.0) == (not response.error_message)
        return response.detected, response.error_message or 'detected'

    def confirm_while_showing(
        self, image: Image, tag_id: str, until: str, *, is_stamped=True
    ) -> tuple[bool, str]:
        """Show an image and ask, again and again, until the message holds a fragment."""
        answers = []

        def says_so():
            self.show(image, is_stamped)
            answers.append(self.confirm(tag_id))
            return until in answers[-1][1]

        wait_until(says_so)
        return answers[-1]


def image_of(picture: np.ndarray, encoding='mono8', padding=0, **fields) -> Image:
    """Return a message of a grey picture; padding lengthens its rows, and `fields` spoil it."""
    height, width = picture.shape
    channels = COLOURS.get(encoding, 1)
    rows = np.repeat(picture, channels, axis=1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    message = Image(height=height, width=width, encoding=encoding, step=rows.shape[1], data=rows.tobytes())
    for name, value in fields.items():
        setattr(message, name, value)
    return message


@pytest.fixture
def start_confirm_tag(start_node):
    """Return a function that starts the node with these parameters; it ends with the test."""
    return lambda **parameters: start_node([executable('lupin_perception', 'confirm_tag')], **parameters)


@pytest.fixture
def start(start_confirm_tag):
    """Return a function that starts the node with these parameters, between a camera and a client."""
    with spinning_node('perception_test') as node:
        yield lambda **parameters: Perception(start_confirm_tag(image_topic=TOPIC, **parameters), node)


@pytest.fixture(scope='module')
def tag_7():
    return Camera().look_at(marker(7, 30), np.random.default_rng(0), angle_degrees=30)


@pytest.mark.parametrize('is_bigendian', [0, 1])
@pytest.mark.parametrize('encoding', COLOURS)
def test_the_expected_tag_is_confirmed_in_every_encoding(start, tag_7, encoding, is_bigendian):
    image = image_of(tag_7, encoding, padding=5, is_bigendian=is_bigendian)
    perception = start()
    assert perception.confirm('7') == (False, 'no usable image yet')
    assert perception.confirm_while_showing(image, '7', 'detected')[0]
    confirmed, message = perception.confirm('8')
    assert not confirmed
    assert message == 'other tags in view: 7'


def test_an_old_image_and_one_of_a_wrong_clock_are_no_proof(start, tag_7):
    perception = start(max_image_age_seconds=0.5)
    image = image_of(tag_7)
    assert perception.confirm_while_showing(image, '7', 'detected')[0]
    wait_until(lambda: 'ago: older than 0.5 s' in perception.confirm('7')[1])
    unstamped = perception.confirm_while_showing(image_of(tag_7), '7', 'is stamped', is_stamped=False)
    assert not unstamped[0]


def test_malformed_images_are_refused_once_and_the_node_lives(start, tag_7):
    perception = start()
    faults = [
        {'encoding': '16UC1'},
        {'encoding': '\x1b[31mred\n'},
        {'step': 1},
        {'height': 0},
        {'width': 2**32 - 1},
        {'height': 2**32 - 1, 'step': 2**32 - 1},
        {'data': b''},
    ]
    malformed = [image_of(tag_7, **fields) for fields in faults]
    for image in malformed * 3:
        perception.confirm_while_showing(image, '7', 'no usable image yet; an image was refused: ')
    assert perception.confirm_while_showing(image_of(tag_7), '7', 'detected')[0]
    assert perception.process.stop() == 0
    log = perception.process.log
    assert len([line for line in log if 'image refused' in line and '16UC1' in line]) == 1
    assert not [line for line in log if 'Traceback' in line or '\x1b' in line]


def test_requests_at_once_are_all_answered(start, tag_7):
    perception = start()
    assert perception.confirm_while_showing(image_of(tag_7), '7', 'detected')[0]
    answers = []
    threads = [threading.Thread(target=lambda: answers.append(perception.confirm('x'))) for _ in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(answers) == 16


@pytest.mark.parametrize('signals', SIGNALS.values(), ids=SIGNALS)
def test_a_signal_ends_it_with_exit_code_0(start, signals):
    process = start().process
    process.send(*signals)
    assert process.end() == 0


@pytest.mark.parametrize('moment', MOMENTS)
def test_a_signal_at_any_moment_ends_it_with_exit_code_0(start_node, moment):
    run = command('lupin_perception', 'confirm_tag', moment, SIGNALS['Ctrl-C twice'])
    process = start_node(run)
    process.wait_for_log('signalled in' if moment in MOMENTS[:7] else 'ready:')
    process.send(*SIGNALS['SIGTERM and Ctrl-C'])
    assert process.end() == 0
    assert any(f'signalled in {moment}' in line for line in process.log)


@pytest.mark.parametrize(
    ('name', 'value', 'fragment'),
    [
        ('min_frames', 0, 'parameter min_frames is 0: must be a whole number from 1 to 100'),
        ('min_sharpness', 'high', "parameter min_sharpness is 'high': must be a number from 0 to 1"),
        ('image_topic', 'no such name', 'no such name'),
        ('image_topic', 5, 'parameter image_topic is 5: must be text'),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(start_confirm_tag, name, value, fragment):
    assert fragment in start_confirm_tag(**{name: value}).refusal()


def test_a_mistyped_parameter_is_named_and_changes_nothing(start_confirm_tag):
    process = start_confirm_tag(min_frame=0)
    process.wait_for_log('parameter min_frame is unknown, and ignored')
    process.wait_for_log('ready: ')
