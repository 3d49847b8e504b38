"""The map that SLAM made, as an occupancy grid. Does not import ROS."""

import copy
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError, escaped, reason_of
from lupin_greenhouse_bridge.simulator.files import read_yaml

from lupin_planning.registration import POSE_LIMITS, Transform
from lupin_planning.values import number
from lupin_planning.walls import Walls

# Of a cell from 0 to 100 %; what is between is unknown.
FREE_PERCENT, OCCUPIED_PERCENT = 25, 65
DEFAULTS = {'negate': 0, 'occupied_thresh': 0.65, 'free_thresh': 0.25, 'mode': 'trinary'}  # of map_server
AS_SAVED = "save it again with Nav2's map_saver_cli, in its default mode"
GREY_MODES = ('1', 'L', 'P', 'RGB')  # of an image of PIL: 8 bits, and no opacity


class OccupancyMap:
    """An occupancy grid. Unknown cells and all outside it are obstacles, unless they count as free."""

    files: tuple[Path, ...] = ()  # that it was read from

    def __init__(
        self,
        width: int,
        height: int,
        resolution_m: float,
        origin: tuple[float, float, float],
        data: Sequence[int] | np.ndarray,
        *,
        unknown_is_free: bool = False,
    ) -> None:
        """
        Take the plain fields of a nav_msgs/OccupancyGrid.

        The origin x, y, yaw is the pose of the outer corner of the first cell. The data has a number for each
        cell, row by row: 0 (free) to 100 (occupied), or -1 (unknown). Raises StartUpError for fields that do
        not match.
        """
        if not (0.0 < resolution_m < math.inf and all(map(math.isfinite, origin))):
            x, y, yaw = origin
            raise StartUpError(
                f'the map has the resolution {resolution_m:g} and the origin {x:g}, {y:g}, {yaw:g}:'
                ' must be finite numbers, and the resolution above 0'
            )
        if not 0 < width * height == len(data):
            raise StartUpError(
                f'the map has {len(data)} cells, but its size is {width} x {height}: must have width x height'
            )
        cells = np.asarray(data, dtype=np.int16).reshape(height, width)
        self.resolution_m, self.origin = resolution_m, Transform(*origin)
        self.is_occupied = cells >= OCCUPIED_PERCENT
        self.is_unknown = ~self.is_occupied & ((cells < 0) | (cells > FREE_PERCENT))
        self._is_free_outside = unknown_is_free
        self._is_obstacle = self.is_occupied if unknown_is_free else self.is_occupied | self.is_unknown

    def in_layout(self, layout_in_map: Transform) -> 'OccupancyMap':
        """Return the same map in the frame of the layout."""
        moved, to_layout = copy.copy(self), layout_in_map.inverse()
        x, y, yaw = self.origin
        moved.origin = Transform(*to_layout.point(x, y), to_layout.heading(yaw))
        return moved

    @property
    def extent(self) -> Walls:
        """The rectangle along the axes that holds the grid."""
        height, width = np.array(self.is_occupied.shape) * self.resolution_m
        xs, ys = self.origin.point(np.array([0.0, width, 0.0, width]), np.array([0.0, 0.0, height, height]))
        return Walls(xs.min(), ys.min(), xs.max(), ys.max())

    def are_obstacles(self, xs: np.ndarray, ys: np.ndarray) -> np.ndarray:
        """Return for each point whether it is in an obstacle."""
        x, y = self.origin.inverse().point(xs, ys)
        columns, rows = np.floor(np.array([x, y]) / self.resolution_m).astype(int)
        height, width = self._is_obstacle.shape
        is_inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        is_obstacle = self._is_obstacle[rows.clip(0, height - 1), columns.clip(0, width - 1)]
        return np.where(is_inside, is_obstacle, not self._is_free_outside)

    def obstacle_points(self) -> np.ndarray:
        """Return the centres of the cells that are obstacles, in an array (points, 2)."""
        rows, columns = np.nonzero(self._is_obstacle)
        x, y = (columns + 0.5) * self.resolution_m, (rows + 0.5) * self.resolution_m
        return np.column_stack(self.origin.point(x, y))


def read_map(path: str | Path, *, unknown_is_free: bool = False) -> OccupancyMap:
    """Return a trinary map, as Nav2's map_saver writes it: a YAML file and its image. Raises StartUpError."""
    where = f"map '{escaped(str(path), 500)}'"
    data: dict[str, Any] = DEFAULTS | read_yaml(path, where, 'a mapping with image, resolution and origin')
    if not isinstance(data.get('image'), str) or not data['image']:
        raise StartUpError(f'{where}: image is missing or no text: must name a PGM or PNG file')
    for key in ('mode', 'negate'):
        if data[key] != DEFAULTS[key]:
            shown = escaped(repr(data[key]), 60)
            raise StartUpError(f'{where}: {key} is {shown}: only {DEFAULTS[key]} is read: {AS_SAVED}')
    resolution_m = number(data, 'resolution', where, 'metres per cell', 1e-4, 1.0)
    if not isinstance(data.get('origin'), list) or len(data['origin']) != 3:
        raise StartUpError(f'{where}: origin is missing or not a list of three: must be [x, y, yaw]')
    origin = dict(zip(('x', 'y', 'yaw'), data['origin'], strict=True))
    x, y, yaw = (number(origin, key, f'{where}: origin', *limits) for key, limits in POSE_LIMITS.items())
    for key in ('occupied_thresh', 'free_thresh'):
        number(data, key, where, 'share of 1', 0.0, 1.0)
    if data['free_thresh'] >= data['occupied_thresh']:
        raise StartUpError(f'{where}: free_thresh must be below occupied_thresh')
    image = Path(path).parent / data['image']
    occupied = 1.0 - _read_image(image, where) / 255.0
    cells = np.select([occupied > data['occupied_thresh'], occupied < data['free_thresh']], [100, 0], -1)
    height, width = cells.shape
    found = OccupancyMap(
        width, height, resolution_m, (x, y, yaw), cells[::-1].ravel(), unknown_is_free=unknown_is_free
    )
    found.files = Path(path), image
    return found


def _read_image(path: Path, where: str) -> np.ndarray:
    """Return the brightness of each pixel, from 0 to 255."""
    try:
        from PIL import Image  # imported late: only maps need it
    except ImportError as error:
        raise StartUpError(f'{error}: sudo apt install python3-pil') from error
    where = f"{where}: image '{escaped(str(path), 300)}'"
    try:
        with Image.open(path) as image:
            mode, grey = image.mode, np.asarray(image.convert('L'))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        fault = f'{where} cannot be read ({reason_of(error)})'
        raise StartUpError(f'{fault}: correct image in the map') from error
    if mode not in GREY_MODES:
        raise StartUpError(f'{where} is not 8-bit grey: {AS_SAVED}')
    return grey
