"""From the bytes of a sensor_msgs/Image to a grey picture. No ROS here."""

import numpy as np

# Channels per pixel, and where red, green and blue are among them; a fourth (alpha) is left aside.
ENCODINGS = {
    'mono8': (1, None),
    'rgb8': (3, (0, 1, 2)),
    'bgr8': (3, (2, 1, 0)),
    'rgba8': (4, (0, 1, 2)),
    'bgra8': (4, (2, 1, 0)),
}
LARGEST_SIDE_PIXELS = 16384
# Luma of ITU-R BT.601, in 256ths.
RED, GREEN, BLUE = 77, 150, 29


class UnusableImage(ValueError):
    """An image that cannot be read; the text says why, in one line."""


def grey_picture(encoding: str, height: int, width: int, step: int, data) -> np.ndarray:
    """
    Return the picture as uint8 of the shape (height, width).

    `step` is the length of a row in bytes and may be longer than the pixels need; `data` holds at least
    height * step bytes. Bytes have no order, so is_bigendian says nothing about these encodings.
    Raises UnusableImage.
    """
    if encoding not in ENCODINGS:
        raise UnusableImage(f'encoding {encoding[:40]!r} is not one of {", ".join(ENCODINGS)}')
    channels, colours = ENCODINGS[encoding]
    if not (0 < height <= LARGEST_SIDE_PIXELS and 0 < width <= LARGEST_SIDE_PIXELS):
        raise UnusableImage(f'{width} x {height} pixels: each side must be 1 to {LARGEST_SIDE_PIXELS}')
    if step < width * channels:
        raise UnusableImage(f'step is {step} bytes, and {width} pixels of {encoding} need {width * channels}')
    values = np.frombuffer(data, dtype=np.uint8)
    if values.size < height * step:
        raise UnusableImage(f'data has {values.size} bytes, and {height} rows of {step} need {height * step}')
    rows = values[: height * step].reshape(height, step)[:, : width * channels]
    if colours is None:
        return np.ascontiguousarray(rows)
    red, green, blue = (rows[:, each::channels].astype(np.uint16) for each in colours)
    return ((RED * red + GREEN * green + BLUE * blue) >> 8).astype(np.uint8)
