"""Where the layout lies in the robot's map: a rotation and a shift in the plane. Does not import ROS."""

import math
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError, printable
from lupin_greenhouse_bridge.greenhouse.files import number, read_yaml

MAP_FRAME, LAYOUT_FRAME = 'map', 'greenhouse'
_EXAMPLE = 'such as "frame_id: map", "x: 1.5", "y: -0.2" and "yaw: 0.3"'
_UNITS = {'x': 'metres', 'y': 'metres', 'yaw': 'radians'}


class Transform(NamedTuple):
    """The pose of the layout's frame in the map: metres, and radians counter-clockwise."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def point(self, x: float, y: float) -> tuple[float, float]:
        """Return a point of the layout in the map."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return self.x + cos * x - sin * y, self.y + sin * x + cos * y

    def heading(self, yaw: float) -> float:
        """Return a direction of the layout in the map, in [-pi, pi]."""
        return math.remainder(yaw + self.yaw, 2 * math.pi)


def read_transform(path: str | Path, frame_id: str = '') -> Transform:
    """
    Return the transform that write_transform() wrote.

    Raises StartUpError if the file is malformed, or holds the layout in another frame than `frame_id`.
    """
    registered_frame_id, transform = read_registration(path)
    if frame_id and registered_frame_id != frame_id:
        raise StartUpError(
            f"{_where(path)}: frame_id is '{registered_frame_id}', but the map's frame is '{frame_id}':"
            ' register the layout in that frame'
        )
    return transform


def read_registration(path: str | Path) -> tuple[str, Transform]:
    """Return the frame that a file registers the layout in, and the transform; raises StartUpError."""
    where = _where(path)
    data = read_yaml(path, where, 'a registration has one level')
    if not isinstance(data, dict):
        raise StartUpError(f'{where}: is not a mapping, {_EXAMPLE}')
    if unknown := [key for key in data if key not in ('frame_id', *_UNITS)]:
        shown = printable(str(unknown[0]), 64)
        raise StartUpError(f"{where}: unknown key '{shown}': the keys are frame_id, x, y and yaw")
    frame_id = data.get('frame_id')
    if not isinstance(frame_id, str) or not frame_id.strip():
        raise StartUpError(f'{where}: frame_id is missing or no text: must name the frame of the map')
    return frame_id, Transform(*(float(number(data, key, where, unit)) for key, unit in _UNITS.items()))


def write_transform(path: str | Path, transform: Transform, frame_id: str = MAP_FRAME) -> None:
    """Write where the layout lies in the map, as YAML; raises StartUpError if the file cannot be written."""
    import yaml  # mdp-greenhouse brings it

    text = yaml.safe_dump({'frame_id': frame_id, **transform._asdict()}, sort_keys=False, allow_unicode=True)
    try:
        Path(path).write_text(
            f'# The pose of the frame {LAYOUT_FRAME} (the layout) in the map: metres and radians.\n{text}',
            encoding='utf-8',
        )
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise StartUpError(f'{_where(path)} cannot be written ({reason}): name another file') from error


def _where(path) -> str:
    return f"registration '{printable(str(path), 500)}'"
