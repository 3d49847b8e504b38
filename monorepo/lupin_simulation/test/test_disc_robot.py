"""The robot of the fake navigator: how it moves, and the parameters of the nodes. No time passes."""

import math
import random

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.testing.helpers import check_settings
from lupin_planning.poses import PoseInPlane
from lupin_simulation import fake_camera
from lupin_simulation import settings as navigator_settings
from lupin_simulation.disc_robot import TURN_RAD_PER_S, DiscRobot, arrival_at
from lupin_simulation.settings import Settings

NORTH = math.pi / 2
PATH = [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0)]  # 3 m, with one turn
DURATION_SECONDS = 3.0 / 0.5 + NORTH / TURN_RAD_PER_S + NORTH / TURN_RAD_PER_S


@pytest.fixture
def robot():
    robot = DiscRobot(PoseInPlane(0.0, 0.0, 0.0), speed_m_per_s=0.5)
    robot.follow(PATH, 0.0)
    return robot


@pytest.mark.parametrize(('start', 'yaw'), [(-3.0, 3.0), (3.0, -3.0), (0.5, -0.5)])
def test_it_turns_the_shorter_way_round(start, yaw):
    robot = DiscRobot(PoseInPlane(0.0, 0.0, start), speed_m_per_s=0.5)
    robot.follow([], yaw)
    seconds = abs(math.remainder(yaw - start, math.tau)) / TURN_RAD_PER_S
    robot.advance(0.99 * seconds)
    assert robot.is_moving
    robot.advance(0.02 * seconds)
    assert (robot.pose.yaw, robot.is_moving) == (yaw, False)


def test_it_drives_straight_and_turns_on_the_spot_before_it_drives_on(robot):
    robot.advance(1.0)
    assert robot.pose == pytest.approx((0.5, 0.0, 0.0))
    assert robot.left_m == pytest.approx(2.5)
    robot.advance(1.0 + 0.5 * NORTH / TURN_RAD_PER_S)
    assert robot.pose == pytest.approx((1.0, 0.0, NORTH / 2))


@pytest.mark.parametrize('steps', [1, 7, 400])
def test_it_ends_at_the_end_of_its_path_however_the_time_is_cut(robot, steps):
    for _ in range(steps):
        robot.advance(0.999 * DURATION_SECONDS / steps)
        assert robot.is_moving
    robot.advance(0.01 * DURATION_SECONDS)
    assert (robot.is_moving, robot.pose) == (False, (1.0, 2.0, 0.0))
    assert (type(robot.left_m), robot.left_m) == (float, 0.0)  # a message takes no int
    robot.stop()
    assert robot.route == [PATH[0], *PATH, PATH[-1]]  # it stood at the start and stands at the end


ACCEPTED = {
    'blocked': 'empty, or x0 y0 x1 y1 of each rectangle: "0.0 2.0 1.0 2.5", with x0 < x1 and y0 < y1',
    'start_pose': 'x, y and yaw in radians: "0.5 0.5 0.0", or an array',
}


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('blocked', ['1 2 3', 'here', '0 1 2 nan', '2 1 0 3', '0 0 0 1', 7, [1.0, 2.0]]),
        ('start_pose', ['', '1 2 up', '1 2 90', '1 2 3 4']),
    ],
)
def test_wrong_numbers_are_refused(name, values):
    for value in values:
        with pytest.raises(StartUpError) as refusal:
            Settings(**{name: value})
        assert str(refusal.value) == f'parameter {name} is {value!r}: must be {ACCEPTED[name]}'


@pytest.mark.parametrize('node', [navigator_settings, fake_camera])
def test_each_parameter_has_its_type_and_its_limits(node):
    check_settings(node.Settings)


def arrivals(goal: PoseInPlane, seed: int = 0, **parameters) -> list[PoseInPlane]:
    """Return where a robot arrives that is sent to one goal a hundred times."""
    settings, chance = Settings(**parameters), random.Random(seed)
    grid = settings.grid()
    return [arrival_at(goal, settings, chance, grid) for _ in range(100)]


def test_a_robot_arrives_beside_its_goal_within_the_errors_and_each_seed_repeats_itself():
    goal, errors = PoseInPlane(0.5, 0.5, 1.0), {'arrival_error_m': 0.06, 'arrival_error_rad': 0.15}
    found = arrivals(goal, **errors)
    assert 0.05 < max(math.dist(each[:2], goal[:2]) for each in found) <= 0.06
    assert 0.14 < max(abs(each.yaw - goal.yaw) for each in found) <= 0.15
    assert len(set(found)) == 100
    assert arrivals(goal, **errors) == found != arrivals(goal, seed=1, **errors)
    assert set(arrivals(goal)) == {goal}


def test_a_table_stops_a_robot_that_arrives_beside_its_goal():
    settings = {'arrival_error_m': 0.06, 'blocked': '0.0 1.0 1.0 1.5'}
    found = arrivals(PoseInPlane(0.5, 0.77, 0.0), **settings)
    assert Settings(**settings).grid().are_free([each[:2] for each in found]).all()
    assert min(each.y for each in found) < 0.75  # the way from the table is free
    assert max(each.y for each in found) > 0.77
