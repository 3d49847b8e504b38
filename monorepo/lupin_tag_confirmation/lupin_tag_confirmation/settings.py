"""The parameters of confirm_tag: the source of images, and the criteria. Does not import ROS."""

from dataclasses import dataclass

from lupin_greenhouse_bridge.errors import StartUpError, pluralized
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
class Criteria:
    """The criteria for a tag. Raises StartUpError for a value outside its limits."""

    max_hamming: int = parameter(
        0, 'Maximum number of bits of the tag that the detector may correct.', smallest=0, largest=2
    )
    min_decision_margin: float = parameter(
        20.0,
        "Minimum contrast of the tag's bits in grey levels; a tag with a reported contrast of 0 counts too,"
        ' because some detectors always report 0.',
        smallest=0.0,
        largest=255.0,
    )
    min_frames: int = parameter(2, 'Number of recent images that must show the tag.', smallest=1, largest=100)
    max_image_age_seconds: float = parameter(
        1.0,
        'Maximum age of an image in seconds when the service is called; neither its stamp nor its arrival'
        ' may be older.',
        smallest=0.001,
        largest=3600.0,
    )
    timeout_seconds: float = parameter(
        2.0,  # the team's mission waits 3.0 s
        'Seconds to look for the tag before the node replies that it does not see it; 0.0: reply at once.',
        smallest=0.0,
        largest=60.0,
    )

    def __post_init__(self):
        check_parameters(self)

    def flaw_of(self, detection) -> str:
        """Return why a Detection does not count; '' if it does."""
        if detection.hamming > self.max_hamming:
            bits = pluralized(detection.hamming, 'corrected bit')
            return f'with {bits}, at most {self.max_hamming} allowed'
        if detection.decision_margin != 0.0 and not detection.decision_margin >= self.min_decision_margin:
            margin = f'{detection.decision_margin:.0f}'
            return f'unclear: decision margin {margin}, {self.min_decision_margin:g} needed'
        return ''


@dataclass(frozen=True)
class Settings(Criteria):
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    source: str = parameter(
        'image', 'image, compressed (JPEG or PNG), or detections (from a detector that is already running).'
    )

    def __post_init__(self):
        super().__post_init__()
        check_source('source', self.source)
