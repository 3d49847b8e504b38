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
    """An occupancy grid. Unknown cells and all outside it count as occupied, or as free if asked for."""

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
    ):
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
        self.is_unknown_taken = not unknown_is_free
        self.is_taken = self.is_occupied | (self.is_unknown & self.is_unknown_taken)

    def in_layout(self, layout_in_map: Transform) -> 'OccupancyMap':
        """Return the same map in the frame of the layout."""
        moved = copy.copy(self)
        offset = Transform(yaw=-layout_in_map.yaw).point(
            self.origin.x - layout_in_map.x, self.origin.y - layout_in_map.y
        )
        moved.origin = Transform(*offset, self.origin.yaw - layout_in_map.yaw)
        return moved

    @property
    def extent(self) -> Walls:
        """The rectangle along the axes that holds the grid."""
        height, width = np.array(self.is_occupied.shape) * self.resolution_m
        xs, ys = zip(*(self.origin.point(x, y) for x in (0.0, width) for y in (0.0, height)), strict=True)
        return Walls(min(xs), min(ys), max(xs), max(ys))

    def have_inside(self, points: np.ndarray) -> np.ndarray:
        """Return for each point (points, 2) whether it is inside the grid."""
        cells = self.in_cells(points)
        inside: np.ndarray = np.all((cells >= 0.0) & (cells <= self.is_occupied.shape[::-1]), axis=1)
        return inside

    def are_taken(self, points: np.ndarray) -> np.ndarray:
        """Return for each point (points, 2) whether the robot cannot be in its cell."""
        columns, rows = np.floor(self.in_cells(points)).astype(int).T
        height, width = self.is_taken.shape
        is_inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        cells = self.is_taken[rows.clip(0, height - 1), columns.clip(0, width - 1)]
        return np.where(is_inside, cells, self.is_unknown_taken)

    def taken_points(self) -> np.ndarray:
        """Return the middles of the cells in which the robot cannot be, in an array (points, 2)."""
        rows, columns = np.nonzero(self.is_taken)
        x, y = self.resolution_m * (np.array([columns, rows]) + 0.5)
        cos, sin = math.cos(self.origin.yaw), math.sin(self.origin.yaw)
        return np.column_stack([self.origin.x + cos * x - sin * y, self.origin.y + sin * x + cos * y])

    def in_cells(self, points: np.ndarray) -> np.ndarray:
        """Return points (points, 2) as columns and rows, counted from the origin."""
        cos, sin = math.cos(self.origin.yaw), math.sin(self.origin.yaw)
        turn = np.array([(cos, -sin), (sin, cos)])
        cells: np.ndarray = (points - self.origin[:2]) @ turn / self.resolution_m
        return cells


def read_map(path: str | Path, *, unknown_is_free: bool = False) -> OccupancyMap:
    """Return a trinary map, as Nav2's map_saver writes it: a YAML file and its image. Raises StartUpError."""
    where = f"map '{escaped(str(path), 500)}'"
    if Path(path).suffix.lower() in ('.pgm', '.png', '.bmp'):
        raise StartUpError(f'{where}: is an image: name the YAML file of the map, which names the image')
    wanted = 'a mapping with image, resolution and origin'
    data: dict[str, Any] = DEFAULTS | read_yaml(path, where, wanted)
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
    x, y, yaw = (float(number(origin, key, f'{where}: origin', *each)) for key, each in POSE_LIMITS.items())
    for key in ('occupied_thresh', 'free_thresh'):
        number(data, key, where, 'share of 1', smallest=0.0, largest=1.0)
    if data['free_thresh'] >= data['occupied_thresh']:
        raise StartUpError(f'{where}: free_thresh must be below occupied_thresh')
    image = Path(path).parent / data['image']
    occupied = 1.0 - _read_image(image, where) / 255.0
    cells = np.select([occupied > data['occupied_thresh'], occupied < data['free_thresh']], [100, 0], -1)
    height, width = cells.shape
    found = OccupancyMap(
        width, height, float(resolution_m), (x, y, yaw), cells[::-1].ravel(), unknown_is_free=unknown_is_free
    )
    found.files = Path(path), image
    return found


def _read_image(path: Path, where: str) -> np.ndarray:
    """Return the brightness of each pixel, from 0 to 255."""
    try:
        from PIL import Image  # imported late: only maps need it
    except ImportError as error:
        raise StartUpError(f'{error}: sudo apt install python3-pil') from error
    try:
        if path.exists() and not path.is_file():  # a pipe would wait for its writer
            raise ValueError('not a regular file')
        with Image.open(path) as image:
            mode, grey = image.mode, np.asarray(image.convert('L'))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        fault = f"image '{escaped(str(path), 300)}' cannot be read ({reason_of(error)})"
        raise StartUpError(f'{where}: {fault}: correct image in this file, or save the map again') from error
    if mode not in GREY_MODES:
        raise StartUpError(f"{where}: image '{escaped(str(path), 300)}' is not 8-bit grey: {AS_SAVED}")
    return grey
