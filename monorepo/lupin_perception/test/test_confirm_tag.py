"""The real node, with images and requests over ROS."""

import io
import os
import threading
import time

import numpy as np
import pytest
from apriltag_msgs.msg import AprilTagDetection, AprilTagDetectionArray
from geometry_msgs.msg import Pose, Quaternion
from lupin_greenhouse_bridge.signalled import MOMENTS, SIGNALS, command
from lupin_greenhouse_bridge.testing import PATIENCE_SECONDS, executable, greet, spinning_node, wait_until
from lupin_msgs.srv import ConfirmTag
from lupin_perception.life_cycle import SERVICE_DEPTH
from lupin_perception.scene import Camera, marker
from PIL import Image as PictureFile
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image

TOPIC = '/tested/image'
# Small, 300 kB in four colours: on a busy machine, best effort loses large images.
CAMERA = Camera(width=320, height=240, focal_length_pixels=300.0)
COLOURS = {'mono8': 1, '8UC1': 1, 'rgb8': 3, 'bgr8': 3, 'rgba8': 4, 'bgra8': 4}


class Perception:
    """The node, a camera that repeats one image, and a client."""

    def __init__(self, process, node, message_type=Image):
        self.process = process
        process.wait_for_log(f'ready: images from {TOPIC}')
        self.node = node
        self._images = node.create_publisher(message_type, TOPIC, qos_profile_sensor_data)
        name = f'{process.namespace}/confirm_tag'
        self._client = node.create_client(ConfirmTag, name, qos_profile=QoSProfile(depth=SERVICE_DEPTH))
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

    def confirm(self, tag_id: str) -> ConfirmTag.Response:
        """Call the service while the camera shows nothing."""
        return self.confirm_while_showing(None, tag_id)

    def confirm_while_showing(self, image, tag_id: str, *, is_stamped=True) -> ConfirmTag.Response:
        """Call the service, and show an image repeatedly until the reply arrives."""
        future = self.ask(tag_id)

        pause = threading.Event()
        deadline = time.monotonic() + 2 * PATIENCE_SECONDS
        while not future.done():
            assert time.monotonic() < deadline, 'no reply'
            if image is not None:
                self.show(image, is_stamped)
            pause.wait(0.05)  # the rate of a camera
        response = future.result()
        assert response.detected == (response.detection_confidence == 1.0) == (not response.error_message)
        assert response.tag_pose_in_map == Pose(orientation=Quaternion(w=0.0))  # never populated
        return response


def image_of(picture: np.ndarray, encoding='mono8', padding=0, **fields) -> Image:
    """Return a message of a grey picture; padding lengthens its rows, and `fields` replace its fields."""
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

        def start_perception(message_type=Image, source='image_topic', **parameters):
            process = start_confirm_tag(**{source: TOPIC}, **parameters)
            return Perception(process, node, message_type)

        yield start_perception


@pytest.fixture(scope='module')
def tag_7():
    return CAMERA.look_at(marker(7, 30), np.random.default_rng(0), distance_m=0.3, angle_degrees=30)


@pytest.mark.parametrize('is_bigendian', [0, 1])
@pytest.mark.parametrize('encoding', COLOURS)
def test_one_call_confirms_the_expected_tag_in_every_encoding(start, tag_7, encoding, is_bigendian):
    image = image_of(tag_7, encoding, padding=5, is_bigendian=is_bigendian)
    assert start(timeout_seconds=PATIENCE_SECONDS).confirm_while_showing(image, '7').detected


def test_a_tag_that_is_not_there_is_said_after_the_timeout(start, tag_7):
    perception = start(timeout_seconds=0.3)
    assert perception.confirm('7').error_message == 'tag 7: no image yet'
    other = 'tag 8: other tags in view: 7'
    wait_until(lambda: perception.confirm_while_showing(image_of(tag_7), '8').error_message == other)


