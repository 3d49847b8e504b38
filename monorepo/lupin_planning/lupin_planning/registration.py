"""Where the layout lies in the robot's map: a rotation and a shift in the plane. Does not import ROS."""

import cmath
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped, reason_of
from lupin_greenhouse_bridge.simulator.files import read_yaml
from numpy.typing import NDArray

from lupin_planning.values import number, refuse_unknown_keys

MAP_FRAME, LAYOUT_FRAME = 'map', 'greenhouse'
HEAD = f'# The pose of the frame {LAYOUT_FRAME} (the layout) in the map: metres and radians.\n'
DEFAULT_TOLERANCE_M = 0.1
DEFAULT_CLICK_ERROR_M = 0.03
FEWEST_THAT_OVERRULE = 3  # two tags can agree by chance
SMALLEST_SPREAD = 1e-6  # square metres; tags in one spot show no rotation
_EXAMPLE = '{frame_id: map, x: 1.5, y: -0.2, yaw: 0.3}'
_METRES = ('metres', -1e12, 1e12)
POSE_LIMITS = {'x': _METRES, 'y': _METRES, 'yaw': ('radians', -10.0, 10.0)}  # not degrees
Positions = NDArray[np.complex128]  # x + y * 1j in metres, which a factor of length 1 rotates
Numbers = NDArray[np.intp]
Point = tuple[float, float]  # x and y in metres
Coordinate = TypeVar('Coordinate', float, np.ndarray)


class CannotFit(OneLineError):
    """No rotation and shift brings the layout to these positions in the map."""


