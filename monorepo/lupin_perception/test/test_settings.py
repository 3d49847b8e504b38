"""Exactly one source of images."""

import pytest
from lupin_perception.errors import StartUpError
from lupin_perception.settings import DEFAULT_IMAGE_TOPIC, Settings


@pytest.mark.parametrize(
    ('topics', 'source'),
    [
        ({}, ('image_topic', DEFAULT_IMAGE_TOPIC)),
        ({'image_topic': '/a'}, ('image_topic', '/a')),
        ({'compressed_image_topic': '/a'}, ('compressed_image_topic', '/a')),
        ({'detections_topic': '/a'}, ('detections_topic', '/a')),
        ({'image_topic': '', 'detections_topic': '/a'}, ('detections_topic', '/a')),
    ],
)
def test_the_source_is_the_one_that_is_set(topics, source):
    assert Settings(**topics).source() == source


@pytest.mark.parametrize(
    ('topics', 'problem'),
    [
        ({'image_topic': ''}, 'no source of images is set'),
        ({'image_topic': '/a', 'detections_topic': '/b'}, 'image_topic is /a and detections_topic is /b'),
        (
            {'compressed_image_topic': '/a', 'detections_topic': '/b'},
            'compressed_image_topic is /a and detections_topic is /b',
        ),
    ],
)
def test_two_sources_or_none_are_refused(topics, problem):
    with pytest.raises(StartUpError) as refusal:
        Settings(**topics)
    assert str(refusal.value) == (
        f'{problem}: set exactly one of image_topic, compressed_image_topic, detections_topic'
    )
