"""What it takes to confirm a tag: age, sharpness, size, number of frames."""

import numpy as np
import pytest
from lupin_perception.confirmation import Confirmer, Criteria, Detection, Frame, UnknownTagId
from lupin_perception.errors import StartUpError

GOOD = Detection(7, 80.0, 0.9)
NOW = 1000.0  # by both clocks


def confirmer(*frames, **criteria) -> Confirmer:
    """Return one that was shown these frames: each a list of detections, all taken just now, or a Frame."""
    pictures = []

    def detect(picture):
        return pictures[picture[0, 0]]

    confirmer = Confirmer(detect, Criteria(**criteria))
    for number, frame in enumerate(frames):
        detections, stamp, arrival = frame if isinstance(frame, tuple) else (frame, NOW, NOW)
        pictures.append(detections)
        confirmer.add(Frame(np.array([[number]]), stamp, arrival))
    return confirmer


def test_a_tag_in_enough_frames_is_confirmed():
    assert confirmer([GOOD], [GOOD]).confirm('7', NOW, NOW) == (1.0, '')


def test_one_frame_without_the_tag_among_enough_with_it_does_no_harm():
    assert confirmer([GOOD], [], [GOOD]).confirm('7', NOW, NOW) == (1.0, '')


@pytest.mark.parametrize(
    ('frames', 'message'),
    [
        ([], 'no usable image yet'),
        ([[], []], 'no tag in view in 2 frames'),
        ([[GOOD]], 'seen in 1 frames of 2 needed'),
        ([[Detection(9, 80.0, 0.9), Detection(8, 80.0, 0.9)]] * 2, 'other tags in view: 8, 9'),
        ([[Detection(7, 23.0, 0.9)]] * 2, 'in view, but small: 23 pixels a side, 24 needed'),
        ([[Detection(7, 80.0, 0.5)]] * 2, 'in view, but blurred: sharpness 0.50, 0.75 needed'),
        ([([GOOD], NOW, NOW - 2.0)] * 2, 'the last image came 2.0 s ago: older than 1 s'),
        ([([GOOD], NOW - 2.0, NOW)] * 2, 'the last image is stamped 2.0 s ago: not within 1 s'),
        ([([GOOD], NOW + 2.0, NOW)] * 2, 'the last image is stamped 2.0 s ahead: not within 1 s'),
        ([([GOOD], 0.0, NOW)] * 2, 'the last image is stamped 1000.0 s ago: not within 1 s'),
        ([([GOOD], NOW - 2.0, NOW - 2.0), [GOOD]], 'seen in 1 frames of 2 needed'),
    ],
)
def test_why_a_tag_is_not_confirmed(frames, message):
    assert confirmer(*frames).confirm('7', NOW, NOW)[1] == f'tag 7: {message}'


@pytest.mark.parametrize(
    'frame_of',
    [
        lambda age: ([GOOD], NOW - age, NOW),
        lambda age: ([GOOD], NOW + age, NOW),  # only a stamp can lie in the future
        lambda age: ([GOOD], NOW, NOW - age),
    ],
    ids=['stamped before', 'stamped ahead', 'arrived before'],
)
def test_a_frame_counts_up_to_its_longest_age(frame_of):
    for age, confidence in ((0.5, 1.0), (0.501, 0.0)):
        seen = confirmer(frame_of(age), frame_of(age), max_image_age_seconds=0.5)
        assert seen.confirm('7', NOW, NOW)[0] == confidence


def test_the_age_that_is_told_is_that_of_the_last_frame():
    old, last = (([GOOD], NOW, NOW - age) for age in (9.0, 3.0))
    assert (
        confirmer(old, last).confirm('7', NOW, NOW)[1]
        == 'tag 7: the last image came 3.0 s ago: older than 1 s'
    )


def test_the_tag_before_is_not_confirmed_for_the_next():
    """Frames of the last tag are still recent on arrival at the next one."""
    seen = confirmer([Detection(6, 80.0, 0.9)], [Detection(6, 80.0, 0.9)], [GOOD])
    assert seen.confirm('7', NOW, NOW) == (0.5, 'tag 7: seen in 1 frames of 2 needed')


@pytest.mark.parametrize(
    'tag_id', ['', '07', ' 7', '7 ', '+7', '-7', '587', '1000', '\uff17', '7\n', 'seven', 'x' * 1000]
)
def test_an_id_that_is_none_of_the_family_is_refused(tag_id):
    with pytest.raises(UnknownTagId) as refusal:
        confirmer([GOOD], [GOOD]).confirm(tag_id, NOW, NOW)
    assert 'is not an id of tag36h11: must be 0 to 586 in decimal' in str(refusal.value)
    assert len(str(refusal.value)) < 140


def test_each_frame_is_looked_into_once_and_only_when_asked():
    looked = []
    seen = Confirmer(lambda picture: looked.append(picture) or [GOOD], Criteria())
    for number in range(6):
        seen.add(Frame(np.array([[number]]), NOW, NOW))
    assert looked == []
    for _ in range(3):
        assert seen.confirm('7', NOW, NOW) == (1.0, '')
        assert seen.confirm('8', NOW, NOW) == (0.0, 'tag 8: other tags in view: 7')
    assert len(looked) == 4


def test_a_refused_image_is_named_until_there_is_a_usable_one():
    seen = confirmer()
    refusal = "; an image was refused: encoding '16UC1' is not one of mono8"
    seen.refusal = "encoding '16UC1' is not one of mono8"
    assert seen.confirm('7', NOW, NOW) == (0.0, f'tag 7: no usable image yet{refusal}')

    seen = confirmer([GOOD], [GOOD])
    seen.refusal = "encoding '16UC1' is not one of mono8"
    later = NOW + 2.0
    message = f'tag 7: the last image came 2.0 s ago: older than 1 s{refusal}'
    assert seen.confirm('7', later, later) == (0.0, message)
    seen.add(Frame(np.array([[0]]), later, later))
    later += 2.0
    assert 'refused' not in seen.confirm('7', later, later)[1]


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('max_image_age_seconds', 0.0),
        ('max_image_age_seconds', float('nan')),
        ('min_side_pixels', -1.0),
        ('min_sharpness', 1.1),
        ('min_frames', 0),
        ('min_frames', 1.5),
        ('min_frames', True),
        ('min_frames', 'two'),
    ],
)
def test_a_criterion_out_of_its_limits_is_refused(name, value):
    with pytest.raises(StartUpError, match=rf'parameter {name} is .*: must be a (whole )?number from'):
        Criteria(**{name: value})
