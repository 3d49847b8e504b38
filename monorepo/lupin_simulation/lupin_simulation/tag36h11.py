"""The tags of the family tag36h11 as images, which OpenCV draws."""

import cv2
import numpy as np

MODULES = 8  # along a side, with the black border


def marker(tag_number: int, module_pixels: int = 1) -> np.ndarray:
    """
    Return a tag with its black border and without its white one, as OpenCV draws it: upside down.

    Each of the MODULES x MODULES modules is a square of `module_pixels`, uint8, 0 or 255.
    """
    side_pixels = MODULES * module_pixels
    if hasattr(cv2.aruco, 'generateImageMarker'):
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        return cv2.aruco.generateImageMarker(dictionary, tag_number, side_pixels)
    dictionary = cv2.aruco.Dictionary_get(cv2.aruco.DICT_APRILTAG_36h11)  # before OpenCV 4.7
    return cv2.aruco.drawMarker(dictionary, tag_number, side_pixels)


def printed_marker(tag_number: int) -> np.ndarray:
    """Return a tag as the AprilTag project prints it, with one pixel for each module."""
    return np.rot90(marker(tag_number), 2)
