"""The poses from which a camera may see a tag, and which are better than others. Does not import ROS."""

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.tag_poses import EQUAL_M, TagPose
from lupin_greenhouse_bridge.runtime.poses import PoseInPlane

STANDOFF_STEP_M = 0.02
ANGLE_STEP_RAD = math.radians(1.5)
SMALLEST_ROOM_M = 0.01  # beyond the robot's radius, as the footprint_padding of Nav2
TIGHT_M = 0.02  # with less room, a steeper view is better
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
    largest_angle_rad: float = math.pi / 4  # of incidence
    steepest_angle_rad: float = math.pi / 3  # of incidence, where the others leave less room than TIGHT_M
    clearance_m: float = 0.05  # beyond the radius; where there is less, the roomiest pose counts
    arrival_tolerance_m: float = 0.06  # how far from its pose the robot may arrive
    arrival_tolerance_rad: float = 0.15
    camera_offset_m: float = 0.0  # of the camera, ahead of the robot's centre

    def __post_init__(self) -> None:
        if not 0.0 < self.smallest_standoff_m <= self.preferred_standoff_m <= self.largest_standoff_m <= 10.0:
            raise StartUpError(
                f'the standoffs are {self.smallest_standoff_m:g}, {self.preferred_standoff_m:g} and'
                f' {self.largest_standoff_m:g} m: must be above 0, and the smallest, the preferred and the'
                ' largest in this order, and at most 10'
            )
        for name, angle_rad in (('largest', self.largest_angle_rad), ('steepest', self.steepest_angle_rad)):
            if not 0.0 <= angle_rad < math.pi / 2:
                degrees = math.degrees(angle_rad)
                raise StartUpError(
                    f'the {name} incidence angle is {degrees:g} degrees: must be from 0 to below 90'
                )
        if not (self.robot_radius_m >= 0.0 and self.clearance_m >= 0.0):
            raise StartUpError(
                f'the radius of the robot is {self.robot_radius_m:g} m and its clearance'
                f' {self.clearance_m:g} m: must not be below 0'
            )
        if not (0.0 <= self.arrival_tolerance_m <= 1.0 and 0.0 <= self.arrival_tolerance_rad <= math.pi):
            raise StartUpError(
                f'the arrival tolerances are {self.arrival_tolerance_m:g} m and'
                f' {self.arrival_tolerance_rad:g} rad: must be from 0 to 1 m, and from 0 to pi rad'
            )
        if not abs(self.camera_offset_m) < self.smallest_standoff_m:
            raise StartUpError(
                f"the camera is {self.camera_offset_m:g} m ahead of the robot's centre: must be less than"
                f' the smallest standoff, which is {self.smallest_standoff_m:g} m'
            )

    @property
    def tight_m(self) -> float:
        """With less room, a steeper view is better."""
        return min(TIGHT_M, self.clearance_m)

    @property
    def room_for_arrival_m(self) -> float:
        """With this room, the robot has its clearance, and is not tight where it may stop beside its pose."""
        return max(self.clearance_m, self.tight_m + self.arrival_tolerance_m)

    @property
    def steepest_rad(self) -> float:
        """The largest incidence angle where there is little room."""
        return max(self.largest_angle_rad, self.steepest_angle_rad)

    @property
    def smallest_room_m(self) -> float:
        """The room beyond the radius that each pose and each path has."""
        return min(SMALLEST_ROOM_M, self.clearance_m)


def find_candidates(
    tag: TagPose, limits: ViewingLimits, *, at_preferred_standoff: bool = False
) -> np.ndarray:
    """Return the possible poses of a tag, with the columns of ApproachPose, in an array (poses, 5)."""
    views = _views(limits, at_preferred_standoff=at_preferred_standoff)
    places = tag[:2] + views[:, :1] * directions(tag.facing + views[:, 1])
    towards = tag[:2] - places
    yaws = np.arctan2(towards[:, 1], towards[:, 0])
    incidences = np.abs(wrapped(yaws + math.pi - tag.facing))
    return np.column_stack([places, yaws, np.hypot(*towards.T), incidences])


def _views(limits: ViewingLimits, *, at_preferred_standoff: bool) -> np.ndarray:
    """Return the standoff and the signed incidence angle of each possible view of a tag (views, 2)."""
    preferred_m = limits.preferred_standoff_m
    standoffs_m = [preferred_m]
    if not at_preferred_standoff:
        standoffs_m += _steps(preferred_m, limits.smallest_standoff_m, STANDOFF_STEP_M)
        standoffs_m += _steps(preferred_m, limits.largest_standoff_m, STANDOFF_STEP_M)
    one_side = _steps(0.0, limits.largest_angle_rad, ANGLE_STEP_RAD)
    one_side += _steps(limits.largest_angle_rad, limits.steepest_rad, ANGLE_STEP_RAD)
    angles = [0.0, *(sign * angle for angle in one_side for sign in (1, -1))]
    views = np.array(list(itertools.product(standoffs_m, angles)))
    # A tag looks narrower from the side: a steep view must be nearer.
    narrow_m = limits.largest_standoff_m / math.cos(limits.largest_angle_rad)
    farthest_m = np.maximum(narrow_m * np.cos(views[:, 1]), limits.smallest_standoff_m)
    is_wide = np.abs(views[:, 1]) <= limits.largest_angle_rad
    return np.asarray(views[is_wide | (views[:, 0] <= farthest_m + EQUAL_M)])


