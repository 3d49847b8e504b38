# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The direction that each tag of a layout faces, and what stands around it. Does not import ROS."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.planning.walls import EAST, NORTH, SOUTH, WEST, Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

EQUAL_M = 1e-9  # distances that differ by less count as equal
PLATE_WIDTH_M = 0.0625  # of a tag of 5 cm with its white border
ON_WALL_M = 0.1  # a tag that is nearer to a wall, and not nearer to a table, hangs on the wall
ASIDE_M = 0.1  # a table that is farther beside a tag is not ahead of it
BEYOND = 1e-6  # share of a line of sight: what touches the tag from the front is before it
SIDES_AT_ONCE = 32
OPPOSITE = {SOUTH: NORTH, NORTH: SOUTH, WEST: EAST, EAST: WEST}


class Table(NamedTuple):
    """The edges of a table in metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    def nearest_edges(self, x: float, y: float) -> list[float]:
        """Return the outward directions of the nearest edges, as angles to the x axis; two on a corner."""
        inside_x, inside_y = min(max(x, self.x0), self.x1), min(max(y, self.y0), self.y1)
        edges_m = {
            SOUTH: math.hypot(x - inside_x, y - self.y0),
            NORTH: math.hypot(x - inside_x, y - self.y1),
            WEST: math.hypot(x - self.x0, y - inside_y),
            EAST: math.hypot(x - self.x1, y - inside_y),
        }
        return [angle for angle, each_m in edges_m.items() if each_m <= min(edges_m.values()) + EQUAL_M]

    def distance_ahead_m(self, x: float, y: float, angle: float) -> float:
        """Return the distance from a point to this table in one of four directions; infinite beside it."""
        ahead = {EAST: self.x0 - x, WEST: x - self.x1, NORTH: self.y0 - y, SOUTH: y - self.y1}[angle]
        aside = (self.y0 - y, y - self.y1) if angle in (EAST, WEST) else (self.x0 - x, x - self.x1)
        return math.inf if max(aside) > ASIDE_M or ahead < 0.0 else ahead


class TagPose(NamedTuple):
    """The centre of a tag in metres, and the direction that it faces, in radians to the x axis."""

    x: float
    y: float
    facing: float

    def ends_of_plate(self) -> np.ndarray:
        """Return the two ends of the tag's plate, seen from above, in an array (2, 2)."""
        half = PLATE_WIDTH_M / 2 * np.array([-math.sin(self.facing), math.cos(self.facing)])
        return np.array([self[:2] + half, self[:2] - half])


def tables_of(layout: Layout) -> list[Table]:
    """Return the tables, in the order of the file; raises StartUpError for one without an area."""
    tables = []
    for name, (xa, ya, xb, yb) in layout.tables.items():
        if xa == xb or ya == yb:
            raise StartUpError(
                f"table '{escaped(name, 64)}' has no area: x0 and x1, and y0 and y1, must differ"
            )
        tables.append(Table(min(xa, xb), min(ya, yb), max(xa, xb), max(ya, yb)))
    return tables


def find_tag_poses(layout: Layout, walls: Walls) -> dict[str, TagPose]:
    """
    Return the pose of each tag by its id, in the order of the layout.

    A tag that hangs on a wall faces away from it. Each other tag faces away from the nearest edge of its
    nearest table. If two tables are equally near, the first in the file counts. On a corner, where two edges
    are equally near, the tag faces the side where the next table or wall is farther away, or else the first
    of south, north, west and east. Without tables, the tags face the middle of the layout. Raises
    StartUpError for a table without an area.
    """
    tables = tables_of(layout)
    xs, ys, _ = zip(*layout.tags.values(), strict=True)
    middle = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
    edges = np.array(tables).reshape(-1, 4)
    tag_poses = {}
    for tag_id, (x, y, _) in layout.tags.items():
        wall = _wall_of(x, y, walls, edges)
        if wall is not None:
            tag_poses[tag_id] = TagPose(x, y, OPPOSITE[wall])
            continue
        if not tables:
            facing = math.atan2(middle[1] - y, middle[0] - x) if (x, y) != middle else SOUTH
            tag_poses[tag_id] = TagPose(x, y, facing)
            continue
        number = nearest_of(distances_m(edges, (x, y)))
        facing, *others = tables[number].nearest_edges(x, y)
        if others:
            around: list[Walls | Table] = [walls, *tables[:number], *tables[number + 1 :]]
            room_m = {
                angle: min(round(each.distance_ahead_m(x, y, angle), 9) for each in around)
                for angle in (facing, *others)
            }
            facing = max(room_m, key=room_m.__getitem__)
        tag_poses[tag_id] = TagPose(x, y, facing)
    return tag_poses


def _wall_of(x: float, y: float, walls: Walls, tables: np.ndarray) -> float | None:
    """Return the direction of the wall that a tag hangs on; None if it hangs on none."""
    away_m = {angle: walls.distance_ahead_m(x, y, angle) for angle in OPPOSITE}
    wall = min(away_m, key=away_m.__getitem__)
    return wall if 0.0 <= away_m[wall] < distances_m(tables, (x, y)).min(initial=ON_WALL_M) else None


def distances_m(tables: np.ndarray, points: ArrayLike) -> np.ndarray:
    """Return the distance of each table (tables, 4) to a point (2), or to each of (points, 1, 2); 0 in it."""
    beside = np.maximum(tables[:, :2] - points, points - tables[:, 2:]).clip(0.0)
    return np.asarray(np.hypot(beside[..., 0], beside[..., 1]))


def nearest_of(distances_m: np.ndarray) -> int:
    """Return the number of the smallest distance; of equal ones, the first."""
    return int(np.argmax(distances_m <= distances_m.min() + EQUAL_M))


class Surroundings(NamedTuple):
    """
    The tables and plates near a tag, in metres: their shapes, and the sides that can hide the tag.

    A tag stands on its nearest table, which never hides it, unless it hangs on a wall.
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
        near_ends = self._ends.query_ball_point(tag[:2], reach_m + PLATE_WIDTH_M / 2)
        plates = np.array(near_ends, dtype=int) // 2
        others = np.unique(self._plates[plates[plates != number]], axis=0)  # of equal ones, one
        away_m = distances_m(self._tables, tag[:2])
        tables = np.flatnonzero(away_m <= reach_m)
        is_on_wall = _wall_of(*tag[:2], self._walls, self._tables) is not None
        own = None if is_on_wall or not len(tables) else nearest_of(away_m)
        other_tables = self._tables[tables[tables != own]]
        corners = other_tables[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]
        sides = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 2)
        sides = np.concatenate([sides, others])
        nearest_first = np.linalg.norm(sides.mean(axis=1) - tag[:2], axis=1).argsort()
        plates = np.concatenate([self._plates[number, None], others])
        return Surroundings(self._walls, self._tables[tables], plates, other_tables, sides[nearest_first])
