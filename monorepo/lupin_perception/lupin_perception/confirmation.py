"""Is the expected tag in view? Decided from the last few frames. No ROS here."""

import re
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lupin_perception.life_cycle import check_parameters, parameter

TAG_COUNT = 587  # tag36h11 has the ids 0 to 586


@dataclass(frozen=True)
class Detection:
    """A tag in a picture."""

    tag_number: int
    side_pixels: float  # of its shortest side, black border included
    sharpness: float  # 0 to 1: how much of the variance of its pixels black and white explain


@dataclass(frozen=True)
class Criteria:
    """What it takes to confirm a tag; raises StartUpError on a criterion out of its limits."""

    max_image_age_seconds: float = parameter(
        1.0,
        'How old an image may be, by its stamp and by its arrival, in seconds.',
        smallest=0.001,
        largest=3600.0,
    )
    min_side_pixels: float = parameter(
        24.0,
        'How long the shortest side of the tag, black border included, must be, in pixels.',
        smallest=1.0,
        largest=1e5,
    )
    min_sharpness: float = parameter(
        0.75,
        'How well black and white explain the pixels of the tag: 0 to 1, without any grey.',
        smallest=0.0,
        largest=1.0,
    )
    min_frames: int = parameter(2, 'In how many recent images the tag must be seen.', smallest=1, largest=100)

    def __post_init__(self):
        check_parameters(self)


class Frame(NamedTuple):
    """A picture and when it was taken, by its own stamp and by its arrival; seconds of the two clocks."""

    picture: np.ndarray
    stamp_seconds: float
    arrival_seconds: float


class Confirmer:
    """Keeps the last frames, and looks for a tag in them only when asked."""

    def __init__(self, detect: Callable[[np.ndarray], list[Detection]], criteria: Criteria):
        self._detect = detect
        self._criteria = criteria
        # Twice as many as must show the tag: one may be blurred.
        self._frames: deque[Frame] = deque(maxlen=2 * criteria.min_frames)
        self.refusal = ''  # why the last image could not be used

    def add(self, frame: Frame) -> None:
        """Keep a frame, in the place of the oldest."""
        self._frames.append(frame)
        self.refusal = ''

    def confirm(self, tag_id: str, stamp_now_seconds: float, arrival_now_seconds: float) -> tuple[float, str]:
        """
        Return the confidence that the camera sees the tag, and in one line why it is below 1.

        The confidence is min(1, frames that show the tag / frames needed).
        """
        if not re.fullmatch(r'0|[1-9][0-9]{0,2}', tag_id) or int(tag_id) >= TAG_COUNT:
            return 0.0, f'{tag_id[:40]!r} is no id of tag36h11: give 0 to {TAG_COUNT - 1} in decimal'
        refused = f'; an image was refused: {self.refusal}' if self.refusal else ''
        if not self._frames:
            return 0.0, f'no usable image yet{refused}'
        recent = [
            frame
            for frame in self._frames
            if not self._fault_of_age(frame, stamp_now_seconds, arrival_now_seconds)
        ]
        if not recent:
            fault = self._fault_of_age(self._frames[-1], stamp_now_seconds, arrival_now_seconds)
            return 0.0, fault + refused
        return self._look(int(tag_id), recent)

    def _fault_of_age(self, frame: Frame, stamp_now_seconds: float, arrival_now_seconds: float) -> str:
        longest = self._criteria.max_image_age_seconds
        age = arrival_now_seconds - frame.arrival_seconds
        if age > longest:
            return f'the last image came {age:.1f} s ago: older than {longest:g} s'
        age = stamp_now_seconds - frame.stamp_seconds
        if abs(age) > longest:
            where = 'ago' if age > 0.0 else 'ahead'
            return f'the last image is stamped {abs(age):.1f} s {where}: not within {longest:g} s'
        return ''

    def _look(self, tag_number: int, frames: list[Frame]) -> tuple[float, str]:
        sightings = 0
        flaws: list[str] = []
        others: Counter[int] = Counter()
        for frame in reversed(frames):
            detections = self._detect(frame.picture)
            expected = [each for each in detections if each.tag_number == tag_number]
            others.update({each.tag_number for each in detections} - {tag_number})
            found = [self._flaw_of(each) for each in expected]
            flaws += filter(None, found)
            sightings += '' in found
            if sightings == self._criteria.min_frames:
                return 1.0, ''
        if sightings:
            needed = self._criteria.min_frames
            reason = (
                f'is in view, but {flaws[0]}' if flaws else f'seen in {sightings} frames of {needed} needed'
            )
            return sightings / needed, f'tag {tag_number} {reason}'
        if flaws:
            return 0.0, f'tag {tag_number} is in view, but {flaws[0]}'
        if others:
            return 0.0, f'other tags in view: {", ".join(map(str, sorted(others)))}'
        return 0.0, f'no tag in view in {len(frames)} frames'

    def _flaw_of(self, detection: Detection) -> str:
        criteria = self._criteria
        if detection.side_pixels < criteria.min_side_pixels:
            return f'small: {detection.side_pixels:.0f} pixels a side, {criteria.min_side_pixels:g} needed'
        if detection.sharpness < criteria.min_sharpness:
            return f'blurred: sharpness {detection.sharpness:.2f}, {criteria.min_sharpness:g} needed'
        return ''
