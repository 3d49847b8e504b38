"""The pose of each tag in the world."""

import math

import numpy as np
import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, find_layout
from lupin_simulation.tag_poses_in_world import roll_pitch_yaw, tag_poses_by_number

LONG = (1.0, 1.0, 3.0, 1.5)  # x0, y0, x1, y1
WALLS = Walls(0.0, 0.0, 4.0, 8.0)


def test_the_frame_has_z_out_of_the_face_x_to_the_viewers_right_and_y_up():
    for x, y, out in ((2.0, 1.0, (0, -1, 0)), (3.0, 1.2, (1, 0, 0))):
        tag_pose = tag_poses_by_number(Layout({'7': Tag(x, y, ['co2'])}, {'table': LONG}), WALLS)[7]
        roll, _, yaw = roll_pitch_yaw(tag_pose)
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
    tag_poses = tag_poses_by_number(layout, WALLS)
    assert list(tag_poses) == sorted(map(int, layout.tags))
    assert {str(number): each[:2] for number, each in tag_poses.items()} == {
        tag_id: tag[:2] for tag_id, tag in layout.tags.items()
    }


@pytest.mark.parametrize('tag_id', ['A7', '587', '07', '-1'])
def test_an_id_that_is_no_tag36h11_is_refused(tag_id):
    with pytest.raises(StartUpError, match='is not an id of tag36h11: must be 0 to 586'):
        tag_poses_by_number(Layout({tag_id: Tag(0.0, 0.0, ['co2'])}, {}), WALLS)
