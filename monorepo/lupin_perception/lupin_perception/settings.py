"""The parameters of confirm_tag: the source of images, and the criteria. Does not import ROS."""

from dataclasses import dataclass

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.node.parameters import check_parameters, parameter

DEFAULT_IMAGE_TOPIC = 'camera/color/image_raw'
SOURCES = ('image_topic', 'compressed_image_topic', 'detections_topic')


@dataclass(frozen=True)
class Criteria:
    """The criteria for a tag. Raises StartUpError for a value outside its limits."""

    max_hamming: int = parameter(
        0, 'Bits of the tag that the detector may correct, at most.', smallest=0, largest=2
    )
    min_decision_margin: float = parameter(
        20.0,
        'Contrast of the bits, at least, in grey levels. A margin of exactly 0 is unknown, and accepted.',
        smallest=0.0,
        largest=255.0,
    )
    min_frames: int = parameter(2, 'Recent images that must show the tag.', smallest=1, largest=100)
    max_image_age_seconds: float = parameter(
        1.0,
        'Age of an image in seconds, at most, by its stamp and by its arrival.',
        smallest=0.001,
        largest=3600.0,
    )

    def __post_init__(self):
        check_parameters(self)

    def flaw_of(self, detection) -> str:
        """Return why a Detection does not count; '' if it does."""
        if detection.hamming > self.max_hamming:
            return f'{detection.hamming} bits were corrected, at most {self.max_hamming} are allowed'
        if detection.decision_margin != 0.0 and not detection.decision_margin >= self.min_decision_margin:
            margin = f'{detection.decision_margin:.0f}'
            return f'unclear: decision margin {margin}, {self.min_decision_margin:g} needed'
        return ''


@dataclass(frozen=True)
class Settings(Criteria):
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    timeout_seconds: float = parameter(
        1.0,
        'Seconds to look for the tag before the answer is no; 0.0: answer at once.',
        smallest=0.0,
        largest=60.0,
    )
    image_topic: str = parameter(
        DEFAULT_IMAGE_TOPIC,
        "The camera's sensor_msgs/Image topic; ignored by default if another source is set.",
    )
    compressed_image_topic: str = parameter('', 'Instead: a sensor_msgs/CompressedImage topic, JPEG or PNG.')
    detections_topic: str = parameter(
        '', 'Instead: the apriltag_msgs/AprilTagDetectionArray topic of a running detector.'
    )

    def __post_init__(self):
        super().__post_init__()
        self.source()

    def source(self) -> tuple[str, str]:
        """Return the name and the value of the parameter that selects the source."""
        chosen = [(name, getattr(self, name)) for name in SOURCES if getattr(self, name)]
        if len(chosen) > 1 and chosen[0] == ('image_topic', DEFAULT_IMAGE_TOPIC):
            del chosen[0]
        if len(chosen) != 1:
            problem = (
                ' and '.join(f'{each} is {topic}' for each, topic in chosen) or 'no source of images is set'
            )
            raise StartUpError(f'{problem}: set exactly one of {", ".join(SOURCES)}')
        return chosen[0]
