"""The picture of a verdict: outlines, labels and a bar."""

import numpy as np
import pytest
from lupin_tag_confirmation.confirmation import Detection
from lupin_tag_confirmation.drawing import BAR_PIXELS, FLAWED, GOOD, OTHER, PAPER, USUAL_WIDTH, draw
from lupin_tag_confirmation.settings import Settings

GREY = np.full((240, 320), 128, np.uint8)
CORNERS = np.array([(100.0, 130.0), (180.0, 130.0), (180.0, 50.0), (100.0, 50.0)])


def drawn(tag_number=7, hamming=0, margin=50.0, reason='') -> np.ndarray:
    detection = Detection(tag_number, hamming, margin, CORNERS)
    return draw(GREY, [detection], 7, reason, Settings())


@pytest.mark.parametrize(
    ('detection', 'colour'),
    [({}, GOOD), ({'margin': 5.0}, FLAWED), ({'tag_number': 8, 'margin': 5.0}, OTHER)],
)
def test_the_outline_has_the_colour_of_the_detection(detection, colour):
    picture = drawn(**detection)
    for x, y in ((100, 90), (180, 90), (140, 50), (140, 130)):  # the middle of each side
        assert tuple(picture[y, x]) == colour
    shown = set(map(tuple, picture[BAR_PIXELS + 1 :].reshape(-1, 3).tolist()))
    assert shown & {GOOD, FLAWED, OTHER} == {colour}
    assert (picture[60:120, 110:170] == 128).all()  # the tag itself stays as it was seen
    assert (picture[134:140, 100:180] == 128).all()  # its white border, too


@pytest.mark.parametrize(('reason', 'colour'), [('', GOOD), ('tag 7: no', FLAWED)])
def test_the_bar_has_the_colour_of_the_verdict(reason, colour):
    bar = drawn(tag_number=8, reason=reason)[BAR_PIXELS // 2 + 1 : BAR_PIXELS]
    assert tuple(bar[0, 319]) == PAPER == (0, 0, 0)
    ink = bar.reshape(-1, 3).sum(axis=0)  # the text is smoothed: no pixel need have the full colour
    assert ink / ink.max() == pytest.approx(np.array(colour) / max(colour), abs=0.05)


def test_the_label_tells_the_id_the_margin_and_corrected_bits():
    labels = [drawn(**each)[142:] for each in ({'margin': 51.0}, {}, {'tag_number': 8}, {'hamming': 1})]
    rows, columns = ([(label != 128).any(axis=(2, axis)).sum() for label in labels] for axis in (1, 0))
    assert len({label.tobytes() for label in labels}) == 4
    assert np.diff(rows).tolist() == [0, -19, 38]  # a line for the contrast, and one for the corrected bit
    assert max(columns) < 300
    assert (labels[2][4:7, 100:150] == PAPER).all()  # room around the text
    assert (labels[2][4:20, 100:104] == PAPER).all()


def test_a_wide_picture_has_a_higher_bar():
    picture = draw(np.full((600, 2 * USUAL_WIDTH), 128, np.uint8), [], 7, '', Settings())
    assert (picture[:, -1] == PAPER).all(axis=1).sum() == pytest.approx(2 * BAR_PIXELS, abs=1)
