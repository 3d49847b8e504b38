"""From the bytes of an image message to a grey picture."""

import contextlib
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lupin_perception.images import ENCODINGS, UnusableImage, grey_picture


@given(
    encoding=st.sampled_from(sorted(ENCODINGS)),
    height=st.integers(1, 12),
    width=st.integers(1, 12),
    padding=st.integers(0, 5),
    extra=st.integers(0, 7),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_encoding_with_any_step_gives_the_brightness(encoding, height, width, padding, extra, seed):
    random = np.random.default_rng(seed)
    red, green, blue = random.integers(0, 256, (3, height, width), dtype=np.uint8)
    alpha = random.integers(0, 256, (height, width), dtype=np.uint8)
    planes = {
        'mono8': [red],
        'rgb8': [red, green, blue],
        'bgr8': [blue, green, red],
        'rgba8': [red, green, blue, alpha],
        'bgra8': [blue, green, red, alpha],
    }[encoding]
    rows = np.stack(planes, axis=-1).reshape(height, -1)
    step = rows.shape[1] + padding
    data = np.zeros((height, step), dtype=np.uint8)
    data[:, : rows.shape[1]] = rows
    picture = grey_picture(encoding, height, width, step, data.tobytes() + bytes(extra))
    expected = red if encoding == 'mono8' else 0.299 * red + 0.587 * green + 0.114 * blue
    assert picture.dtype == np.uint8
    assert picture.shape == (height, width)
    assert np.abs(picture - expected).max() <= 2.0


@pytest.mark.parametrize(
    ('encoding', 'height', 'width', 'step', 'size', 'fragment'),
    [
        ('16UC1', 2, 2, 4, 8, "encoding '16UC1' is not one of mono8, rgb8"),
        ('', 2, 2, 2, 4, "encoding ''"),
        ('x' * 1000, 2, 2, 2, 4, 'is not one of'),
        ('mono8', 0, 2, 2, 4, '2 x 0 pixels'),
        ('mono8', 2, 0, 2, 4, '0 x 2 pixels'),
        ('mono8', 2, 2**32 - 1, 2**32 - 1, 4, 'each side must be 1 to 16384'),
        ('rgb8', 2, 2, 5, 10, 'step is 5 bytes, and 2 pixels of rgb8 need 6'),
        ('mono8', 2, 2, 2, 3, 'data has 3 bytes, and 2 rows of 2 need 4'),
        ('mono8', 2, 2, 2**32 - 1, 4, 'data has 4 bytes'),
        ('mono8', 2, 2, 2, 0, 'data has 0 bytes'),
    ],
)
def test_an_image_that_cannot_be_read_is_refused(encoding, height, width, step, size, fragment):
    with pytest.raises(UnusableImage, match=re.escape(fragment)) as refusal:
        grey_picture(encoding, height, width, step, bytes(size))
    assert len(str(refusal.value)) < 200


@given(
    st.text(max_size=10) | st.sampled_from(sorted(ENCODINGS)),
    st.integers(0, 2**32 - 1) | st.integers(0, 9),
    st.integers(0, 2**32 - 1) | st.integers(0, 9),
    st.integers(0, 2**32 - 1) | st.integers(0, 9),
    st.binary(max_size=100),
)
def test_whatever_a_message_can_hold_is_a_picture_or_a_refusal(encoding, height, width, step, data):
    with contextlib.suppress(UnusableImage):
        assert grey_picture(encoding, height, width, step, data).shape == (height, width)
