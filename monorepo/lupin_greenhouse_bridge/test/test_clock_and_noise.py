# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The effect of the three debugging parameters on the clock and the noise."""

import copy
import datetime
import random

import pytest
import yaml
from greenhouse_sim import simulator
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation

NOISY_TAGS = ('21', '1', '5', '21', '12', '1')
TICK_SECONDS = 1800.0  # simulated seconds per wall second in the shipped config


class WallClock:
    """Replaces `datetime` in the simulator."""

    def now(self):
        return datetime.datetime.strptime(self.time, '%H:%M:%S')


def loaded(config_file=None, **parameters):
    """Return the simulator that a bridge with these parameters serves."""
    return simulation.load(Settings(**parameters), None, config_file).sim


def sim_time(sim) -> float:
    return simulation.read(sim, '1')[0]


@pytest.fixture
def sim_times(monkeypatch):
    """Return a function that returns the simulated times of one start at these wall times."""
    clock = WallClock()

    def read_at(wall_times, **parameters):
        clock.time = '00:00:00'
        sim = loaded(**parameters)
        times = []
        for clock.time in wall_times:
            times.append(sim_time(sim))
        return times

    monkeypatch.setattr(simulator, 'datetime', clock)
    return read_at


def noisy_sequence(**parameters):
    sim = loaded(**parameters)
    return [simulation.read(sim, tag_id)[1] for tag_id in NOISY_TAGS]


@pytest.mark.parametrize('speedup', [1, 7.5, 3600])
def test_a_wall_second_is_speedup_seconds_of_the_live_clock(sim_times, speedup):
    first, second, later = sim_times(['00:00:01', '00:00:02', '00:00:12'], speedup_factor=speedup)
    assert (first, second - first, later - second) == (speedup, speedup, 10 * speedup)


def test_the_live_clock_takes_the_speedup_of_the_config(sim_times):
    assert sim_times(['00:00:00', '00:00:01']) == [0.0, TICK_SECONDS]


def test_the_live_clock_wraps_and_stays_within_a_day(sim_times):
    wall_times = ['00:00:47', '00:00:48', '11:59:59', '12:00:00', '23:59:59', '00:00:00']
    times = sim_times(wall_times)
    assert times[:2] == [86400 - TICK_SECONDS, 0.0]
    assert all(0.0 <= each < 86400.0 for each in times)


def test_a_restart_does_not_set_the_greenhouse_back(sim_times):
    first = sim_times(['10:11:13'])
    assert sim_times(['10:11:13']) == first == [TICK_SECONDS]


def test_a_frozen_clock_stays_frozen(sim_times):
    wall_times = ['01:00:00', '13:30:59', '23:59:59']
    assert sim_times(wall_times, debug_time_of_day=7.25) == [7.25 * 3600] * 3


@pytest.mark.parametrize(('hours', 'seconds'), [(0, 0.0), (0.0, 0.0), (23.999, 86396.4), (24, 0.0)])
def test_both_ends_of_the_day_are_midnight(hours, seconds):
    assert sim_time(loaded(debug_time_of_day=hours)) == pytest.approx(seconds)


def test_a_config_may_say_24_hours_too(shipped_config, tmp_path):
    config = copy.deepcopy(shipped_config)
    config['time'].update(debug_mode=True, debug_time_of_day=24)
    path = tmp_path / 'config.yaml'
    path.write_text(yaml.safe_dump(config))
    assert sim_time(loaded(path)) == 0.0


def test_a_whole_number_is_taken_for_a_time_of_day_and_a_speedup_without_effect_is_warned_of(start_bridge):
    bridge = start_bridge(debug_time_of_day=6, speedup_factor=3600)
    assert bridge.call('1').reading.sim_time_of_day_seconds == 6 * 3600.0
    assert any('[WARN]' in line and 'speedup_factor has no effect' in line for line in bridge.log)


def test_the_same_seed_gives_the_same_values_also_after_a_restart():
    parameters = {'debug_seed': 7, 'debug_time_of_day': 12.0}
    first = noisy_sequence(**parameters)
    assert noisy_sequence(**parameters) == first
    assert noisy_sequence(**{**parameters, 'debug_seed': 8}) != first


def test_seeded_noise_is_the_simulators_own_from_the_first_request_on(start_bridge):
    """The reads at start-up do not count."""
    bridge = start_bridge(debug_seed=7, debug_time_of_day=12.0)
    served = [bridge.values(tag_id) for tag_id in NOISY_TAGS]
    sim = simulator.GreenhouseSimulator()
    sim.sim_config['time'].update(debug_mode=True, debug_time_of_day=12.0)
    random.seed(7)
    own = [sim.get_sensor_data(tag_id) for tag_id in NOISY_TAGS]
    assert served == [{name: data[name] for name in data if name != 'timestamp'} for data in own]


def test_without_a_seed_the_noise_goes_on_as_the_process_started_it():
    sequences = []
    for seed_of_the_process in (1, 1, 2):
        random.seed(seed_of_the_process)
        sequences.append(noisy_sequence(debug_time_of_day=12.0))
    first, same, other = sequences
    assert first == same != other


def test_a_seed_alone_freezes_the_clock_at_the_time_of_the_config(shipped_config):
    assert sim_time(loaded(debug_seed=0)) == shipped_config['time']['debug_time_of_day'] * 3600


@pytest.mark.parametrize(
    ('arguments', 'is_warned_of'),
    [
        ({'speedup_factor': 60.0, 'debug_time_of_day': 12.0}, True),
        ({'speedup_factor': 60.0}, False),
        ({'debug_time_of_day': 12.0}, False),
    ],
)
def test_a_speedup_is_warned_of_only_when_the_clock_is_frozen(arguments, is_warned_of):
    warnings = simulation.load(Settings(**arguments), None, None).warnings
    assert ['speedup_factor has no effect' in line for line in warnings] == [True] * is_warned_of
