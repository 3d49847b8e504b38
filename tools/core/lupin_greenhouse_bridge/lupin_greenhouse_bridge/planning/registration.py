"""Where the layout lies in the robot's map: a rotation and a shift in the plane. Does not import ROS."""

import cmath
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped
from lupin_greenhouse_bridge.simulator.files import number, read_yaml

MAP_FRAME, LAYOUT_FRAME = 'map', 'greenhouse'
DEFAULT_TOLERANCE_M = 0.1
DEFAULT_CLICK_ERROR_M = 0.03
FEWEST_THAT_OVERRULE = 3  # two tags can agree by chance
_EXAMPLE = 'such as "frame_id: map", "x: 1.5", "y: -0.2" and "yaw: 0.3"'
_UNITS = {'x': 'metres', 'y': 'metres', 'yaw': 'radians'}


class CannotFit(OneLineError):
    """No rotation and shift brings the layout to these positions in the map."""


class Transform(NamedTuple):
    """The pose of the layout's frame in the map: metres, and radians counter-clockwise."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def point(self, x: float, y: float) -> tuple[float, float]:
        """Transform a point from the frame of the layout into the map."""
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
    hides_mirror: bool  # the tags lie so near to one line that a mirror image fits about as well


def fit(
    layout_m: Mapping[str, tuple[float, float]],
    map_m: Mapping[str, tuple[float, float]],
    tolerance_m: float = DEFAULT_TOLERANCE_M,
    click_error_m: float = DEFAULT_CLICK_ERROR_M,
) -> Fit:
    """
    Return the rotation and shift from the layout to the map, by least squares.

    Both mappings have x and y in metres by tag id, and the layout must have every tag of the map. While a
    residual is above the tolerance, the tag is left out without which the others fit best; at least three
    tags, and more than half of them, remain. The click error is the smallest standard deviation to assume for
    a position in the map, along each axis: a few residuals can be small by chance.

    Raises CannotFit if there are fewer than two tags, if the tags are in one spot, if the positions are a
    mirror image, or if a residual or the expected error is above the tolerance.
    """
    pairs = {tag_id: (complex(*layout_m[tag_id]), complex(*place)) for tag_id, place in map_m.items()}
    if len(pairs) < 2:
        raise CannotFit(f'tags with a position in the map: {len(pairs)}: at least 2 are needed')
    mirrored = {tag_id: (place.conjugate(), other) for tag_id, (place, other) in pairs.items()}
    kept, mirrored_kept = _agreeing(pairs, tolerance_m), _agreeing(mirrored, tolerance_m)
    if len(kept) != len(mirrored_kept):
        is_mirror = len(mirrored_kept) > len(kept)
    elif kept:
        is_mirror = _squares(mirrored_kept) < _squares(kept) - click_error_m**2
    else:
        is_mirror = _squares(mirrored) < 0.25 * _squares(pairs)
    if is_mirror:
        raise CannotFit(
            'the positions in the map are a mirror image of the layout: x and y are swapped, or an axis'
            ' points the wrong way'
        )
    if not kept:
        residuals_m = _residuals_m(pairs, *_rotation_and_shift(pairs))
        worst = max(residuals_m, key=residuals_m.get)
        raise CannotFit(
            f'the layout does not fit the map: the largest residual is {residuals_m[worst]:.2f} m, of tag'
            f" '{escaped(worst, 64)}', and the tolerance is {tolerance_m:g} m: correct this position, add"
            ' more tags, or raise the tolerance'
        )
    mean, _, centred = _centred(kept)
    if max(abs(place) for place, _ in centred.values()) <= tolerance_m:
        raise CannotFit(
            f'the {len(kept)} tags that fit lie in one spot of the layout, within the tolerance of'
            f' {tolerance_m:g} m, and fit any rotation: use tags that are far apart'
        )
    distances_m = {tag_id: abs(complex(*place) - mean) for tag_id, place in layout_m.items()}
    farthest = max(distances_m, key=distances_m.get)
    # A residual has two coordinates, and the fit takes three of them: the shift and the rotation.
    deviation_m = max(click_error_m, math.sqrt(_squares(kept) / (2 * len(kept) - 3)))
    turning = distances_m[farthest] ** 2 / sum(abs(place) ** 2 for place, _ in centred.values())
    expected_error_m = deviation_m * math.sqrt(2 / len(kept) + turning)
    if expected_error_m > tolerance_m:
        raise CannotFit(
            f"the expected error is {expected_error_m:.2f} m at tag '{escaped(farthest, 64)}', which is"
            f' {distances_m[farthest]:.1f} m from the {len(kept)} tags that fit, and the tolerance is'
            f' {tolerance_m:g} m: use more tags, or tags that are farther apart'
        )
    more_if_mirrored = _squares({tag_id: mirrored[tag_id] for tag_id in kept}) - _squares(kept)
    rotation, shift = _rotation_and_shift(kept)
    return Fit(
        Transform(shift.real, shift.imag, cmath.phase(rotation)),
        _residuals_m(pairs, rotation, shift),
        [tag_id for tag_id in pairs if tag_id not in kept],
        farthest,
        expected_error_m,
        hides_mirror=more_if_mirrored < (4 * deviation_m) ** 2,
    )


def best_to_click(layout_m: Mapping[str, tuple[float, float]], count: int) -> list[str]:
    """Return `count` tags that are widely spread in both directions, from x and y in metres by tag id."""
    places = {tag_id: complex(*place) for tag_id, place in layout_m.items()}
    mean = sum(places.values()) / len(places)
    chosen = [max(places, key=lambda tag_id: abs(places[tag_id] - mean))]
    while len(chosen) < count:
        left = [tag_id for tag_id in places if tag_id not in chosen]
        chosen.append(max(left, key=lambda tag_id: _spread([places[each] for each in [*chosen, tag_id]])))
    return chosen


def _spread(places: list[complex]) -> tuple[float, float]:
    """Return the determinant and the trace of the scatter matrix: the trace counts for tags on a line."""
    mean = sum(places) / len(places)
    trace = sum(abs(place - mean) ** 2 for place in places)
    squares = sum((place - mean) ** 2 for place in places)  # xx - yy + 2j * xy
    return round((trace**2 - abs(squares) ** 2) / 4, 6), trace


# Positions are complex numbers, in pairs (layout, map) by tag id: a rotation is a factor of length 1.


def _centred(pairs: dict) -> tuple[complex, complex, dict]:
    """Return the mean position in the layout and in the map, and the pairs relative to them."""
    mean, other_mean = (sum(column) / len(pairs) for column in zip(*pairs.values(), strict=True))
    return mean, other_mean, {tag_id: (p - mean, q - other_mean) for tag_id, (p, q) in pairs.items()}


def _rotation_and_shift(pairs: dict) -> tuple[complex, complex]:
    mean, other_mean, centred = _centred(pairs)
    product = sum(p.conjugate() * q for p, q in centred.values())
    rotation = cmath.rect(1.0, cmath.phase(product))
    return rotation, other_mean - rotation * mean


def _residuals_m(pairs: dict, rotation: complex, shift: complex) -> dict[str, float]:
    return {tag_id: abs(rotation * p + shift - q) for tag_id, (p, q) in pairs.items()}


def _squares(pairs: dict) -> float:
    """Return the sum of the squared residuals of the best fit."""
    return sum(each**2 for each in _residuals_m(pairs, *_rotation_and_shift(pairs)).values())


def _agreeing(pairs: dict, tolerance_m: float) -> dict:
    """Return the pairs that remain when those that do not fit are left out; {} if too few do."""
    fewest = max(FEWEST_THAT_OVERRULE, len(pairs) // 2 + 1)
    kept = dict(pairs)
    while max(_residuals_m(kept, *_rotation_and_shift(kept)).values()) > tolerance_m:
        if len(kept) <= fewest:
            return {}
        del kept[_worst(kept)]
    return kept


def _worst(pairs: dict) -> str:
    """Return the tag without which the sum of the squared residuals is smallest; the first of equal ones."""
    _, _, centred = _centred(pairs)
    product = sum(p.conjugate() * q for p, q in centred.values())
    squares = sum(abs(p) ** 2 + abs(q) ** 2 for p, q in centred.values())
    share = len(pairs) / (len(pairs) - 1)  # what a pair adds to the two sums, as the means move too

    def rest(tag_id: str) -> float:
        p, q = centred[tag_id]
        return squares - share * (abs(p) ** 2 + abs(q) ** 2) - 2 * abs(product - share * p.conjugate() * q)

    return min(centred, key=rest)


def read_places(path: str | Path) -> dict[str, tuple[float, float]]:
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
        places[tag_id] = tuple(float(number(at, axis, here, 'metres')) for axis in at)
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
    data = read_yaml(path, where, f'a mapping, {_EXAMPLE}')
    if unknown := [key for key in data if key not in ('frame_id', *_UNITS)]:
        shown = escaped(str(unknown[0]), 64)
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
    return f"registration '{escaped(str(path), 500)}'"
