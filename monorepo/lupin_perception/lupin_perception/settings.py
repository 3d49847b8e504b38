"""The parameters of confirm_tag: where images come from, and what it takes to confirm a tag. No ROS here."""

from dataclasses import dataclass

from lupin_perception.confirmation import Criteria
from lupin_perception.life_cycle import parameter


@dataclass(frozen=True)
class Settings(Criteria):
    """The parameter values of one run, checked; raises StartUpError on one out of its limits."""

    timeout_seconds: float = parameter(
        1.0,
        'How long to watch for the tag before the answer is no, in seconds; 0.0: answer at once.',
        smallest=0.0,
        largest=60.0,
    )
    image_topic: str = parameter('/camera/image_raw', "The camera's sensor_msgs/Image topic.")
