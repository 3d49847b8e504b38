"""The directions of the tags, the walls, the approach poses of a layout, the grid, and the route."""

import functools
import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, find_layout, shipped_file
from lupin_planning.approach import Approaches, find_approaches
from lupin_planning.grid import CELL_M, SMALLEST_ROOM_M, Grid, length_m
from lupin_planning.occupancy import OccupancyMap
from lupin_planning.poses import PoseInPlane
from lupin_planning.route import plan_route
from lupin_planning.tag_poses import (
    EAST,
    NORTH,
    SOUTH,
    TAG_WIDTH_M,
    WEST,
    distances_m,
    find_tag_poses,
    tables_of,
)
from lupin_planning.viewpoints import ApproachPose, ViewingLimits, best_first
from lupin_planning.walls import Walls, find_walls, parse_walls, walls_around

SHIPPED = find_layout('')
SHIPPED_WALLS = find_walls(SHIPPED)
USUAL = ViewingLimits()
SAME_M = 1e-6


@pytest.fixture(scope='module')
def approaches() -> Approaches:
    return find_approaches(SHIPPED, SHIPPED_WALLS, USUAL)


def layout_of(*places, **tables) -> Layout:
    """Return a layout with tags '0', '1', ... at these places."""
    return Layout({str(number): Tag(*each, ['co2']) for number, each in enumerate(places)}, tables)


def approaches_of(layout: Layout, limits: ViewingLimits = USUAL, **options) -> Approaches:
    return find_approaches(layout, walls_around(layout), limits, **options)


def gaps_m(layout: Layout, points, walls: Walls | None = None) -> np.ndarray:
    """Return the distance of each point to the nearest table, tag or wall; below 0 outside the walls."""
    walls, points = walls or walls_around(layout), np.reshape(points, (-1, 2))
    gaps = [*(points - walls[:2]).T, *(walls[2:] - points).T]
    gaps += distances_m(np.reshape(tables_of(layout), (-1, 4)), points[:, None]).T.tolist()
    gaps += [np.linalg.norm(points - tag[:2], axis=1) for tag in layout.tags.values()]
    return np.min(gaps, axis=0)


def crosses_table(line, table) -> bool:
    """Return whether one of many points of a line is inside a table."""
    points, (low, high) = np.linspace(*line, 501), np.reshape(table, (2, 2))
    return bool(((points > low + SAME_M) & (points < high - SAME_M)).all(axis=1).any())


def is_hidden(layout: Layout, tag_id: str, pose: ApproachPose, camera_offset_m: float = 0.0) -> bool:
    """Return whether a table but its own is before the centre or an end of a tag."""
    tables, (x, y, facing) = tables_of(layout), find_tag_poses(layout, walls_around(layout))[tag_id]
    middle = np.array([x, y])
    aside = np.array([-math.sin(facing), math.cos(facing)]) * TAG_WIDTH_M / 2
    if tables:
        del tables[int(distances_m(np.array(tables), middle).argmin())]
    eye = pose[:2] + camera_offset_m * np.array([math.cos(pose.yaw), math.sin(pose.yaw)])
    targets = middle, middle + aside, middle - aside
    return any(crosses_table((eye, target), each) for target in targets for each in tables)


def points_of(path) -> np.ndarray:
    return np.reshape([np.linspace(*leg, 200) for leg in itertools.pairwise(path)], (-1, 2))


# By the number of tags of the simulator's version, and by radius: poses, and those head-on at 0.5 m.
COUNTS = {
    29: {0.15: (29, 21), 0.25: (29, 19), 0.30: (12, 7)},
    22: dict.fromkeys((0.15, 0.25, 0.30), (22, 21)),
}
# Limits of the length of the shortest route.
SHORTEST_M = {29: (21.0, 21.9), 22: (28.0, 29.5)}
HEAD_ON = {
    'smallest_standoff_m': 0.5,
    'largest_standoff_m': 0.5,
    'largest_angle_rad': 0.0,
}
NEEDED_M = 2 * (0.2 + SMALLEST_ROOM_M)  # between two obstacles, by a robot of radius 0.2 m
# A yard with one entrance, 1 cm wider than the robot and a cell. Tag 0 is in it, tag 1 outside.
YARD = layout_of(
    (1.5, 0.5),
    (1.5, 0.0),
    south=(0.0, 0.0, 3.0, 0.5),
    north=(0.0, 3.0, 3.0, 3.5),
    west=(0.0, 0.5, 0.5, 3.0),
    east=(2.5, 0.5 + NEEDED_M + CELL_M + 0.01, 3.0, 3.0),
)
OUTSIDE_M, INSIDE_M = (-0.8, -0.8), (1.5, 1.75)
CROWDED = YARD._replace(tables={**YARD.tables, 'ahead': (1.2, -0.7, 1.8, -0.3)})


