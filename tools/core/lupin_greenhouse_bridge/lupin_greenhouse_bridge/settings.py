"""The bridge's five parameters: names, defaults, limits and descriptions."""

import math
from dataclasses import dataclass

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.node.parameters import check_parameters, parameter

SECONDS_PER_DAY = 86400.0


@dataclass(frozen=True)
class Settings:
    """
    The validated parameters of one run. A default keeps the value of the config file.

    Raises StartUpError for a value outside its limits.
    """

    tag_file: str = parameter('', 'Path of a tag_locations.json; empty: the one of mdp-greenhouse.')
    sim_config_file: str = parameter(
        '', 'Path of a greenhouse_config.yaml; empty: the one of mdp-greenhouse.'
    )
    debug_time_of_day: float = parameter(
        -1.0, 'Hour in [0, 24] to freeze the simulated clock at, 24 is midnight; -1.0: as in the config.'
    )
    speedup_factor: float = parameter(
        0.0, 'Simulated seconds per real second, above 0; 0.0: as in the config.'
    )
    debug_seed: int = parameter(
        -1, 'Seed of the noise, 0 or above; freezes the clock (debug mode); -1: as in the config.'
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
                f'parameter debug_seed is {self.debug_seed}: must be 0 or above,'
                ' or -1 for the seed of the config'
            )
