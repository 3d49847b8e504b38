"""Drive to a tag: the interface that the mission needs, and a simulated drive. nav2_drive.py has Nav2."""

from abc import ABC, abstractmethod
from typing import NamedTuple


class Goal(NamedTuple):
    """A pose of the robot in the map: metres, and radians counter-clockwise from the x axis."""

    x: float
    y: float
    yaw: float


class Arrival(NamedTuple):
    """The end of a drive: the robot stands at its goal, or the drive has failed."""

    failure: str = ''  # why the robot is not at its goal; empty if it is
    is_final: bool = False  # another attempt would fail too
    needs_person: bool = False  # the mission keeps the tag, and pauses until somebody resumes it
    is_stuck: bool = False  # the robot hardly moved


class Drive(ABC):
    """
    Brings the robot to one tag at a time, and to its dock.

    Times are seconds of a clock that stops during a pause.
    """

    @abstractmethod
    def start(self, tag_id: str, now_seconds: float, pose: int = 1) -> None:
        """Set off for one of the tag's poses, the first of which is the best."""

    def count_poses(self, tag_id: str) -> int:  # noqa: ARG002
        """Return how many poses a tag can be looked at from."""
        return 1

    @abstractmethod
    def start_return(self, now_seconds: float) -> None:
        """Set off for the dock."""

    @abstractmethod
    def arrival(self, now_seconds: float) -> Arrival | None:
        """Return how the last drive ended; None while the robot drives."""

    def stop(self) -> None:  # noqa: B027 - optional: a simulated drive has nothing to stop
        """Stand still, and give up the goal."""

    def pause(self) -> None:  # noqa: B027
        """Stand still, until resume()."""

    def resume(self) -> None:  # noqa: B027
        """Go on to the same goal."""

    def is_over(self) -> bool:
        """Return whether the robot has ended all drives that were stopped."""
        return True


class SimulatedDrive(Drive):
    """Moves no robot: takes the same time to every goal; with 0 it arrives at once."""

    def __init__(self, drive_seconds: float):
        self._drive_seconds = drive_seconds
        self._arrival_seconds = 0.0

    def start(self, tag_id, now_seconds, pose=1):  # noqa: ARG002
        """Set off."""
        self.start_return(now_seconds)

    def start_return(self, now_seconds):
        """Set off."""
        self._arrival_seconds = now_seconds + self._drive_seconds

    def arrival(self, now_seconds):
        """Return the arrival once the time has passed."""
        return Arrival() if now_seconds >= self._arrival_seconds else None