@pytest.mark.parametrize('radius_m', COUNTS[29])
def test_so_many_shipped_tags_have_a_pose(radius_m):
    limits = ViewingLimits(radius_m), ViewingLimits(radius_m, **HEAD_ON)
    counts = tuple(len(find_approaches(SHIPPED, SHIPPED_WALLS, each).poses) for each in limits)
    assert counts == COUNTS[len(SHIPPED.tags)][radius_m]


def test_without_a_start_the_poses_are_in_the_part_that_reaches_most_tags():
    """A wall divides the hall from a storeroom, whose crates have more corners, and which has one tag."""
    crates = {f'crate {x} {y}': (x, y, x + 0.5, y + 0.5) for x in (1.0, 3.2, 5.4) for y in (8.6, 10.2)}
    tables = {'south': (1.0, 2.0, 7.0, 2.6), 'north': (1.0, 5.0, 7.0, 5.6), 'wall': (0.0, 7.5, 8.0, 7.8)}
    places = [(1.3 + 0.6 * number, y) for y in (2.0, 5.6) for number in range(10)]
    layout = layout_of(*places, (1.0, 8.8), **tables, **crates)
    found = find_approaches(layout, Walls(0.0, 0.0, 8.0, 12.0), USUAL)
    reason = 'cut off from the rest of the free space: no passage between is wide enough for a robot of'
    assert (len(found.poses), found.unreachable) == (20, {'20': f'{reason} radius 0.2 m'})
    with pytest.raises(StartUpError, match='leave no free space for the robot'):
        find_approaches(layout, Walls(1.0, 2.0, 7.0, 2.6), USUAL)


CUT_OFF = (
    'cut off from the start at ({:g}, {:g}): no passage between is wide enough for a robot of radius 0.3 m'
)
TOO_NARROW = 'no place for a robot of radius 0.3 m within 0.5 m and 0°'
BENCH = {'bench': (1.0, 1.0, 3.0, 1.5)}
ALONE, SINGLE = layout_of((2.0, 1.0)), layout_of((2.0, 1.0), **BENCH)
TWICE = layout_of((2.0, 1.0), (2.0, 1.0), (2.5, 1.0), **BENCH)
COVERED = layout_of((2.0, 1.0), **BENCH, before=(1.0, 0.9, 3.0, 1.0))
HIDDEN = 'tables hide it wherever the robot has a place'
THERE = {'0': 'no place for a robot of radius 0 m at its override'}


@pytest.mark.parametrize(
    ('layout', 'limits', 'options', 'unreachable'),
    [
        (YARD, ViewingLimits(0.2), {'start_m': OUTSIDE_M}, {}),
        (YARD, ViewingLimits(0.3), {'start_m': OUTSIDE_M}, {'0': CUT_OFF.format(*OUTSIDE_M)}),
        (YARD, ViewingLimits(0.3), {'start_m': INSIDE_M}, {'1': CUT_OFF.format(*INSIDE_M)}),
        (CROWDED, ViewingLimits(0.3, **HEAD_ON), {}, {'1': TOO_NARROW}),
        (TWICE, USUAL, {}, {}),
        (COVERED, USUAL, {}, {'0': HIDDEN}),
        (ALONE, ViewingLimits(0.0), {'overrides': {'0': PoseInPlane(2.0, 1.0, 0.0)}}, THERE),
        (SINGLE, ViewingLimits(0.0), {'overrides': {'0': PoseInPlane(2.0, 1.2, 0.0)}}, THERE),
    ],
)
def test_a_tag_without_a_pose_has_the_reason_and_the_others_have_poses(layout, limits, options, unreachable):
    found = approaches_of(layout, limits, **options)
    assert found.unreachable == unreachable
    assert set(found.poses) == set(layout.tags) - set(unreachable)