def test_the_camera_is_watched_until_the_tag_appears(start, tag_7):
    """After the call come images of another tag, then images of the tag."""
    perception = start(timeout_seconds=PATIENCE_SECONDS)
    future = perception.ask('7')
    tag_8 = image_of(CAMERA.look_at(marker(8, 30), np.random.default_rng(0), distance_m=0.3))
    other = perception.ask('8')
    wait_until(lambda: perception.show(tag_8) or other.done())
    assert not future.done()
    wait_until(lambda: perception.show(image_of(tag_7)) or future.done())
    assert (other.result().detected, future.result().detected) == (True, True)


def test_a_caller_who_waits_keeps_nobody_else_waiting(start, tag_7):
    perception = start(timeout_seconds=PATIENCE_SECONDS)
    waiting = [perception.ask('9') for _ in range(16)]
    assert perception.confirm('seven').error_message.startswith("tag 'seven' is not an id of tag36h11")
    assert perception.confirm_while_showing(image_of(tag_7), '7').detected
    assert not any(future.done() for future in waiting)


def test_a_signal_ends_it_while_callers_wait(start, tag_7):
    perception = start(timeout_seconds=PATIENCE_SECONDS)
    waiting = [perception.ask('9') for _ in range(4)]
    assert perception.confirm_while_showing(image_of(tag_7), '7').detected
    assert perception.process.stop() == 0
    assert not any('never awaited' in line for line in perception.process.log)
    assert not any(future.done() for future in waiting)


def test_an_old_image_and_one_of_a_wrong_clock_are_no_proof(start, tag_7):
    perception = start(max_image_age_seconds=0.5, timeout_seconds=0.8)
    wait_until(lambda: perception.confirm_while_showing(image_of(tag_7), '7').detected)
    wait_until(lambda: 'ago: older than 0.5 s' in perception.confirm('7').error_message)
    unstamped = perception.confirm_while_showing(image_of(tag_7), '7', is_stamped=False)
    assert 'is stamped' in unstamped.error_message


def compressed(picture: np.ndarray, kind: str) -> CompressedImage:
    data = io.BytesIO()
    PictureFile.fromarray(picture).save(data, kind)
    return CompressedImage(format=f'mono8; {kind.lower()} compressed ', data=data.getvalue())


def detections(*tags: tuple, family='tag36h11'):
    """Return the message of a detector for tags of (number, hamming, margin)."""
    return AprilTagDetectionArray(
        detections=[
            AprilTagDetection(family=family, id=number, hamming=hamming, decision_margin=margin)
            for number, hamming, margin in tags
        ]
    )


@pytest.mark.parametrize('kind', ['JPEG', 'PNG'])
def test_a_compressed_image_is_decoded(start, tag_7, kind):
    perception = start(
        CompressedImage, 'compressed_image_topic', timeout_seconds=PATIENCE_SECONDS, min_frames=1
    )
    assert perception.confirm_while_showing(compressed(tag_7, kind), '7').detected


@pytest.mark.parametrize(
    ('message', 'error'),
    [
        (detections((9, 0, 50.0), (7, 0, 50.0)), ''),
        (detections((7, 0, 50.0), family='tf36h11'), ''),
        (detections((7, 0, 0.0)), ''),
        (detections((7, 1, 50.0)), 'in view, but 1 bits were corrected, at most 0 are allowed'),
        (detections((7, 0, 5.0)), 'in view, but unclear: decision margin 5, 20 needed'),
        (detections((7, 0, 50.0), family='tag25h9'), 'no tag in view in '),
        (detections((-7, 0, 50.0), (2**31 - 1, 0, 50.0)), 'other tags in view: -7, 2147483647'),
        (detections((7, -1, float('nan'))), 'in view, but unclear: decision margin nan, 20 needed'),
    ],
)
def test_detections_of_another_node_are_judged(start, message, error):
    perception = start(AprilTagDetectionArray, 'detections_topic', timeout_seconds=0.5, min_frames=1)

    def is_judged():
        reason = perception.confirm_while_showing(message, '7').error_message.removeprefix('tag 7: ')
        return reason.startswith(error) if error else not reason

    wait_until(is_judged)


