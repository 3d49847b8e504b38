# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The approach poses of a layout, the free floor, and the order of visits."""

import heapq
import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.approach import (
    ApproachPose,
    Override,
    ViewingLimits,
    find_approaches,
    read_overrides,
)
from lupin_greenhouse_bridge.planning.free_space import MARGIN_M, PLATE_WIDTH_M, FreeSpace, room_of
from lupin_greenhouse_bridge.planning.route import in_numeric_order, plan_route
from lupin_greenhouse_bridge.planning.tag_poses import find_tag_poses, tables_of
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, find_layout

HEAD_ON = {'smallest_distance_m': 0.5, 'largest_distance_m': 0.5, 'largest_angle_rad': 0.0}
SAME_M = 1e-6


@pytest.fixture(scope='module')
def shipped():
    """Return the layout that mdp-greenhouse ships."""
    return find_layout('')


def layout_of(*places, **tables) -> Layout:
    """Return a layout with tags '0', '1', ... at these places."""
    return Layout({str(number): Tag(*each, ['co2']) for number, each in enumerate(places)}, tables)


def gap_m(layout: Layout, x: float, y: float) -> float:
    """Return the distance of a point to the nearest table, plate or wall; below 0 outside the walls."""
    x0, y0, x1, y1 = room_of(layout)
    gaps = [x - x0, y - y0, x1 - x, y1 - y]
    gaps += [each.distance_m(x, y) for each in tables_of(layout)]
    for tag in find_tag_poses(layout).values():
        along = np.array([-math.sin(tag.facing), math.cos(tag.facing)]) * PLATE_WIDTH_M / 2
        offset = np.array([x - tag.x, y - tag.y])
        share = np.clip(offset @ along / (along @ along), -1.0, 1.0)
        gaps.append(float(np.linalg.norm(offset - share * along)))
    return min(gaps)


def points_of(way, step_m: float = 0.01):
    """Yield points along a way."""
    for (xa, ya), (xb, yb) in itertools.pairwise(way):
        count = max(1, math.ceil(math.dist((xa, ya), (xb, yb)) / step_m))
        yield from ((xa + (xb - xa) * n / count, ya + (yb - ya) * n / count) for n in range(count + 1))


# Poses by the number of tags of the simulator's version, and by radius: all, and head-on at 0.5 m.
COUNTS = {
    29: {0.15: (29, 22), 0.20: (29, 20), 0.30: (24, 15)},
    22: {0.15: (22, 21), 0.20: (22, 21), 0.30: (22, 21)},
}
# Limits of the route's length: the shortest, and by number.
ROUTES_M = {29: ((23.0, 27.0), (60.0, 75.0)), 22: ((29.0, 33.0), (44.0, 52.0))}
# A yard with one entrance, 0.45 m wide. Tag 0 is in it, tag 1 outside.
YARD = layout_of(
    (1.5, 0.5),
    (1.5, 0.0),
    south=(0.0, 0.0, 3.0, 0.5),
    north=(0.0, 3.0, 3.0, 3.5),
    west=(0.0, 0.5, 0.5, 3.0),
    east=(2.5, 0.95, 3.0, 3.0),
)
OUTSIDE_M, INSIDE_M = (-0.8, -0.8), (1.5, 1.75)


@pytest.mark.parametrize('radius_m', COUNTS[29])
def test_so_many_tags_of_the_shipped_layout_have_a_pose(shipped, radius_m):
    count, head_on = COUNTS[len(shipped.tags)][radius_m]
    assert len(find_approaches(shipped, ViewingLimits(radius_m)).poses) == count
    assert len(find_approaches(shipped, ViewingLimits(radius_m, **HEAD_ON)).poses) == head_on


def test_a_tag_without_a_pose_has_the_reason():
    assert not find_approaches(YARD, ViewingLimits(0.2), start_m=OUTSIDE_M).unreachable
    outside = find_approaches(YARD, ViewingLimits(0.3), start_m=OUTSIDE_M)
    assert outside.unreachable == {'0': 'cut off from the start at (-0.8, -0.8)'}
    inside = find_approaches(YARD, ViewingLimits(0.3), start_m=INSIDE_M)
    assert inside.unreachable == {'1': 'cut off from the start at (1.5, 1.75)'}
    crowded = YARD._replace(tables={**YARD.tables, 'ahead': (1.2, -0.7, 1.8, -0.3)})
    assert find_approaches(crowded, ViewingLimits(0.3, **HEAD_ON)).unreachable == {
        '0': 'cut off from the rest of the floor',
        '1': 'no place for a robot of radius 0.30 m within 0.5 m and 0°',
    }


