"""The criteria for a tag: age, decision margin, number of frames."""

import numpy as np
import pytest
from lupin_tag_confirmation.confirmation import (
    Confirmer,
    Detection,
    Frame,
    Moment,
    Sight,
    UnknownTagId,
    Verdict,
    tag_number,
)
from lupin_tag_confirmation.images import UnusableImage
from lupin_tag_confirmation.settings import Settings

NOW = 1000.0  # by both clocks


def tag(number, margin=100.0) -> Detection:
    return Detection(number, 0, margin, np.zeros((4, 2)))


GOOD = tag(7)


def frame_of(detections, stamp=NOW, arrival=NOW) -> Frame:
    return Frame(lambda: Sight(detections), stamp, arrival)


def refused(text='an image was refused', stamp=NOW, arrival=NOW) -> Frame:
    def look():
        raise UnusableImage(text)

    return Frame(look, stamp, arrival)


def confirmer(*frames, **criteria) -> Confirmer:
    """Return a Confirmer with these frames: lists of current detections, or whole frames."""
    confirmer = Confirmer(Settings(**criteria))
    for frame in frames:
        confirmer.add(frame if isinstance(frame, Frame) else frame_of(frame))
    return confirmer


def verdict_of(confirmer, tag_id='7', now=NOW) -> Verdict:
    """Search all frames, and return the verdict on this tag for a request that came at NOW."""
    moments = Moment(now, now), Moment(NOW, NOW)
    while confirmer.choose(*moments):
        pass
    return confirmer.judge(tag_number(tag_id), *moments)


def answer(confirmer, tag_id='7') -> tuple[float, str]:
    return verdict_of(confirmer, tag_id)[:2]


@pytest.mark.parametrize(
    ('frames', 'criteria', 'message'),
    [
        ([[], []], {}, 'no tag in view in 2 images'),
        ([[tag(9), tag(8)]] * 2, {}, 'in view instead: tags 8 and 9'),
        ([[tag(7, 19.9)]] * 2, {}, 'in view, but unclear: decision margin 20, 20 needed'),
        ([frame_of([GOOD], NOW, NOW - age) for age in (9.0, 3.0)], {}, 'the last image came 3.0 s ago'),
        ([refused('first'), refused('last')], {}, 'last'),
        ([refused(), [GOOD]], {}, 'seen in 1 of the 2 images needed'),
        # Too few images are said before what is in them.
        ([[tag(9), tag(9)], []], {'min_frames': 3}, '2 images in 2 s: 3 are needed'),
        ([[GOOD]], {'timeout_seconds': 0.0}, '1 image in 1 s: 2 are needed'),  # of the last second
    ],
)
def test_why_a_tag_is_not_confirmed(frames, criteria, message):
    confidence, reason = answer(confirmer(*frames, **criteria))
    assert reason.startswith(f'tag 7: {message}')
    assert confidence == (0.5 if [GOOD] in frames else 0.0)


def test_each_image_since_shortly_before_the_request_counts_however_late_it_comes():
    """It was taken up to the longest age before the request, and comes 2.3 s later."""
    for taken in (NOW - 0.9, NOW + 0.2):
        late = confirmer(*[frame_of([GOOD], taken, taken + 2.3)] * 2)
        assert verdict_of(late, now=NOW + 2.5).reason == ''
    early = verdict_of(confirmer(frame_of([GOOD], NOW - 1.1, NOW + 1.2)), now=NOW + 2.5)
    assert early.reason == 'tag 7: the last image is stamped 3.6 s ago: not within 1 s'


def test_frames_are_searched_only_when_asked_each_once_and_the_newest_first():
    """A slow computer searches what the camera shows now, before what it showed on the way."""
    searched, waiting, now = [], confirmer(), Moment(NOW, NOW)
    for number in range(6):
        look = lambda number=number: searched.append(number) or Sight([GOOD])  # noqa: E731
        waiting.add(Frame(look, NOW, NOW - 0.1 + 0.01 * number))
    assert searched == []
    for expected in ([5], [5, 4], [5, 4, 3], [5, 4, 3, 2]):
        assert waiting.choose(now, now)
        waiting.judge(7, now, now)
        assert searched == expected
    assert not waiting.choose(now, now)
    for _ in range(3):
        assert answer(waiting) == (1.0, '')
        assert answer(waiting, '8') == (0.0, 'tag 8: in view instead: tag 7')
    assert searched == [5, 4, 3, 2]


@pytest.mark.parametrize('margin', [20.0, 0.0])  # of a detector that does not report it, it is 0
def test_a_detection_at_the_limit_counts_whatever_the_other_frames_show(margin):
    detection = tag(7, margin)
    assert answer(confirmer([detection], [], [detection])) == (1.0, '')


@pytest.mark.parametrize(
    'aged',
    [
        lambda age: frame_of([GOOD], NOW - age),
        lambda age: frame_of([GOOD], NOW + age),  # only a stamp can lie in the future
        lambda age: frame_of([GOOD], NOW, NOW - age),
    ],
    ids=['stamped before', 'stamped ahead', 'arrived before'],
)
def test_a_frame_counts_up_to_its_longest_age(aged):
    for age, confidence in ((0.5, 1.0), (0.501, 0.0)):
        assert answer(confirmer(aged(age), aged(age), max_image_age_seconds=0.5))[0] == confidence


@pytest.mark.parametrize('tag_id', ['', '07', '-7', '587', '\uff17', '7\n', 'x' * 1000])
def test_an_id_that_is_none_of_the_family_is_refused(tag_id):
    with pytest.raises(UnknownTagId) as refusal:
        tag_number(tag_id)
    assert 'is not an id of tag36h11: must be 0 to 586 in decimal' in str(refusal.value)
    assert len(str(refusal.value)) < 140


@pytest.mark.parametrize(('min_frames', 'confidence'), [(1, 1.0), (2, 0.5)])
def test_the_verdict_comes_with_the_newest_usable_sight(min_frames, confidence):
    new = Sight([])
    frames = [frame_of([GOOD]), Frame(lambda: new, NOW, NOW)]
    if min_frames > 1:
        frames.append(refused())
    verdict = verdict_of(confirmer(*frames, min_frames=min_frames))
    assert (verdict.confidence, verdict.sight is new) == (confidence, True)
