"""The camera for tests and simulations shows the tag that the mission stands at, or what the robot sees."""

import json
import math

import numpy as np
import pytest
from confirming import Confirming
from geometry_msgs.msg import Pose
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.runtime.poses import pose_message
from lupin_greenhouse_bridge.testing._helpers import wait_until
from lupin_simulation.fake_camera import FakeCamera, Settings, message_maker, tag_poses_by_number
from lupin_simulation.pinhole_camera import PinholeCamera
from lupin_tag_confirmation.confirm_tag import ConfirmTagNode
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import Settings as ConfirmTagSettings
from lupin_tag_confirmation.sources import open_source
from nav_msgs.msg import Odometry
from std_msgs.msg import String

AT_TAG = '/mission/at_tag'
CAMERA = PinholeCamera(width=320, height=240, focal_length_pixels=300.0)
RANDOM = np.random.default_rng(0)
WALL = CAMERA.expose(CAMERA.wall(RANDOM), RANDOM)


@pytest.fixture(scope='session')
def tag_7():
    return CAMERA.expose(CAMERA.scene_of_tag(7, RANDOM, distance_m=0.3, angle_degrees=30), RANDOM)


def sight_of(source: str, message):
    return open_source(ConfirmTagSettings(source=source))[1](message)


def test_another_kind_is_refused():
    with pytest.raises(
        StartUpError, match="parameter publishes is 'video': must be image, compressed or det"
    ):
        Settings('video')


def test_an_image_has_the_pixels_of_the_picture(tag_7):
    _, image_of = message_maker('image')
    assert (sight_of('image', image_of(tag_7)).picture == tag_7).all()


def test_a_compressed_image_has_the_tag_of_the_picture(tag_7):
    _, compressed_image_of = message_maker('compressed')
    message = compressed_image_of(tag_7)
    assert message.format == 'mono8; jpeg compressed '
    assert len(message.data) < tag_7.size / 2
    sight = sight_of('compressed', message)
    assert [tag.tag_number for tag in sight.detections] == [7]
    assert np.abs(sight.picture.astype(int) - tag_7).mean() < 5


def test_detections_are_those_of_the_picture(tag_7):
    message_type, detections_of = message_maker('detections')
    (expected,) = TagDetector().detect(tag_7)
    message = detections_of(tag_7)
    assert type(message) is message_type
    (found,) = sight_of('detections', message).detections
    assert found[:2] == expected[:2]
    assert found.decision_margin == pytest.approx(expected.decision_margin)
    assert np.allclose(found.corners, expected.corners)
    (centre,) = [(tag.centre.x, tag.centre.y) for tag in message.detections]
    assert centre == pytest.approx(expected.corners.mean(axis=0), abs=0.01)
    assert not detections_of(WALL).detections


@pytest.mark.parametrize('source', ['image', 'compressed', 'detections'])
def test_it_shows_the_tag_of_the_mission_and_a_wall_for_any_other_id(run_nodes, source):
    parameters = {'timeout_seconds': 0.0, 'max_image_age_seconds': 3600.0}
    *_, node = run_nodes(FakeCamera, ConfirmTagNode, publishes=source, source=source, **parameters)
    at_tag = node.create_publisher(String, AT_TAG, latched())
    confirming = Confirming(node)
    for tag_id in ('7', '587', 'seven', '586', ''):
        at_tag.publish(String(data=tag_id))
        if tag_id in ('7', '586'):
            wait_until(lambda tag_id=tag_id: confirming.confirm(tag_id).detected)
        else:
            confirming.confirm_until('no tag in view in 4 images')


def test_an_id_outside_the_family_has_no_place_in_the_picture(tmp_path):
    tag_file = tmp_path / 'tags.json'
    tag = {'x': 1.0, 'y': 2.0, 'sensors': ['co2']}
    tags = {'7': tag, '587': tag, 'seven': tag, '-1': tag}
    tag_file.write_text(json.dumps({'tags': tags, 'tables': {}}), encoding='utf-8')
    assert set(tag_poses_by_number(Settings(tag_file=str(tag_file)))) == {7}


def test_a_camera_on_the_robot_sees_its_tag_only_from_where_the_robot_really_stands(run_nodes):
    parameters = {'timeout_seconds': 0.0, 'max_image_age_seconds': 3600.0, 'from_odometry': True}
    *_, node = run_nodes(FakeCamera, ConfirmTagNode, **parameters)
    at_tag = node.create_publisher(String, AT_TAG, latched())
    at_tag.publish(String(data='7'))  # what the mission believes counts for nothing
    odometry = node.create_publisher(Odometry, '/odom', 1)
    confirming = Confirming(node)
    confirming.confirm_until('no tag in view in 4 images')  # no odometry yet
    tag = tag_poses_by_number(Settings())[7]
    x, y = tag.x + 0.4 * math.cos(tag.facing), tag.y + 0.4 * math.sin(tag.facing)
    towards, aside = pose_message(x, y, tag.facing + math.pi), pose_message(x, y, tag.facing)

    def stands_at(pose: Pose):
        message = Odometry()
        message.pose.pose = pose
        odometry.publish(message)
        return confirming.confirm('7')

    wait_until(lambda: stands_at(towards).detected)
    wait_until(lambda: 'no tag in view' in stands_at(aside).error_message)
    wait_until(lambda: stands_at(towards).detected)
