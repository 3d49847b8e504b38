"""Where a tag stands, and which way it faces."""

import math

import numpy as np
import pytest
from lupin_mission.errors import StartUpError
from lupin_mission.layout import Layout, Tag, find_layout
from lupin_world.placement import EAST, NORTH, SOUTH, WEST, place

LONG = (1.0, 1.0, 3.0, 1.5)  # x0, y0, x1, y1


def facing(x, y, **tables):
    layout = Layout({'7': Tag(x, y, ['co2'])}, tables or {'table': LONG})
    return place(layout)[7].facing


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
        (1.0, 1.0, SOUTH),  # on a corner, with room on both sides
        (3.0, 1.5, NORTH),
    ],
)
def test_a_tag_faces_away_from_the_nearest_edge_of_its_table(x, y, expected):
    assert facing(x, y) == expected


def test_on_a_corner_a_tag_faces_the_side_with_more_room():
    before_south = (1.0, 0.0, 3.0, 0.5)
    assert facing(1.0, 1.0, table=LONG, south=before_south) == WEST
    assert facing(1.0, 1.0, table=LONG, south=before_south, west=(0.0, 0.8, 0.9, 1.2)) == SOUTH


def test_the_nearest_table_counts_and_of_two_the_first():
    assert facing(2.0, 2.0, near=(1.0, 1.0, 3.0, 1.9), far=(1.0, 2.5, 3.0, 3.0)) == NORTH
    assert facing(2.0, 2.0, south=(1.0, 1.0, 3.0, 1.9), north=(1.0, 2.1, 3.0, 3.0)) == NORTH
    assert facing(2.0, 2.0, north=(1.0, 2.1, 3.0, 3.0), south=(1.0, 1.0, 3.0, 1.9)) == SOUTH


def test_the_order_of_a_tables_corners_does_not_matter():
    assert facing(2.0, 1.0, table=(3.0, 1.5, 1.0, 1.0)) == SOUTH


def test_without_tables_tags_face_the_middle():
    tags = {'0': Tag(0.0, 0.0, ['co2']), '1': Tag(2.0, 0.0, ['co2']), '2': Tag(1.0, 0.0, ['co2'])}
    placements = place(Layout(tags, {}))
    assert [placements[number].facing for number in (0, 1, 2)] == [0.0, math.pi, SOUTH]


def test_the_frame_has_z_out_of_the_face_x_to_the_viewers_right_and_y_up():
    for x, y, out in ((2.0, 1.0, (0, -1, 0)), (3.0, 1.2, (1, 0, 0))):
        placement = place(Layout({'7': Tag(x, y, ['co2'])}, {'table': LONG}))[7]
        roll, _, yaw = placement.roll_pitch_yaw
        about_x = np.array(
            [[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]]
        )
        about_z = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
        to_right, up, towards = (about_z @ about_x).T
        assert np.allclose(towards, out)
        assert np.allclose(up, (0, 0, 1))
        assert np.allclose(to_right, np.cross(-towards, up))


def test_the_tags_come_in_numeric_order_at_exactly_their_places():
    layout = find_layout('')
    placements = place(layout)
    assert list(placements) == sorted(map(int, layout.tags))
    assert {str(number): each[:2] for number, each in placements.items()} == {
        tag_id: tag[:2] for tag_id, tag in layout.tags.items()
    }


@pytest.mark.parametrize('tag_id', ['A7', '587', '07', '-1'])
def test_an_id_that_is_no_tag36h11_is_refused(tag_id):
    with pytest.raises(StartUpError, match='is not an id of tag36h11: must be 0 to 586'):
        place(Layout({tag_id: Tag(0.0, 0.0, ['co2'])}, {}))


def test_a_table_without_an_area_is_refused():
    with pytest.raises(StartUpError, match="table 't' has no area"):
        place(Layout({'7': Tag(0.0, 0.0, ['co2'])}, {'t': (1.0, 1.0, 1.0, 2.0)}))
