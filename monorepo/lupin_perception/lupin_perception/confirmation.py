"""Is the expected tag in view? Decided from the last few frames. No ROS here."""

import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lupin_perception.errors import OneLineError, printable
from lupin_perception.life_cycle import check_parameters, parameter

TAG_COUNT = 587  # tag36h11 has the ids 0 to 586


class UnknownTagId(OneLineError):
    """An id that no tag36h11 has."""


def tag_number(tag_id: str) -> int:
    """Return the number of a tag36h11 id in decimal; raises UnknownTagId."""
    if not re.fullmatch(r'0|[1-9][0-9]{0,2}', tag_id) or int(tag_id) >= TAG_COUNT:
        shown = printable(tag_id, 40)
        raise UnknownTagId(f"tag '{shown}' is not an id of tag36h11: must be 0 to {TAG_COUNT - 1} in decimal")
    return int(tag_id)


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
    """Keeps the last frames, and looks for tags in them only when asked: once in each, for all who ask."""

    def __init__(self, detect: Callable[[np.ndarray], list[Detection]], criteria: Criteria):
        self._detect = detect
        self._criteria = criteria
        # Twice as many as must show the tag: one may be blurred.
        self._frames: deque[Frame] = deque(maxlen=2 * criteria.min_frames)
        self._detections: dict[int, list[Detection]] = {}  # by id() of a frame that is kept
        self.refusal = ''  # why the last image could not be used

    def add(self, frame: Frame) -> None:
        """Keep a frame, in the place of the oldest."""
        self._frames.append(frame)
        kept = set(map(id, self._frames))
        self._detections = {key: found for key, found in self._detections.items() if key in kept}
        self.refusal = ''

    def confirm(self, tag_id: str, stamp_now_seconds: float, arrival_now_seconds: float) -> tuple[float, str]:
        """
        Return the confidence that the camera sees the tag, and in one line why it does not; '' when it does.

        The confidence is min(1, frames that show the tag / frames needed). Raises UnknownTagId.
        """
        number = tag_number(tag_id)
        refused = f'; an image was refused: {self.refusal}' if self.refusal else ''
        faults = [self._fault_of_age(each, stamp_now_seconds, arrival_now_seconds) for each in self._frames]
        recent = [frame for frame, fault in zip(self._frames, faults, strict=True) if not fault]
        if not recent:
            return 0.0, f'tag {number}: {faults[-1] if faults else "no usable image yet"}{refused}'
        sightings, reason = self._look(number, recent)
        if sightings >= self._criteria.min_frames:
            return 1.0, ''
        return sightings / self._criteria.min_frames, f'tag {number}: {reason}'

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

    def _look(self, number: int, frames: list[Frame]) -> tuple[int, str]:
        """Return in how many frames the tag is, and what is in the way of more."""
        sightings = 0
        flaws: list[str] = []
        others: set[int] = set()
        for frame in reversed(frames):
            if id(frame) not in self._detections:
                self._detections[id(frame)] = self._detect(frame.picture)
            detections = self._detections[id(frame)]
            others.update({each.tag_number for each in detections} - {number})
            found = [self._flaw_of(each) for each in detections if each.tag_number == number]
            flaws += filter(None, found)
            sightings += '' in found
        if flaws:
            return sightings, f'in view, but {flaws[0]}'
        if sightings:
            return sightings, f'seen in {sightings} frames of {self._criteria.min_frames} needed'
        if others:
            return 0, f'other tags in view: {", ".join(map(str, sorted(others)))}'
        return 0, f'no tag in view in {len(frames)} frames'

    def _flaw_of(self, detection: Detection) -> str:
        criteria = self._criteria
        if detection.side_pixels < criteria.min_side_pixels:
            return f'small: {detection.side_pixels:.0f} pixels a side, {criteria.min_side_pixels:g} needed'
        if detection.sharpness < criteria.min_sharpness:
            return f'blurred: sharpness {detection.sharpness:.2f}, {criteria.min_sharpness:g} needed'
        return ''
