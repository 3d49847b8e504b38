"""Parameters, and messages of cameras and detectors that become detections. Nothing is sent over ROS."""

import dataclasses
import re
import sys

import numpy as np
import pytest
import yaml
from ament_index_python.packages import get_package_share_path
from confirmation_helpers import compressed, detections, image_of, marker
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.testing.helpers import check_settings
from lupin_tag_confirmation.confirmation import Confirmer, Frame, Moment
from lupin_tag_confirmation.settings import Settings
from lupin_tag_confirmation.sources import open_source

SHARE = get_package_share_path('lupin_tag_confirmation')
APRILTAG_MSGS = 'apriltag_msgs'


def judge(source: str, message, **parameters) -> str:
    """Return why tag 7 is not confirmed by one current message of this source; '' if it is."""
    settings = Settings(source=source, min_frames=1, **parameters)
    confirmer = Confirmer(settings)
    message_type, sight_of = open_source(settings)
    assert type(message) is message_type
    confirmer.add(Frame(lambda: sight_of(message), 0.0, 0.0))
    now = Moment(0.0, 0.0)
    assert confirmer.choose(now, now)
    return confirmer.judge(7, now, now).reason


@pytest.mark.parametrize('source', ['image', 'compressed'])
def test_max_hamming_reaches_the_detector(source):
    tag = marker(7)
    tag[10:20, 10:20] ^= 255
    picture = np.pad(tag, 40, constant_values=255)
    message = image_of(picture) if source == 'image' else compressed(picture, 'PNG')
    assert judge(source, message) == 'tag 7: no tag in view in 1 image'
    assert judge(source, message, max_hamming=1) == ''


@pytest.mark.parametrize(
    ('message', 'reason'),
    [
        (detections((7, 0, 50.0), family='tf36h11'), ''),
        (detections((7, 1, 50.0)), 'in view, but with 1 corrected bit, at most 0 allowed'),
        (detections((7, 0, 50.0), family='tag25h9'), 'no tag in view in 1 image'),
        (detections((-7, 0, 50.0), (2**31 - 1, 0, 50.0)), 'in view instead: tags -7 and 2147483647'),
        (detections((7, -1, float('nan'))), 'in view, but unclear: decision margin nan, 20 needed'),
    ],
)
def test_detections_of_another_node_are_judged(message, reason):
    assert judge('detections', message) == (f'tag 7: {reason}' if reason else '')


@pytest.mark.parametrize(
    ('source', 'module', 'problem'),
    [
        ('image', 'apriltag', 'AprilTag library is missing .*: sudo apt install python3-apriltag$'),
        ('compressed', 'apriltag', 'AprilTag library is missing'),
        ('detections', 'apriltag_msgs.msg', f'package apriltag_msgs.*{re.escape(APRILTAG_MSGS)}'),
    ],
)
def test_what_a_source_needs_is_refused_with_its_package_where_it_is_missing(
    source, module, problem, monkeypatch
):
    monkeypatch.delitem(sys.modules, 'lupin_tag_confirmation.detector', raising=False)
    monkeypatch.setitem(sys.modules, module, None)  # as if it was not installed
    with pytest.raises(StartUpError, match=problem):
        open_source(Settings(source=source))
    open_source(Settings(source='image' if source == 'detections' else 'detections'))


def test_each_parameter_has_its_type_its_limits_and_its_default_in_the_parameter_file():
    check_settings(Settings)
    for source in ('', 'Image', 'video'):
        with pytest.raises(StartUpError) as refusal:
            Settings(source=source)
        accepted = 'image, compressed or detections'
        assert str(refusal.value) == f'parameter source is {source!r}: must be {accepted}'
    (nodes,) = yaml.safe_load_all((SHARE / 'config/confirm_tag.yaml').read_text(encoding='utf-8'))
    parameters = nodes['/**/confirm_tag']['ros__parameters']
    assert {name: (value, type(value)) for name, value in parameters.items()} == {
        each.name: (each.default, type(each.default)) for each in dataclasses.fields(Settings)
    }
