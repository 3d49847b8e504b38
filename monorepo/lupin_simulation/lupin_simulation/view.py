"""The tags of an SDF world, and where they are seen from. Does not import Drake."""

import math
from dataclasses import dataclass

import numpy as np

from lupin_simulation.tag_poses_in_world import TAG_HEIGHT_M


@dataclass(frozen=True)
class Tag:
    """A tag of the world: its centre in metres, and the axes of its model's frame."""

    centre: np.ndarray
    to_right: np.ndarray  # of the viewer
    up: np.ndarray
    out: np.ndarray  # of its face


def viewpoint(tag: Tag, distance_m: float, angle_degrees: float) -> np.ndarray:
    """Return a point at this distance from a tag and at its height, turned from its normal to its right."""
    angle = math.radians(angle_degrees)
    return tag.centre + distance_m * (math.cos(angle) * tag.out + math.sin(angle) * tag.to_right)


def ahead(x: float, y: float, yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where the camera of a robot with this pose is, and a point before it, as high as the tags."""
    eye = np.array([x, y, TAG_HEIGHT_M])
    return eye, eye + np.array([math.cos(yaw), math.sin(yaw), 0.0])
