"""The tags of an SDF world, and where they are seen from. Does not import Drake."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError


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


def open_world(sdf_file: str | Path):
    """Return the renderer.World of an SDF file; raises StartUpError without Drake, or for another file."""
    try:
        from lupin_world.renderer import World  # imported here: a missing library is a one-line error
    except ImportError as error:
        raise StartUpError(f'Drake is missing ({error}): pip install drake') from error
    try:
        return World(sdf_file)
    except RuntimeError as error:
        raise StartUpError(f"'{sdf_file}' is not an SDF world: use one of generate_world: {error}") from error
