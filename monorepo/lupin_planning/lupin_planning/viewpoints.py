"""The poses from which a camera may see a tag, the best first. Does not import ROS."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError

from lupin_planning.poses import PoseInPlane
from lupin_planning.tag_poses import EQUAL_M, TagPose

STANDOFF_STEP_M = 0.02
ANGLE_STEP_RAD = math.radians(1.5)
HALF_VIEW_RAD = math.radians(28.0)  # half of the horizontal field of view of a usual camera


class ApproachPose(NamedTuple):
    """A pose of the robot in the layout's frame, with its +x axis towards the centre of the tag."""

    x: float  # metres
    y: float
    yaw: float  # radians to the x axis
    distance_m: float  # the standoff: from the robot to the tag
    angle_rad: float  # the incidence angle: between the line of sight and the normal of the tag


@dataclass(frozen=True)
class ViewingLimits:
    """The limits of an approach pose. Raises StartUpError for values that allow none."""

    robot_radius_m: float = 0.20
    smallest_standoff_m: float = 0.3  # from the robot to the tag
    largest_standoff_m: float = 1.0
    preferred_standoff_m: float = 0.5
    largest_angle_rad: float = math.pi / 3  # of incidence
    clearance_m: float = 0.05  # beyond the radius; a pose with less is warned of
    arrival_tolerance_m: float = 0.06  # how far from its pose the robot may arrive
    camera_offset_m: float = 0.0  # of the camera, ahead of the robot's centre

    def __post_init__(self) -> None:
        if not 0.0 < self.smallest_standoff_m <= self.preferred_standoff_m <= self.largest_standoff_m <= 10.0:
            raise StartUpError(
                f'the standoffs are {self.smallest_standoff_m:g}, {self.preferred_standoff_m:g} and'
                f' {self.largest_standoff_m:g} m: must be above 0, and the smallest, the preferred and the'
                ' largest in this order, and at most 10'
            )
        if not 0.0 <= self.largest_angle_rad < math.pi / 2:
            degrees = math.degrees(self.largest_angle_rad)
            raise StartUpError(
                f'the largest incidence angle is {degrees:g} degrees: must be from 0 to below 90'
            )
        if not (self.robot_radius_m >= 0.0 and self.clearance_m >= 0.0):
            raise StartUpError(
                f'the radius of the robot is {self.robot_radius_m:g} m and its clearance'
                f' {self.clearance_m:g} m: must not be below 0'
            )
        if not 0.0 <= self.arrival_tolerance_m <= 1.0:
            raise StartUpError(
                f'the arrival tolerance is {self.arrival_tolerance_m:g} m: must be from 0 to 1 m'
            )
        if not abs(self.camera_offset_m) < self.smallest_standoff_m:
            raise StartUpError(
                f"the camera is {self.camera_offset_m:g} m ahead of the robot's centre: must be less than"
                f' the smallest standoff, which is {self.smallest_standoff_m:g} m'
            )


def find_candidates(tag: TagPose, limits: ViewingLimits) -> np.ndarray:
    """Return the poses within the limits, with the columns of ApproachPose, in an array (poses, 5)."""
    largest_rad = limits.largest_angle_rad
    standoffs_m = _steps(
        limits.smallest_standoff_m, limits.preferred_standoff_m, limits.largest_standoff_m, STANDOFF_STEP_M
    )
    both_sides = _steps(-largest_rad, 0.0, largest_rad, ANGLE_STEP_RAD)[::-1]
    away_m, angles = (axis.ravel() for axis in np.meshgrid(standoffs_m, both_sides, indexing='ij'))
    places = tag[:2] + away_m[:, None] * directions(tag.facing + angles)
    yaws = wrapped(tag.facing + angles + math.pi)
    return np.column_stack([places, yaws, away_m, np.abs(angles)])


def best_first(poses: np.ndarray, rooms_m: np.ndarray, limits: ViewingLimits) -> np.ndarray:
    """
    Return the numbers of the poses, an array (poses, 5) with the room at each, the best first.

    The pose with the most room is the best, counted up to the clearance plus the arrival tolerance; then the
    one whose standoff is nearest to the preferred one; then the one with the smallest incidence angle.
    """
    enough_m = limits.clearance_m + limits.arrival_tolerance_m
    room_mm = np.round(1e3 * np.minimum(rooms_m, enough_m))
    off_m = np.round(np.abs(poses[:, 3] - limits.preferred_standoff_m), 9)
    return np.lexsort((np.round(poses[:, 4], 9), off_m, -room_mm))


def cameras_at(poses: np.ndarray, limits: ViewingLimits) -> np.ndarray:
    """Return where the camera is at each pose, an array (poses, 3 or more) of x, y and yaw, as (poses, 2)."""
    return np.asarray(poses[:, :2] + limits.camera_offset_m * directions(poses[:, 2]))


def override_pose(pose: PoseInPlane, tag: TagPose, limits: ViewingLimits) -> tuple[ApproachPose, str]:
    """Return the approach pose that a team has set, and why the camera cannot see the tag from it, or ''."""
    x, y, yaw = pose
    distance_m = math.hypot(tag.x - x, tag.y - y)
    ((camera_x, camera_y),) = cameras_at(np.array([pose]), limits)
    sight = math.atan2(tag.y - camera_y, tag.x - camera_x)
    past_rad = abs(math.remainder(sight - yaw, math.tau))
    angle_rad = abs(math.remainder(sight + math.pi - tag.facing, math.tau))
    problem = ''
    if past_rad > HALF_VIEW_RAD:
        problem = f'it looks {math.degrees(past_rad):.0f}° past the tag: correct yaw'
    elif angle_rad > limits.largest_angle_rad + EQUAL_M:
        problem = (
            f'the incidence angle is {math.degrees(angle_rad):.0f}°, above'
            f' {math.degrees(limits.largest_angle_rad):g}°: correct the position'
        )
    elif not limits.smallest_standoff_m - EQUAL_M <= distance_m <= limits.largest_standoff_m + EQUAL_M:
        problem = (
            f'it is {distance_m:.2f} m from the tag, not {limits.smallest_standoff_m:g} to'
            f' {limits.largest_standoff_m:g} m: correct the position'
        )
    return ApproachPose(x, y, yaw, distance_m, angle_rad), problem


def directions(angles: np.ndarray) -> np.ndarray:
    """Return the unit vectors of angles to the x axis, in an array (angles, 2)."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def wrapped(angles: np.ndarray) -> np.ndarray:
    """Return angles from -pi to pi."""
    return angles - math.tau * np.round(angles / math.tau)


def _steps(lowest: float, middle: float, highest: float, step: float) -> np.ndarray:
    """Return in order the values that are whole steps from the middle, and both ends."""
    down, up = math.floor((middle - lowest) / step), math.floor((highest - middle) / step)
    return np.unique(np.round([lowest, *(middle + step * np.arange(-down, up + 1)), highest], 9))
