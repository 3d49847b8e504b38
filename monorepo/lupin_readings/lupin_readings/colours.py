"""The colours of the page and of the markers, and the values that they stand for. Does not import ROS."""

import math
from collections.abc import Sequence

import numpy as np
from lupin_greenhouse_bridge.simulator.config import find_config

STOPS = (  # viridis, which works in black and white and for colour-blind people
    *('#440154', '#482475', '#414487', '#355f8d', '#2a788e', '#21918c', '#22a884', '#44bf70', '#7ad151'),
    *('#bddf26', '#fde725'),
)
SMALLEST_SPAN = 0.1  # from the lowest to the highest colour, without a range in the config


def colours_of(values: Sequence[float] | np.ndarray, lowest: float, highest: float) -> np.ndarray:
    """Return red, green and blue of each value, from 0 to 1. Beyond an end, they are those of the end."""
    stops = np.array([[int(stop[at : at + 2], 16) / 255 for at in (1, 3, 5)] for stop in STOPS])
    places = (np.asarray(values, float) - lowest) / (highest - lowest) * (len(stops) - 1)
    return np.stack([np.interp(places, np.arange(len(stops)), part) for part in stops.T], axis=-1)


def hex_colours_of(values: Sequence[float], lowest: float, highest: float) -> list[str]:
    """Return colours_of() as #rrggbb."""
    parts = np.rint(255 * colours_of(values, lowest, highest)).astype(int)
    return [f'#{red:02x}{green:02x}{blue:02x}' for red, green, blue in parts.tolist()]


def colour_limits(values: Sequence[float], limits: tuple[float, float] | None) -> tuple[float, float]:
    """
    Return the values at the ends of the colours: round numbers around all values, within the config's range.

    They are at least a fiftieth of that range apart, so that noise does not fill the scale.
    """
    floor, ceiling = limits if limits and limits[0] < limits[1] else (-math.inf, math.inf)
    low, high = (min(max(pick(values or limits or [0.0]), floor), ceiling) for pick in (min, max))
    smallest_span = (ceiling - floor) / 50
    if math.isinf(smallest_span):
        smallest_span = max(SMALLEST_SPAN, 1e-6 * abs(low))  # beside 1e17, 0.1 makes no difference
    margin = max(smallest_span - (high - low), 0.0) / 2
    low, high = low - margin, high + margin
    power = 10.0 ** math.floor(math.log10((high - low) / 5))
    step = next(digit * power for digit in (1, 2, 5, 10) if digit * power >= 0.999 * (high - low) / 5)
    ends = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return max(round(ends[0] * step, 9), floor), min(round(ends[1] * step, 9), ceiling)


def read_colour_ranges(sim_config_file: str = '') -> dict[str, tuple[float, float]]:
    """
    Return the lowest and highest value of each sensor's colour scale in the greenhouse config, in its unit.

    '' selects the config of mdp-greenhouse; {} if that is not installed. Raises StartUpError.
    """
    config = find_config(sim_config_file)
    ranges = (config.visualization.get('colorbar_ranges') if config else None) or {}
    return {str(sensor): (float(limits['min']), float(limits['max'])) for sensor, limits in ranges.items()}