def test_a_pose_is_at_the_preferred_distance_head_on_where_that_is_free():
    approaches = find_approaches(layout_of((2.0, 1.0), table=(1.0, 1.0, 3.0, 1.5)), ViewingLimits())
    assert approaches.poses['0'] == pytest.approx((2.0, 0.5, math.pi / 2, 0.5, 0.0))


def test_the_preferred_distance_comes_before_the_smallest_angle():
    layout = layout_of((2.0, 1.0), table=(1.0, 1.0, 3.0, 1.5), ahead=(1.95, 0.2, 2.05, 0.5))
    pose = find_approaches(layout, ViewingLimits(0.1)).poses['0']
    assert pose.distance_m == pytest.approx(0.5)
    assert 0.1 < pose.angle_rad < math.pi / 4


def test_a_start_that_is_not_free_is_refused(shipped):
    with pytest.raises(StartUpError, match=r'the start at \(2, 7.4\) is not free'):
        find_approaches(shipped, ViewingLimits(), start_m=(2.0, 7.4))


@pytest.mark.parametrize(
    ('values', 'fragment'),
    [
        ({'smallest_distance_m': 0.6}, 'the distances to a tag are 0.6, 0.5 and 1 m'),
        ({'largest_distance_m': math.nan}, 'must be above 0, and the smallest'),
        ({'largest_angle_rad': math.pi / 2}, 'is 90 degrees: must be from 0 to below 90'),
        ({'robot_radius_m': -0.1}, 'must not be below 0'),
        ({'clearance_m': math.nan}, 'must not be below 0'),
    ],
)
def test_a_reach_that_allows_no_pose_is_refused(values, fragment):
    with pytest.raises(StartUpError) as refusal:
        ViewingLimits(**values)
    assert fragment in str(refusal.value)


def test_a_robot_too_large_for_the_way_around_the_tables_is_refused(shipped):
    with pytest.raises(StartUpError, match=r'does not fit: must be from 0 to below 0\.8 m'):
        FreeSpace(shipped, MARGIN_M / 2)


place_in_room = st.floats(0.0, 4.0).map(lambda value: round(value, 2))
sizes = st.floats(0.05, 1.5).map(lambda value: round(value, 2))


@st.composite
def layouts(draw):
    """Draw tables anywhere, and tags on their corners, in rows, alone, and in one spot."""
    tables = {}
    for number in range(draw(st.integers(0, 4))):
        x, y = draw(place_in_room), draw(place_in_room)
        tables[str(number)] = (x, y, x + draw(sizes), y + draw(sizes))
    places = draw(st.lists(st.tuples(place_in_room, place_in_room), min_size=1, max_size=3))
    places += [draw(st.sampled_from([(a, b), (c, b), (a, d), (c, d)])) for a, b, c, d in tables.values()]
    row = draw(st.integers(0, 4))
    places += [(places[0][0] + 0.3 * number, places[0][1]) for number in range(row)]  # the first, and a row
    return layout_of(*places, **tables)


@settings(max_examples=60)
@given(layout=layouts(), radius_m=st.sampled_from([0.0, 0.1, 0.2, 0.35]))
def test_every_pose_is_free_looks_at_its_tag_and_can_be_driven_to(layout, radius_m):
    reach = ViewingLimits(radius_m)
    approaches = find_approaches(layout, reach)
    assert set(approaches.poses) | set(approaches.unreachable) == set(layout.tags)
    assert not set(approaches.poses) & set(approaches.unreachable)
    for tag_id, pose in approaches.poses.items():
        tag = find_tag_poses(layout)[tag_id]
        assert gap_m(layout, pose.x, pose.y) >= radius_m - SAME_M
        assert math.dist(pose[:2], tag[:2]) == pytest.approx(pose.distance_m)
        assert pose.x + pose.distance_m * math.cos(pose.yaw) == pytest.approx(tag.x)
        assert pose.y + pose.distance_m * math.sin(pose.yaw) == pytest.approx(tag.y)
        assert reach.smallest_distance_m - SAME_M <= pose.distance_m <= reach.largest_distance_m + SAME_M
        off_normal = math.remainder(pose.yaw + math.pi - tag.facing, math.tau)
        assert abs(off_normal) == pytest.approx(pose.angle_rad, abs=SAME_M)
        assert pose.angle_rad <= reach.largest_angle_rad + SAME_M
    floor = FreeSpace(layout, radius_m + reach.clearance_m)
    route = plan_route(floor, approaches.poses, None, 'shortest')
    assert sorted(route.tag_ids) == sorted(approaches.poses)
    assert all(gap_m(layout, *point) >= radius_m - SAME_M for point in points_of(route.points_m, 0.05))


