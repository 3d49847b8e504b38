"""What stands around a tag: the room that it leaves a robot, and what hides the tag. Does not import ROS."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.planning.free_space import cross
from lupin_greenhouse_bridge.planning.grid import Grid
from lupin_greenhouse_bridge.planning.tag_poses import Table, TagPose, nearest_tables
from lupin_greenhouse_bridge.planning.walls import Walls

SAME_M = 1e-9
BEYOND = 1e-6  # share of a line of sight: what touches the tag from the front is before it


class Surroundings(NamedTuple):
    """
    The tables and plates near a tag, in metres: their shapes, and the sides that can hide the tag.

    A tag stands on its nearest table, which never hides it.
    """

    walls: Walls
    tables: np.ndarray  # (tables, 4): x0, y0, x1 and y1
    plates: np.ndarray  # (plates, 2, 2): the two ends of each, that of the tag too
    others: np.ndarray  # (tables, 4): without the table of the tag
    sides: np.ndarray  # (sides, 2, 2): of these and of the other plates
    plate: np.ndarray  # (2, 2): the two ends of the tag

    def gaps_m(self, points: np.ndarray) -> np.ndarray:
        """Return the distance from each point (points, 2) to the nearest table, plate or wall."""
        x, y = points.T
        x0, y0, x1, y1 = self.walls
        to_walls_m = np.min([x - x0, y - y0, x1 - x, y1 - y], axis=0)
        low, high = self.tables[:, :2], self.tables[:, 2:]
        beside = np.maximum(np.maximum(low - points[:, None], points[:, None] - high), 0.0)
        start = self.plates[:, 0]
        along = self.plates[:, 1] - start
        offsets = points[:, None] - start
        shares = np.clip((offsets * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
        offsets -= shares[..., None] * along
        others_m = np.hypot(*np.moveaxis(np.concatenate([beside, offsets], axis=1), 2, 0))
        return np.minimum(to_walls_m, others_m.min(axis=1))

    def are_in_view(self, eyes: np.ndarray) -> np.ndarray:
        """
        Return whether a camera at each point (eyes, 2) has a view of the whole tag.

        It has if no table and no plate is in the triangle between the camera and the ends of the tag: no side
        of one passes through the triangle, and its middle is not over another table.
        """
        ends = eyes[:, None] + (self.plate - eyes[:, None]) * (1.0 + BEYOND)
        corners = np.concatenate([eyes[:, None], ends], axis=1)  # (eyes, 3, 2)
        edges = np.roll(corners, -1, axis=1) - corners
        inwards = np.stack([-edges[..., 1], edges[..., 0]], axis=2)
        inwards *= np.sign(cross(edges[:, 0], edges[:, 1]))[:, None, None]
        inwards /= np.maximum(np.linalg.norm(inwards, axis=2, keepdims=True), SAME_M)
        # The depths of both ends of each side (eyes, 3, sides) within each edge; a part is inside all three.
        first, last = (
            np.einsum('nei,si->nes', inwards, self.sides[:, end])
            - np.einsum('nei,nei->ne', inwards, corners)[..., None]
            - SAME_M
            for end in (0, 1)
        )
        with np.errstate(divide='ignore', invalid='ignore'):
            meets = first / (first - last)
        enters = np.where(first <= 0.0, np.where(last > 0.0, meets, np.inf), 0.0).max(axis=1)
        leaves = np.where(last <= 0.0, np.where(first > 0.0, meets, -np.inf), 1.0).min(axis=1)
        low, high = self.others[:, :2] + SAME_M, self.others[:, 2:] - SAME_M
        middles = corners.mean(axis=1)[:, None]
        is_within = ((middles > low) & (middles < high)).all(axis=2)
        return ~((enters < leaves).any(axis=1) | is_within.any(axis=1))


class AllSurroundings:
    """The tables and plates of a greenhouse, by the tags that they are near."""

    def __init__(self, tables: list[Table], walls: Walls, tag_poses: Mapping[str, TagPose]):
        """Take the tables, and the poses of the tags by their ids."""
        self._walls = walls
        self._tables = np.array(tables, dtype=float).reshape(-1, 4)
        self._plates = np.array([each.ends_of_plate() for each in tag_poses.values()]).reshape(-1, 2, 2)
        self._near_tables = Grid(self._tables[:, :2], self._tables[:, 2:])
        self._near_plates = Grid(self._plates.min(axis=1), self._plates.max(axis=1))
        self._numbers = {tag_id: number for number, tag_id in enumerate(tag_poses)}
        self._nearest = nearest_tables(tables, [each[:2] for each in tag_poses.values()])

    def of(self, tag_id: str, reach_m: float) -> Surroundings:
        """Return what is within this distance of a tag."""
        number = self._numbers[tag_id]
        plate = self._plates[number]
        centre = plate.mean(axis=0)
        box = centre[None] - reach_m, centre[None] + reach_m
        tables, plates = (np.unique(each.near(*box)[1]) for each in (self._near_tables, self._near_plates))
        x0, y0, x1, y1 = self._tables[tables].T
        (x, y) = centre
        beside = np.maximum(np.maximum([x0 - x, y0 - y], [x - x1, y - y1]), 0.0)
        tables = tables[np.hypot(*beside) <= reach_m]
        plates = plates[np.linalg.norm(self._plates[plates] - centre, axis=2).min(axis=1) <= reach_m]
        others = self._tables[tables[tables != self._nearest[number]]]
        corners = others[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]
        sides = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 2)
        return Surroundings(
            self._walls,
            self._tables[tables],
            self._plates[plates],
            others,
            np.concatenate([sides, self._plates[plates[plates != number]]]),
            plate,
        )
