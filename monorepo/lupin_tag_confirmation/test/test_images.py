"""Image messages become grey pictures."""

import io
import math
import re
import struct
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lupin_tag_confirmation.images import (
    ENCODINGS,
    MOST_PIXELS,
    SMALLEST_SIDE_PIXELS,
    UnusableImage,
    decoded_picture,
    grey_picture,
)
from PIL import Image


# Whatever the speed of the machine.
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    encoding=st.sampled_from(sorted(ENCODINGS)),
    height=st.integers(SMALLEST_SIDE_PIXELS, 24),
    width=st.integers(SMALLEST_SIDE_PIXELS, 24),
    padding=st.integers(0, 5),
    extra=st.integers(0, 7),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_encoding_with_any_step_gives_the_brightness(encoding, height, width, padding, extra, seed):
    orders = {'mono8': 'r', '8UC1': 'r', 'rgb8': 'rgb', 'bgr8': 'bgr', 'rgba8': 'rgba', 'bgra8': 'bgra'}
    values = np.random.default_rng(seed).integers(0, 256, (4, height, width), np.uint8)
    channels = dict(zip('rgba', values, strict=True))
    rows = np.stack([channels[each] for each in orders[encoding]], axis=-1).reshape(height, -1)
    step = rows.shape[1] + padding
    data = np.pad(rows, ((0, 0), (0, padding))).tobytes() + bytes(extra)
    picture = grey_picture(encoding, height, width, step, data)
    red, green, blue, _ = values
    expected = red if encoding in ('mono8', '8UC1') else 0.299 * red + 0.587 * green + 0.114 * blue
    assert picture.dtype == np.uint8
    assert picture.shape == (height, width)
    assert np.abs(picture - expected).max() <= 2.0


@pytest.mark.parametrize(
    ('encoding', 'height', 'width', 'step', 'size', 'fragment'),
    [
        ('16UC1' * 200, 20, 20, 40, 800, "16UC1' is not one of mono8, 8UC1, rgb8"),
        ('mono8', 20, 15, 15, 300, 'the image has 15 x 20 pixels: each side must have 16 to 16384'),
        ('mono8', 20, 2**32 - 1, 2**32 - 1, 400, 'each side must have 16 to 16384'),
        ('mono8', 16384, 1025, 1025, 400, f'at most {MOST_PIXELS} are allowed'),
        ('rgb8', 20, 20, 59, 1180, 'step is 59 bytes, but 20 pixels of rgb8 need 60'),
        ('mono8', 20, 20, 20, 399, 'data has 399 bytes, but 20 rows of 20 need 400'),
    ],
)
def test_an_image_that_cannot_be_read_is_refused(encoding, height, width, step, size, fragment):
    with pytest.raises(UnusableImage, match=re.escape(fragment)) as refusal:
        grey_picture(encoding, height, width, step, bytes(size))
    assert len(str(refusal.value)) < 200


@pytest.mark.parametrize('shape', [(4096, 4096), (1024, 16384), (16, 16)])
def test_an_image_of_the_largest_and_of_the_smallest_size_is_read(shape):
    assert math.prod(shape) in (MOST_PIXELS, SMALLEST_SIDE_PIXELS**2)
    assert grey_picture('mono8', *shape, shape[1], bytes(math.prod(shape))).shape == shape


GRADIENT = np.linspace(0, 255, 40 * 30).reshape(30, 40).astype(np.uint8)


def encoded(kind, mode='L', **options) -> bytes:
    data = io.BytesIO()
    Image.fromarray(GRADIENT).convert(mode).save(data, kind, **options)
    return data.getvalue()


def png_header(width, height) -> bytes:
    """Return a PNG with this size in its header, and other pixels."""
    png = encoded('PNG')
    header = png[12:16] + struct.pack('>II', width, height) + png[24:29]
    return png[:12] + header + struct.pack('>I', zlib.crc32(header)) + png[33:]


@pytest.mark.parametrize(
    'content',
    [
        encoded('JPEG', quality=95),
        encoded('JPEG', 'RGB', quality=95, progressive=True),
        *(encoded('PNG', mode) for mode in ('L', 'RGBA', 'P', 'LA')),
    ],
)
def test_jpeg_and_png_give_the_brightness(content):
    picture = decoded_picture(content)
    assert (picture.dtype, picture.shape) == (np.uint8, GRADIENT.shape)
    assert np.abs(picture.astype(int) - GRADIENT).max() <= 8


@pytest.mark.parametrize('options', [{}, {'progressive': True}])
@pytest.mark.parametrize('mode', ['L', 'RGB'])
def test_a_jpeg_without_its_end_marker_is_the_same_picture_and_a_cut_one_is_refused(mode, options):
    content = encoded('JPEG', mode, quality=90, **options)
    assert content.endswith(b'\xff\xd9')
    assert np.array_equal(decoded_picture(content[:-2]), decoded_picture(content))
    assert np.array_equal(decoded_picture(content[:-1]), decoded_picture(content))
    for kept in (0.6, 0.9):
        with pytest.raises(UnusableImage, match='cannot be decoded'):
            decoded_picture(content[: int(kept * len(content))])


@pytest.mark.parametrize(
    ('data', 'fragment'),
    [
        (b'GIF89a' + bytes(100), 'the 106 bytes are not a JPEG or PNG image'),
        (bytes(12) + encoded('PNG'), 'are not a JPEG or PNG image'),  # as compressedDepth
        (encoded('PNG')[:33] + bytes(4) + encoded('PNG')[37:], 'the image cannot be decoded'),
        (png_header(100_000, 100_000), f'claims too many pixels: at most {MOST_PIXELS} are allowed'),
        (png_header(2, 200), '2 x 200 pixels: each side must have 16'),
        (png_header(0, 0), 'not a JPEG or PNG image'),
        (encoded('PNG', 'I;16'), 'must have 8 bits per colour'),
    ],
)
def test_a_compressed_image_that_cannot_be_read_is_refused(data, fragment):
    with pytest.raises(UnusableImage, match=re.escape(fragment)) as refusal:
        decoded_picture(data)
    assert len(str(refusal.value)) < 200
