"""Read greenhouse_config.yaml. Needs neither the simulator nor ROS."""

from pathlib import Path
from typing import Any, NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator.files import read_yaml, schema_of, unread_keys, validate
from lupin_greenhouse_bridge.simulator.layout import Layout, shipped_file

SCHEMA = schema_of('greenhouse_config')
SIDES = ('greenhouse_width_m', 'greenhouse_height_m')


class Config(NamedTuple):
    """A validated config."""

    data: dict[str, Any]
    where: str  # how error messages begin
    unread_keys: tuple[str, ...]  # the places of the keys that nothing reads

    @property
    def visualization(self) -> dict[str, Any]:
        """Return the section of this name; {} if the config has none."""
        return self.data.get('visualization') or {}


def find_config(sim_config_file: str = '') -> Config | None:
    """Return this config, or the shipped one for ''; None if that is not there. Raises StartUpError."""
    path = sim_config_file or shipped_file('greenhouse_config.yaml')
    return read_config(path) if path else None


def read_config(path: str | Path, settings: Settings | None = None) -> Config:
    """
    Return a greenhouse config with which the simulator works at every hour of the day.

    With `settings`, section `time` must also have the keys that a bridge with these settings needs.
    Raises StartUpError.
    """
    where = f"sim_config_file '{path}'"
    data = read_yaml(path, where, 'a mapping with time and sensors')
    validate(data, SCHEMA, where)
    config = Config(data, where, tuple(unread_keys(data, SCHEMA, SCHEMA['definitions'])))
    for sensor, limits in (config.visualization.get('colorbar_ranges') or {}).items():
        if limits['max'] < limits['min']:
            place = f'visualization.colorbar_ranges.{escaped(str(sensor), 60)}'
            raise StartUpError(f'{where}: {place}: max is below min')
    for name in _required_times(data['time'], settings) if settings else ():
        if name not in data['time']:
            raise StartUpError(f"{where}: time: '{name}' is a required property, unless set as a parameter")
    return config


def _required_times(time: dict[str, Any], settings: Settings) -> list[str]:
    """Return the keys of section `time` that these settings do not make unnecessary."""
    is_frozen = time['debug_mode'] or settings.debug_time_of_day >= 0.0 or settings.debug_seed >= 0
    required = ['debug_seed'] if time['debug_mode'] else []
    if is_frozen and settings.debug_time_of_day < 0.0:
        required.append('debug_time_of_day')
    if not (is_frozen or settings.speedup_factor > 0.0):
        required.append('speedup_factor')
    return required


def check_sensors(layout: Layout, config: Config) -> None:
    """Raise StartUpError for the first tag with a sensor that the config does not have."""
    sensors = config.data['sensors']
    for tag_id, tag in layout.tags.items():
        for name in tag.sensors:
            if name not in sensors:
                raise StartUpError(
                    f"tag_file '{layout.path}': tag '{escaped(tag_id, 64)}' has the sensor {name!r}, which"
                    f' {config.where} does not have: use one of {", ".join(sensors)}, or add it'
                )
