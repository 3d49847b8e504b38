"""Read and validate greenhouse_config.yaml, so that the simulator can serve every value in it."""

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator.json_yaml import (
    kind_of,
    mapping_of,
    number,
    read_yaml,
    shown,
    start_of,
)

SMALLEST_DIVISOR = 1e-12
TIME_EXAMPLE = '{debug_mode: false, speedup_factor: 1800}'
SENSORS_EXAMPLE = '{co2: [{value_at_midnight: 600, value_at_noon: 400, ...}]}'
UNIT = 'the unit of the sensor'
COMPONENT_NUMBERS: dict[str, dict[str, Any]] = {
    'value_at_midnight': {'unit': UNIT},
    'value_at_noon': {'unit': UNIT},
    'noise_sigma': {'unit': UNIT, 'smallest': 0.0},
    'decay_distance': {'unit': 'metres', 'smallest': SMALLEST_DIVISOR},
    'angle': {'unit': 'degrees'},
}


def read_config(
    path: str | Path, settings: Settings, sensor_types: Collection[str], dynamics_types: Collection[str]
) -> dict[str, Any]:
    """
    Return the simulator's config, validated for a run with these settings.

    `sensor_types` and `dynamics_types` hold the names that the simulator knows.
    Raises StartUpError if the simulator could not serve the config at every hour of the day.
    """
    where = f"sim_config_file '{path}'"
    config = read_yaml(path, where, 'a mapping with time and sensors')
    _check_time(mapping_of(config, 'time', where, TIME_EXAMPLE), settings, f'{where}: time')
    sensors = mapping_of(config, 'sensors', where, SENSORS_EXAMPLE)
    if not sensors:
        raise StartUpError(f'{where}: sensors is empty: name at least one of {_listed(sensor_types)}')
    for name, components in sensors.items():
        _check_known(name, sensor_types, f'{where}: unknown sensor type')
        here = f'{where}: sensor {name!r}'
        if not isinstance(components, list) or not components:
            raise StartUpError(f'{here} is {kind_of(components)}: must be a list with at least one component')
        for position, component in enumerate(components, start=1):
            _check_component(component, dynamics_types, f'{here}, component {position}')
    return config


def _check_time(time: dict[str, Any], settings: Settings, where: str) -> None:
    if not isinstance(time.get('debug_mode'), bool):
        raise StartUpError(f'{where}: debug_mode is {shown(time, "debug_mode")}: must be true or false')
    is_frozen = time['debug_mode'] or settings.debug_time_of_day >= 0.0 or settings.debug_seed >= 0
    if 'debug_time_of_day' in time or (is_frozen and settings.debug_time_of_day < 0.0):
        number(time, 'debug_time_of_day', where, 'hours', 0.0, 24.0)
    if 'speedup_factor' in time or not (is_frozen or settings.speedup_factor > 0.0):
        number(time, 'speedup_factor', where, 'simulated seconds per second', SMALLEST_DIVISOR)
    if ('debug_seed' in time or time['debug_mode']) and type(time.get('debug_seed')) is not int:
        raise StartUpError(f'{where}: debug_seed is {shown(time, "debug_seed")}: must be a whole number')


def _check_component(component: Any, dynamics_types: Collection[str], where: str) -> None:
    """Check the keys of a component that the file has: the simulator has a default for every key."""
    if not isinstance(component, dict):
        raise StartUpError(
            f'{where} is {kind_of(component)}, not a mapping with value_at_midnight, value_at_noon, ...'
        )
    _check_known(component.get('dynamics', 'uniform'), dynamics_types, f'{where}: unknown dynamics')
    for key, limits in COMPONENT_NUMBERS.items():
        if key in component:
            number(component, key, where, **limits)
    position = component.get('position', [0.0, 0.0])
    if not isinstance(position, list) or len(position) != 2:
        raise StartUpError(f'{where}: position is {start_of(position)}: must be [x, y] in metres')
    for axis, value in zip('xy', position, strict=True):
        number({axis: value}, axis, f'{where}: position', 'metres')


def _check_known(name: object, known: Collection[str], problem: str) -> None:
    if not isinstance(name, str) or name not in known:
        raise StartUpError(f'{problem} {start_of(name)}: known are {_listed(known)}')


def _listed(names: Iterable[str]) -> str:
    return ', '.join(sorted(names))
