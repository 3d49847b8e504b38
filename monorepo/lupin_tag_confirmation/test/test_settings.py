"""The source of images, and the limits of each number."""

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_tag_confirmation.settings import DEPRECATED, SOURCES, Settings


@pytest.mark.parametrize(
    ('parameters', 'source', 'topic'),
    [
        ({}, 'image', 'camera/color/image_raw'),
        ({'source': 'compressed'}, 'compressed', 'camera/color/image_raw/compressed'),
        ({'source': 'detections'}, 'detections', 'detections'),
        ({'image_topic': '/a'}, 'image', '/a'),
        ({'compressed_image_topic': '/a'}, 'compressed', '/a'),
        ({'detections_topic': '/a'}, 'detections', '/a'),
        ({'source': 'detections', 'detections_topic': '/a'}, 'detections', '/a'),
        ({'image_topic': '', 'detections_topic': '/a'}, 'detections', '/a'),
    ],
)
def test_the_source_is_the_one_that_is_set(parameters, source, topic):
    assert Settings(**parameters).source_and_topic == (source, topic)


@pytest.mark.parametrize(
    ('parameters', 'advice'),
    [
        ({'image_topic': '/a'}, '-p source:=image -r camera/color/image_raw:=/a'),
        (
            {'compressed_image_topic': '/a'},
            '-p source:=compressed -r camera/color/image_raw/compressed:=/a',
        ),
        ({'detections_topic': '/a'}, '-p source:=detections -r detections:=/a'),
    ],
)
def test_a_deprecated_parameter_says_what_to_write_instead(parameters, advice):
    (name,) = parameters
    assert Settings(**parameters).deprecations == [f'parameter {name} is deprecated: write {advice}']


@pytest.mark.parametrize('source', sorted(DEPRECATED.values()))
def test_the_parameter_source_is_not_deprecated(source):
    assert Settings(source=source).deprecations == []


@pytest.mark.parametrize(
    ('parameters', 'problem'),
    [
        ({'image_topic': '/a', 'detections_topic': '/b'}, 'image_topic is /a and detections_topic is /b'),
        (
            {'source': 'detections', 'compressed_image_topic': '/a'},
            'source is detections and compressed_image_topic is /a',
        ),
        ({'source': 'compressed', 'image_topic': '/a'}, 'source is compressed and image_topic is /a'),
    ],
)
def test_two_sources_are_refused(parameters, problem):
    with pytest.raises(StartUpError) as refusal:
        Settings(**parameters)
    assert str(refusal.value) == f'{problem}: set source alone, and remap its topic'


@pytest.mark.parametrize('source', ['', 'Image', 'video'])
def test_another_source_is_refused(source):
    with pytest.raises(StartUpError) as refusal:
        Settings(source=source)
    assert str(refusal.value) == f'parameter source is {source!r}: must be image, compressed or detections'


def test_a_launch_file_can_forward_all_that_selects_the_source():
    assert SOURCES == ('source', 'image_topic', 'compressed_image_topic', 'detections_topic')


@pytest.mark.parametrize(
    ('name', 'smallest', 'largest'),
    [
        ('max_hamming', 0, 2),
        ('min_decision_margin', 0.0, 255.0),
        ('min_frames', 1, 100),
        ('max_image_age_seconds', 0.001, 3600.0),
        ('timeout_seconds', 0.0, 60.0),
    ],
)
def test_a_number_is_accepted_up_to_its_limits_and_no_further(name, smallest, largest):
    for value in (smallest, largest):
        assert getattr(Settings(**{name: value}), name) == value
    beyond = 1 if isinstance(smallest, int) else 1e-6
    for value in (smallest - beyond, largest + beyond):
        with pytest.raises(StartUpError, match=rf'parameter {name} is .* from {smallest:g} to {largest:g}$'):
            Settings(**{name: value})
