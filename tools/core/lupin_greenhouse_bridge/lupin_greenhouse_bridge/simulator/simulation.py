"""Load, validate and read the mdp-greenhouse simulator. Does not import ROS."""

import importlib
import importlib.metadata
import math
import numbers
import random
from pathlib import Path
from typing import Any, NamedTuple

from packaging.version import InvalidVersion, Version

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped, names_text, pluralized
from lupin_greenhouse_bridge.settings import SECONDS_PER_DAY, Settings
from lupin_greenhouse_bridge.simulator.config import Config, check_sensors, read_config
from lupin_greenhouse_bridge.simulator.layout import Layout, read_layout

OLDEST_SIMULATOR = '1.0.7'
INSTALL_COMMAND = f"pip install --upgrade 'mdp-greenhouse>={OLDEST_SIMULATOR}'"


class ReadingError(OneLineError):
    """The simulator returned no usable reading for a tag that it has loaded."""


class LoadedGreenhouse(NamedTuple):
    """A loaded simulator and what start-up learned about it."""

    sim: Any  # greenhouse_sim.simulator.GreenhouseSimulator
    tag_ids: list[str]  # every tag that has a sensor, in the order of the file; each was read once
    warnings: list[str]  # one line each
    summary: str  # one line: tags, sensors, clock


def load(
    settings: Settings, tag_file: Path | str | None, sim_config_file: Path | str | None
) -> LoadedGreenhouse:
    """
    Return a simulator that can be read at every tag of `tag_ids` at any hour.

    `tag_file` and `sim_config_file` are passed on to the simulator; None selects its shipped files.
    Raises StartUpError if the simulator or a file is missing or invalid, or if a tag cannot be read.
    """
    version = require_simulator()
    from greenhouse_sim import simulator

    shipped_files = Path(simulator.__file__).parent / 'configs'
    tag_path = tag_file or shipped_files / 'tag_locations.json'
    layout = read_layout(tag_path)
    config_path = sim_config_file or shipped_files / 'greenhouse_config.yaml'
    config = read_config(config_path, settings)
    check_sensors(layout, config)
    try:
        sim = simulator.GreenhouseSimulator(tag_file, sim_config_file)
    except Exception as error:
        if isinstance(error, AttributeError) and isinstance(tag_file, str):
            raise StartUpError(
                f"tag_file '{tag_path}': mdp-greenhouse {version} takes only a pathlib.Path and got"
                f' str ({error}): leave tag_file empty, or apply custom_tag_file.patch (see README.md)'
            ) from error
        raise StartUpError(
            f"mdp-greenhouse {version} cannot load tag_file '{tag_path}' and sim_config_file '{config_path}':"
            f' {type(error).__name__}: {error}'
        ) from error
    if set(sim.tags()) != {*layout.tags, *layout.tags_without_sensors}:
        raise StartUpError(
            f"tag_file '{tag_path}': mdp-greenhouse does not read it as UTF-8: set PYTHONUTF8=1"
        )
    _apply_overrides(sim.sim_config['time'], settings)
    _prove_readable(sim, layout)
    summary = f'{_summary(sim, layout)}; mdp-greenhouse {version}'
    warnings = _warnings(sim, layout, config, settings)
    return LoadedGreenhouse(sim, list(layout.tags), warnings, summary)


def require_simulator() -> str:
    """
    Return the installed version of mdp-greenhouse (`greenhouse_sim.simulator.__version__` is wrong).

    Raises StartUpError if it is missing, cannot be imported, or is older than 1.0.7, whose clock was wrong.
    """
    try:
        version = importlib.metadata.version('mdp-greenhouse')
    except importlib.metadata.PackageNotFoundError as error:
        raise StartUpError(f'mdp-greenhouse is not installed: {INSTALL_COMMAND}') from error
    try:
        is_too_old = Version(version) < Version(OLDEST_SIMULATOR)
    except InvalidVersion:
        is_too_old = True
    if is_too_old:
        raise StartUpError(
            f'mdp-greenhouse {version} is installed, {OLDEST_SIMULATOR} or newer is needed: {INSTALL_COMMAND}'
        )
    try:
        importlib.import_module('greenhouse_sim.simulator')
    except ImportError as error:
        raise StartUpError(
            f'mdp-greenhouse {version} cannot be imported ({error}):'
            f' sudo apt install python3-yaml, or {INSTALL_COMMAND}'
        ) from error
    return version


