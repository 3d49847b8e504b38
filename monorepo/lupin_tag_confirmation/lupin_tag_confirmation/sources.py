"""The sources of confirm_tag: images, compressed images, or the detections of another node."""

from collections.abc import Callable
from typing import Any

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_readings.detections import FAMILIES, detection_messages
from sensor_msgs.msg import CompressedImage, Image

from lupin_tag_confirmation.confirmation import Detection, Sight
from lupin_tag_confirmation.images import decoded_picture, grey_picture
from lupin_tag_confirmation.settings import Settings


def open_source(settings: Settings) -> tuple[type, Callable[[Any], Sight]]:
    """
    Return the type of the messages, and the function that turns one into a Sight or raises UnusableImage.

    Raises StartUpError if a package that the source needs is missing.
    """
    if settings.source == 'detections':
        return detection_messages().AprilTagDetectionArray, detections_of
    try:
        from lupin_tag_confirmation.detector import TagDetector  # late: a missing library is a one-line error
    except ImportError as error:
        problem = f'the AprilTag library is missing ({error}): sudo apt install python3-apriltag'
        raise StartUpError(problem) from error
    detector = TagDetector(settings.max_hamming)

    def sight_of(message: Any) -> Sight:
        if settings.source == 'compressed':
            picture = decoded_picture(message.data)
        else:
            size = message.height, message.width, message.step
            picture = grey_picture(message.encoding, *size, message.data)
        return Sight(detector.detect(picture), picture)

    return {'image': Image, 'compressed': CompressedImage}[settings.source], sight_of


def detections_of(message: Any) -> Sight:
    """Return the detections of tag36h11; other families are ignored."""
    detections = []
    for tag in message.detections:
        if tag.family in FAMILIES:
            corners = np.array([(corner.x, corner.y) for corner in tag.corners])
            detections.append(Detection(tag.id, tag.hamming, tag.decision_margin, corners))
    return Sight(detections)