def pose_by_hand(pose: PoseInPlane, tag: TagPose, limits: ViewingLimits) -> tuple[ApproachPose, str]:
    """
    Return the approach pose that a team has set, and why the camera cannot see the tag from it, or ''.

    The angle of the pose is that of the camera's line of sight. If the robot looks past the tag, there is
    none, and the angle is that between the direction of the robot and the normal of the tag.
    """
    x, y, yaw = pose
    distance_m = math.hypot(tag.x - x, tag.y - y)
    camera_x = x + limits.camera_offset_m * math.cos(yaw)
    camera_y = y + limits.camera_offset_m * math.sin(yaw)
    sight = math.atan2(tag.y - camera_y, tag.x - camera_x)
    past_rad, incidence_rad = _between(sight, yaw), _between(sight + math.pi, tag.facing)
    angle_rad, reason = incidence_rad, ''
    if past_rad > HALF_VIEW_RAD:
        angle_rad = _between(yaw + math.pi, tag.facing)
        reason = f'it looks {math.degrees(past_rad):.0f}° past the tag: correct yaw'
    elif incidence_rad > limits.steepest_rad + EQUAL_M:
        reason = (
            f'the incidence angle is {math.degrees(incidence_rad):.0f}°, above'
            f' {math.degrees(limits.steepest_rad):g}°: correct the position'
        )
    elif not limits.smallest_standoff_m - EQUAL_M <= distance_m <= limits.largest_standoff_m + EQUAL_M:
        reason = (
            f'it is {distance_m:.2f} m from the tag, not {limits.smallest_standoff_m:g} to'
            f' {limits.largest_standoff_m:g} m: correct the position'
        )
    return ApproachPose(x, y, yaw, distance_m, angle_rad), reason


def _between(one_rad: float, other_rad: float) -> float:
    """Return the angle from 0 to pi between two directions."""
    return abs(math.remainder(one_rad - other_rad, math.tau))


def best_first(
    poses: np.ndarray, rooms_m: np.ndarray, limits: ViewingLimits, worst_rank: float = math.inf
) -> np.ndarray:
    """
    Return the numbers of the poses, an array (poses, 5), that have room and at most this rank.

    The ranks: 0 clearance, and room and view allow for an arrival beside the pose; 1 clearance, and the view
    does; 2 clearance; 3 not tight; 4 not tight, but a steep view; 5 others.
    """
    is_steep = poses[:, 4] > limits.largest_angle_rad + EQUAL_M
    has_clearance = rooms_m >= limits.clearance_m - EQUAL_M
    is_tight = rooms_m < limits.tight_m - EQUAL_M
    enough_m = limits.room_for_arrival_m
    is_close = rooms_m < enough_m - EQUAL_M
    allows_arrival = _allow_arrival(poses, limits)
    conditions = [is_tight, is_steep, ~has_clearance, ~allows_arrival, is_close]
    ranks = np.select(conditions, [5, 4, 3, 2, 1], 0)
    room_mm = np.round(1e3 * np.minimum(rooms_m, enough_m))
    off_m = np.round(np.abs(poses[:, 3] - limits.preferred_standoff_m), 9)
    order = np.lexsort((np.round(poses[:, 4], 9), off_m, ~allows_arrival, -room_mm, ranks))
    has_room = rooms_m >= limits.smallest_room_m - EQUAL_M
    return order[(has_room & (ranks <= worst_rank))[order]]


def _allow_arrival(poses: np.ndarray, limits: ViewingLimits) -> np.ndarray:
    """Return whether the view from each pose is within the limits after an arrival within the tolerances."""
    standoffs_m, angles = poses[:, 3], poses[:, 4]
    aside_m = limits.arrival_tolerance_m + abs(limits.camera_offset_m) * limits.arrival_tolerance_rad
    to_camera_m = np.maximum(standoffs_m - limits.camera_offset_m, EQUAL_M)
    turn = np.arcsin(np.minimum(aside_m / to_camera_m, 1.0))  # of the line of sight
    nearest_m = min(limits.smallest_standoff_m + limits.arrival_tolerance_m, limits.preferred_standoff_m)
    farthest_m = max(limits.largest_standoff_m - limits.arrival_tolerance_m, limits.preferred_standoff_m)
    return (
        (angles + np.maximum(turn, limits.arrival_tolerance_rad) <= limits.largest_angle_rad + EQUAL_M)
        & (standoffs_m >= nearest_m - EQUAL_M)
        & (standoffs_m <= farthest_m + EQUAL_M)
    )


def directions(angles: np.ndarray) -> np.ndarray:
    """Return the unit vectors of angles to the x axis, in an array (angles, 2)."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def wrapped(angles: np.ndarray) -> np.ndarray:
    """Return angles from -pi to pi."""
    return angles - math.tau * np.round(angles / math.tau)


def _steps(start: float, end: float, step: float) -> list[float]:
    """Return the values from a start, which is left out, to an end, which is not."""
    count = math.ceil(round(abs(end - start) / step, 6))
    return [start + math.copysign(n * step, end - start) for n in range(1, count)] + [end] * bool(count)
