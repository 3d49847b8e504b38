"""The interface of a drive to a tag, and a simulated drive. The drive with Nav2 is in nav2_drive.py."""

from abc import ABC, abstractmethod
from typing import NamedTuple

DEPENDENCY_TIMEOUT = 'dependency_timeout'


class Arrival(NamedTuple):
    """
    The end of a drive. `failure` is the reason why the robot is not at its goal, or '' if it is.

    If the failure is final, another attempt would fail too. If it needs a person, the mission keeps the tag,
    and pauses until somebody resumes it; `code` is the team's code for the reason. A robot is stuck if it
    hardly moved. If the drive succeeded too far from its goal, `miss` is that distance; otherwise it is ''.
    """

    failure: str = ''
    is_final: bool = False
    needs_person: bool = False
    code: str = ''
    is_stuck: bool = False
    miss: str = ''


class Drive(ABC):
    """Brings the robot to a tag, or to its dock. Times are seconds of a clock that stops during a pause."""

    @abstractmethod
    def start(self, tag_id: str, now_seconds: float, pose: int = 1) -> None:
        """Start to drive to one of the tag's poses, where pose 1 is the best."""

    def count_poses(self, tag_id: str) -> int:  # noqa: ARG002
        """Return the number of poses from which the robot can look at a tag."""
        return 1

    @abstractmethod
    def start_return(self, now_seconds: float) -> None:
        """Start to drive to the dock."""

    @abstractmethod
    def arrival(self, now_seconds: float) -> Arrival | None:
        """Return how the last drive ended; None while the robot drives."""

    def stop(self) -> None:  # noqa: B027 - optional: a simulated drive has nothing to stop
        """Stand still, and give up the goal."""

    def pause(self) -> None:  # noqa: B027
        """Stand still, until resume()."""

    def resume(self) -> None:  # noqa: B027
        """Continue to the same goal."""

    def is_over(self) -> bool:
        """Return whether all stopped drives have ended."""
        return True

    def position_m(self) -> tuple[float, float] | None:
        """Return x and y in the map where the robot was last; None if that is unknown."""
        return None

    def close(self) -> None:  # noqa: B027
        """Release the ROS client of the drive. Nothing may spin the node during this call."""


class SimulatedDrive(Drive):
    """Moves no robot. Each drive takes the same time; with 0 s, it ends immediately."""

    def __init__(self, drive_seconds: float):
        self._drive_seconds = drive_seconds
        self._arrival_seconds = 0.0

    def start(self, tag_id: str, now_seconds: float, pose: int = 1) -> None:  # noqa: ARG002
        """Start to drive."""
        self.start_return(now_seconds)

    def start_return(self, now_seconds: float) -> None:
        """Start to drive."""
        self._arrival_seconds = now_seconds + self._drive_seconds

    def arrival(self, now_seconds: float) -> Arrival | None:
        """Return the arrival once the time has passed."""
        return Arrival() if now_seconds >= self._arrival_seconds else None
