"""What an AprilTag detector sees: its messages, and which tag to request next. Importable without ROS."""

import importlib
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

from lupin_greenhouse_bridge.errors import StartUpError

if TYPE_CHECKING:
    from lupin_readings.read_on_sight import Settings

# One family under two names: apriltag_ros uses the first, apriltag_detector the second.
FAMILIES = ('tag36h11', 'tf36h11')


def detection_messages() -> ModuleType:
    """Return the module apriltag_msgs.msg; raises StartUpError if that package is missing."""
    try:
        return importlib.import_module('apriltag_msgs.msg')
    except ImportError as error:
        raise StartUpError(
            f'detections need the package apriltag_msgs ({error}):'
            ' sudo apt install ros-$ROS_DISTRO-apriltag-msgs'
        ) from error


@dataclass
class _Sighting:
    """A tag in view."""

    seen_at: float
    sent_at: float | None = None  # when its pending request was sent; None while it waits for its turn
    attempts: int = 0  # requests since the last reply


class Sightings:
    """
    Keeps the tags in view and the pending requests. All times are seconds of one steady clock.

    Each tag is requested once per cooldown, which starts with the reply. One request is pending at any time,
    because a bridge handles one after the other. A request that times out is repeated while the tag is in
    view, up to the number of attempts. After the last attempt, the tag is not requested for as long as these
    attempts may take, but at most for the cooldown. A tag is in view until the detector has not seen it for
    longer than a timeout.
    """

    def __init__(self, settings: 'Settings') -> None:
        """Take the cooldown, the timeout and the attempts from the settings of read_on_sight."""
        self._settings = settings
        self._tags: dict[str, _Sighting] = {}  # in the order of their turns
        self._cool_at: dict[str, float] = {}  # when each tag may be requested again

    def see(self, tag_id: str, now: float) -> None:
        """Note that a tag is in view."""
        if self._cool_at.get(tag_id, now) <= now:
            self._tags.setdefault(tag_id, _Sighting(now)).seen_at = now

    def next(self) -> str | None:
        """Return the tag to request now; None if there is none, or if a request is pending."""
        waiting = [tag_id for tag_id, sighting in self._tags.items() if sighting.sent_at is None]
        return waiting[0] if waiting and len(waiting) == len(self._tags) else None

    def asked(self, tag_id: str, now: float) -> None:
        """Note that the request for a tag was sent."""
        self._tags[tag_id].sent_at = now
        self._tags[tag_id].attempts += 1

    def answered(self, tag_id: str, now: float) -> None:
        """Note that a reply arrived for a tag, with any status and perhaps late."""
        self._tags.pop(tag_id, None)
        self._cool_at[tag_id] = now + self._settings.cooldown_seconds

    def timed_out(self, tag_id: str, now: float) -> bool:
        """Give up a request without a reply; return whether the tag will be requested again."""
        settings, sighting = self._settings, self._tags.pop(tag_id)
        if sighting.attempts >= settings.max_attempts:
            # The bridge may return long before a whole cooldown would end.
            self._cool_at[tag_id] = now + min(settings.cooldown_seconds, settings.patience_seconds)
            return False
        if not self._is_in_view(sighting, now):
            return False
        sighting.sent_at = None
        self._tags[tag_id] = sighting  # behind the others
        return True

    def overdue(self, now: float) -> list[str]:
        """Return the tags whose requests have taken too long."""
        longest = self._settings.request_timeout_seconds
        sent_at = {tag_id: sighting.sent_at for tag_id, sighting in self._tags.items()}
        return [tag_id for tag_id, sent in sent_at.items() if sent is not None and now - sent >= longest]

    def forget(self, now: float) -> None:
        """Drop the tags that have gone out of view, and the cooldowns that have ended."""
        for tag_id, sighting in list(self._tags.items()):
            if sighting.sent_at is None and not self._is_in_view(sighting, now):
                del self._tags[tag_id]
        self._cool_at = {tag_id: end for tag_id, end in self._cool_at.items() if end > now}

    def _is_in_view(self, sighting: _Sighting, now: float) -> bool:
        return now - sighting.seen_at <= self._settings.request_timeout_seconds
