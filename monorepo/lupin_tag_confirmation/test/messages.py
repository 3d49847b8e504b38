"""The messages of cameras and detectors, for tests."""

import io

import cv2
import numpy as np
from apriltag_msgs.msg import AprilTagDetection, AprilTagDetectionArray
from PIL import Image as PictureFile
from sensor_msgs.msg import CompressedImage, Image

COLOURS = {'mono8': 1, '8UC1': 1, 'rgb8': 3, 'bgr8': 3, 'rgba8': 4, 'bgra8': 4}


def marker(tag_number: int, module_pixels: int) -> np.ndarray:
    """Return a tag36h11 as uint8, with its black border and without the white margin."""
    if hasattr(cv2.aruco, 'generateImageMarker'):
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        return cv2.aruco.generateImageMarker(dictionary, tag_number, 8 * module_pixels)
    dictionary = cv2.aruco.Dictionary_get(cv2.aruco.DICT_APRILTAG_36h11)  # before OpenCV 4.7
    return cv2.aruco.drawMarker(dictionary, tag_number, 8 * module_pixels)


def picture_of_tag(tag_number: int) -> np.ndarray:
    """
    Return a picture of a tag, uint8 of the shape (240, 320).

    It is small, 300 kB in four colours: on a busy machine, best effort loses large images.
    """
    return np.pad(marker(tag_number, 10), ((80, 80), (120, 120)), constant_values=200)


def image_of(picture: np.ndarray, encoding='mono8', padding=0, **fields) -> Image:
    """Return a message of a grey picture; padding lengthens its rows, and `fields` replace its fields."""
    height, width = picture.shape
    channels = COLOURS.get(encoding, 1)
    rows = np.repeat(picture, channels, axis=1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    message = Image(height=height, width=width, encoding=encoding, step=rows.shape[1], data=rows.tobytes())
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def compressed(picture: np.ndarray, kind: str) -> CompressedImage:
    """Return the message of a grey picture, as JPEG or PNG."""
    data = io.BytesIO()
    PictureFile.fromarray(picture).save(data, kind)
    return CompressedImage(format=f'mono8; {kind.lower()} compressed ', data=data.getvalue())


def detections(*tags: tuple, family='tag36h11') -> AprilTagDetectionArray:
    """Return the message of a detector for tags of (number, hamming, margin)."""
    return AprilTagDetectionArray(
        detections=[
            AprilTagDetection(family=family, id=number, hamming=hamming, decision_margin=margin)
            for number, hamming, margin in tags
        ]
    )