@settings(max_examples=30)
@given(layout=layouts(), radius_m=st.sampled_from([0.1, 0.25]), ends=st.tuples(*[place_in_room] * 4))
def test_a_way_is_free_and_no_longer_than_on_a_grid(layout, radius_m, ends):
    floor = FreeSpace(layout, radius_m)
    start, goal = ends[:2], ends[2:]
    assume(floor.is_free(*start) and floor.is_free(*goal))
    way = floor.way(start, goal)
    on_grid_m = grid_length_m(layout, radius_m, start, goal)
    if way is None:
        assert on_grid_m == math.inf
    else:
        assert (way[0], way[-1]) == (start, goal)
        assert all(gap_m(layout, *point) >= radius_m - SAME_M for point in points_of(way, 0.05))
        assert floor.length_m(way) <= 1.03 * on_grid_m + 0.2


def grid_length_m(layout: Layout, radius_m: float, start, goal, step_m: float = 0.1) -> float:
    """Return the length of the shortest way on a grid with eight neighbours; infinite if there is none."""
    x0, y0, x1, y1 = room_of(layout)
    play_m = radius_m * 1.09 + 0.001  # outside the octagon around the robot's circle

    def nearest(point):
        i, j = (round((point[axis] - (x0, y0)[axis]) / step_m) for axis in (0, 1))
        return i, j

    is_free = {}

    def free(cell):
        if cell not in is_free:
            x, y = x0 + cell[0] * step_m, y0 + cell[1] * step_m
            is_free[cell] = x0 < x < x1 and y0 < y < y1 and gap_m(layout, x, y) > play_m + step_m
        return is_free[cell]

    first, last = nearest(start), nearest(goal)
    if not (free(first) and free(last)):
        return math.inf
    best, heap = {first: 0.0}, [(0.0, first)]
    while heap:
        length_m, cell = heapq.heappop(heap)
        if cell == last:
            return length_m
        for step in itertools.product((-1, 0, 1), repeat=2):
            there = cell[0] + step[0], cell[1] + step[1]
            longer_m = length_m + step_m * math.hypot(*step)
            if longer_m < best.get(there, math.inf) and free(there):
                best[there] = longer_m
                heapq.heappush(heap, (longer_m, there))
    return math.inf


def test_the_same_layout_gives_the_same_poses_and_route(shipped):
    results = []
    for _ in range(2):
        approaches = find_approaches(shipped, ViewingLimits())
        results.append((approaches, plan_route(FreeSpace(shipped, 0.2), approaches.poses, None, 'shortest')))
    assert results[0] == results[1]


def test_the_shortest_route_of_the_shipped_layout_is_much_shorter_than_by_number(shipped):
    poses = find_approaches(shipped, ViewingLimits()).poses
    floor = FreeSpace(shipped, 0.205)
    routes = {
        order: plan_route(floor, poses, (0.5, 0.5), order) for order in ('given', 'numeric', 'shortest')
    }
    assert routes['given'].tag_ids == list(shipped.tags)
    assert routes['numeric'].tag_ids == sorted(shipped.tags, key=int)
    for order, (lowest_m, highest_m) in zip(
        ('shortest', 'numeric'), ROUTES_M[len(shipped.tags)], strict=True
    ):
        assert lowest_m < routes[order].length_m < highest_m
    for route in routes.values():
        assert route.points_m[0] == (0.5, 0.5)
        assert route.length_m == pytest.approx(floor.length_m(route.points_m))
        assert all(poses[tag_id][:2] in route.points_m for tag_id in route.tag_ids)


def test_numbers_come_in_their_order_and_before_other_ids():
    ids = ['b', '10', 'aa', '9', '007', '9' * 5000]
    assert sorted(ids, key=in_numeric_order) == ['007', '9', '10', '9' * 5000, 'aa', 'b']


def test_two_opt_mends_what_the_nearest_first_leaves():
    floor = FreeSpace(layout_of((0.0, -3.0), (12.0, 3.0)), 0.1)
    stops = {'1': 1.0, '2': -1.5, '3': 3.5, '4': -5.0}  # nearest first turns round at each
    poses = {tag_id: ApproachPose(x + 5.0, 0.0, 0.0, 0.5, 0.0) for tag_id, x in stops.items()}
    route = plan_route(floor, poses, (5.0, 0.0), 'shortest')
    assert route.length_m < 13.5


