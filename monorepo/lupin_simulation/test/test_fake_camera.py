"""The camera for tests and simulations shows the tag that the mission stands at, or what the robot sees."""

import json
import math
import re

import numpy as np
import pytest
from lupin_greenhouse_bridge.contract import SERVICE_QOS, latched
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS, call, greet, wait_until
from lupin_msgs.srv import ConfirmTag
from lupin_planning.poses import PoseInPlane, pose_message
from lupin_simulation.fake_camera import FakeCamera, Settings, message_maker
from lupin_simulation.pinhole_camera import PinholeCamera
from lupin_tag_confirmation.confirm_tag import ConfirmTagNode
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import TOPICS
from nav_msgs.msg import Odometry
from std_msgs.msg import String


def test_a_detection_has_the_place_of_its_tag_in_the_picture():
    camera, random = PinholeCamera(), np.random.default_rng(0)
    picture = camera.expose(camera.scene_of_tag(7, random, distance_m=0.3, angle_degrees=30), random)
    (found,), (tag,) = message_maker('detections')[1](picture).detections, TagDetector().detect(picture)
    assert (found.family, found.id, found.hamming) == ('tag36h11', 7, 0)
    assert found.decision_margin == pytest.approx(tag.decision_margin)
    assert np.allclose([(each.x, each.y) for each in found.corners], tag.corners)
    assert (found.centre.x, found.centre.y) == pytest.approx(tag.corners.mean(axis=0), abs=0.01)


@pytest.fixture
def run_camera(run_nodes):
    """Return a function that runs both nodes; it returns a third node, and a function that asks for a tag."""

    def run(**parameters):
        every = {'timeout_seconds': 0.0, 'max_image_age_seconds': 3600.0}
        *_, node = run_nodes(FakeCamera, ConfirmTagNode, **every, **parameters)
        client = node.create_client(ConfirmTag, '/perception/confirm_tag', qos_profile=SERVICE_QOS)
        assert client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
        greet(client, ConfirmTag.Request())  # an empty id is refused at once

        def reason(tag_id: str) -> str:
            """Return why confirm_tag does not confirm a tag; '' if it does."""
            return call(client, ConfirmTag.Request(expected_tag_id=tag_id)).error_message

        return node, reason

    return run


@pytest.mark.parametrize(
    ('source', 'tag_ids'),
    [('image', ['7', '587', 'seven', '586', '']), ('compressed', ['7', '']), ('detections', ['7', ''])],
)
def test_it_shows_the_tag_of_the_mission_and_a_wall_for_any_other_id(run_camera, source, tag_ids, capfd):
    node, reason = run_camera(publishes=source, source=source)
    assert (
        f'ready: /{TOPICS[source]} shows the tag that is named on /mission/at_tag' in capfd.readouterr().err
    )
    at_tag = node.create_publisher(String, '/mission/at_tag', latched())
    for tag_id in tag_ids:
        at_tag.publish(String(data=tag_id))
        if tag_id in ('7', '586'):
            wait_until(lambda tag_id=tag_id: reason(tag_id) == '')
        else:
            wait_until(lambda: 'no tag in view in 4 images' in reason('7'))


def test_an_id_outside_the_family_has_no_place_in_the_picture_and_is_named(tmp_path, run_nodes, capfd):
    tag_file = tmp_path / 'tags.json'
    tag = {'x': 1.0, 'y': 2.0, 'sensors': ['co2']}
    tags = {'7': tag, '587': tag, 'seven': tag, '-1': tag}
    tag_file.write_text(json.dumps({'tags': tags, 'tables': {}}), encoding='utf-8')
    assert set(Settings(tag_file=str(tag_file)).tag_poses()) == {7}
    run_nodes(FakeCamera, from_odometry=True, tag_file=str(tag_file))
    assert re.search('no image shows tags .*seven.*: not in tag36h11, which has 0', capfd.readouterr().err)


def test_a_camera_on_the_robot_sees_its_tag_only_from_where_the_robot_really_stands(run_camera):
    node, reason = run_camera(from_odometry=True)
    at_tag = node.create_publisher(String, '/mission/at_tag', latched())
    at_tag.publish(String(data='7'))  # counts for nothing
    wait_until(lambda: 'no tag in view in 4 images' in reason('7'))  # no odometry yet
    odometry = node.create_publisher(Odometry, '/odom', 1)
    x, y, facing = Settings().tag_poses()[7]
    stand = PoseInPlane(x + 0.4 * math.cos(facing), y + 0.4 * math.sin(facing), facing + math.pi)

    def reason_at(pose: PoseInPlane) -> str:
        message = Odometry()
        message.pose.pose = pose_message(*pose)
        odometry.publish(message)
        return reason('7')

    wait_until(lambda: reason_at(stand) == '')
    wait_until(lambda: 'no tag in view' in reason_at(stand._replace(yaw=facing)))
    wait_until(lambda: reason_at(stand) == '')