def test_detections_without_apriltag_msgs_are_refused_in_one_line(start_confirm_tag, tmp_path, monkeypatch):
    hidden = tmp_path / 'apriltag_msgs'
    hidden.mkdir()
    (hidden / '__init__.py').write_text("raise ImportError('hidden')")
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}:{os.environ["PYTHONPATH"]}')
    refusal = start_confirm_tag(detections_topic='/detections').refusal()
    assert 'package apriltag_msgs' in refusal
    assert 'sudo apt install ros-$ROS_DISTRO-apriltag-msgs' in refusal


def test_two_sources_are_refused_in_one_line(start_confirm_tag):
    refusal = start_confirm_tag(image_topic='/a', compressed_image_topic='/b').refusal()
    assert 'image_topic is /a and compressed_image_topic is /b: set exactly one of' in refusal


def test_bad_images_are_refused_and_the_node_lives(start, tag_7):
    perception = start(timeout_seconds=0.1)
    faults = [
        {'encoding': '16UC1'},
        {'encoding': '\x1b[31mred\n'},
        {'step': 1},
        {'height': 0},
        {'height': 1, 'width': 320},  # the library crashes on one row
        {'width': 2**32 - 1},
        {'height': 2**32 - 1, 'step': 2**32 - 1},
        {'data': b''},
    ]
    for image in [image_of(tag_7, **fields) for fields in faults] * 2:
        message = perception.confirm_while_showing(image, '7').error_message
        assert message.startswith('tag 7: an image was refused: ')
        assert message.isprintable()
    wait_until(lambda: perception.confirm_while_showing(image_of(tag_7), '7').detected)
    assert perception.process.stop() == 0
    log = perception.process.log
    assert 1 <= len([line for line in log if 'image refused' in line]) < 16
    assert not [line for line in log if '\x1b' in line]


def test_bad_compressed_images_are_refused_and_the_node_lives(start, tag_7):
    perception = start(CompressedImage, 'compressed_image_topic', timeout_seconds=0.1)
    good = compressed(tag_7, 'JPEG')
    truncated = CompressedImage(data=bytes(good.data)[:500])
    for image in (CompressedImage(), CompressedImage(data=bytes(500_000)), truncated):
        message = perception.confirm_while_showing(image, '7').error_message
        assert message.startswith('tag 7: an image was refused: ')
    wait_until(lambda: perception.confirm_while_showing(good, '7').detected)
    assert perception.process.stop() == 0


def test_what_was_judged_can_be_seen(start, tag_7):
    """The picture has the size of the image; the verdict and the outline of the tag are green."""
    perception = start(timeout_seconds=PATIENCE_SECONDS)
    topic = f'{perception.process.namespace}/confirm_tag/seen'
    seen = []
    perception.node.create_subscription(Image, topic, seen.append, 10)
    wait_until(lambda: perception.node.count_publishers(topic) == 1)
    wait_until(lambda: perception.confirm_while_showing(image_of(tag_7), '7').detected and seen)
    last = seen[-1]
    assert (last.encoding, last.width, last.height, last.step) == ('rgb8', 320, 240, 960)
    picture = np.frombuffer(last.data, np.uint8).reshape(240, 320, 3)
    is_green = (picture[..., 1] > 180) & (picture[..., 0] < 100)
    assert is_green[:17].any()
    assert is_green[17:].any()


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
        (
            'min_decision_margin',
            'high',
            "parameter min_decision_margin is 'high': must be a number from 0 to 255",
        ),
        ('image_topic', 'no such name', 'no such name'),
        ('image_topic', 5, 'parameter image_topic is 5: must be text'),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(start_confirm_tag, name, value, fragment):
    assert fragment in start_confirm_tag(**{name: value}).refusal()


def test_a_mistyped_parameter_is_named_and_changes_nothing(start_confirm_tag):
    process = start_confirm_tag(min_frame=0)
    process.wait_for_log('parameter min_frame is unknown and ignored')
    process.wait_for_log('ready: ')
