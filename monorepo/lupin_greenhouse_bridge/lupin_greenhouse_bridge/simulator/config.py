# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Read and validate greenhouse_config.yaml. Needs neither the simulator nor ROS."""

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError, escaped, meant_name
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator.json_yaml import (
    kind_of,
    mapping_of,
    number,
    read_yaml,
    shown,
    start_of,
    unknown_keys,
)
from lupin_greenhouse_bridge.simulator.layout import Layout, shipped_file
from lupin_greenhouse_bridge.units import UNITS

SMALLEST_DIVISOR = 1e-12
SMALLEST_SIDE_M = 0.01
TIME_EXAMPLE = '{debug_mode: false, speedup_factor: 1800}'
SENSORS_EXAMPLE = '{co2: [{value_at_midnight: 600, value_at_noon: 400, ...}]}'
SIDES_EXAMPLE = '{greenhouse_width_m: 4.0, greenhouse_height_m: 8.0}'
RANGES_EXAMPLE = '{co2: {min: 400, max: 600}}'
SECTIONS = ('time', 'sensors', 'visualization')
IGNORED_SECTIONS = ('version', 'environment', 'plant')  # the simulator knows them, and does not use them
TIME_KEYS = ('debug_mode', 'speedup_factor', 'debug_time_of_day', 'debug_seed')
SIDES = ('greenhouse_width_m', 'greenhouse_height_m')
VISUALIZATION_KEYS = (
    *(*SIDES, 'colorbar_ranges', 'grid_spacing_m', 'snap_step_m', 'mesh_cell_m', 'canvas_padding_px'),
    *('table_default_w_m', 'table_default_h_m'),
)
# What the simulator silently takes for a missing key. Uniform dynamics use the first four, and only linear
# dynamics use the angle.
COMPONENT_DEFAULTS = {
    'dynamics': 'uniform',
    'value_at_midnight': 20.0,
    'value_at_noon': 25.0,
    'noise_sigma': 0.0,
    'position': [0, 0],
    'decay_distance': 100.0,
    'decay_type': 'linear',
    'angle': 0.0,
}
UNIT = 'the unit of the sensor'
COMPONENT_NUMBERS: dict[str, dict[str, Any]] = {
    'value_at_midnight': {'unit': UNIT},
    'value_at_noon': {'unit': UNIT},
    'noise_sigma': {'unit': UNIT, 'smallest': 0.0},
    'decay_distance': {'unit': 'metres', 'smallest': SMALLEST_DIVISOR},
    'angle': {'unit': 'degrees'},
}


class Config(NamedTuple):
    """A validated config, and a line for each thing that its author may not have meant."""

    data: dict[str, Any]
    where: str  # its place in error messages
    warnings: list[str]

    @property
    def visualization(self) -> dict[str, Any]:
        """Return the section of this name; {} if the config has none."""
        return self.data.get('visualization') or {}


def find_config(sim_config_file: str = '') -> Config | None:
    """Return this config, or the shipped one for ''; None without it. Raises StartUpError."""
    path = sim_config_file or shipped_file('greenhouse_config.yaml')
    return read_config(path) if path else None


def read_config(path: str | Path, settings: Settings | None = None) -> Config:
    """
    Return a greenhouse config that the simulator can serve at every hour of the day.

    With `settings`, section `time` must also have what a bridge with these settings needs.
    Raises StartUpError for a wrong value, and for a key that looks like a typo of one that is missing.
    """
    where = f"sim_config_file '{path}'"
    data = read_yaml(path, where, 'a mapping with time and sensors')
    ignored = [each for each in unknown_keys(data, SECTIONS, where) if each not in IGNORED_SECTIONS]
    time = mapping_of(data, 'time', where, TIME_EXAMPLE)
    ignored += unknown_keys(time, TIME_KEYS, f'{where}: time')
    _check_time(time, settings, f'{where}: time')
    sensors = mapping_of(data, 'sensors', where, SENSORS_EXAMPLE)
    sensor_types, dynamics_types = _known_types()
    if not sensors:
        raise StartUpError(f'{where}: sensors is empty: name at least one of {_listed(sensor_types)}')
    defaults = []
    for name, components in sensors.items():
        _check_known(name, sensor_types, f'{where}: unknown sensor type')
        here = f'{where}: sensor {name!r}'
        if not isinstance(components, list) or not components:
            raise StartUpError(f'{here} is {kind_of(components)}: must be a list with at least one component')
        for position, component in enumerate(components, start=1):
            ignored += _check_component(component, dynamics_types, f'{here}, component {position}')
            if taken := _defaults_taken(component):
                defaults.append(f'{name} component {position}: {", ".join(taken)}')
    if data.get('visualization') is not None:
        ignored += _check_visualization(mapping_of(data, 'visualization', where, SIDES_EXAMPLE), where)
    warnings = []
    if ignored:
        warnings.append(f'{where}: the simulator ignores the keys {_some(dict.fromkeys(ignored), ", ")}')
    if defaults:
        some = _some(defaults, '; ')
        warnings.append(f'{where}: the simulator takes defaults for missing keys, which may be fine: {some}')
    return Config(data, where, [escaped(each, 1000) for each in warnings])


