"""The camera in the world: its viewpoints, and its topics. The world is a stand-in: there may be no Drake."""

import contextlib
import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.runtime.poses import pose_message
from lupin_greenhouse_bridge.testing._helpers import executable, running, wait_until
from lupin_simulation import world_camera
from lupin_simulation.rendered_world import TagModel
from lupin_simulation.world_camera import WorldCamera, view_of
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String

TAG = TagModel(np.array([2.0, 1.0, 0.3]), *np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]))
WHITE, BLACK = 255, 0


def look(_eye, at) -> np.ndarray:
    """Return a white picture of the tag, and a black one of anything else."""
    return np.full((24, 32, 3), WHITE if np.linalg.norm(at - TAG.centre) < 0.2 else BLACK, np.uint8)


def test_the_camera_stands_in_front_of_the_tag_and_looks_at_it():
    random = np.random.default_rng(1)
    for _ in range(200):
        eye, at = view_of(TAG, random)
        right, up, out = (axis @ (eye - TAG.centre) for axis in (TAG.to_right, TAG.up, TAG.out))
        assert up == 0.0
        assert out > abs(right)  # less than 45 degrees from the normal
        assert 0.3 - 0.03 < np.hypot(right, out) < 1.0 + 0.03
        assert np.linalg.norm(at - TAG.centre) < 0.03 + 1.0 * np.tan(world_camera.LARGEST_YAW)


def test_without_a_tag_the_camera_looks_at_the_sky():
    eye, at = view_of(None, np.random.default_rng(1))
    assert at[2] > eye[2] > 0.0


@pytest.fixture
def run_camera(monkeypatch):
    """Return a function that runs a camera beside a robot whose mission stands at tag 7 already."""
    world = SimpleNamespace(tags={7: TAG}, look=look)
    monkeypatch.setattr(world_camera, 'RenderedWorld', lambda _file: world)
    with contextlib.ExitStack() as stack:

        def run(namespace='', **parameters):
            arguments = ['-r', f'__ns:={namespace}'] if namespace else []
            # One participant for both: their endpoints find each other at once.
            beside = partial(rclpy.create_node, 'robot')
            _, robot = stack.enter_context(running(WorldCamera, beside, arguments=arguments, **parameters))
            images = []
            topic = f'{namespace}/camera/color/image_raw'
            robot.create_subscription(Image, topic, images.append, qos_profile_sensor_data)
            at_tag = robot.create_publisher(String, f'{namespace}/mission/at_tag', latched())
            at_tag.publish(String(data='7'))
            return robot, at_tag, images, lambda level: bool(images) and images[-1].data[0] == level

        yield run


@pytest.mark.parametrize('namespace', ['', '/robot1'])
def test_it_shows_the_tag_of_the_mission_in_its_namespace(run_camera, namespace):
    _, at_tag, images, shows = run_camera(namespace)
    wait_until(lambda: shows(WHITE))
    for other in ('', '8', 'seven', '9' * 5000):
        at_tag.publish(String(data=other))
        wait_until(lambda: shows(BLACK))
        at_tag.publish(String(data='7'))
        wait_until(lambda: shows(WHITE))
    assert (images[-1].encoding, images[-1].height, images[-1].width) == ('mono8', 24, 32)
    assert images[-1].header.frame_id == 'camera'


def test_a_camera_on_the_robot_looks_from_its_odometry_and_not_from_the_mission(run_camera):
    robot, _, _, shows = run_camera(from_odometry=True)
    odometry = robot.create_publisher(Odometry, '/odom', 1)

    def shows_from(x: float, y: float, yaw: float, level: int) -> bool:
        message = Odometry()
        message.pose.pose = pose_message(x, y, yaw)
        odometry.publish(message)
        return shows(level)

    wait_until(lambda: shows(BLACK))  # no odometry yet
    wait_until(lambda: shows_from(2.0, 0.0, math.pi / 2, WHITE))
    wait_until(lambda: shows_from(2.0, 0.0, 0.0, BLACK))


@pytest.mark.usefixtures('without_drake')
def test_a_missing_drake_is_one_fatal_line_that_names_the_command(start_node):
    camera = start_node([executable('lupin_simulation', 'world_camera')], world_file='greenhouse.sdf')
    assert camera.refusal().endswith('Drake is missing (No Drake in this test): pip install drake')
