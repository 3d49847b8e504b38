# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The colours of every picture, page and marker, and the values that they stand for. Does not import ROS."""

import math
from collections.abc import Sequence

import numpy as np

from lupin_greenhouse_bridge.simulator.config import find_config

COLOUR_MAP = 'viridis'  # readable in black and white, and for colour-blind people
STOPS = (  # of this map
    *('#440154', '#482475', '#414487', '#355f8d', '#2a788e', '#21918c', '#22a884', '#44bf70', '#7ad151'),
    *('#bddf26', '#fde725'),
)
ROUTE, ROBOT, FAILED, SIGHT = '#3d6fa8', '#eaf1f9', '#b3261e', '0.4'
OBSTACLE, UNKNOWN_PART = '#e69f00', '0.7'  # in the map of the room
TABLE = '#e3e6ea'  # without an edge, which would cross the labels
SMALLEST_SPAN = 0.01  # of colours without a range in the config


def colours_of(values: Sequence[float] | np.ndarray, lowest: float, highest: float) -> np.ndarray:
    """Return red, green and blue, from 0 to 1, of each value; one beyond an end has the colour of the end."""
    stops = np.array([[int(stop[at : at + 2], 16) / 255 for at in (1, 3, 5)] for stop in STOPS])
    places = (np.asarray(values, float) - lowest) / (highest - lowest) * (len(stops) - 1)
    return np.stack([np.interp(places, np.arange(len(stops)), part) for part in stops.T], axis=-1)


def hex_colours_of(values: Sequence[float], lowest: float, highest: float) -> list[str]:
    """Return colours_of() as #rrggbb."""
    parts = np.rint(255 * colours_of(values, lowest, highest)).astype(int)
    return [f'#{red:02x}{green:02x}{blue:02x}' for red, green, blue in parts.tolist()]


def colour_limits(values: Sequence[float], limits: tuple[float, float] | None) -> tuple[float, float]:
    """
    Return the values at the ends of the colours: the fifths of the config's range in which all values lie.

    So similar values differ in colour, noise hardly does, and the next mission mostly has the same colours.
    """
    if not (values and limits and limits[0] < limits[1]):
        low, high = limits or (min(values), max(values))
        smallest_span = max(SMALLEST_SPAN, 1e-6 * abs(low))  # beside 1e16, 0.01 makes no difference
        margin = 0.0 if high - low >= smallest_span else 50 * smallest_span
        return low - margin, high + margin
    fifth = (limits[1] - limits[0]) / 5
    low, high = (round((pick(values) - limits[0]) / fifth, 9) for pick in (min, max))
    first = min(max(math.floor(low), 0), 4)
    last = min(max(math.ceil(high), first + 1), 5)
    return round(limits[0] + first * fifth, 9), round(limits[0] + last * fifth, 9)


def read_colour_ranges(sim_config_file: str = '') -> dict[str, tuple[float, float]]:
    """
    Return the lowest and highest value of each sensor's colour scale in the greenhouse config, in its unit.

    '' selects the config of mdp-greenhouse; {} if that is not installed. Raises StartUpError.
    """
    config = find_config(sim_config_file)
    ranges = (config.visualization.get('colorbar_ranges') if config else None) or {}
    return {str(sensor): (float(limits['min']), float(limits['max'])) for sensor, limits in ranges.items()}
