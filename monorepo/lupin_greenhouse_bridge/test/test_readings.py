"""The contents of a reading: the tag's sensors, the model's values, two clocks."""

import copy
import importlib.metadata
import math
import time

import pytest
import yaml
from lupin_greenhouse_bridge.interfaces import GetTagReading, TagReading
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation

TAGS_SHIPPED = {'1.0.7': 22, '1.0.8': 29}
HOURS = {'midnight': 0.0, '06:00': 6.0, 'noon': 12.0, '18:00': 18.0}


def closed_form(components, x, y, hour):
    """Compute a noise-free sensor's value from its config alone, without the simulator."""
    values = []
    for component in components:
        midnight, noon = component['value_at_midnight'], component['value_at_noon']
        value = (midnight + noon) / 2 + (noon - midnight) / 2 * math.sin(2 * math.pi * (hour - 6) / 24)
        anchor_x, anchor_y = component['position']
        if component['dynamics'] == 'radial':
            distance_m = math.hypot(x - anchor_x, y - anchor_y)
        elif component['dynamics'] == 'linear':
            angle = math.radians(component['angle'])
            distance_m = abs(math.sin(angle) * (x - anchor_x) + math.cos(angle) * (y - anchor_y))
        else:
            distance_m = 0.0
        # The simulator does not know 'square' of its own config, and treats it as linear.
        power = 2 if component['decay_type'] == 'quadratic' else 1
        values.append(value * max(0.0, 1 - (distance_m / component['decay_distance']) ** power))
    return max(values)


@pytest.fixture(scope='module')
def noise_free_config_file(shipped_config, tmp_path_factory):
    """Return a file with the shipped config without noise."""
    config = copy.deepcopy(shipped_config)
    for components in config['sensors'].values():
        for component in components:
            component['noise_sigma'] = 0
    path = tmp_path_factory.mktemp('config') / 'noise_free.yaml'
    path.write_text(yaml.safe_dump(config), encoding='utf-8')
    return path


def is_noise_free(components):
    return all(component['noise_sigma'] == 0 for component in components)


def test_every_tag_gives_exactly_its_own_sensors_in_its_order(noon_bridge, shipped_tags):
    version = importlib.metadata.version('mdp-greenhouse')
    assert len(shipped_tags) == TAGS_SHIPPED.get(version, len(shipped_tags))
    served = {tag_id: list(noon_bridge.values(tag_id)) for tag_id in shipped_tags}
    assert served == {tag_id: tag['sensors'] for tag_id, tag in shipped_tags.items()}


def values_of(tag_ids, config_file=None, **parameters):
    """Return the values by tag that a bridge with these parameters serves."""
    sim = simulation.load(Settings(**parameters), None, config_file).sim
    return {tag_id: simulation.read(sim, tag_id)[1] for tag_id in tag_ids}


@pytest.mark.parametrize('hour', HOURS.values(), ids=HOURS)
def test_without_noise_all_five_sensors_follow_the_closed_form(
    shipped_tags, shipped_config, noise_free_config_file, hour
):
    seen = set()
    for tag_id, values in values_of(shipped_tags, noise_free_config_file, debug_time_of_day=hour).items():
        tag = shipped_tags[tag_id]
        for name, value in values.items():
            expected = closed_form(shipped_config['sensors'][name], tag['x'], tag['y'], hour)
            assert value == pytest.approx(expected, rel=1e-12), (tag_id, name)
            seen.add(name)
    assert seen == {'temperature', 'humidity', 'co2', 'light', 'soil_moisture'}


def test_the_service_returns_the_values_of_the_closed_form(noon_bridge, shipped_tags, shipped_config):
    for tag_id, tag in shipped_tags.items():
        for name, value in noon_bridge.values(tag_id).items():
            components = shipped_config['sensors'][name]
            if is_noise_free(components):
                assert value == pytest.approx(closed_form(components, tag['x'], tag['y'], 12.0), rel=1e-12)


def test_noon_is_warmer_than_midnight_at_the_same_tag(shipped_tags):
    warm_tags = [tag_id for tag_id, tag in shipped_tags.items() if 'temperature' in tag['sensors']]
    midnight, noon = (values_of(warm_tags, debug_time_of_day=hour) for hour in (0.0, 12.0))
    assert warm_tags
    assert all(noon[tag_id]['temperature'] > midnight[tag_id]['temperature'] for tag_id in warm_tags)


def test_a_reading_carries_its_tag_id_and_the_frozen_time(noon_bridge):
    reading = noon_bridge.call('5').reading
    assert (reading.tag_id, reading.sim_time_of_day_seconds) == ('5', 12 * 3600.0)


def test_stamp_is_the_wall_clock_while_the_simulated_day_races(start_bridge):
    bridge = start_bridge(speedup_factor=7200)
    bridge.connect()
    for _ in range(5):
        before = time.time_ns()
        stamp = bridge.call('1').reading.stamp
        assert before <= stamp.sec * 10**9 + stamp.nanosec <= time.time_ns()


def test_an_unknown_tag_gets_the_typed_status_the_count_and_a_default_reading(noon_bridge, shipped_tags):
    response = noon_bridge.call('99')
    assert response.status == GetTagReading.Response.STATUS_UNKNOWN_TAG
    assert response.error_message == (
        f"Tag '99' is not in the loaded greenhouse ({len(shipped_tags)} tags known)."
    )
    assert response.reading == TagReading()


def test_a_reading_is_never_torn(start_bridge, altered, shipped_tags, shipped_config):
    """The time in a reading is the time of its values, even if the clock ticks at every read."""
    bridge = start_bridge(altered('ticking_clock'))
    components = shipped_config['sensors']['temperature']
    warm_tags = {tag_id: tag for tag_id, tag in shipped_tags.items() if 'temperature' in tag['sensors']}
    times = set()
    for tag_id, tag in warm_tags.items():
        reading = bridge.call(tag_id).reading
        value = {each.name: each.value for each in reading.readings}['temperature']
        hour = reading.sim_time_of_day_seconds / 3600
        assert value == pytest.approx(closed_form(components, tag['x'], tag['y'], hour), rel=1e-12)
        times.add(reading.sim_time_of_day_seconds)
    assert len(times) == len(warm_tags)
