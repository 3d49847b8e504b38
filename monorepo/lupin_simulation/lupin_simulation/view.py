"""An SDF world: open it with Drake, and where its tags are seen from. Does not import Drake at the top."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError

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


def open_world(sdf_file: str | Path):
    """Return the renderer.World of an SDF file; raises StartUpError without Drake, or for another file."""
    try:
        from lupin_simulation.renderer import World  # imported here: a missing library is a one-line error
    except ImportError as error:
        raise StartUpError(f'Drake is missing ({error}): pip install drake') from error
    try:
        return World(sdf_file)
    except RuntimeError as error:
        raise StartUpError(
            f"'{sdf_file}' is not an SDF world: use a world made by generate_world: {error}"
        ) from error
