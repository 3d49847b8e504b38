"""The picture of a verdict: outlines, labels and a bar."""

import numpy as np
import pytest
from lupin_tag_confirmation.confirmation import Detection
from lupin_tag_confirmation.drawing import FLAWED, GOOD, OTHER, draw
from lupin_tag_confirmation.settings import Settings

GREY = np.full((240, 320), 128, np.uint8)
TITLE, BAR = 24, 42  # the lower sides of the verdict and of the bar with one line below it
CORNERS = np.array([(100.0, 130.0), (180.0, 130.0), (180.0, 50.0), (100.0, 50.0)])


def drawn(tag_number=7, hamming=0, margin=50.0, reason='') -> np.ndarray:
    return draw(GREY, [Detection(tag_number, hamming, margin, CORNERS)], 7, reason, Settings())


@pytest.mark.parametrize(
    ('detection', 'colour'),
    [({}, GOOD), ({'margin': 5.0}, FLAWED), ({'tag_number': 8, 'margin': 5.0}, OTHER)],
)
def test_the_outline_has_the_colour_of_the_detection(detection, colour):
    picture = drawn(**detection)
    for x, y in ((100, 90), (180, 90), (140, 50), (140, 130)):  # the middle of each side
        assert tuple(picture[y, x]) == colour
    shown = set(map(tuple, picture[BAR + 1 :].reshape(-1, 3).tolist()))
    assert shown & {GOOD, FLAWED, OTHER} == {colour}
    assert (picture[np.r_[60:120, 133:140], 110:170] == 128).all()  # the tag stays as seen, its border too


@pytest.mark.parametrize(('reason', 'colour'), [('', GOOD), ('tag 7: no', FLAWED)])
def test_the_bar_has_the_colour_of_the_verdict(reason, colour):
    bar = drawn(tag_number=8, reason=reason)[:TITLE]
    ink = bar.reshape(-1, 3).sum(axis=0)  # the text is smoothed: no pixel need have the full colour
    assert ink / ink.max() == pytest.approx(np.array(colour) / max(colour), abs=0.05)


def test_the_label_tells_the_id_the_margin_and_corrected_bits():
    labels = [drawn(**each)[142:] for each in ({'margin': 51.0}, {}, {'tag_number': 8}, {'hamming': 1})]
    rows, columns = ([(label != 128).any(axis=(2, axis)).sum() for label in labels] for axis in (1, 0))
    assert len({label.tobytes() for label in labels}) == 4
    assert np.diff(rows).tolist() == [0, -16, 32]  # a line for the contrast, and one for the corrected bit
    assert max(columns) < 160
    assert not labels[2][2:5, 90:150].any()  # room around the text


def test_a_label_hides_no_tag_and_no_other_label():
    places = np.array([(70, 40), (135, 50), (200, 40), (-30, 165), (200, 145)])[:, None] + CORNERS / 2
    tags = [Detection(7 + number, 0, 50.0, corners) for number, corners in enumerate(places)]
    pictures = (draw(GREY, shown, 7, '', Settings()) for shown in ([], tags, *([tag] for tag in tags)))
    empty, together, *alone = ((picture != 128).any(axis=-1).sum() for picture in pictures)
    assert together - empty == sum(alone) - 5 * empty


def test_the_bar_is_higher_in_a_large_picture_and_for_a_long_reason():
    choices = ((240, 320), ''), ((640, 1080), ''), ((240, 320), f'no: {list(range(99))}'), ((16, 16), 'no')
    pictures = (draw(np.full(shape, 128, np.uint8), [], 7, why, Settings()) for shape, why in choices)
    assert [(picture[:, -1] == 0).all(axis=1).sum() for picture in pictures][:3] == [BAR, 124, BAR + 16]
