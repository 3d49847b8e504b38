"""Turn image messages into grey pictures, uint8 of the shape (height, width). Does not import ROS."""

import io
import warnings

import numpy as np
from PIL import Image, UnidentifiedImageError

# Pillow's mode of the picture, and its name for the bytes of a pixel. A fourth byte (alpha) is ignored.
ENCODINGS = {
    'mono8': ('L', 'L'),
    '8UC1': ('L', 'L'),
    'rgb8': ('RGB', 'RGB'),
    'bgr8': ('RGB', 'BGR'),
    'rgba8': ('RGB', 'RGBX'),
    'bgra8': ('RGB', 'BGRX'),
}
JPEG_START, JPEG_END, FILLER = b'\xff\xd8', b'\xff\xd9', b'\x55' * 64
SMALLEST_SIDE_PIXELS = 16  # AprilTag 3.3.0 and 3.4.5 crash on pictures of one or two rows
LARGEST_SIDE_PIXELS = 16384
MOST_PIXELS = 2**24  # more would keep the node busy for seconds
# Pillow's modes with at most 8 bits per channel. Depth pictures (16 bits) are refused.
MODES = ('1', 'L', 'LA', 'P', 'RGB', 'RGBA', 'YCbCr', 'CMYK')


class UnusableImage(ValueError):
    """An image that cannot be read; the text gives the reason in one line."""


def _check_size(width: int, height: int) -> None:
    if not all(SMALLEST_SIDE_PIXELS <= side <= LARGEST_SIDE_PIXELS for side in (width, height)):
        limits = f'{SMALLEST_SIDE_PIXELS} to {LARGEST_SIDE_PIXELS}'
        raise UnusableImage(f'the image has {width} x {height} pixels: each side must have {limits}')
    if width * height > MOST_PIXELS:
        raise UnusableImage(f'the image has {width} x {height} pixels: at most {MOST_PIXELS} are allowed')


def grey_picture(encoding: str, height: int, width: int, step: int, data: bytes) -> np.ndarray:
    """
    Return the picture of a sensor_msgs/Image; raises UnusableImage.

    `step` is the length of a row in bytes, padding included. `data` holds at least height * step bytes. All
    encodings have one byte per channel, so is_bigendian does not matter.
    """
    if encoding not in ENCODINGS:
        raise UnusableImage(f'encoding {encoding[:40]!r} is not one of {", ".join(ENCODINGS)}')
    mode, pixel = ENCODINGS[encoding]
    _check_size(width, height)
    if step < width * len(pixel):
        raise UnusableImage(
            f'step is {step} bytes, but {width} pixels of {encoding} need {width * len(pixel)}'
        )
    size = height * step
    if len(data) < size:
        raise UnusableImage(f'data has {len(data)} bytes, but {height} rows of {step} need {size}')
    rows = bytes(memoryview(data)[:size])  # Pillow 9.0 takes no view
    image = Image.frombytes(mode, (width, height), rows, 'raw', pixel, step)
    return np.asarray(image.convert('L'))


def decoded_picture(data: bytes) -> np.ndarray:
    """Return the picture of a JPEG or PNG file; raises UnusableImage. A JPEG may lack its end marker."""
    data = bytes(data)
    try:
        return _decoded(data)
    except UnusableImage:
        if not data.startswith(JPEG_START):
            raise
        data = data.removesuffix(JPEG_END[:1])
        picture = _decoded(data + JPEG_END)
        # The decoder invents the pixels that a cut file lacks. In that case, more bytes change the picture.
        if not np.array_equal(picture, _decoded(data + FILLER + JPEG_END)):
            raise
        return picture


def _decoded(data: bytes) -> np.ndarray:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # large pictures are refused below
            image = Image.open(io.BytesIO(data), formats=('JPEG', 'PNG'))
            _check_size(*image.size)  # read from the header; nothing is decoded yet
            if image.mode not in MODES:
                raise UnusableImage(f'the image has pixels of kind {image.mode}: must have 8 bits per colour')
            image.draft('L', image.size)  # lets the JPEG decoder skip the colours
            return np.asarray(image.convert('L'))
    except UnusableImage:
        raise
    except UnidentifiedImageError as error:
        raise UnusableImage(f'the {len(data)} bytes are not a JPEG or PNG image') from error
    except Image.DecompressionBombError as error:  # Pillow's own, higher limit
        raise UnusableImage(f'the image claims too many pixels: at most {MOST_PIXELS} are allowed') from error
    except Exception as error:  # Pillow raises OSError, SyntaxError, ValueError, struct.error, zlib.error...
        raise UnusableImage(f'the image cannot be decoded: {error}') from error
