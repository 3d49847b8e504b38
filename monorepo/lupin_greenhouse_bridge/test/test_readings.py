# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The contents of a reading, two clocks, and the effect of the debugging parameters."""

import datetime
import fractions
import itertools
import math
import random
import re
import time
from types import SimpleNamespace

import numpy
import pytest
from greenhouse_sim import simulator
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation


def loaded(**parameters):
    return simulation.load(Settings(**parameters), None, None).sim


def test_a_reading_is_never_torn_and_has_the_stamp_of_the_wall_clock(ask_here, monkeypatch, shipped_tags):
    """The time in a reading is the time of its values, even if the clock ticks at every read."""
    start = datetime.datetime(2026, 1, 1, 6)
    ticks = (start + datetime.timedelta(seconds=tick) for tick in itertools.count())
    monkeypatch.setattr(simulator, 'datetime', SimpleNamespace(now=lambda: next(ticks)))
    ask = ask_here(use_sim_time=True)
    warm_tags = [tag_id for tag_id, tag in shipped_tags.items() if 'temperature' in tag['sensors']][:4]
    times = set()
    for tag_id in warm_tags:
        before = time.time_ns()
        reading = ask(tag_id).reading
        assert before <= reading.stamp.sec * 10**9 + reading.stamp.nanosec <= time.time_ns()
        (value,) = [value.value for value in reading.readings if value.name == 'temperature']
        frozen = loaded(debug_time_of_day=reading.sim_time_of_day_seconds / 3600)
        assert value == pytest.approx(simulation.read(frozen, tag_id)[1]['temperature'])  # without noise
        times.add(reading.sim_time_of_day_seconds)
    assert len(times) == len(warm_tags)


def read_answer(answer):
    return simulation.read(SimpleNamespace(get_sensor_data=lambda _tag_id: answer), '1')


@pytest.mark.parametrize(
    ('answer', 'cause'),
    [
        ({'timestamp': 0, 'co2': math.nan}, 'nan for co2'),
        ({'timestamp': 0, 'co2': '21.3'}, "'21.3' for co2"),
        ({'timestamp': 0, 'co2': True}, 'True for co2'),
        ({'timestamp': 0, 'co2': 10**400}, 'OverflowError'),
        ({'timestamp': 0}, 'no value'),
        ({}, "KeyError: 'timestamp'"),
        ({'timestamp': math.nan, 'co2': 1.0}, 'nan for timestamp'),
        ({'timestamp': 86400.0, 'co2': 1.0}, 'outside [0, 86400)'),
        ({'timestamp': -1e-9, 'co2': 1.0}, 'outside [0, 86400)'),
    ],
)
def test_an_answer_that_is_no_reading_is_an_error_with_its_cause(answer, cause):
    with pytest.raises(simulation.ReadingError, match=re.escape(cause)):
        read_answer(answer)


@pytest.mark.parametrize('value', [numpy.float32(3), numpy.int8(3), 3, fractions.Fraction(6, 2)])
def test_any_finite_real_number_is_cast(value):
    sim_time, values = read_answer({'timestamp': numpy.int64(43200), 'co2': value})
    assert (sim_time, values) == (43200.0, {'co2': 3.0})
    assert {type(sim_time), type(values['co2'])} == {float}


NOISY_TAGS = ('21', '1', '5', '21', '12', '1')


@pytest.mark.parametrize(
    ('parameters', 'wall_times', 'expected'),
    [
        ({'speedup_factor': 7.5}, ('00:00:01', '00:00:02', '00:00:12'), [7.5, 15.0, 90.0]),
        ({}, ('00:00:00', '00:00:01', '00:00:47', '00:00:48'), [0.0, 1800.0, 84600.0, 0.0]),  # of the config
        *(
            ({'debug_time_of_day': hours}, ('01:00:00', '13:30:59', '23:59:59'), [seconds] * 3)
            for hours, seconds in ((0, 0), (7.25, 26100), (23.999, 86396.4), (24, 0))
        ),
    ],
)
def test_the_clock_counts_from_the_start_or_is_frozen(monkeypatch, parameters, wall_times, expected):
    """A start is at midnight, and the clock of the shipped config wraps after 48 s."""
    nows = [datetime.datetime.strptime(text, '%H:%M:%S') for text in ('00:00:00', *wall_times)]
    clock = SimpleNamespace(now=lambda: nows[0])  # in place of `datetime` in the simulator
    monkeypatch.setattr(simulator, 'datetime', clock)
    sim, times = loaded(**parameters), []
    for _ in wall_times:
        del nows[0]
        times.append(simulation.read(sim, '1')[0])
    assert times == pytest.approx(expected)


def test_seeded_noise_is_the_simulators_own_from_the_first_request_on(ask_here):
    ask = ask_here(debug_seed=7, debug_time_of_day=12.0)
    served = [{value.name: value.value for value in ask(tag_id).reading.readings} for tag_id in NOISY_TAGS]
    sim = simulator.GreenhouseSimulator()
    sim.sim_config['time'].update(debug_mode=True, debug_time_of_day=12.0)
    random.seed(7)
    own = [sim.get_sensor_data(tag_id) for tag_id in NOISY_TAGS]
    assert served == [{name: data[name] for name in data if name != 'timestamp'} for data in own]


def test_without_a_seed_the_noise_goes_on_as_the_process_started_it():
    sequences = []
    for seed_of_the_process in (1, 1, 2):
        random.seed(seed_of_the_process)
        sim = loaded(debug_time_of_day=12.0)
        sequences.append([simulation.read(sim, tag_id)[1] for tag_id in NOISY_TAGS])
    first, same, other = sequences
    assert first == same != other
