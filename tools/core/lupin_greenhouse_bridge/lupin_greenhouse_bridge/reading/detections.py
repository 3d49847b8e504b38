"""What an AprilTag detector sees: its messages, and which tag to request next. Importable without ROS."""

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

from lupin_greenhouse_bridge.errors import StartUpError

if TYPE_CHECKING:
    from lupin_greenhouse_bridge.reading.read_on_sight import Settings

# One family under two names: apriltag_ros uses the first, apriltag_detector the second.
FAMILIES = ('tag36h11', 'tf36h11')
MOST_IN_FLIGHT = 4


def detection_messages() -> ModuleType:
    """Return the module apriltag_msgs.msg; raises StartUpError if that package is missing."""
    try:
        return importlib.import_module('apriltag_msgs.msg')
    except ImportError as error:
        raise StartUpError(
            f'detections need the package apriltag_msgs ({error}):'
            ' sudo apt install ros-$ROS_DISTRO-apriltag-msgs'
        ) from error


class Sightings:
    """
    Keeps the tags in view and the pending requests. All times are seconds of one steady clock.

    Each tag is requested once per cooldown, which starts with the reply. Only a few requests are pending at
    any time. A request that times out is repeated while the tag is in view, up to the number of attempts.
    After the last attempt, the tag is not requested for as long as these attempts may take, but at most for
    the cooldown. A tag is in view until the detector has not seen it for longer than a timeout.
    """

    def __init__(self, settings: 'Settings') -> None:
        """Take the cooldown, the timeout and the attempts from the settings of read_on_sight."""
        self._settings = settings
        self._seen_at: dict[str, float] = {}  # when each tag that waits or is requested was seen last
        self._waiting: dict[str, None] = {}  # the tags to request, in the order in which they came into view
        self._sent_at: dict[str, float] = {}  # when each pending request was sent
        self._attempts: dict[str, int] = {}  # the requests for each tag since the last reply
        self._cool_at: dict[str, float] = {}  # when each tag may be requested again

    def see(self, tag_id: str, now: float) -> None:
        """Note that a tag is in view."""
        if self._cool_at.get(tag_id, now) <= now:
            self._seen_at[tag_id] = now
            if tag_id not in self._sent_at:
                self._waiting[tag_id] = None

    def next(self) -> str | None:
        """Return the tag to request now; None if there is none, or if enough requests are pending."""
        return next(iter(self._waiting), None) if len(self._sent_at) < MOST_IN_FLIGHT else None

    def asked(self, tag_id: str, now: float) -> None:
        """Note that the request for a tag was sent."""
        del self._waiting[tag_id]
        self._sent_at[tag_id] = now
        self._attempts[tag_id] = self._attempts.get(tag_id, 0) + 1

    def answered(self, tag_id: str, now: float) -> None:
        """Note that a reply arrived for a tag, with any status."""
        self._drop(tag_id)
        self._cool_at[tag_id] = now + self._settings.cooldown_seconds

    def timed_out(self, tag_id: str, now: float) -> bool:
        """Give up a request without a reply; return whether the tag will be requested again."""
        settings = self._settings
        if self._attempts[tag_id] >= settings.max_attempts:
            self._drop(tag_id)
            # The bridge may return long before a whole cooldown would end.
            pause_seconds = settings.max_attempts * settings.request_timeout_seconds
            self._cool_at[tag_id] = now + min(settings.cooldown_seconds, pause_seconds)
            return False
        if not self._is_in_view(tag_id, now):
            self._drop(tag_id)
            return False
        del self._sent_at[tag_id]
        self._waiting[tag_id] = None
        return True

    def overdue(self, now: float) -> list[str]:
        """Return the tags whose requests have taken too long."""
        longest = self._settings.request_timeout_seconds
        return [tag_id for tag_id, sent in self._sent_at.items() if now - sent >= longest]

    def forget(self, now: float) -> None:
        """Drop the tags that have gone out of view, and the cooldowns that have ended."""
        for tag_id in [each for each in self._waiting if not self._is_in_view(each, now)]:
            self._drop(tag_id)
        self._cool_at = {tag_id: end for tag_id, end in self._cool_at.items() if end > now}

    def _is_in_view(self, tag_id: str, now: float) -> bool:
        return now - self._seen_at[tag_id] <= self._settings.request_timeout_seconds

    def _drop(self, tag_id: str) -> None:
        for times in (self._seen_at, self._waiting, self._sent_at, self._attempts):
            times.pop(tag_id, None)