def test_room_for_an_arrival_counts_to_obstacles_that_are_far_from_the_tag():
    """0.24 m ahead of the head-on pose is a post: its room would be 0.06 m, less than 0.02 m and 0.06 m."""
    pose = approaches_of(layout_of((2.0, 1.0), **BENCH, post=(1.95, 0.0, 2.05, 0.24))).poses['0']
    to_post_m = math.hypot(max(pose.x - 2.05, 0.0), pose.y - 0.24)
    assert to_post_m - 0.2 >= 0.08 - 1e-9


def aisle_of(width_m: float) -> Layout:
    return layout_of((2.0, 1.0), south=(0.0, 0.0, 4.0, 1.0), north=(0.0, 1.0 + width_m, 4.0, 2.0 + width_m))


@pytest.mark.parametrize('room_m', [0.1, 0.04, SMALLEST_ROOM_M + CELL_M / 2])
def test_the_roomiest_pose_is_taken_where_there_is_little_room(room_m):
    layout = aisle_of(2 * (0.2 + room_m))
    found = approaches_of(layout)
    assert gaps_m(layout, found.poses['0'][:2]) - 0.2 >= room_m - 0.006
    assert len(found.room_warnings) == (room_m < USUAL.clearance_m)
    assert not approaches_of(aisle_of(NEEDED_M - 0.005)).poses


@given(
    y=st.floats(1.0, 1.0 + CELL_M),
    width_m=st.floats(NEEDED_M + CELL_M, NEEDED_M + 3 * CELL_M),
    share=st.floats(0.0, 1.0),
)
def test_an_aisle_that_is_one_cell_wider_than_needed_is_free_all_along(y, width_m, share):
    tables = {'south': (1.0, 0.5, 3.0, y), 'north': (1.0, y + width_m, 3.0, 2.5)}
    grid = Grid(layout_of((0.1, 0.1), **tables), Walls(0.0, 0.0, 4.0, 3.5), 0.2)
    across_m = y + NEEDED_M / 2 + share * (width_m - NEEDED_M)
    points = np.column_stack([np.linspace(0.5, 3.5, 50), np.full(50, across_m)])
    assert grid.are_free(points).all()
    assert len(set(grid.regions_of(points))) == 1


def test_room_counts_before_the_standoff_and_the_standoff_before_the_angle():
    """The clearance of 5 cm and the arrival tolerance of 6 cm are as much room as counts."""
    rows = [  # room, standoff, angle
        (0.15, 0.5, 0.0),
        (0.12, 0.5, 0.3),
        (0.13, 0.6, 0.0),
        (0.10, 0.5, 0.0),
        (0.01, 0.5, 0.0),
    ]
    poses = np.array([(0.0, 0.0, 0.0, standoff_m, angle) for _, standoff_m, angle in rows])
    rooms_m = np.array([room_m for room_m, *_ in rows])
    for order in itertools.permutations(range(len(rows))):
        numbers = list(order)
        found = best_first(poses[numbers], rooms_m[numbers], USUAL)
        assert [order[each] for each in found] == [0, 1, 2, 3, 4]


