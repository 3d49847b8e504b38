"""The sources of confirm_tag: images, compressed images, or the detections of another node."""

from collections.abc import Callable
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.reading.detections import FAMILIES, detection_messages
from sensor_msgs.msg import CompressedImage, Image

from lupin_tag_confirmation.confirmation import Detection, Sight
from lupin_tag_confirmation.images import decoded_picture, grey_picture
from lupin_tag_confirmation.settings import TOPICS, Settings


class Source(NamedTuple):
    """A topic, and the function that turns one of its messages into a Sight or raises UnusableImage."""

    message_type: type
    topic: str
    sight_of: Callable[..., Sight]


def open_source(settings: Settings) -> Source:
    """Return the source of the settings; raises StartUpError if a package that it needs is missing."""
    topic = TOPICS[settings.source]
    if settings.source == 'detections':
        return Source(detection_messages().AprilTagDetectionArray, topic, detections_of)
    message_type, picture_of = _PICTURES[settings.source]
    detect = _detector(settings).detect

    def sight_of(message) -> Sight:
        picture = picture_of(message)
        return Sight(detect(picture), picture)

    return Source(message_type, topic, sight_of)


def detections_of(message) -> Sight:
    """Return the detections of tag36h11; other families are ignored."""
    return Sight(
        [
            Detection(tag.id, tag.hamming, tag.decision_margin, [(each.x, each.y) for each in tag.corners])
            for tag in message.detections
            if tag.family in FAMILIES
        ]
    )


def _detector(settings: Settings):
    try:
        from lupin_tag_confirmation.detector import TagDetector  # here: a missing library is a one-line error
    except ImportError as error:
        raise StartUpError(
            f'the AprilTag library is missing ({error}): sudo apt install python3-apriltag'
        ) from error
    return TagDetector(settings.max_hamming)


_PICTURES = {
    'image': (Image, lambda each: grey_picture(each.encoding, each.height, each.width, each.step, each.data)),
    'compressed': (CompressedImage, lambda each: decoded_picture(each.data)),
}
