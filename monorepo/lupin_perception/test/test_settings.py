"""Exactly one source of images, and the limits of each number."""

import re
from dataclasses import fields
from pathlib import Path

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
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


def test_the_defaults_are_those_of_the_readme():
    settings = Settings()
    readme = (Path(__file__).resolve().parent.parent / 'README.md').read_text(encoding='utf-8')
    rows = re.findall(r'^\| `(\w+)` \| (empty|`(\S+)`) \|', readme, re.MULTILINE)
    assert {name: value for name, _, value in rows} == {
        each.name: str(getattr(settings, each.name)) for each in fields(settings)
    }
