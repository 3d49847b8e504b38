"""The simulated greenhouse that the figures show."""

import itertools
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
import scipy.special
from greenhouse_sim.simulator import GreenhouseSimulator
from lupin_greenhouse_bridge.display.placing import Point, box_of
from lupin_greenhouse_bridge.planning.approach import find_approaches
from lupin_greenhouse_bridge.planning.route import plan_route
from lupin_greenhouse_bridge.planning.viewpoints import ViewingLimits
from lupin_greenhouse_bridge.planning.walls import Walls, find_walls
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator.layout import require_layout, shipped_file
from lupin_greenhouse_bridge.simulator.simulation import load
from lupin_greenhouse_bridge.units import sensor_order

TINY = 1e-9
Subset: TypeAlias = tuple[str, ...]  # the letters of some sensors


class Greenhouse:
    """The simulator with a settable clock and noise, its layout, and the route of a robot of default size."""

    def __init__(self, tag_file: str, sim_config_file: str):
        """Validate the files like the bridge; raises StartUpError. '' selects the shipped file."""
        self.files = [
            Path(given or shipped_file(name) or name)
            for given, name in ((tag_file, 'tag_locations.json'), (sim_config_file, 'greenhouse_config.yaml'))
        ]
        load(Settings(), *self.files)
        self.layout = require_layout(tag_file)
        self.tables = [box_of(Walls(*each)) for each in self.layout.tables.values()]
        self.walls = find_walls(self.layout, sim_config_file)
        self.approaches = find_approaches(self.layout, self.walls, ViewingLimits())
        self.route = plan_route(self.approaches.free_space, self.approaches.poses, None, 'shortest')
        self._noisy, self._silent = (GreenhouseSimulator(*self.files) for _ in range(2))
        for components in self._silent.sim_config['sensors'].values():
            for component in components:
                component['noise_sigma'] = 0.0
        self.sensors: list[str] = sorted(self._noisy.sensors(), key=sensor_order)
        self.letters = letters_of(self.sensors)
        self.subset_of: dict[str, Subset] = {
            tag_id: tuple(letter for name, letter in self.letters.items() if name in tag.sensors)
            for tag_id, tag in self.layout.tags.items()
        }

    def value(self, sensor: str, position_m: Point, hour: float, *, is_noisy: bool = False) -> float:
        """Return the value of a sensor at a position, in its unit."""
        simulator = self._noisy if is_noisy else self._silent
        return float(simulator.sensor_registry.get_sensor(sensor).retrieve_data(position_m, hour * 3600.0))

    def quantiles(self, sensor: str, position_m: Point, hour: float, shares: Sequence[float]) -> np.ndarray:
        """
        Return the values below which these shares of a sensor's readings lie, in its unit.

        A reading is the largest of normal variables, one of each component.
        """
        silent, noisy = (
            getattr(sensors := each.sensor_registry.get_sensor(sensor), 'sensors', [sensors])
            for each in (self._silent, self._noisy)
        )
        means = np.array([each.retrieve_data(position_m, hour * 3600.0) for each in silent])
        sigmas = np.array([each.params.get('noise_sigma', 0.0) for each in noisy])
        values = means.max() + 5 * sigmas.max() * np.linspace(-1, 1, 2001)
        below = scipy.special.ndtr((values[:, None] - means) / np.maximum(sigmas, TINY)).prod(axis=1)
        found: np.ndarray = np.interp(shares, below, values)
        return found


def letters_of(sensors: list[str]) -> dict[str, str]:
    """Return for each sensor the shortest start of its name that no other name has, such as T."""
    starts = {each: [each[:length].capitalize() for length in range(1, len(each) + 1)] for each in sensors}
    shared = Counter(itertools.chain.from_iterable(starts.values()))
    return {each: next((text for text in starts[each] if shared[text] == 1), each) for each in sensors}
