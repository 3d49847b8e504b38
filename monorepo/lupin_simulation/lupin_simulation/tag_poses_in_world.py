"""Compute the pose of each tag of a layout in the world. Does not import ROS."""

import math

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.tag_poses import TagPose, find_tag_poses
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout
from lupin_tag_confirmation.confirmation import UnknownTagId, tag_number

# The heights suit the camera of a small mobile robot, 0.3 m above the floor.
TABLE_HEIGHT_M = 0.20
TAG_HEIGHT_M = 0.30  # of the centre of each tag


def tag_poses_by_number(layout: Layout, walls: Walls) -> dict[int, TagPose]:
    """
    Return the tag_pose of each tag by its number, in numeric order.

    Raises StartUpError for an id outside tag36h11, or a table without an area.
    """
    try:
        tag_poses = find_tag_poses(layout, walls).items()
        return dict(sorted((tag_number(tag_id), each) for tag_id, each in tag_poses))
    except UnknownTagId as error:
        raise StartUpError(str(error)) from error


def roll_pitch_yaw(tag_pose: TagPose) -> tuple[float, float, float]:
    """Return the pose of a frame with z out of the tag's face, x to the viewer's right and y up."""
    return math.pi / 2, 0.0, tag_pose.facing + math.pi / 2
