# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The bridge's parameters: names, defaults, limits and descriptions."""

import sys
from dataclasses import dataclass

from lupin_greenhouse_bridge.runtime.parameters import check_parameters, invalid, parameter

SECONDS_PER_DAY = 86400.0
HOURS = 'between 0 and 24 hours, such as 12.5 for 12:30, or -1.0 for the time of the config'


@dataclass(frozen=True)
class Settings:
    """The parameters of one run; raises StartUpError. A default changes nothing."""

    tag_file: str = parameter('', 'Path of a tag_locations.json; empty: the one of mdp-greenhouse.')
    sim_config_file: str = parameter(
        '', 'Path of a greenhouse_config.yaml; empty: the one of mdp-greenhouse.'
    )
    debug_time_of_day: float = parameter(
        -1.0,
        'Freeze the simulated clock at this hour, 0 to 24 (24 is midnight); -1.0: use the config.',
        smallest=-1.0,
        largest=24.0,
        accepted=HOURS,
    )
    speedup_factor: float = parameter(
        0.0,
        'Simulated seconds per real second; 0.0: use the config (debug_time_of_day stops the clock).',
        smallest=0.0,
        largest=sys.float_info.max / SECONDS_PER_DAY,
        accepted='finite and above 0 (simulated seconds per real second),'
        ' or 0.0 for the factor of the config',
    )
    debug_seed: int = parameter(
        -1,
        'Seed of the noise, 0 or above; freezes the clock (debug mode); -1: use the config.',
        smallest=-1,
        largest=2**63 - 1,
        accepted='0 or above, or -1 for the seed of the config',
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        if -1.0 < self.debug_time_of_day < 0.0:
            raise invalid('debug_time_of_day', self.debug_time_of_day, HOURS)
