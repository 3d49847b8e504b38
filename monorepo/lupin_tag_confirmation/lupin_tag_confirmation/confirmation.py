"""Decide from the last frames whether the expected tag is in view. Does not import ROS."""

import itertools
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from lupin_greenhouse_bridge.errors import OneLineError, escaped, names_text, pluralized

from lupin_tag_confirmation.images import UnusableImage
from lupin_tag_confirmation.settings import Settings

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
    decision_margin: float  # contrast of the bits in grey levels, at least 0; 0.0 if unknown
    corners: np.ndarray  # shape (4, 2): x and y in pixels, counter-clockwise from the lower left

    def flaw(self, settings: Settings) -> str:
        """Return why this detection does not count; '' if it does."""
        if self.hamming > settings.max_hamming:
            return f'with {pluralized(self.hamming, "corrected bit")}, at most {settings.max_hamming} allowed'
        margin, least = self.decision_margin, settings.min_decision_margin
        if margin != 0.0 and not margin >= least:  # NaN does not count either
            return f'unclear: decision margin {margin:.0f}, {least:g} needed'
        return ''


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


_arrival = attrgetter('arrival_seconds')  # of a frame


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

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        # Twice as many as needed, because some may be blurred.
        self._most = 2 * settings.min_frames
        self._waiting: deque[Frame] = deque(maxlen=self._most)
        self._chosen: list[Frame] = []  # by arrival

    def add(self, frame: Frame) -> None:
        """Keep a frame, in place of the oldest waiting one if there are too many."""
        self._waiting.append(frame)

    def choose(self, now: Moment, asked_at: Moment) -> bool:
        """Choose the newest waiting frame that counts for a request; return whether there was one."""
        for frame in reversed(self._waiting):
            if not self._age_problem(frame, now, asked_at):
                self._waiting.remove(frame)
                self._chosen = sorted([frame, *self._chosen], key=_arrival)[-self._most :]
                return True
        return False

    def judge(self, number: int, now: Moment, asked_at: Moment) -> Verdict:
        """Search the chosen frames, and return whether they confirm the tag of this number."""
        recent = [frame for frame in self._chosen if not self._age_problem(frame, now, asked_at)]
        sights = [frame.sight for frame in reversed(recent)]
        usable = [sight for sight in sights if isinstance(sight, Sight)]
        if not usable:
            fault = sights[0] if sights else self._no_image(now, asked_at)
            return Verdict(0.0, f'tag {number}: {fault}', None)
        flaws = [
            [tag.flaw(self._settings) for tag in sight.detections if tag.tag_number == number]
            for sight in usable
        ]
        sightings, needed = sum('' in frame_flaws for frame_flaws in flaws), self._settings.min_frames
        if sightings >= needed:
            return Verdict(1.0, '', usable[0])
        others = {tag.tag_number for sight in usable for tag in sight.detections} - {number}
        if len(recent) < needed:
            seconds = self._settings.timeout_seconds or self._settings.max_image_age_seconds
            reason = f'{pluralized(len(recent), "image")} in {seconds:g} s: {needed} are needed'
        elif flaw := next(filter(None, itertools.chain(*flaws)), ''):
            reason = f'in view, but {flaw}'
        elif sightings:
            reason = f'seen in {sightings} of the {needed} images needed'
        elif others:
            ids = [str(other) for other in sorted(others)]
            reason = f'in view instead: {names_text("tag", ids, len(ids))}'
        else:
            reason = f'no tag in view in {pluralized(len(usable), "image")}'
        return Verdict(sightings / needed, f'tag {number}: {reason}', usable[0])

    def _no_image(self, now: Moment, asked_at: Moment) -> str:
        """Return why no frame counts for a request: the problem of the last one."""
        frames = sorted([*self._chosen, *self._waiting], key=_arrival)
        return self._age_problem(frames[-1], now, asked_at) if frames else 'no image yet'

    def _age_problem(self, frame: Frame, now: Moment, asked_at: Moment) -> str:
        """Return why a frame does not count: it was too old when the request came, or lies in the future."""
        longest = self._settings.max_image_age_seconds
        if asked_at.arrival_seconds - frame.arrival_seconds > longest:
            age = now.arrival_seconds - frame.arrival_seconds
            return f'the last image came {age:.1f} s ago: older than {longest:g} s'
        age = now.stamp_seconds - frame.stamp_seconds
        if asked_at.stamp_seconds - frame.stamp_seconds > longest:
            return f'the last image is stamped {age:.1f} s ago: not within {longest:g} s'
        if -age > longest:
            return f'the last image is stamped {-age:.1f} s ahead: not within {longest:g} s'
        return ''