def read(sim: Any, tag_id: str) -> tuple[float, dict[str, float]]:
    """
    Return the simulated time of day in seconds, in [0, 86400), and the value of each sensor at the tag.

    The values belong to exactly this time. A second call of the simulator's clock could return a later tick.
    Raises ReadingError if the simulator fails, returns no value, or one that is not finite or in this range.
    """
    try:
        values = {str(name): _finite(value, name) for name, value in sim.get_sensor_data(tag_id).items()}
        sim_time = values.pop('timestamp')
        if not 0.0 <= sim_time < SECONDS_PER_DAY:
            raise ValueError(f'the time of day {sim_time} s, which is outside [0, 86400)')
        if not values:
            raise ValueError('no value')
    except Exception as error:
        problem = f'{type(error).__name__}: {error}'
        raise ReadingError(f"the simulator failed at tag '{escaped(tag_id, 64)}': {problem}") from error
    return sim_time, values


def _finite(value: Any, name: str) -> float:
    # The simulator returns floats, and an int for its clock. To check for an abstract class takes longer.
    is_number = isinstance(value, (float, int, numbers.Real)) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value):
        raise ValueError(f'{value!r} for {name}, not a finite number')
    return float(value)


def _apply_overrides(time: dict[str, Any], settings: Settings) -> None:
    """Override the loaded config with every setting that is not a sentinel, and seed the noise."""
    if settings.debug_time_of_day >= 0.0:
        time.update(debug_mode=True, debug_time_of_day=settings.debug_time_of_day)
    if settings.speedup_factor > 0.0:
        time['speedup_factor'] = settings.speedup_factor
    if settings.debug_seed >= 0:
        time.update(debug_mode=True, debug_seed=settings.debug_seed)
        # The simulator seeds only in its constructor, which has already run: this line makes the seed work.
        random.seed(settings.debug_seed)


def _prove_readable(sim: Any, layout: Layout) -> None:
    """Read every tag once, then restore the noise: a seeded sequence starts with the first request."""
    state = random.getstate()
    for tag_id in layout.tags:
        try:
            read(sim, tag_id)
        except ReadingError as error:
            raise StartUpError(
                f"tag '{escaped(tag_id, 64)}' is loaded but cannot be read: {error}"
            ) from error
    random.setstate(state)


def _warnings(sim: Any, layout: Layout, config: Config, settings: Settings) -> list[str]:
    warnings = []
    tag_file = f"tag_file '{layout.path}'"
    for where, keys in ((tag_file, layout.unread_keys), (config.where, config.unread_keys)):
        if keys:
            warnings.append(f'{where}: unknown and ignored: {names_text("key", keys, 5)}')
    if without_sensors := layout.tags_without_sensors:
        warnings.append(f'not served (no sensors): {names_text("tag", without_sensors, 5)}')
    if settings.speedup_factor > 0.0 and sim.sim_config['time']['debug_mode']:
        warnings.append('speedup_factor has no effect: debug mode freezes the simulated clock')
    return warnings


def _summary(sim: Any, layout: Layout) -> str:
    time = sim.sim_config['time']
    if time['debug_mode']:
        clock = f'clock frozen at {time["debug_time_of_day"]} h'
    else:
        clock = f'clock live, {time["speedup_factor"]} simulated seconds per second'
    return f'{pluralized(len(layout.tags), "tag")}; sensors {", ".join(sim.sensors())}; {clock}'
