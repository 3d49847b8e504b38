"""Turn image messages into grey pictures. Does not import ROS."""

import io
import warnings

import numpy as np
from PIL import Image

# Channels per pixel, and the positions of red, green and blue. A fourth channel (alpha) is ignored.
ENCODINGS = {
    'mono8': (1, None),
    '8UC1': (1, None),
    'rgb8': (3, (0, 1, 2)),
    'bgr8': (3, (2, 1, 0)),
    'rgba8': (4, (0, 1, 2)),
    'bgra8': (4, (2, 1, 0)),
}
SMALLEST_SIDE_PIXELS = 16  # AprilTag 3.3.0 and 3.4.5 crash on pictures of one or two rows
LARGEST_SIDE_PIXELS = 16384
MOST_PIXELS = 2**24  # more would keep the node busy for seconds
# Luma of ITU-R BT.601, in 256ths.
RED, GREEN, BLUE = 77, 150, 29
# Pillow's modes with at most 8 bits per channel. Depth pictures (16 bits) are refused.
MODES = ('1', 'L', 'LA', 'P', 'RGB', 'RGBA', 'YCbCr', 'CMYK')


class UnusableImage(ValueError):
    """An image that cannot be read; the text gives the reason in one line."""


def _check_size(width: int, height: int) -> None:
    if not all(SMALLEST_SIDE_PIXELS <= each <= LARGEST_SIDE_PIXELS for each in (width, height)):
        limits = f'{SMALLEST_SIDE_PIXELS} to {LARGEST_SIDE_PIXELS}'
        raise UnusableImage(f'the image has {width} x {height} pixels: each side must have {limits}')
    if width * height > MOST_PIXELS:
        raise UnusableImage(f'the image has {width} x {height} pixels: at most {MOST_PIXELS} are allowed')


def grey_picture(encoding: str, height: int, width: int, step: int, data) -> np.ndarray:
    """
    Return the picture of a sensor_msgs/Image as uint8 of the shape (height, width).

    `step` is the length of a row in bytes, padding included. `data` holds at least height * step bytes. All
    encodings have one byte per channel, so is_bigendian does not matter. Raises UnusableImage.
    """
    if encoding not in ENCODINGS:
        raise UnusableImage(f'encoding {encoding[:40]!r} is not one of {", ".join(ENCODINGS)}')
    channels, colours = ENCODINGS[encoding]
    _check_size(width, height)
    if step < width * channels:
        raise UnusableImage(f'step is {step} bytes, but {width} pixels of {encoding} need {width * channels}')
    values = np.frombuffer(data, dtype=np.uint8)
    if values.size < height * step:
        raise UnusableImage(f'data has {values.size} bytes, but {height} rows of {step} need {height * step}')
    rows = values[: height * step].reshape(height, step)[:, : width * channels]
    if colours is None:
        return np.ascontiguousarray(rows)
    red, green, blue = (rows[:, each::channels] for each in colours)
    # Integer arithmetic in place takes a quarter of the time of floats.
    luma = np.multiply(green, GREEN, dtype=np.uint16)
    luma += np.multiply(red, RED, dtype=np.uint16)
    luma += np.multiply(blue, BLUE, dtype=np.uint16)
    luma >>= 8
    return luma.astype(np.uint8)


def decoded_picture(data) -> np.ndarray:
    """Return the picture in a JPEG or PNG as uint8 of the shape (height, width); raises UnusableImage."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # about large pictures, which are limited below
            image = Image.open(io.BytesIO(data), formats=('JPEG', 'PNG'))
            _check_size(*image.size)  # read from the header; nothing is decoded yet
            if image.mode not in MODES:
                raise UnusableImage(f'the image has pixels of kind {image.mode}: must have 8 bits per colour')
            image.draft('L', image.size)  # lets the JPEG decoder skip the colours
            return np.asarray(image.convert('L'))
    except UnusableImage:
        raise
    except Image.UnidentifiedImageError as error:
        raise UnusableImage(f'the {len(data)} bytes are not a JPEG or PNG image') from error
    except Image.DecompressionBombError as error:  # Pillow's own, higher limit
        raise UnusableImage(f'the image claims too many pixels: at most {MOST_PIXELS} are allowed') from error
    except Exception as error:  # Pillow raises OSError, SyntaxError, ValueError, struct.error, zlib.error...
        raise UnusableImage(f'the image cannot be decoded: {error}') from error
