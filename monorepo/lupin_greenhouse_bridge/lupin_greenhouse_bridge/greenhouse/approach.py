"""Where the robot stands to look at a tag: the approach poses. Does not import ROS."""

from typing import NamedTuple


class ApproachPose(NamedTuple):
    """A pose of the robot in the layout's frame, with its +x axis towards the centre of the tag."""

    x: float  # metres
    y: float
    yaw: float  # radians to the x axis
    distance_m: float  # to the tag
    angle_rad: float  # between the line of sight and the normal of the tag