class Transform(NamedTuple):
    """The pose of the layout's frame in the map: metres, and radians counter-clockwise."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def inverse(self) -> 'Transform':
        """Return the transform from the map into the frame of the layout."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return Transform(-cos * self.x - sin * self.y, sin * self.x - cos * self.y, -self.yaw)

    def point(self, x: Coordinate, y: Coordinate) -> tuple[Coordinate, Coordinate]:
        """Transform a point, or arrays of x and y, from the frame of the layout into the map."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return self.x + cos * x - sin * y, self.y + sin * x + cos * y

    def heading(self, yaw: float) -> float:
        """Transform a direction from the frame of the layout into the map; returns radians in [-pi, pi]."""
        return math.remainder(yaw + self.yaw, 2 * math.pi)


class Fit(NamedTuple):
    """The best transform, and the residual of each position in the map."""

    transform: Transform
    residuals_m: dict[str, float]  # of every tag, by id
    left_out: list[str]
    farthest: str  # the tag of the layout that is farthest from those that fit
    expected_error_m: float  # root mean square, of the farthest tag in the map


class _Alignment(NamedTuple):
    """The rotation and shift that bring some positions nearest to those in the map, by least squares."""

    rotation: complex
    shift: complex
    residuals_m: NDArray[np.float64]

    @property
    def squared_error(self) -> float:
        """The sum of the squared residuals in square metres."""
        return float((self.residuals_m**2).sum())


def fit(
    layout_m: Mapping[str, Point],
    map_m: Mapping[str, Point],
    tolerance_m: float = DEFAULT_TOLERANCE_M,
    click_error_m: float = DEFAULT_CLICK_ERROR_M,
) -> Fit:
    """
    Return the rotation and shift from the layout to the map, by least squares.

    Both mappings have x and y in metres by tag id, and the layout must have every tag of the map. While a
    residual is above the tolerance, the tag is left out without which the others fit best; at least three
    tags, and more than half of them, remain. The click error is the smallest standard deviation to assume for
    a position in the map, along each axis: a few residuals can be small by chance.

    Raises CannotFit if there are fewer than two tags, if the positions are a mirror image, or if a residual
    or the expected error is above the tolerance.
    """
    tag_ids = list(map_m)
    if len(tag_ids) < 2:
        raise CannotFit(f'tags with a position in the map: {len(tag_ids)}: at least 2 are needed')
    everywhere = _complex(layout_m.values())
    layout, in_map = _complex(layout_m[tag_id] for tag_id in tag_ids), _complex(map_m.values())
    kept = _agreeing(layout, in_map, tolerance_m)
    if _is_mirrored(layout, in_map, kept, tolerance_m, click_error_m):
        raise CannotFit(
            'the positions in the map are a mirror image of the layout: x and y are swapped, or an axis'
            ' points the wrong way'
        )
    if not len(kept):
        residuals_m = _aligned(layout, in_map).residuals_m
        worst = int(residuals_m.argmax())
        raise CannotFit(
            f'the layout does not fit the map: the largest residual is {residuals_m[worst]:.2f} m, of tag'
            f" '{escaped(tag_ids[worst], 64)}', and the tolerance is {tolerance_m:g} m: correct this"
            ' position, add more tags, or raise the tolerance'
        )
    aligned, middle = _aligned(layout[kept], in_map[kept]), layout[kept].mean()
    distances_m = np.abs(everywhere - middle)
    farthest, farthest_m = list(layout_m)[distances_m.argmax()], distances_m.max()
    # A residual has two coordinates, and the fit takes three of them: the shift and the rotation.
    deviation_m = max(click_error_m, math.sqrt(aligned.squared_error / (2 * len(kept) - 3)))
    spread = max((np.abs(layout[kept] - middle) ** 2).sum(), SMALLEST_SPREAD)
    expected_error_m = deviation_m * math.sqrt(2 / len(kept) + farthest_m**2 / spread)
    if expected_error_m > tolerance_m:
        raise CannotFit(
            f"the expected error is {expected_error_m:.2f} m at tag '{escaped(farthest, 64)}', which is"
            f' {farthest_m:.1f} m from the {len(kept)} tags that fit, and the tolerance is'
            f' {tolerance_m:g} m: use more tags, or tags that are farther apart'
        )
    rotation, shift, _ = aligned
    return Fit(
        Transform(shift.real, shift.imag, cmath.phase(rotation)),
        dict(zip(tag_ids, np.abs(rotation * layout + shift - in_map).tolist(), strict=True)),
        [tag_id for number, tag_id in enumerate(tag_ids) if number not in kept],
        farthest,
        expected_error_m,
    )


def _complex(places: Iterable[Point]) -> Positions:
    return np.array([complex(*place) for place in places])


def _aligned(layout: Positions, in_map: Positions) -> _Alignment:
    middle, middle_in_map = layout.mean(), in_map.mean()
    product = np.vdot(layout - middle, in_map - middle_in_map)
    rotation = cmath.rect(1.0, cmath.phase(product))
    shift = complex(middle_in_map - rotation * middle)
    return _Alignment(rotation, shift, np.abs(rotation * layout + shift - in_map))


def _agreeing(layout: Positions, in_map: Positions, tolerance_m: float) -> Numbers:
    """Return the numbers of the tags that fit when those that do not are left out; none if too few do."""
    fewest = max(FEWEST_THAT_OVERRULE, len(layout) // 2 + 1)
    kept = np.arange(len(layout))
    while _aligned(layout[kept], in_map[kept]).residuals_m.max() > tolerance_m:
        if len(kept) <= fewest:
            return kept[:0]
        without_one = [np.delete(kept, number) for number in range(len(kept))]
        kept = min(without_one, key=lambda some: _aligned(layout[some], in_map[some]).squared_error)
    return kept


def _is_mirrored(
    layout: Positions, in_map: Positions, kept: Numbers, tolerance_m: float, click_error_m: float
) -> bool:
    """Return whether the mirror image of the layout fits the map better than the layout does."""
    mirrored = layout.conj()
    kept_mirrored = _agreeing(mirrored, in_map, tolerance_m)
    if len(kept) != len(kept_mirrored):
        return len(kept_mirrored) > len(kept)
    if not len(kept):
        return _aligned(mirrored, in_map).squared_error < 0.25 * _aligned(layout, in_map).squared_error
    error = _aligned(mirrored[kept_mirrored], in_map[kept_mirrored]).squared_error
    return error < _aligned(layout[kept], in_map[kept]).squared_error - click_error_m**2


def read_places(path: str | Path) -> dict[str, Point]:
    """Return x and y in metres by tag id, from a YAML or JSON file; raises StartUpError for a bad file."""
    where = f"pairs '{escaped(str(path), 500)}'"
    example = 'such as {"7": [1.5, 7.3]}'
    data = read_yaml(path, where, f'positions in the map by tag id, {example}')
    places = {}
    for tag_id, place in data.items():
        here = f"{where}: tag '{escaped(str(tag_id), 64)}'"
        if not isinstance(tag_id, str):
            raise StartUpError(f'{here} is not text: put quotes around the id, {example}')
        if not isinstance(place, list) or len(place) != 2:
            raise StartUpError(f'{here}: must be a list of x and y, {example}')
        at = dict(zip('xy', place, strict=True))
        places[tag_id] = number(at, 'x', here, 'metres'), number(at, 'y', here, 'metres')
    return places


def read_transform(path: str | Path, frame_id: str = '') -> Transform:
    """Return the transform that read_registration() reads; also raises StartUpError for another frame."""
    registered_frame_id, transform = read_registration(path)
    if frame_id and registered_frame_id != frame_id:
        raise StartUpError(
            f"{_where(path)}: frame_id is '{registered_frame_id}', but the map's frame is '{frame_id}':"
            ' register the layout in that frame'
        )
    return transform


def read_registration(path: str | Path) -> tuple[str, Transform]:
    """Return the frame and the transform in a file of write_transform(); raises StartUpError."""
    where = _where(path)
    data = read_yaml(path, where, f'a mapping, such as {_EXAMPLE}')
    refuse_unknown_keys(data, ('frame_id', *POSE_LIMITS), where, _EXAMPLE)
    frame_id = data.get('frame_id')
    if not isinstance(frame_id, str) or not frame_id.strip():
        raise StartUpError(f'{where}: frame_id is missing or no text: must name the frame of the map')
    return frame_id, Transform(*(number(data, key, where, *limits) for key, limits in POSE_LIMITS.items()))


def write_transform(path: str | Path, transform: Transform, frame_id: str = MAP_FRAME) -> None:
    """Write where the layout lies in the map, as YAML; raises StartUpError if the file cannot be written."""
    import yaml  # mdp-greenhouse brings it

    text = yaml.safe_dump({'frame_id': frame_id, **transform._asdict()}, sort_keys=False, allow_unicode=True)
    try:
        Path(path).write_text(HEAD + text, encoding='utf-8')
    except (OSError, ValueError) as error:
        reason = f'cannot be written ({reason_of(error)})'
        raise StartUpError(f'{_where(path)} {reason}: name another file') from error


def _where(path: str | Path) -> str:
    return f"registration '{escaped(str(path), 500)}'"