def check_sensors(layout: Layout, config: Config) -> None:
    """Raise StartUpError for the first tag with a sensor that the config does not have."""
    sensors = config.data['sensors']
    for tag_id, tag in layout.tags.items():
        if unknown := [name for name in tag.sensors if name not in sensors]:
            meant = meant_name(unknown[0], sensors)
            advice = f'did you mean {meant}?' if meant else f'use one of {", ".join(sensors)}, or add it'
            raise StartUpError(
                f"tag_file '{layout.path}': tag '{escaped(tag_id, 64)}' has the sensor {unknown[0]!r}, which"
                f' {config.where} does not have: {advice}'
            )


def _known_types() -> tuple[Collection[str], Collection[str]]:
    """Return the types of sensors and dynamics that the simulator has, or has in 1.0.8 if it is missing."""
    try:
        from greenhouse_sim.dynamics import AVAILABLE_DYNAMICS
        from greenhouse_sim.sensors import AVAILABLE_SENSORS
    except ImportError:
        return UNITS, ('uniform', 'radial', 'linear')
    return AVAILABLE_SENSORS, AVAILABLE_DYNAMICS


def _check_time(time: dict[str, Any], settings: Settings | None, where: str) -> None:
    if not isinstance(time.get('debug_mode'), bool):
        raise StartUpError(f'{where}: debug_mode is {shown(time, "debug_mode")}: must be true or false')
    required = set()
    if settings:
        is_frozen = time['debug_mode'] or settings.debug_time_of_day >= 0.0 or settings.debug_seed >= 0
        if is_frozen and settings.debug_time_of_day < 0.0:
            required.add('debug_time_of_day')
        if not (is_frozen or settings.speedup_factor > 0.0):
            required.add('speedup_factor')
        if time['debug_mode']:
            required.add('debug_seed')
    if 'debug_time_of_day' in {*time, *required}:
        number(time, 'debug_time_of_day', where, 'hours, such as 12.5', 0.0, 24.0)
    if 'speedup_factor' in {*time, *required}:
        number(time, 'speedup_factor', where, 'simulated seconds per second', SMALLEST_DIVISOR)
    if 'debug_seed' in {*time, *required} and type(time.get('debug_seed')) is not int:
        raise StartUpError(f'{where}: debug_seed is {shown(time, "debug_seed")}: must be a whole number')


def _check_component(component: Any, dynamics_types: Collection[str], where: str) -> list[str]:
    """Check the keys of a component that it has, and return those that the simulator ignores."""
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
    return unknown_keys(component, COMPONENT_DEFAULTS, where)


def _defaults_taken(component: dict[str, Any]) -> list[str]:
    """Return each missing key that the dynamics of a component use, with the simulator's default."""
    keys = list(COMPONENT_DEFAULTS)
    used = {'uniform': keys[:4], 'radial': keys[:-1]}.get(component.get('dynamics', 'uniform'), keys)
    return [f'{key} {COMPONENT_DEFAULTS[key]}' for key in used if key not in component]


def _check_visualization(section: dict[str, Any], where: str) -> list[str]:
    """Check the section that planners and pictures read, and return the keys that nothing reads."""
    where = f'{where}: visualization'
    if any(side in section for side in SIDES):
        for side in SIDES:
            number(section, side, where, 'metres', SMALLEST_SIDE_M)
    if section.get('colorbar_ranges') is not None:
        ranges = mapping_of(section, 'colorbar_ranges', where, RANGES_EXAMPLE)
        for sensor in ranges:
            limits = mapping_of(ranges, sensor, f'{where}: colorbar_ranges', '{min: 400, max: 600}')
            here = f'{where}: colorbar_ranges: {start_of(sensor)}'
            number(limits, 'max', here, UNIT, smallest=number(limits, 'min', here, UNIT))
    return unknown_keys(section, VISUALIZATION_KEYS, where)


def _check_known(name: object, known: Collection[str], problem: str) -> None:
    if not isinstance(name, str) or name not in known:
        raise StartUpError(f'{problem} {start_of(name)}: known are {_listed(known)}')


def _listed(names: Iterable[str]) -> str:
    return ', '.join(sorted(names))


def _some(things: Collection[str], separator: str) -> str:
    """Return the first five of some things, and how many more there are."""
    more = f' and {len(things) - 5} more' if len(things) > 5 else ''
    return separator.join(list(things)[:5]) + more
