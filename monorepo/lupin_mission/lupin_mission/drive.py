"""Driving to a tag, as little of it as the mission needs. Nav2 would be a third implementation."""

from abc import ABC, abstractmethod


class Drive(ABC):
    """Brings the robot to one tag at a time. Times are seconds of a clock that stands still in a pause."""

    @abstractmethod
    def start(self, tag_id: str, now_seconds: float) -> None:
        """Set off for a tag."""

    @abstractmethod
    def has_arrived(self, now_seconds: float) -> bool:
        """Tell whether the robot stands before the tag of the last start()."""

    def pause(self) -> None:  # noqa: B027 - a drive without a motor has nothing to stop
        """Stand still, until resume()."""

    def resume(self) -> None:  # noqa: B027
        """Go on to the same tag."""


class TimedDrive(Drive):
    """Takes the same time to every tag; 0: the robot is there at once."""

    def __init__(self, drive_seconds: float):
        self._drive_seconds = drive_seconds
        self._arrival_seconds = 0.0

    def start(self, tag_id, now_seconds):  # noqa: ARG002
        """Set off."""
        self._arrival_seconds = now_seconds + self._drive_seconds

    def has_arrived(self, now_seconds):
        """Tell whether the time has passed."""
        return now_seconds >= self._arrival_seconds
