"""The parameters of confirm_tag: where images come from, and what it takes to confirm a tag. No ROS here."""

from dataclasses import dataclass

from lupin_perception.errors import StartUpError
from lupin_perception.life_cycle import check_parameters, parameter

DEFAULT_IMAGE_TOPIC = '/camera/color/image_raw'
SOURCES = ('image_topic', 'compressed_image_topic', 'detections_topic')


@dataclass(frozen=True)
class Criteria:
    """What it takes to confirm a tag; raises StartUpError for a criterion out of its limits."""

    max_hamming: int = parameter(
        0, 'How many bits of the tag the detector may correct.', smallest=0, largest=2
    )
    min_decision_margin: float = parameter(
        20.0,
        'How clearly the bits of the tag must differ, in grey levels. A margin of exactly 0 is ignored.',
        smallest=0.0,
        largest=255.0,
    )
    min_frames: int = parameter(2, 'In how many recent images the tag must be seen.', smallest=1, largest=100)
    max_image_age_seconds: float = parameter(
        1.0,
        'How old an image may be, by its stamp and by its arrival, in seconds.',
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
    """The parameter values of one run, checked; raises StartUpError for one out of its limits."""

    timeout_seconds: float = parameter(
        1.0,
        'How long to watch for the tag before the answer is no, in seconds; 0.0: answer at once.',
        smallest=0.0,
        largest=60.0,
    )
    image_topic: str = parameter(
        DEFAULT_IMAGE_TOPIC, "The camera's sensor_msgs/Image topic; its default gives way to another source."
    )
    compressed_image_topic: str = parameter('', 'Instead: a sensor_msgs/CompressedImage topic, JPEG or PNG.')
    detections_topic: str = parameter(
        '', 'Instead: the apriltag_msgs/AprilTagDetectionArray topic of a detector that runs already.'
    )

    def __post_init__(self):
        super().__post_init__()
        self.source()

    def source(self) -> tuple[str, str]:
        """Return the name and the value of the parameter that tells where images come from."""
        chosen = [(name, getattr(self, name)) for name in SOURCES if getattr(self, name)]
        if len(chosen) > 1 and chosen[0] == ('image_topic', DEFAULT_IMAGE_TOPIC):
            del chosen[0]
        if len(chosen) != 1:
            problem = (
                ' and '.join(f'{each} is {topic}' for each, topic in chosen) or 'no source of images is set'
            )
            raise StartUpError(f'{problem}: set exactly one of {", ".join(SOURCES)}')
        return chosen[0]