def test_a_route_visits_the_given_tags_in_the_given_order():
    poses = find_approaches(YARD, ViewingLimits()).poses
    route = plan_route(FreeSpace(YARD, 0.2), poses, None, 'given', ['1', '0', '1'])
    assert route.tag_ids == ['1', '0', '1']
    assert plan_route(FreeSpace(YARD, 0.2), poses, OUTSIDE_M, 'shortest', []) == ([], [OUTSIDE_M], 0.0)


@pytest.mark.parametrize(
    ('radius_m', 'start_m', 'tag_ids', 'problem'),
    [
        (0.2, None, ['99'], "tag '99' has no approach pose"),
        (0.3, OUTSIDE_M, ['0'], r'\(1.50, 1.00\) is cut off from \(-0.80, -0.80\)'),
        (0.2, (1.5, 0.25), ['0'], r'\(1.50, 0.25\) is not free'),
    ],
)
def test_a_route_that_cannot_be_driven_is_refused(radius_m, start_m, tag_ids, problem):
    poses = find_approaches(YARD, ViewingLimits()).poses
    with pytest.raises(StartUpError, match=problem):
        plan_route(FreeSpace(YARD, radius_m + 0.005), poses, start_m, 'given', tag_ids)


TABLE = {'table': (1.0, 1.0, 3.0, 1.5)}


@pytest.mark.parametrize(
    ('override', 'pose'),
    [
        (Override(standoff=0.8), (2.0, 0.2, math.pi / 2, 0.8, 0.0)),
        (Override(yaw=math.pi / 3), (1.75, 1 - 0.25 * 3**0.5, math.pi / 3, 0.5, math.pi / 6)),
        (Override(goal_x=2.3), (2.3, 0.5, math.atan2(0.5, -0.3), math.hypot(0.3, 0.5), math.atan2(0.3, 0.5))),
        (Override(goal_y=0.1), (2.0, 0.1, math.pi / 2, 0.9, 0.0)),
        (Override(0.0, None, 2.0, 0.4), (2.0, 0.4, 0.0, 0.6, 0.0)),
    ],
)
def test_an_override_sets_what_it_names(override, pose):
    layout = layout_of((2.0, 1.0), **TABLE)
    assert find_approaches(layout, ViewingLimits(), overrides={'0': override}).poses['0'] == pytest.approx(
        pose
    )


def test_an_override_never_sets_a_pose_in_a_table():
    approaches = find_approaches(
        layout_of((2.0, 1.0), **TABLE), ViewingLimits(), overrides={'0': Override(goal_x=2.0, goal_y=1.2)}
    )
    assert approaches.unreachable == {
        '0': 'no place for a robot of radius 0.20 m where the overrides set the pose'
    }


@pytest.fixture
def overrides(tmp_path):
    """Return a function that reads overrides of this text."""

    def read(text: str):
        path = tmp_path / f'approach_overrides.{"json" if text.startswith("{") else "yaml"}'
        path.write_text(text, encoding='utf-8')
        return read_overrides(path, {'7', '21'})

    return read


def test_the_overrides_are_read_by_tag_and_an_unknown_tag_is_warned_of(overrides):
    found, (warning,) = overrides(
        'overrides:\n  "7": {yaw: 1, goal_x: 2.5}\n  21:\n  "99": {standoff: 0.4}\n'
    )
    assert found == {'7': Override(yaw=1.0, goal_x=2.5), '21': Override()}
    assert warning.endswith("tag '99' is not in the layout: its override has no effect")
    assert overrides('') == overrides('overrides:\n') == ({}, [])


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        (
            'overrides:\n  "7":\n    yaw: 1\n    stand_off: 0.4\n',
            "tag '7': line 4: unknown key 'stand_off': use yaw, ",
        ),
        ('override: {}\n', "line 1: unknown key 'override': use overrides"),
        ('overrides: {"7": {standoff: 2.0}}', "tag '7': standoff is 2.0: must be a number from 0.2 to 1.5"),
        ('overrides: {"7": {goal_x: .nan}}', "tag '7': goal_x is nan: must be a number"),
        ('overrides: {"7": {yaw: "north"}}', "tag '7': yaw is 'north': must be a number"),
        ('overrides: [7]', 'is not a mapping, such as {overrides:'),
        ('overrides: {"7": 1.5}', "tag '7': is not a mapping"),
        ('overrides: {', 'is not YAML'),
        ('{"overrides": {\n\t"7": {"Yaw": 1}}}', "tag '7': line 2: unknown key 'Yaw': use yaw"),
    ],
)
def test_a_malformed_override_is_refused_with_its_place(overrides, text, problem):
    with pytest.raises(StartUpError) as refusal:
        overrides(text)
    assert problem in str(refusal.value)
