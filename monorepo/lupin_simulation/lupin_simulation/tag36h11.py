"""The tags of the family tag36h11 as images, which OpenCV draws."""

from typing import Any

import cv2
import numpy as np

MODULES = 8  # along a side, with the black border


def marker(tag_number: int, module_pixels: int = 1) -> np.ndarray:
    """
    Return a tag with its black border, without its white border, and upside down, as OpenCV draws it.

    Each of the MODULES x MODULES modules is a square of `module_pixels`, uint8, 0 or 255.
    """
    aruco: Any = cv2.aruco
    if hasattr(aruco, 'generateImageMarker'):
        dictionary, draw = aruco.getPredefinedDictionary(aruco.DICT_APRILTAG_36h11), aruco.generateImageMarker
    else:  # before OpenCV 4.7
        dictionary, draw = aruco.Dictionary_get(aruco.DICT_APRILTAG_36h11), aruco.drawMarker
    image: np.ndarray = draw(dictionary, tag_number, MODULES * module_pixels)
    return image


def printed_marker(tag_number: int) -> np.ndarray:
    """Return a tag as the AprilTag project prints it, with one pixel for each module."""
    return np.rot90(marker(tag_number), 2)
