"""The world that Drake renders: its camera and its check. ci/tests/test_world.py has what needs Drake."""

import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.runtime.poses import pose_message
from lupin_greenhouse_bridge.testing._helpers import wait_until
from lupin_simulation import check_world, world_camera
from lupin_simulation.pinhole_camera import PinholeCamera
from lupin_simulation.rendered_world import RenderedWorld, TagModel, View, viewpoint
from lupin_simulation.settings import SOURCE_OF_DRAKE
from lupin_simulation.world_camera import WorldCamera, view_of
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String

SOUTHWARDS = TagModel(
    np.array([2.0, 1.0, 0.3]), *np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
)
WHITE, BLACK = 255, 0


@pytest.mark.parametrize(
    ('angle_degrees', 'place'),
    [(0, (2.0, 0.5, 0.3)), (90, (2.5, 1.0, 0.3)), (-90, (1.5, 1.0, 0.3)), (60, (2.433013, 0.75, 0.3))],
)
def test_a_viewpoint_is_in_front_of_a_tag_and_turned_to_its_right(angle_degrees, place):
    assert viewpoint(SOUTHWARDS, 0.5, angle_degrees) == pytest.approx(place)


def test_the_camera_stands_in_front_of_the_tag_and_looks_at_it_and_without_a_tag_at_the_sky():
    random = np.random.default_rng(1)
    for _ in range(200):
        eye, at = view_of(SOUTHWARDS, random)
        right, up, out = (
            axis @ (eye - SOUTHWARDS.centre) for axis in (SOUTHWARDS.to_right, SOUTHWARDS.up, SOUTHWARDS.out)
        )
        assert up == 0.0
        assert out > abs(right)  # less than 45 degrees from the normal
        assert 0.3 - 0.03 < np.hypot(right, out) < 1.0 + 0.03
        assert np.linalg.norm(at - SOUTHWARDS.centre) < 0.03
    eye, at = view_of(None, random)
    assert at[2] > eye[2] > 0.0


def look(_eye, at) -> np.ndarray:
    """Return a white picture of the tag, and a black one of anything else."""
    return np.full((24, 32, 3), WHITE if np.linalg.norm(at - SOUTHWARDS.centre) < 0.2 else BLACK, np.uint8)


@pytest.fixture
def run_camera(monkeypatch, run_nodes):
    """Return a function that runs a camera beside a robot whose mission stands at tag 7 already."""
    world = SimpleNamespace(tags={7: SOUTHWARDS}, look=look)
    monkeypatch.setattr(world_camera, 'RenderedWorld', lambda _file: world)
    monkeypatch.setattr(world_camera, 'FRAMES_PER_SECOND', 100)

    def run(namespace='', **parameters):
        arguments = ['-r', f'__ns:={namespace}'] if namespace else []
        *_, robot = run_nodes(WorldCamera, arguments=arguments, **parameters)
        images = []
        topic = f'{namespace}/camera/color/image_raw'
        robot.create_subscription(Image, topic, images.append, qos_profile_sensor_data)
        at_tag = robot.create_publisher(String, f'{namespace}/mission/at_tag', latched())
        at_tag.publish(String(data='7'))
        return robot, at_tag, images, lambda level: bool(images) and images[-1].data[0] == level

    return run


def test_it_shows_the_tag_of_the_mission_in_its_namespace(run_camera):
    _, at_tag, images, shows = run_camera('/robot1')
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


def test_a_tag_is_read_in_all_views_of_a_group_and_the_tags_are_counted(monkeypatch, capsys):
    monkeypatch.setattr(check_world.Progress, 'NEXT_SECONDS', 0.0)
    camera, random = PinholeCamera(), np.random.default_rng(0)
    front = camera.expose(camera.scene_of_tag(7, random, distance_m=0.5), random)
    blank = np.full_like(front, 255)
    world = SimpleNamespace(look=lambda eye, _at: np.stack([eye] * 3, axis=-1))
    views = [View(blank, blank), View(front, blank)]

    def tags_read(groups: list[list[View]]) -> set[int]:
        setting = check_world.Setting('here', {7: groups, 8: groups})
        return check_world.tags_read(world, setting, check_world.Progress('check_world', first_seconds=0.0))

    assert tags_read([[each] for each in views]) == {7}
    assert capsys.readouterr().err.splitlines() == ['check_world: here: 0 of 2', 'check_world: here: 1 of 2']
    assert tags_read([views]) == set()


@pytest.mark.parametrize('name', ['', 'missing.sdf'])
def test_a_world_file_that_is_missing_is_named_before_drake_is_asked_for(monkeypatch, name):
    monkeypatch.setitem(sys.modules, 'pydrake', None)
    with pytest.raises(StartUpError, match=f"^there is no file '{name}': name a world made by generate_"):
        RenderedWorld(name)


DRAKE_IS_MISSING = f'Drake is missing (import of pydrake halted; None in sys.modules): {SOURCE_OF_DRAKE}'


@pytest.mark.parametrize(
    ('arguments', 'errors'),
    [
        ('--check', []),  # of the arguments alone
        ('', [DRAKE_IS_MISSING]),
        ('--tag-file /missing.json', ["tag_file '/missing.json': cannot be read"]),
        ('--walls 90 90 94 98', ['outside the walls (x 90 to 94 m, y 90 to 98 m): tags ', DRAKE_IS_MISSING]),
    ],
)
def test_a_check_that_cannot_be_made_is_refused_in_one_line(monkeypatch, capsys, arguments, errors):
    """A layout outside the walls is warned of."""
    monkeypatch.setitem(sys.modules, 'pydrake', None)
    assert check_world.main(arguments.split()) == (2 if errors else 0)
    for line, error in zip(capsys.readouterr().err.splitlines(), errors, strict=True):
        assert line.startswith(f'check_world: {error}')
