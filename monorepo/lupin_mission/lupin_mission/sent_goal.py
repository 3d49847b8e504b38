"""One goal of the action NavigateToPose, from its request to its end. No call blocks."""

import math
import uuid
from collections.abc import Callable
from enum import Enum
from typing import Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import PoseStamped
from lupin_greenhouse_bridge.errors import escaped
from lupin_planning.poses import pose_in_plane
from unique_identifier_msgs.msg import UUID

from lupin_mission.mission import Severity

STUCK_M = 0.05  # A robot that moves less in a drive is stuck.


class GoalState(Enum):
    """The state of a goal."""

    SENT = 'sent'
    ACCEPTED = 'accepted'
    REJECTED = 'rejected'
    ENDED = 'ended'


class SentGoal:
    """A goal that one action client has sent, and that can be given up."""

    def __init__(
        self,
        client: Any,
        goal: Any,
        name: str,
        note: Callable[[str, Severity], None],
        sent_at_seconds: float,
    ):
        """Send a goal to the action `name`; `note` gets an event if the server refuses a cancel."""
        self.goal_id = uuid.uuid4().bytes
        self.state = GoalState.SENT
        self.failure = ''
        self.is_given_up = False
        self.servers: set[bytes] = set()
        self.sent_at_seconds = sent_at_seconds
        self.ended_at_seconds: float | None = None
        self.pose: PoseStamped | None = None  # from the last feedback
        self._start: tuple[float, float] | None = None
        self._farthest_m = 0.0
        self._name, self._note = name, note
        self._handle: Any = None
        self._awaited: list[tuple[Any, Callable[[Any], None]]] = []
        reply = client.send_goal_async(goal, self._on_feedback, UUID(uuid=list(self.goal_id)))
        self._await(reply, self._on_reply)

    def is_over(self) -> bool:
        """Return whether the server has rejected or ended the goal."""
        return self.state in (GoalState.REJECTED, GoalState.ENDED)

    def has_succeeded(self) -> bool:
        """Return whether the robot has reached the goal."""
        return self.is_over() and not self.failure

    def is_stuck(self) -> bool:
        """Return whether the robot hardly moved, according to the feedback of the server."""
        return self._start is not None and self._farthest_m < STUCK_M

    def give_up(self) -> None:
        """Cancel the goal immediately, or as soon as it is accepted."""
        if self.is_given_up or self.is_over():
            return
        self.is_given_up = True
        if self.state is GoalState.ACCEPTED:
            self._cancel()

    def update(self, _future: Any = None) -> None:
        """Handle the replies that have arrived. Each future calls this, unless its executor ends first."""
        awaited, self._awaited = self._awaited, []
        for future, take in awaited:
            if future.done():
                take(future.result())
            else:
                self._awaited.append((future, take))

    def _await(self, future: Any, take: Callable[[Any], None]) -> None:
        self._awaited.append((future, take))
        future.add_done_callback(self.update)

    def _cancel(self) -> None:
        self._await(self._handle.cancel_goal_async(), self._on_cancel_reply)

    def _on_feedback(self, message: Any) -> None:
        pose = pose_in_plane(message.feedback.current_pose.pose)
        if not all(map(math.isfinite, pose)):  # The robot is not localized.
            return
        self.pose = message.feedback.current_pose
        position_m = pose[:2]
        self._start = self._start or position_m
        self._farthest_m = max(self._farthest_m, math.dist(self._start, position_m))

    def _on_reply(self, handle: Any) -> None:
        if not handle.accepted:
            self._end(GoalState.REJECTED, 'rejected the goal')
            return
        self.state, self._handle = GoalState.ACCEPTED, handle
        self._await(handle.get_result_async(), self._on_result)
        if self.is_given_up:
            self._cancel()

    def _on_cancel_reply(self, response: Any) -> None:
        if response.return_code == CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID:
            self._end(GoalState.ENDED, 'does not know the goal any more')
        has_ended = self.is_over() or response.return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED
        if not (response.goals_canceling or has_ended):
            event = f'{self._name} refused to cancel the drive: the robot may still move'
            self._note(event, Severity.ERROR)

    def _on_result(self, response: Any) -> None:
        if response.status == GoalStatus.STATUS_SUCCEEDED:
            self.state = GoalState.ENDED
        elif response.status == GoalStatus.STATUS_CANCELED:
            self.state, self.failure = GoalState.ENDED, 'another client cancelled the drive'
        else:
            self._end(GoalState.ENDED, f'aborted the drive{_reason_of(response.result)}')

    def _end(self, state: GoalState, event: str) -> None:
        self.state, self.failure = state, f'{self._name} {event}'


def _reason_of(result: Any) -> str:
    """Return the error code and message of a result, if the distro has them. Humble has neither."""
    code, text = getattr(result, 'error_code', 0), getattr(result, 'error_msg', '')
    return (f' with code {code}' if code else '') + (f': {escaped(text, 200)}' if text else '')
