# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What stands around a tag: the room that it leaves a robot, and what hides the tag. Does not import ROS."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from lupin_greenhouse_bridge.planning.tag_poses import EQUAL_M, Table, TagPose, distances_m, nearest_of
from lupin_greenhouse_bridge.planning.walls import Walls

BEYOND = 1e-6  # share of a line of sight: what touches the tag from the front is before it
SIDES_AT_ONCE = 32


class Surroundings(NamedTuple):
    """
    The tables and plates near a tag, in metres: their shapes, and the sides that can hide the tag.

    A tag stands on its nearest table, which never hides it.
    """

    walls: Walls
    tables: np.ndarray  # (tables, 4): x0, y0, x1 and y1
    plates: np.ndarray  # (plates, 2, 2): the two ends of each, that of the tag first
    other_tables: np.ndarray  # (tables, 4): without the table of the tag
    sides: np.ndarray  # (sides, 2, 2): of these tables and of the other plates, the nearest first

    def gaps_m(self, points: np.ndarray) -> np.ndarray:
        """Return the distance from each point (points, 2) to the nearest table, plate or wall."""
        x, y = points.T
        x0, y0, x1, y1 = self.walls
        to_walls_m = np.min([x - x0, y - y0, x1 - x, y1 - y], axis=0)
        to_tables_m = distances_m(self.tables, points[:, None])
        starts, along = self.plates[:, 0], self.plates[:, 1] - self.plates[:, 0]
        offsets = points[:, None] - starts
        shares = ((offsets * along).sum(axis=2) / (along**2).sum(axis=1)).clip(0.0, 1.0)
        to_plates_m = np.linalg.norm(offsets - shares[..., None] * along, axis=2)
        gaps_m = np.concatenate([to_walls_m[:, None], to_tables_m, to_plates_m], axis=1)
        return np.asarray(gaps_m.min(axis=1))

    def are_in_view(self, eyes: np.ndarray) -> np.ndarray:
        """
        Return whether a camera at each point (eyes, 2) has a view of the whole tag.

        It has if no table and no plate is in the triangle between the camera and the ends of the tag: no side
        of one passes through the triangle, and its middle is not over another table.
        """
        ends = eyes[:, None] + (self.plates[0] - eyes[:, None]) * (1.0 + BEYOND)
        triangles = np.concatenate([eyes[:, None], ends], axis=1)  # (eyes, 3, 2)
        middles = triangles.mean(axis=1)[:, None]
        low, high = self.other_tables[:, :2] + EQUAL_M, self.other_tables[:, 2:] - EQUAL_M
        are_in_view = np.asarray(~((middles > low) & (middles < high)).all(axis=2).any(axis=1))
        for first in range(0, len(self.sides), SIDES_AT_ONCE):
            left = np.flatnonzero(are_in_view)
            sides = self.sides[first : first + SIDES_AT_ONCE]
            are_in_view[left] = ~_pass_through(sides, triangles[left])
        return are_in_view


def _pass_through(sides: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return whether a side, (sides, 2, 2), passes through each triangle, (triangles, 3, 2)."""
    edges = np.roll(triangles, -1, axis=1) - triangles
    inwards = np.stack([-edges[..., 1], edges[..., 0]], axis=2)
    inwards *= np.sign((inwards[:, 0] * edges[:, 1]).sum(axis=1))[:, None, None]
    inwards /= np.maximum(np.linalg.norm(inwards, axis=2, keepdims=True), EQUAL_M)
    # The depths of both ends of each side (triangles, 3, sides) within each edge; a part is inside all three.
    first, last = (
        np.einsum('nei,si->nes', inwards, sides[:, end])
        - np.einsum('nei,nei->ne', inwards, triangles)[..., None]
        - EQUAL_M
        for end in (0, 1)
    )
    with np.errstate(divide='ignore', invalid='ignore'):
        meets = first / (first - last)
    enters = np.where(first <= 0.0, np.where(last > 0.0, meets, np.inf), 0.0).max(axis=1)
    leaves = np.where(last <= 0.0, np.where(first > 0.0, meets, -np.inf), 1.0).min(axis=1)
    return np.asarray((enters < leaves).any(axis=1))


class Obstacles:
    """The tables and plates of a greenhouse, by the tags that they are near."""

    def __init__(self, tables: list[Table], walls: Walls, tag_poses: Mapping[str, TagPose]):
        """Take the tables, and the poses of the tags by their ids."""
        self._walls, self._tag_poses = walls, tag_poses
        self._numbers = {tag_id: number for number, tag_id in enumerate(tag_poses)}
        self._tables = np.array(tables, dtype=float).reshape(-1, 4)
        self._plates = np.array([each.ends_of_plate() for each in tag_poses.values()])
        self._ends = KDTree(self._plates.reshape(-1, 2))

    def around(self, tag_id: str, reach_m: float) -> Surroundings:
        """Return what is within this distance of a tag."""
        tag, number = self._tag_poses[tag_id], self._numbers[tag_id]
        plates = np.array(self._ends.query_ball_point(tag[:2], reach_m)) // 2
        others = np.unique(self._plates[plates[plates != number]], axis=0)  # of equal ones, one
        away_m = distances_m(self._tables, tag[:2])
        tables = np.flatnonzero(away_m <= reach_m)
        other_tables = self._tables[tables[tables != nearest_of(away_m)]] if len(tables) else self._tables[:0]
        corners = other_tables[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]
        sides = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 2)
        sides = np.concatenate([sides, others])
        nearest_first = np.linalg.norm(sides.mean(axis=1) - tag[:2], axis=1).argsort()
        plates = np.concatenate([self._plates[number, None], others])
        return Surroundings(self._walls, self._tables[tables], plates, other_tables, sides[nearest_first])
