"""The direction that each tag of a layout faces, and what hides it from a camera. Does not import ROS."""

import math
from typing import NamedTuple

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.simulator.layout import Layout
from numpy.typing import ArrayLike, NDArray

from lupin_planning.walls import EAST, NORTH, SOUTH, WEST, Walls

EQUAL_M = 1e-9  # distances that differ by less count as equal
TAG_WIDTH_M = 0.0625  # of a tag of 5 cm with its white border
ON_WALL_M = 0.1  # a tag that is nearer to a wall, and not nearer to a table, hangs on the wall
ASIDE_M = 0.1  # a table that is farther beside a tag is not ahead of it
LOW, HIGH = slice(0, 2), slice(2, 4)  # corners of a table
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
        return [angle for angle, edge_m in edges_m.items() if edge_m <= min(edges_m.values()) + EQUAL_M]

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
    edges = np.array(tables).reshape(-1, 4)
    xs, ys, _ = zip(*layout.tags.values(), strict=True)
    middle_x, middle_y = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
    tag_poses = {}
    for tag_id, (x, y, _) in layout.tags.items():
        wall = _wall_of(x, y, walls, edges)
        if wall is not None:
            facing = OPPOSITE[wall]
        elif tables:
            facing = _side_of_table(x, y, _nearest_table(x, y, edges), tables, walls)
        else:
            facing = SOUTH if (x, y) == (middle_x, middle_y) else math.atan2(middle_y - y, middle_x - x)
        tag_poses[tag_id] = TagPose(x, y, facing)
    return tag_poses


def _wall_of(x: float, y: float, walls: Walls, tables: np.ndarray) -> float | None:
    """Return the direction of the wall that a tag hangs on; None if it hangs on none."""
    away_m = {angle: walls.distance_ahead_m(x, y, angle) for angle in OPPOSITE}
    wall = min(away_m, key=away_m.__getitem__)
    return wall if 0.0 <= away_m[wall] < distances_m(tables, (x, y)).min(initial=ON_WALL_M) else None


def _nearest_table(x: float, y: float, tables: np.ndarray) -> int:
    """Return the number of the table that is nearest to a point; of equal ones, the first."""
    return int(np.round(distances_m(tables, (x, y)), 9).argmin())


def _side_of_table(x: float, y: float, number: int, tables: list[Table], walls: Walls) -> float:
    """Return the direction in which a tag on a table faces."""
    others: list[Walls | Table] = [walls, *tables[:number], *tables[number + 1 :]]
    room_m = {
        angle: min(round(other.distance_ahead_m(x, y, angle), 9) for other in others)
        for angle in tables[number].nearest_edges(x, y)
    }
    return max(room_m, key=room_m.__getitem__)


def distances_m(tables: np.ndarray, points: ArrayLike) -> np.ndarray:
    """Return the distance of each table (tables, 4) to a point (2), or to each of (points, 1, 2); 0 in it."""
    beside = np.maximum(tables[:, :2] - points, points - tables[:, 2:]).clip(0.0)
    return np.asarray(np.hypot(beside[..., 0], beside[..., 1]))


def are_hidden(cameras: np.ndarray, tag: TagPose, tables: np.ndarray, walls: Walls) -> NDArray[np.bool_]:
    """
    Return for each camera position (cameras, 2) whether a table (tables, 4) hides the tag.

    It does if it is between the camera and the middle of the tag, or one of its ends. A tag stands on its
    nearest table, which never hides it, unless it hangs on a wall.
    """
    x, y, facing = tag
    reach_m = np.hypot(*(cameras - (x, y)).T).max(initial=0.0)
    is_near = distances_m(tables, (x, y)) <= reach_m
    if len(tables) and _wall_of(x, y, walls, tables) is None:
        is_near[_nearest_table(x, y, tables)] = False
    # Without its edges, a table that touches a line does not hide it.
    near = tables[is_near] + np.array([1.0, 1.0, -1.0, -1.0]) * EQUAL_M
    aside = TAG_WIDTH_M / 2 * np.array([-math.sin(facing), math.cos(facing)])
    targets = (x, y) + np.array([[-1.0], [0.0], [1.0]]) * aside
    starts = cameras[:, None, None]
    along = targets[:, None] - starts  # (cameras, targets, 1, 2)
    with np.errstate(divide='ignore'):
        meets = np.sort([(near[:, corner] - starts) / along for corner in (LOW, HIGH)], axis=0)
    enters, leaves = meets[0].max(axis=3).clip(0.0), meets[1].min(axis=3).clip(None, 1.0)
    return np.asarray((enters < leaves).any(axis=(1, 2)))
