"""What an AprilTag detector sees: its messages, and which tag to request next. Importable without ROS."""

import importlib

from lupin_greenhouse_bridge.errors import StartUpError

# One family under two names: apriltag_ros uses the first, apriltag_detector the second.
FAMILIES = ('tag36h11', 'tf36h11')
MOST_IN_FLIGHT = 4


def detection_messages():
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
    any time. A request that times out is repeated, up to the number of attempts. After the last attempt, the
    tag is not requested for as long as these attempts may take, but at most for the cooldown. A tag that has
    been out of view for longer than a timeout is not requested.
    """

    def __init__(self, settings):
        """Take the cooldown, the timeout and the attempts from the settings of read_on_sight."""
        self._settings = settings
        self._waiting: dict[str, float] = {}  # when each tag was seen last; ordered by when it came into view
        self._attempts: dict[str, int] = {}  # of the tags that wait for another attempt or its reply
        self._in_flight: dict[str, float] = {}  # when each request was sent
        self._cool_at: dict[str, float] = {}  # when each tag may be requested again

    def see(self, tag_id: str, now: float) -> None:
        """Note that a tag is in view."""
        is_cool = self._cool_at.get(tag_id, now) <= now
        if tag_id in self._waiting or (is_cool and tag_id not in self._in_flight):
            self._waiting[tag_id] = now

    def next(self) -> str | None:
        """Return the tag to request now; None if there is none, or if enough requests are pending."""
        if not self._waiting or len(self._in_flight) >= MOST_IN_FLIGHT:
            return None
        return next(iter(self._waiting))

    def asked(self, tag_id: str, now: float) -> None:
        """Note that the request for a tag was sent."""
        del self._waiting[tag_id]
        self._in_flight[tag_id] = now
        self._attempts[tag_id] = self._attempts.get(tag_id, 0) + 1

    def answered(self, tag_id: str, now: float) -> None:
        """Note that a reply arrived for a tag, with any status."""
        del self._in_flight[tag_id]
        del self._attempts[tag_id]
        self._cool_at[tag_id] = now + self._settings.cooldown_seconds

    def timed_out(self, tag_id: str, now: float) -> bool:
        """Give up a request without a reply; return whether the tag will be requested again."""
        settings = self._settings
        if self._attempts[tag_id] >= settings.max_attempts:
            # The bridge may return long before a whole cooldown would end.
            pause_seconds = settings.max_attempts * settings.request_timeout_seconds
            self.answered(tag_id, now)
            self._cool_at[tag_id] = now + min(settings.cooldown_seconds, pause_seconds)
            return False
        del self._in_flight[tag_id]
        self._waiting[tag_id] = now
        return True

    def overdue(self, now: float) -> list[str]:
        """Return the tags whose requests have taken too long."""
        longest = self._settings.request_timeout_seconds
        return [tag_id for tag_id, sent in self._in_flight.items() if now - sent >= longest]

    def forget(self, now: float) -> None:
        """Drop the tags that have gone out of view, and the cooldowns that have ended."""
        oldest = now - self._settings.request_timeout_seconds
        for tag_id in [tag_id for tag_id, seen in self._waiting.items() if seen < oldest]:
            del self._waiting[tag_id]
            self._attempts.pop(tag_id, None)
        self._cool_at = {tag_id: end for tag_id, end in self._cool_at.items() if end > now}
