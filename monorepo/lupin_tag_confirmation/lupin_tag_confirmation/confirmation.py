"""Decide from the last frames whether the expected tag is in view. Does not import ROS."""

import itertools
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from lupin_greenhouse_bridge.errors import OneLineError, escaped, pluralized

from lupin_tag_confirmation.images import UnusableImage
from lupin_tag_confirmation.settings import Criteria

TAG_NUMBERS = {str(number): number for number in range(587)}  # the ids of tag36h11


class UnknownTagId(OneLineError):
    """An id that is not in the family tag36h11."""


def tag_number(tag_id: str) -> int:
    """Return the number of a decimal tag36h11 id; raises UnknownTagId."""
    if tag_id not in TAG_NUMBERS:
        shown, largest = escaped(tag_id, 40), len(TAG_NUMBERS) - 1
        raise UnknownTagId(f"tag '{shown}' is not an id of tag36h11: must be 0 to {largest} in decimal")
    return TAG_NUMBERS[tag_id]


class Detection(NamedTuple):
    """A tag of the family tag36h11 in a picture."""

    tag_number: int
    hamming: int  # bits that the detector corrected
    decision_margin: float  # contrast of the bits in grey levels, 0 to 255; 0.0 if unknown
    corners: np.ndarray  # shape (4, 2): x and y in pixels, counter-clockwise from the lower left


class Sight(NamedTuple):
    """The detections in one frame, and its image if there is one, as uint8 of the shape (height, width)."""

    detections: list[Detection]
    picture: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Frame:
    """One message of a camera or a detector. Its two times are seconds on different clocks."""

    look: Callable[[], Sight]  # decodes and searches; raises UnusableImage
    stamp_seconds: float
    arrival_seconds: float

    @cached_property
    def sight(self) -> Sight | UnusableImage:
        """What `look` returns or raises. It is called once."""
        try:
            return self.look()
        except UnusableImage as error:
            return error


class Moment(NamedTuple):
    """A moment on the clock of the stamps and on the clock of the arrivals, in seconds."""

    stamp_seconds: float
    arrival_seconds: float


class Verdict(NamedTuple):
    """The answer to one request, and the newest sight that it is based on."""

    confidence: float  # min(1, frames that show the tag / frames needed)
    reason: str  # why the tag is not confirmed, in one line; '' if it is
    sight: Sight | None


class Confirmer:
    """Keeps the last frames, and searches each at most once, only on request."""

    def __init__(self, criteria: Criteria):
        self._criteria = criteria
        # Twice as many as must show the tag: some may be blurred.
        self._most = 2 * criteria.min_frames
        self._waiting: deque[Frame] = deque(maxlen=self._most)
        self._chosen: list[Frame] = []  # to be searched, or searched

    def add(self, frame: Frame) -> None:
        """Keep a frame, in place of the oldest waiting one if there are too many."""
        self._waiting.append(frame)

    def confirm(self, tag_id: str, stamp_now_seconds: float, arrival_now_seconds: float) -> Verdict:
        """Search all frames, and return whether the camera sees this tag now. Raises UnknownTagId."""
        number, now = tag_number(tag_id), Moment(stamp_now_seconds, arrival_now_seconds)
        while self.choose(now, now):
            pass
        return self.judge(number, now, now)

    def choose(self, now: Moment, asked_at: Moment) -> bool:
        """Choose the newest waiting frame that counts for a request; return whether there was one."""
        for frame in reversed(self._waiting):
            if not self._fault_of_age(frame, now, asked_at):
                self._waiting.remove(frame)
                self._chosen = _by_arrival(frame, *self._chosen)[-self._most :]
                return True
        return False

    def judge(self, number: int, now: Moment, asked_at: Moment) -> Verdict:
        """Search the chosen frames, and return whether they confirm the tag of this number."""
        recent = [frame for frame in self._chosen if not self._fault_of_age(frame, now, asked_at)]
        sights = [frame.sight for frame in reversed(recent)]
        usable = [sight for sight in sights if isinstance(sight, Sight)]
        if not usable:
            frames = _by_arrival(*self._chosen, *self._waiting)
            fault = self._fault_of_age(frames[-1], now, asked_at) if frames else 'no image yet'
            return Verdict(0.0, f'tag {number}: {sights[0] if sights else fault}', None)
        sightings, reason = self._count(number, usable)
        needed = self._criteria.min_frames
        if sightings >= needed:
            return Verdict(1.0, '', usable[0])
        if len(recent) < needed:
            seconds = self._criteria.timeout_seconds or self._criteria.max_image_age_seconds
            reason = f'{pluralized(len(recent), "image")} in {seconds:g} s: {needed} are needed'
        return Verdict(sightings / needed, f'tag {number}: {reason}', usable[0])

    def _fault_of_age(self, frame: Frame, now: Moment, asked_at: Moment) -> str:
        """Return why a frame does not count: it was too old when the request came, or lies in the future."""
        longest = self._criteria.max_image_age_seconds
        if asked_at.arrival_seconds - frame.arrival_seconds > longest:
            age = now.arrival_seconds - frame.arrival_seconds
            return f'the last image came {age:.1f} s ago: older than {longest:g} s'
        age = now.stamp_seconds - frame.stamp_seconds
        if asked_at.stamp_seconds - frame.stamp_seconds > longest:
            return f'the last image is stamped {age:.1f} s ago: not within {longest:g} s'
        if -age > longest:
            return f'the last image is stamped {-age:.1f} s ahead: not within {longest:g} s'
        return ''

    def _count(self, number: int, sights: list[Sight]) -> tuple[int, str]:
        """Return how many of the sights, newest first, show the tag, and why the others do not."""
        flaws = [
            [self._criteria.flaw_of(tag) for tag in sight.detections if tag.tag_number == number]
            for sight in sights
        ]
        sightings = sum('' in each for each in flaws)
        others = {tag.tag_number for sight in sights for tag in sight.detections} - {number}
        if flaw := next(filter(None, itertools.chain(*flaws)), ''):
            return sightings, f'in view, but {flaw}'
        if sightings:
            return sightings, f'seen in {sightings} of the {self._criteria.min_frames} images needed'
        if others:
            return 0, f'other tag ids in view: {", ".join(map(str, sorted(others)))}'
        return 0, f'no tag in view in {pluralized(len(sights), "image")}'


def _by_arrival(*frames: Frame) -> list[Frame]:
    return sorted(frames, key=lambda frame: frame.arrival_seconds)
