"""The direction that each tag of a layout faces, and the walls around it."""

import math

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.tag_poses import EAST, NORTH, SOUTH, WEST, Table, find_tag_poses
from lupin_greenhouse_bridge.planning.walls import Walls, find_walls, parse_walls
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, shipped_file

LONG = (1.0, 1.0, 3.0, 1.5)  # x0, y0, x1, y1
FAR = Walls(-50.0, -50.0, 50.0, 50.0)
CONFIG = 'time: {debug_mode: false}\nsensors: {co2: [{}]}\n'
LAYOUT = Layout({'7': Tag(1.0, 2.5, ['co2'])}, {'bench': (0.0, 0.0, 2.0, 1.0)})


def facing(x, y, walls=FAR, **tables):
    layout = Layout({'7': Tag(x, y, ['co2'])}, tables or {'table': LONG})
    return find_tag_poses(layout, walls)['7'].facing


@pytest.mark.parametrize(
    ('x', 'y', 'expected'),
    [
        (2.0, 1.0, SOUTH),
        (2.0, 1.5, NORTH),
        (1.0, 1.2, WEST),
        (3.0, 1.2, EAST),
        (2.0, 1.4, NORTH),  # on the table
        (2.0, 0.2, SOUTH),  # beside it
        (5.0, 1.2, EAST),
        (1.0, 1.0, SOUTH),  # on a corner, with as much space on both sides
        (3.0, 1.5, NORTH),
    ],
)
def test_a_tag_faces_away_from_the_nearest_edge_of_its_table(x, y, expected):
    assert facing(x, y) == expected


def test_on_a_corner_a_tag_faces_the_side_where_the_next_table_or_wall_is_farther():
    before_south = (1.0, 0.0, 3.0, 0.5)
    assert facing(1.0, 1.0, table=LONG, south=before_south) == WEST
    assert facing(1.0, 1.0, table=LONG, south=before_south, west=(0.0, 0.8, 0.9, 1.2)) == SOUTH
    for beside_m, side in ((0.09, WEST), (0.11, SOUTH)):  # 10 cm beside the tag, a table is not ahead of it
        assert facing(1.0, 1.0, table=LONG, beside=(1.0 + beside_m, 0.0, 3.0, 0.5)) == side
    assert facing(1.0, 1.0, Walls(0.0, 0.1, 9.0, 9.0)) == WEST
    assert facing(1.0, 1.0, Walls(0.1, 0.0, 9.0, 9.0)) == SOUTH
    assert facing(3.0, 1.5, Walls(0.0, 0.0, 4.0, 2.4)) == EAST
    assert facing(3.0, 1.5, Walls(0.0, 0.0, 3.8, 2.4)) == NORTH


@pytest.mark.parametrize(
    ('x', 'y', 'distance_m'),
    [
        (2.0, 1.2, 0.0),
        (0.4, 1.2, 0.6),
        (2.0, 1.9, 0.4),
        (0.7, 0.6, 0.5),
        (3.3, 1.9, 0.5),
    ],
)
def test_the_distance_of_a_table_is_that_of_its_nearest_point(x, y, distance_m):
    assert Table(*LONG).distance_m(x, y) == pytest.approx(distance_m)


def test_the_nearest_table_counts_and_of_two_the_first():
    assert facing(2.0, 2.0, near=(1.0, 1.0, 3.0, 1.9), far=(1.0, 2.5, 3.0, 3.0)) == NORTH
    assert facing(2.0, 2.0, south=(1.0, 1.0, 3.0, 1.9), north=(1.0, 2.1, 3.0, 3.0)) == NORTH
    assert facing(2.0, 2.0, north=(1.0, 2.1, 3.0, 3.0), south=(1.0, 1.0, 3.0, 1.9)) == SOUTH


def test_the_order_of_a_tables_corners_does_not_matter():
    for table in ((3.0, 1.5, 1.0, 1.0), (3.0, 1.0, 1.0, 1.5), (1.0, 1.5, 3.0, 1.0)):
        assert facing(2.0, 1.0, table=table) == SOUTH
        assert facing(3.0, 1.2, table=table) == EAST


def test_without_tables_tags_face_the_middle():
    places = {'0': (0.0, 0.0), '1': (2.0, 6.0), '2': (1.0, 3.0), '3': (0.0, 3.0), '4': (1.0, 6.0)}
    tag_poses = find_tag_poses(
        Layout({tag_id: Tag(*each, ['co2']) for tag_id, each in places.items()}, {}), FAR
    )
    to_middle = [math.atan2(3.0, 1.0), math.atan2(-3.0, -1.0), SOUTH, EAST, SOUTH]
    assert [tag_poses[tag_id].facing for tag_id in '01234'] == pytest.approx(to_middle)


@pytest.mark.parametrize('edges', [(1.0, 1.0, 1.0, 2.0), (1.0, 2.0, 3.0, 2.0), (1.0, 1.0, 1.0, 1.0)])
def test_a_table_without_an_area_is_refused(edges):
    with pytest.raises(StartUpError, match="table 't' has no area"):
        find_tag_poses(Layout({'7': Tag(0.0, 0.0, ['co2'])}, {'t': edges}), FAR)


def test_the_walls_are_those_of_the_config_or_go_around_everything(monkeypatch, tmp_path):
    shipped = find_walls(LAYOUT)
    assert shipped in ((0.0, 0.0, 4.0, 8.0), (0.0, 0.0, 5.0, 10.0))
    assert shipped == find_walls(LAYOUT, shipped_file('greenhouse_config.yaml'))
    config = tmp_path / 'config.yaml'
    config.write_text(f'{CONFIG}visualization: {{greenhouse_width_m: 3, greenhouse_height_m: 6}}')
    assert find_walls(LAYOUT, str(config)) == (0.0, 0.0, 3.0, 6.0)
    assert find_walls(LAYOUT, str(config), '-1, -2 5 6.5') == (-1.0, -2.0, 5.0, 6.5)
    for section in ('', 'visualization:', 'visualization: {grid_spacing_m: 1}'):
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