def test_a_robot_that_arrives_beside_its_pose_has_room_where_the_greenhouse_has_it():
    rooms_m = []
    for pose in find_approaches(SHIPPED, SHIPPED_WALLS, USUAL).poses.values():
        away_m, direction = np.random.default_rng(1).uniform(0.0, (0.06, math.tau), (100, 2)).T
        places = pose[:2] + away_m[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
        rooms_m.append(gaps_m(SHIPPED, places, SHIPPED_WALLS).min() - 0.2)
    assert sum(room_m < USUAL.clearance_m - 0.005 for room_m in rooms_m) <= 1
    assert min(rooms_m) > 0.02


def test_the_alternatives_of_a_tag_are_apart_from_its_pose_and_from_each_other():
    limits = ViewingLimits(largest_standoff_m=0.6)
    alone, found = (find_approaches(SHIPPED, SHIPPED_WALLS, limits, most_per_tag=most) for most in (1, 4))
    assert (found.poses, set(found.alternatives)) == (alone.poses, set(alone.poses))
    counts = [len(others) for others in found.alternatives.values()]
    assert max(counts) == 3
    assert sum(counts) > 2 * len(counts)
    for tag_id, others in found.alternatives.items():
        for here, there in itertools.combinations([found.poses[tag_id], *others], 2):
            turned = abs(math.remainder(here.yaw - there.yaw, math.tau))
            assert math.dist(here[:2], there[:2]) > 0.199 or math.degrees(turned) > 19.9


coordinates_m = st.floats(0.0, 4.0).map(lambda value: round(value, 2))
sizes = st.floats(0.05, 1.5).map(lambda value: round(value, 2))


@st.composite
def layouts(draw):
    """Draw tables anywhere, and tags on their corners, in rows, alone, and in one spot."""
    tables = {}
    for number in range(draw(st.integers(0, 4))):
        x, y = draw(coordinates_m), draw(coordinates_m)
        tables[str(number)] = (x, y, x + draw(sizes), y + draw(sizes))
    places = draw(st.lists(st.tuples(coordinates_m, coordinates_m), min_size=1, max_size=3))
    places += [draw(st.sampled_from([(a, b), (c, b), (a, d), (c, d)])) for a, b, c, d in tables.values()]
    row = draw(st.integers(0, 4))
    places += [(places[0][0] + 0.3 * number, places[0][1]) for number in range(row)]  # the first, and a row
    return layout_of(*places, **tables)


BEHIND = layout_of((0.69, 0.0), (1.31, 0.0), a=(0.2, 0.0, 0.69, 1.0))
OVERLAPS = (  # where no side of the table that covers a tag is between the tag and the camera
    layout_of((1.5, 1.5), (0.5, 0.0), a=(0.5, 0.0, 1.5, 1.5), b=(1.0, 1.0, 2.0, 2.0)),
    layout_of((2.0, 1.5), (0.0, 0.0), a=(2.0, 1.5, 3.0, 2.5), b=(1.75, 1.0, 2.75, 2.0)),
)


@settings(max_examples=60)
@example(layout=BEHIND, radius_m=0.0, camera_offset_m=-0.1)
@example(layout=OVERLAPS[0], radius_m=0.0, camera_offset_m=0.15)
@example(layout=OVERLAPS[1], radius_m=0.0, camera_offset_m=0.15)
@given(
    layout=layouts(),
    radius_m=st.sampled_from([0.0, 0.1, 0.2, 0.35]),
    camera_offset_m=st.sampled_from([0.0, 0.15, -0.1]),
)
def test_every_pose_is_free_sees_its_tag_and_can_be_driven_to(layout, radius_m, camera_offset_m):
    limits = ViewingLimits(radius_m, camera_offset_m=camera_offset_m)
    approaches = approaches_of(layout, limits)
    tag_poses = find_tag_poses(layout, walls_around(layout))
    assert set(approaches.poses) | set(approaches.unreachable) == set(layout.tags)
    assert not set(approaches.poses) & set(approaches.unreachable)
    rooms_m = gaps_m(layout, [pose[:2] for pose in approaches.poses.values()]) - radius_m
    for (tag_id, pose), room_m in zip(approaches.poses.items(), rooms_m, strict=True):
        tag = tag_poses[tag_id]
        assert room_m >= SMALLEST_ROOM_M - SAME_M
        warning = f"tag '{tag_id}': its pose has {room_m:.3f} m of room beyond the robot's radius, less than"
        assert (tag_id in approaches.room_warnings) == (room_m < limits.clearance_m - SAME_M)
        assert approaches.room_warnings.get(tag_id, warning).startswith(warning)
        assert not is_hidden(layout, tag_id, pose, camera_offset_m)
        assert math.dist(pose[:2], tag[:2]) == pytest.approx(pose.distance_m)
        assert pose.x + pose.distance_m * math.cos(pose.yaw) == pytest.approx(tag.x)
        assert pose.y + pose.distance_m * math.sin(pose.yaw) == pytest.approx(tag.y)
        assert limits.smallest_standoff_m - SAME_M <= pose.distance_m <= limits.largest_standoff_m + SAME_M
        off_normal = math.remainder(pose.yaw + math.pi - tag.facing, math.tau)
        assert abs(off_normal) == pytest.approx(pose.angle_rad, abs=SAME_M)
        assert pose.angle_rad <= limits.largest_angle_rad + SAME_M
    order = 'shortest' if len(approaches.poses) <= 3 else 'given'
    route = plan_route(approaches.grid, approaches.poses, None, order)
    assert sorted(route.tag_ids) == sorted(approaches.poses)
    assert (gaps_m(layout, points_of(route.points_m)) >= radius_m - SAME_M).all()


@settings(max_examples=30)
@given(layout=layouts(), radius_m=st.sampled_from([0.1, 0.25]), ends=st.tuples(*[coordinates_m] * 4))
def test_a_path_is_free_and_hardly_longer_than_through_many_random_free_points(layout, radius_m, ends):
    walls = Walls(-0.1, -0.1, 4.1, 4.1)
    grid = Grid(layout, walls, radius_m)
    start, goal = ends[:2], ends[2:]
    assume(grid.is_free(*start) and grid.is_free(*goal))
    path = grid.path(start, goal)
    assert (path is None) == (grid.region_of(start) != grid.region_of(goal))
    if path:
        assert (path[0], path[-1]) == (start, goal)
        assert (gaps_m(layout, points_of(path), walls) >= radius_m - SAME_M).all()
        points = np.random.default_rng(1).uniform(-0.1, 4.1, (1000, 2))
        points = points[grid.are_free(points)]
        starts, ends = (np.broadcast_to(each, points.shape) for each in (start, goal))
        is_way = grid.are_in_sight(starts, points) & grid.are_in_sight(points, ends)
        lengths_m = np.hypot(*(points - start).T) + np.hypot(*(points - goal).T)
        assert length_m(path) <= 1.01 * lengths_m[is_way].min(initial=math.inf)


def test_a_line_is_in_sight_if_each_of_its_points_is_free():
    grid = Grid(SHIPPED, SHIPPED_WALLS, 0.2)
    starts, ends = np.random.default_rng(4).uniform((-0.1, -0.1), (4.1, 8.1), (2, 300, 2))
    lines = [np.linspace(*line, 2000) for line in zip(starts, ends, strict=True)]
    rooms_m = [gaps_m(SHIPPED, line, SHIPPED_WALLS).min() - 0.2 for line in lines]
    are_in_sight = grid.are_in_sight(starts, ends)
    assert min(itertools.compress(rooms_m, are_in_sight)) > SMALLEST_ROOM_M - 0.002
    assert max(itertools.compress(rooms_m, ~are_in_sight)) < SMALLEST_ROOM_M + 0.002
    assert 5 < are_in_sight.sum() < 295


def test_a_large_greenhouse_has_larger_cells_and_says_what_they_may_miss():
    assert Grid(SHIPPED, SHIPPED_WALLS, 0.2).warning == ''
    grid = Grid(SHIPPED, Walls(0.0, 0.0, 40.0, 50.0), 0.2)
    assert grid.cell_m == pytest.approx(2 * CELL_M)
    narrowest_m = NEEDED_M + 2 * CELL_M
    assert grid.warning == f'cells of 4.0 cm: passages of less than {narrowest_m:.2f} m may be missed'


def test_the_route_of_many_stops_is_hardly_longer_than_the_shortest():
    """Of 300 stops, each half a metre from the next."""
    layout = layout_of((0.0, 0.0), (12.0, 10.0))
    stops = [(1.0 + 0.5 * column, 1.0 + 0.5 * row) for row in range(15) for column in range(20)]
    poses = {str(n): ApproachPose(x, y, 0.0, 0.5, 0.0) for n, (x, y) in enumerate(stops)}
    grid = Grid(layout, walls_around(layout), 0.1)
    route = plan_route(grid, poses, None, 'shortest')
    assert sorted(route.tag_ids, key=int) == list(poses)
    assert 299 * 0.5 <= route.length_m < 1.08 * 299 * 0.5


def test_the_shortest_route_of_the_shipped_layout_is_much_shorter_than_as_given(approaches):
    grid, poses = approaches.grid, approaches.poses
    given, shortest = (plan_route(grid, poses, (0.5, 0.5), order) for order in ('given', 'shortest'))
    assert given.tag_ids == list(SHIPPED.tags)
    lowest_m, highest_m = SHORTEST_M[len(SHIPPED.tags)]
    assert lowest_m < shortest.length_m < highest_m < 0.7 * given.length_m
    for route in (given, shortest):
        assert route.points_m[0] == (0.5, 0.5)
        assert route.length_m == pytest.approx(length_m(route.points_m))
        assert all(poses[tag_id][:2] in route.points_m for tag_id in route.tag_ids)


@pytest.mark.parametrize('start_m', [None, (0.5, 0.5)])
@pytest.mark.parametrize('end_m', [None, (0.5, 0.5)])
def test_the_shortest_route_is_that_of_all_orders_from_the_start_to_the_end(approaches, start_m, end_m):
    grid, poses = approaches.grid, approaches.poses
    tag_ids = list(poses)[::5]
    stops = {tag_id: poses[tag_id][:2] for tag_id in tag_ids} | {None: start_m, 'end': end_m}

    @functools.cache
    def between_m(*pair) -> float:
        here, there = map(stops.get, pair)
        return plan_route(grid, poses, here, 'given', [], there).length_m if here and there else 0.0

    def length_m(tag_ids) -> float:
        return sum(itertools.starmap(between_m, itertools.pairwise([None, *tag_ids, 'end'])))

    route = plan_route(grid, poses, start_m, 'shortest', tag_ids, end_m)
    assert route.length_m == pytest.approx(length_m(route.tag_ids))
    assert route.length_m == pytest.approx(min(map(length_m, itertools.permutations(tag_ids))), rel=0.02)
    assert route.points_m[0] == (start_m or poses[route.tag_ids[0]][:2])
    assert route.points_m[-1] == (end_m or poses[route.tag_ids[-1]][:2])


def test_the_route_avoids_the_obstacles_of_the_map():
    """A pallet of 0.8 m x 0.6 m stands on the straight way between two tags of the bench."""
    layout = layout_of((1.2, 1.0), (4.8, 1.0), bench=(1.0, 1.0, 5.0, 1.5))
    cells = np.zeros((30, 60), dtype=int)  # of 0.1 m
    cells[4:12, 27:33] = 100
    occupancy = OccupancyMap(60, 30, 0.1, (0.0, -0.5, 0.0), cells.ravel())
    routes = []
    for in_map in (None, occupancy):
        found = find_approaches(layout, Walls(0.0, -0.5, 6.0, 2.5), USUAL, occupancy=in_map)
        routes.append(plan_route(found.grid, found.poses, None, 'shortest'))
    assert routes[1].length_m > routes[0].length_m + 0.2
    to_pallet_m = distances_m(np.array([[2.7, -0.1, 3.3, 0.7]]), points_of(routes[1].points_m)[:, None])
    assert to_pallet_m.min() >= 0.2 - SAME_M


def plan_in_yard(*options, radius_m=0.2):
    grid = Grid(YARD, walls_around(YARD), radius_m)
    return plan_route(grid, approaches_of(YARD).poses, *options)


def test_a_route_visits_the_given_tags_in_the_given_order():
    assert plan_in_yard(None, 'given', ['1', '0', '1']).tag_ids == ['1', '0', '1']
    assert plan_in_yard(OUTSIDE_M, 'shortest', []) == ([], [OUTSIDE_M], 0.0)
    assert plan_in_yard(None, 'shortest', [], OUTSIDE_M).points_m == [OUTSIDE_M]
    there_and_back = plan_in_yard(OUTSIDE_M, 'shortest', ['0'], OUTSIDE_M)
    assert there_and_back.points_m[0] == there_and_back.points_m[-1] == OUTSIDE_M


@pytest.mark.parametrize(
    ('radius_m', 'start_m', 'tag_id', 'problem'),
    [
        (0.305, OUTSIDE_M, '0', r'from \(-0.80, -0.80\) to \(1.50, 1.00\)'),
        (0.2, (1.5, 0.25), '0', r'from \(1.50, 0.25\) to \(1.50, 1.00\)'),
    ],
)
def test_a_route_that_cannot_be_driven_is_refused(radius_m, start_m, tag_id, problem):
    with pytest.raises(StartUpError, match=problem):
        plan_in_yard(start_m, 'given', [tag_id], radius_m=radius_m)


TOO_STEEP = 'the incidence angle is 78°, above 60°: correct the position'
TOO_FAR = 'it is 2.00 m from the tag, not 0.3 to 1 m: correct the position'
POST = {'post': (1.9, 0.6, 2.1, 0.7)}


@pytest.mark.parametrize(
    ('pose', 'camera_offset_m', 'angle', 'reason'),
    [
        ((2.0, 0.5, math.pi / 2), 0.0, 0.0, None),
        ((2.0, 0.5, 0.0), 0.0, 0.0, 'it looks 90° past the tag: correct yaw'),
        ((2.0, 0.5, math.radians(62.5)), 0.0, 0.0, None),
        ((2.0, 0.5, math.radians(61.0)), 0.0, 0.0, 'it looks 29° past the tag: correct yaw'),
        # The camera is 0.2 * sin(20°) m aside of the tag, and 0.5 - 0.2 * cos(20°) m before it.
        ((2.0, 0.5, math.radians(70.0)), 0.2, 12.4, 'it looks 32° past the tag: correct yaw'),
        ((2.0, 0.5, math.radians(80.0)), 0.2, 6.54, None),
        ((3.4, 0.7, math.radians(168.0)), 0.0, 77.9, TOO_STEEP),
        ((2.0, -1.0, math.pi / 2), 0.0, 0.0, TOO_FAR),
        ((2.0, 0.3, math.pi / 2), 0.0, 0.0, 'a table hides it'),
    ],
)
def test_an_override_is_kept_and_warned_of_if_no_camera_sees_the_tag(pose, camera_offset_m, angle, reason):
    layout = layout_of((2.0, 1.0), **BENCH, **(POST if reason and 'hides' in reason else {}))
    found = find_approaches(
        layout,
        Walls(-3.0, -3.0, 6.0, 6.0),
        ViewingLimits(camera_offset_m=camera_offset_m),
        overrides={'0': PoseInPlane(*pose)},
        most_per_tag=3,
    )
    distance_m = math.dist(pose[:2], (2.0, 1.0))
    assert found.poses['0'] == pytest.approx((*pose, distance_m, math.radians(angle)), abs=1e-3)
    assert found.alternatives['0'] == []
    warning = f"tag '0': the camera cannot see it from its override: {reason}"
    assert found.warnings == ([warning] if reason else [])


LONG = (1.0, 1.0, 3.0, 1.5)  # x0, y0, x1, y1
FAR = Walls(-50.0, -50.0, 50.0, 50.0)
CONFIG = 'time: {debug_mode: false}\nsensors: {co2: [{}]}\n'
LAYOUT = Layout({'7': Tag(1.0, 2.5, ['co2'])}, {'bench': (0.0, 0.0, 2.0, 1.0)})
SOUTH_OF_IT, WEST_OF_IT = (1.0, 0.0, 3.0, 0.5), (0.0, 0.8, 0.9, 1.2)
# The tag is between them.
BELOW, ABOVE = (1.0, 1.0, 3.0, 1.9), (1.0, 2.1, 3.0, 3.0)


@pytest.mark.parametrize(
    ('x', 'y', 'expected', 'tables', 'walls'),
    [
        (2.0, 1.4, NORTH, [LONG], FAR),  # away from the nearest edge of its table, on the table
        (2.0, 0.2, SOUTH, [LONG], FAR),  # and beside it
        (3.0, 1.5, NORTH, [LONG], FAR),  # on a corner, with as much space on both sides
        (1.0, 1.0, WEST, [LONG, SOUTH_OF_IT], FAR),  # on a corner: where the next table or wall is farther
        (1.0, 1.0, SOUTH, [LONG, SOUTH_OF_IT, WEST_OF_IT], FAR),
        (1.0, 1.0, WEST, [LONG, (1.09, 0.0, 3.0, 0.5)], FAR),
        (1.0, 1.0, SOUTH, [LONG, (1.11, 0.0, 3.0, 0.5)], FAR),  # 10 cm beside the tag, it is not ahead of it
        (3.0, 1.5, EAST, [LONG], Walls(0.0, 0.0, 4.0, 2.4)),
        (2.0, 1.0, NORTH, [(2.3, 1.3, 3.0, 2.0), (1.0, 0.0, 3.0, 0.6)], FAR),  # the nearest table counts
        (2.0, 2.0, SOUTH, [ABOVE, BELOW], FAR),  # and of two the first
        (3.0, 1.2, EAST, [(3.0, 1.5, 1.0, 1.0)], FAR),  # the corners may be in any order
        (2.0, 0.09, NORTH, [LONG], Walls(0.0, 0.0, 9.0, 9.0)),  # it hangs on the wall
        (2.0, 0.11, SOUTH, [LONG], Walls(0.0, 0.0, 9.0, 9.0)),
        (2.0, 0.97, SOUTH, [LONG], Walls(0.0, 0.9, 9.0, 9.0)),  # the table is nearer
        (9.0, 5.0, WEST, [], Walls(0.0, 0.0, 9.0, 9.0)),
    ],
)
def test_a_tag_faces_away_from_its_table_towards_the_free_side(x, y, expected, tables, walls):
    layout = layout_of((x, y), **{str(number): each for number, each in enumerate(tables)})
    assert find_tag_poses(layout, walls)['0'].facing == expected


@pytest.mark.parametrize(
    ('table', 'pose'), [((1.0, 3.0, 3.0, 4.0), (2.0, 0.5)), ((1.0, 0.3, 3.0, 0.5), None)]
)
def test_a_tag_on_a_wall_is_seen_from_the_room_unless_a_table_hides_it(table, pose):
    poses = find_approaches(layout_of((2.0, 0.0), t=table), Walls(0.0, 0.0, 4.0, 4.0), USUAL).poses
    assert (poses['0'][:2] if poses else None) == pose


def test_without_tables_tags_face_the_middle():
    layout = layout_of((0.0, 0.0), (2.0, 6.0), (1.0, 3.0), (0.0, 3.0), (1.0, 6.0))
    to_middle = [math.atan2(3.0, 1.0), math.atan2(-3.0, -1.0), SOUTH, EAST, SOUTH]
    facings = [each.facing for each in find_tag_poses(layout, FAR).values()]
    assert facings == pytest.approx(to_middle)


@pytest.mark.parametrize('edges', [(1.0, 1.0, 1.0, 2.0), (1.0, 2.0, 3.0, 2.0), (1.0, 1.0, 1.0, 1.0)])
def test_a_table_without_an_area_is_refused(edges):
    with pytest.raises(StartUpError, match="table 't' has no area"):
        find_tag_poses(layout_of((0.0, 0.0), t=edges), FAR)


def test_the_walls_are_those_of_the_config_or_go_around_everything(monkeypatch, tmp_path):
    shipped = find_walls(LAYOUT)
    assert shipped in ((0.0, 0.0, 4.0, 8.0), (0.0, 0.0, 5.0, 10.0))
    assert shipped == find_walls(LAYOUT, shipped_file('greenhouse_config.yaml'))
    config = tmp_path / 'config.yaml'
    config.write_text(f'{CONFIG}visualization: {{greenhouse_width_m: 3, greenhouse_height_m: 6}}')
    assert find_walls(LAYOUT, str(config)) == (0.0, 0.0, 3.0, 6.0)
    assert find_walls(LAYOUT, str(config), '-1, -2 5 6.5') == (-1.0, -2.0, 5.0, 6.5)
    for section in ('', 'visualization: {}', 'visualization: {grid_spacing_m: 1}'):
        config.write_text(f'{CONFIG}{section}')
        assert find_walls(LAYOUT, str(config)) == (-1.6, -1.6, 3.6, 4.1)
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert find_walls(LAYOUT) == (-1.6, -1.6, 3.6, 4.1)


@pytest.mark.parametrize('walls', ['0 0 4 8', '[0, 0, 4, 8]', ' 0.0,0.0,4.0,8.0 ', [0, 0, 4.0, 8]])
def test_walls_are_text_or_an_array(walls):
    assert parse_walls(walls) == (0.0, 0.0, 4.0, 8.0)


@pytest.mark.parametrize('walls', ['0 0 4', 'wide', '0 0 4 nan', '4 0 0 8', [0.0, 8.0, 4.0, 8.0], 7, [1, 2]])
def test_walls_that_are_no_rectangle_are_refused(walls):
    with pytest.raises(StartUpError) as refusal:
        parse_walls(walls)
    assert str(refusal.value).startswith(f'walls is {walls!r}: must be x0 y0 x1 y1 in metres')
