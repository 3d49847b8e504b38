"""The bridge's five parameters: names, defaults, what is accepted, what they do."""

import math
from dataclasses import dataclass

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.life_cycle import check_parameters, parameter

SECONDS_PER_DAY = 86400.0


@dataclass(frozen=True)
class Settings:
    """
    The parameter values of one run, checked; every default leaves the loaded config alone.

    Raises StartUpError on a value outside of what its description accepts.
    """

    tag_file: str = parameter('', 'Path of a tag_locations.json; empty: the shipped one.')
    sim_config_file: str = parameter('', 'Path of a greenhouse_config.yaml; empty: the shipped one.')
    debug_time_of_day: float = parameter(
        -1.0, 'Hours in [0, 24] to freeze the simulated time at, 24 is midnight; -1.0: as the config says.'
    )
    speedup_factor: float = parameter(
        0.0, 'Simulated seconds per real second, above 0; 0.0: as the config says.'
    )
    debug_seed: int = parameter(
        -1, 'Seed of the noise, from 0 up; turns debug mode on; -1: as the config says.'
    )

    def __post_init__(self):
        check_parameters(self)
        if '\0' in self.tag_file + self.sim_config_file:
            raise StartUpError(
                'parameter tag_file or sim_config_file holds a NUL character: set the path of a file'
            )
        if not (self.debug_time_of_day == -1.0 or 0.0 <= self.debug_time_of_day <= 24.0):
            raise StartUpError(
                f'parameter debug_time_of_day is {self.debug_time_of_day}: must be between 0 and 24 hours,'
                ' or -1.0 for the time of the config'
            )
        if not 0.0 <= self.speedup_factor * SECONDS_PER_DAY < math.inf:
            raise StartUpError(
                f'parameter speedup_factor is {self.speedup_factor}: must be finite and above 0'
                ' (simulated seconds per real second), or 0.0 for the factor of the config'
            )
        if self.debug_seed < -1:
            raise StartUpError(
                f'parameter debug_seed is {self.debug_seed}: must be a whole number from 0 up,'
                ' or -1 for the seed of the config'
            )
