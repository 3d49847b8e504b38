"""The goals of a robot in the map, and the order of its visits, without ROS."""

import functools
import math
from dataclasses import replace

import pytest
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag
from lupin_mission.plan import Plan
from lupin_mission.settings import Settings
from lupin_planning.occupancy import OccupancyMap
from lupin_planning.registration import Transform

# A table along x; the tags are on its south side and face south.
LAYOUT = Layout(
    {tag_id: Tag(x, 1.0, ['co2']) for tag_id, x in (('1', 0.5), ('2', 3.5), ('3', 1.5), ('4', 2.5))},
    {'table': (0.0, 1.0, 4.0, 2.0)},
)
TURNED = Transform(10.0, 20.0, math.pi / 2)
AS_IT_IS = Transform()
SETTINGS = Settings(drive='nav2', walls='-1.6 -0.6 5.6 3.6')


@functools.cache
def plan(in_map=AS_IT_IS, **parameters) -> Plan:
    return Plan(LAYOUT, replace(SETTINGS, **parameters), in_map)


def test_the_robot_stands_before_a_tag_and_looks_at_it():
    assert plan().goals['1'][0] == pytest.approx((0.5, 0.5, math.pi / 2))
    for standoff_m in (0.35, 0.75, 1.2):
        goal = plan(approach_standoff_m=standoff_m).goals['1'][0]
        assert goal == pytest.approx((0.5, 1.0 - standoff_m, math.pi / 2))
    assert plan(TURNED).goals['1'][0] == pytest.approx((9.5, 20.5, math.pi))
    found = [plan(TURNED).goal_in_layout_m(*each) for each in (('1', 1), ('1', 9), ('9', 1))]
    assert found == [(0.5, 0.5), None, None]


def test_a_goal_has_its_room_in_the_map_where_the_layout_lies():
    """A pillar of 0.1 m in the pose of tag 1, in a map whose cells lie along its own axes."""
    x, y = TURNED.point(0.5, 0.5)
    cells = [0] * (100 * 100)  # 0.1 m, around the layout
    column, row = int((x - 5.0) / 0.1), int((y - 18.0) / 0.1)
    cells[row * 100 + column] = 100
    occupancy = OccupancyMap(100, 100, 0.1, (5.0, 18.0, 0.0), cells)
    goals, without = Plan(LAYOUT, SETTINGS, TURNED, occupancy).goals, plan(TURNED).goals
    assert {tag_id for tag_id in goals if goals[tag_id][0] != without[tag_id][0]} == {'1'}
    assert all(math.dist(goal[:2], (x, y)) >= 0.25 for goal in goals['1'])


def test_the_shortest_order_knows_the_obstacles_of_the_map():
    """A barrier south of the table, in the map alone, is between tags 1 and 3 and tags 4 and 2."""
    cells = [100 * (row < 16 and column in (35, 36)) for row in range(42) for column in range(72)]
    occupancy = OccupancyMap(72, 42, 0.1, (-1.6, -0.6, 0.0), cells)  # of 0.1 m, between the walls
    assert plan().shortest(list('1234'), (2.8, 0.4)) == list('2431')
    assert Plan(LAYOUT, SETTINGS, AS_IT_IS, occupancy).shortest(list('1234'), (2.8, 0.4)) == list('4213')


@pytest.fixture
def overrides(tmp_path):
    """Return a function that writes an approach_overrides.yaml and returns the parameter."""

    def write(text):
        path = tmp_path / 'approach_overrides.yaml'
        path.write_text(text)
        return {'approach_overrides_file': str(path)}

    return write


@pytest.mark.parametrize('in_map', [AS_IT_IS, TURNED, Transform(-3.0, 1.0, -0.7)])
@pytest.mark.parametrize('frame', ['layout', 'map'])
def test_an_override_is_a_pose_in_the_frame_of_its_file(overrides, in_map, frame):
    goal = (*in_map.point(0.6, 0.3), in_map.heading(1.5))
    x, y, yaw = goal if frame == 'map' else (0.6, 0.3, 1.5)
    pose = f'{{x: {x!r}, y: {y!r}, yaw: {yaw!r}}}'
    found = plan(in_map, **overrides(f'frame: {frame}\noverrides: {{"1": {pose}, "99": {pose}}}'))
    assert found.goals['1'] == [pytest.approx(goal)]
    (warning,) = found.warnings
    assert "tag '99' is not in the layout" in warning


@pytest.mark.parametrize(
    ('robot', 'dock', 'order'),
    [
        ((20.0 - 19.0, 20.0 + 0.5), None, '1342'),  # in a table or outside: no start
        ((9.5, 24.0), None, '2431'),  # in the layout: (4, 0.5), beside tag 2
        ((8.5, 21.0), (9.5, 24.0), '2431'),  # the robot is in the table
        (None, (9.5, 24.0), '2431'),
        (None, None, '1342'),
        ((9.5, 24.0), (9.5, 20.0), '2431'),
    ],
)
def test_the_shortest_order_starts_at_the_robot_or_its_dock_if_they_are_free(robot, dock, order):
    """A tag without a pose is visited last."""
    assert ''.join(plan(TURNED).shortest(list('91234'), robot, dock)) == f'{order}9'
