"""The parameters of confirm_tag: the source of images, and when a tag counts as seen. Does not import ROS."""

from dataclasses import dataclass

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, parameter

TOPICS = {
    'image': 'camera/color/image_raw',
    'compressed': 'camera/color/image_raw/compressed',
    'detections': 'detections',
}


def check_source(name: str, value: str) -> None:
    """Raise StartUpError if a parameter does not name a source."""
    if value not in TOPICS:
        raise StartUpError(f'parameter {name} is {value!r}: must be image, compressed or detections')


@dataclass(frozen=True)
class Settings:
    """
    The validated parameters of one run; raises StartUpError for an invalid value.

    doc/confirm_tag.md describes each parameter in detail.
    """

    source: str = parameter('image', 'image, compressed (JPEG or PNG), or detections (of another node).')
    min_frames: int = parameter(2, 'Number of recent images that must show the tag.', smallest=1, largest=100)
    max_image_age_seconds: float = parameter(
        1.0, 'Maximum age of an image when the service is called.', smallest=0.001, largest=3600.0
    )
    timeout_seconds: float = parameter(  # the team's mission waits 3.0 s
        2.0, 'Seconds to look for the tag; 0.0: reply at once.', smallest=0.0, largest=60.0
    )
    max_hamming: int = parameter(0, 'Maximum number of corrected bits of a tag.', smallest=0, largest=2)
    min_decision_margin: float = parameter(
        20.0, "Minimum contrast of the tag's bits in grey levels.", smallest=0.0, largest=255.0
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        check_source('source', self.source)
