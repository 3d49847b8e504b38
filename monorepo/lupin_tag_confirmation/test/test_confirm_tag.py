"""The real node, with images and requests over ROS."""

import threading
from types import SimpleNamespace

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from confirmation_helpers import PATIENCE_SECONDS, Perception, image_of, picture_of_tag
from lupin_greenhouse_bridge.runtime.rclpy_internals import rclpy_implementation
from lupin_greenhouse_bridge.testing.helpers import executable, spinning_node, wait_until
from lupin_tag_confirmation import confirm_tag
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.drawing import GOOD
from lupin_tag_confirmation.settings import TOPICS
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image

EXECUTABLE = ('lupin_tag_confirmation', 'confirm_tag')
TAG_7 = picture_of_tag(7)


def test_a_tag_that_is_not_there_is_said_after_the_timeout(start):
    perception = start(timeout_seconds=0.1)
    assert perception.confirm('7').error_message == 'tag 7: no image yet'
    reason = perception.confirm_until('in view instead', image_of(TAG_7), '8')
    assert reason == 'tag 8: in view instead: tag 7'


def test_the_camera_is_watched_until_the_tag_appears(start):
    """After the call come images of another tag, then images of the tag."""
    perception = start()
    future = perception.ask('7')
    assert perception.confirm('8', image_of(picture_of_tag(8))).detected
    assert not future.done()
    wait_until(lambda: perception.show(image_of(TAG_7)) or future.done())
    assert future.result().detected


def test_an_image_that_came_too_long_ago_is_no_proof_but_one_that_comes_while_the_call_waits(start):
    """A millisecond is too long here, and the images come 50 ms apart."""
    perception = start(timeout_seconds=1.0, max_image_age_seconds=0.001)
    assert perception.confirm('7', image_of(TAG_7)).detected
    assert perception.confirm_until('the last image came').endswith(' s ago: older than 0.001 s')


def test_an_image_that_arrives_while_the_node_searches_another_counts(run_nodes, monkeypatch):
    """The timeout ends during the search."""
    clock = SimpleNamespace(monotonic=lambda: 0.0)
    searching, may_go_on = threading.Event(), threading.Event()
    detect = TagDetector.detect

    def detect_slowly(detector, picture):
        searching.set()
        assert may_go_on.wait(PATIENCE_SECONDS)
        return detect(detector, picture)

    monkeypatch.setattr(confirm_tag, 'time', clock)
    monkeypatch.setattr(TagDetector, 'detect', detect_slowly)
    confirming, node = run_nodes(confirm_tag.ConfirmTagNode, max_image_age_seconds=3600.0)
    topic = f'/{TOPICS["image"]}'
    (subscription,) = [each for each in confirming.subscriptions if each.topic_name == topic]
    perception = Perception(node)
    future = perception.ask('7')
    wait_until(lambda: perception.show(image_of(TAG_7)) or searching.wait(0.05))
    wait_until(lambda: perception.show(image_of(TAG_7)) or is_ready(subscription))
    clock.monotonic = lambda: 4.0
    may_go_on.set()
    wait_until(future.done)
    assert future.result().detected


def is_ready(subscription) -> bool:
    """Return whether a message waits for this subscription, which nobody spins at the moment."""
    wait_set = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, rclpy.get_default_context().handle)
    wait_set.clear_entities()
    wait_set.add_subscription(subscription.handle)
    wait_set.wait(0)
    return bool(wait_set.get_ready_entities('subscription'))


def test_with_sim_time_the_age_of_an_image_is_that_of_the_simulators_clock(start):
    perception = start(use_sim_time=True, max_image_age_seconds=1.0, timeout_seconds=0.0)
    simulator = perception.node.create_publisher(Clock, '/clock', 1)

    def reason(stamp_seconds):
        simulator.publish(Clock(clock=Time(sec=100)))
        image = image_of(TAG_7)
        image.header.stamp.sec = stamp_seconds
        return perception.confirm('7', image, is_stamped=False).error_message

    wait_until(lambda: reason(100) == '')
    wait_until(lambda: 'is stamped 2.0 s ago' in reason(98))
    wait_until(lambda: 'is stamped 2.0 s ahead' in reason(102))


def test_bad_images_are_refused_and_the_node_lives(start, monkeypatch, capfd):
    monkeypatch.setattr(confirm_tag, 'LOG_EVERY_SECONDS', 3600.0)
    perception = start(timeout_seconds=0.0, min_frames=1)
    for fields, fault in (
        ({'encoding': '\x1b[31mred\n'}, "encoding '\\x1b[31mred\\n' is not one of"),
        ({'height': 1, 'width': 320}, 'the image has 320 x 1 pixels'),  # the library crashes on one row
    ):
        reason = perception.confirm_until(fault, image_of(TAG_7, **fields))
        assert reason.startswith('tag 7: an image was refused: ')
        assert reason.isprintable()
    wait_until(lambda: perception.confirm('7', image_of(TAG_7)).detected)
    log = capfd.readouterr().err
    assert log.count('image refused') == 1  # a stream of them does not flood the log
    assert '\x1b' not in log


def test_what_was_judged_can_be_seen_and_a_picture_that_cannot_be_drawn_costs_only_the_picture(
    start, monkeypatch, capfd
):
    perception, seen, topic = start(), [], '/perception/confirm_tag/seen'
    perception.node.create_subscription(Image, topic, seen.append, 10)
    wait_until(lambda: perception.node.count_publishers(topic) == 1)
    wait_until(lambda: perception.confirm('7', image_of(TAG_7)).detected and seen)
    last = seen[-1]
    assert (last.encoding, last.width, last.height, last.step) == ('rgb8', 320, 240, 960)
    picture = np.frombuffer(last.data, np.uint8).reshape(240, 320, 3)
    assert (picture[60:] == GOOD).all(axis=-1).any()
    monkeypatch.setattr(confirm_tag, 'draw', lambda *_: 1 / 0)
    assert perception.confirm('7', image_of(TAG_7)).detected
    assert f'cannot draw {topic}: ZeroDivisionError: division by zero' in capfd.readouterr().err


def test_a_caller_who_waits_keeps_nobody_else_waiting_and_a_signal_ends_it_all_the_same(start_node):
    patient = {'timeout_seconds': 60.0, 'max_image_age_seconds': 3600.0}
    process = start_node([executable(*EXECUTABLE)], **patient)
    process.wait_for_log('ready: images from ')
    with spinning_node('perception_test') as node:
        perception = Perception(node, process.namespace)
        waiting = [perception.ask('9') for _ in range(16)]
        assert perception.confirm('seven').error_message.startswith("tag 'seven' is not an id of tag36h11")
        assert perception.confirm('7', image_of(TAG_7)).detected
        assert process.stop() == 0
        assert not any('never awaited' in line for line in process.log)
        assert not any(future.done() for future in waiting)
