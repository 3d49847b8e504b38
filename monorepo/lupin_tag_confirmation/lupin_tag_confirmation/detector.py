"""AprilTag 3, from Debian's and Ubuntu's package python3-apriltag or from a wheel. Does not import ROS."""

import contextlib
import io

import numpy as np

with contextlib.redirect_stdout(io.StringIO()):  # the wheel prints a line if OpenCV is missing
    from apriltag import apriltag

from lupin_tag_confirmation.confirmation import Detection

FAMILY = 'tag36h11'


class TagDetector:
    """Finds tag36h11 tags."""

    def __init__(self, max_hamming: int = 0):
        """`max_hamming` is the number of wrong bits that the library corrects, 0 to 2."""
        # No decimation: it would lose tags of less than 30 pixels.
        self._detector = apriltag(FAMILY, maxhamming=max_hamming, decimate=1.0)

    def detect(self, picture: np.ndarray) -> list[Detection]:
        """Return the tags in a uint8 picture of the shape (height, width), both at least 3."""
        return [
            Detection(tag['id'], tag['hamming'], tag['margin'], tag['lb-rb-rt-lt'])
            for tag in self._detector.detect(picture)
        ]
