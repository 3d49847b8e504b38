"""OpenCV's detector of tag36h11 tags, with OpenCV 4.5.4 (Ubuntu 22.04) and newer. No ROS here."""

import cv2
import numpy as np

from lupin_perception.confirmation import Detection

SAMPLE_PIXELS = 80  # a tag is 8 modules wide, its black border included
# Of the 11 bits that two tags differ in at least, OpenCV may correct 5 (at 1.0). One is enough for a tag
# that is sharp, and keeps other families out (the figures are in the README).
ERROR_CORRECTION_RATE = 0.2


class TagDetector:
    """Finds tag36h11 tags."""

    def __init__(self):
        """Set it up; raises AttributeError where OpenCV was built without its aruco module."""
        aruco = cv2.aruco
        is_old = not hasattr(aruco, 'ArucoDetector')  # before OpenCV 4.7
        parameters = aruco.DetectorParameters_create() if is_old else aruco.DetectorParameters()
        parameters.errorCorrectionRate = ERROR_CORRECTION_RATE
        parameters.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
        if is_old:
            # The edge of the paper is a square too, one module out; by default the two are taken for one, and
            # the paper is kept.
            parameters.minMarkerDistanceRate = 0.01
            dictionary = aruco.Dictionary_get(aruco.DICT_APRILTAG_36h11)
            dictionary.maxCorrectionBits = 5  # as newer ones know it; here 0
            self._detect = lambda picture: aruco.detectMarkers(picture, dictionary, parameters=parameters)
        else:
            dictionary = aruco.getPredefinedDictionary(aruco.DICT_APRILTAG_36h11)
            self._detect = aruco.ArucoDetector(dictionary, parameters).detectMarkers

    def detect(self, picture: np.ndarray) -> list[Detection]:
        """Return the tags in a uint8 picture of the shape (height, width)."""
        corners, numbers, _ = self._detect(picture)
        if numbers is None:
            return []
        return [
            Detection(
                int(number), _shortest_side(quad.reshape(4, 2)), _sharpness(picture, quad.reshape(4, 2))
            )
            for number, quad in zip(numbers.ravel(), corners, strict=True)
        ]


def _shortest_side(quad: np.ndarray) -> float:
    return float(np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1).min())


def _sharpness(picture: np.ndarray, quad: np.ndarray) -> float:
    """
    Return the separability of the tag's pixels into black and white: 1.0 without any grey between.

    N. Otsu, A Threshold Selection Method from Gray-Level Histograms, 1979: eta. Blur and noise lower it, the
    brightness does not change it, and neither does the distance, for the tag is brought to one size first.
    """
    side = SAMPLE_PIXELS - 1
    square = np.array([[0, 0], [side, 0], [side, side], [0, side]], dtype=np.float32)
    to_square = cv2.getPerspectiveTransform(quad.astype(np.float32), square)
    sample = cv2.warpPerspective(picture, to_square, (SAMPLE_PIXELS, SAMPLE_PIXELS))
    threshold, _ = cv2.threshold(sample, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    is_white = sample > threshold
    share = is_white.mean()
    if sample.var() == 0.0 or share in (0.0, 1.0):
        return 0.0
    between = share * (1.0 - share) * (sample[is_white].mean() - sample[~is_white].mean()) ** 2
    return float(between / sample.var())
