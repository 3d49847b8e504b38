"""Drive with Nav2: an action client of nav2_msgs/action/NavigateToPose. No call blocks."""

import importlib
import math
import uuid
from collections.abc import Callable

from action_msgs.msg import GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.runtime.poses import PoseInPlane, pose_message
from rclpy.action import ActionClient
from rclpy.qos import qos_profile_action_status_default
from unique_identifier_msgs.msg import UUID

from lupin_mission.drive import Arrival, Drive
from lupin_mission.mission import Severity
from lupin_mission.settings import Settings

DISCOVERY_SECONDS = 2.0  # a server may be found that late
LONGEST_REPLY_SECONDS = 5.0  # from a goal to its acceptance or rejection
LONGEST_END_SECONDS = 2.0  # from a cancel to the end of the goal
RESEND_SECONDS = 0.5  # between two goals to a server that rejects them
STATUS_SECONDS = 1.0  # the status of a goal follows its result within this time
STUCK_M = 0.05  # a robot that moves less in a drive is stuck
MOVING = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)
ANOTHER_CLIENT = 'another client drives the robot'
NOT_IN_LAYOUT = 'the layout does not have this tag'


def navigate_to_pose():
    """Return the action NavigateToPose; raises StartUpError if the package nav2_msgs is missing."""
    try:
        return importlib.import_module('nav2_msgs.action').NavigateToPose
    except ImportError as error:
        raise StartUpError(
            f'drive:=nav2 needs the package nav2_msgs ({error}): sudo apt install ros-$ROS_DISTRO-nav2-msgs,'
            ' or set drive:=simulated on a machine without a robot'
        ) from error


class Nav2Drive(Drive):
    """
    Sends the robot to one pose at a time.

    `goals` has the poses for each tag, and `unreachable` the reason why a tag has none. A goal is sent when
    the server is available and the previous goal has ended. stop() and pause() cancel it. If the server is
    missing or rejects the goal, the goal is sent again for up to dependency_timeout_s.
    """

    def __init__(self, node, settings: Settings, note: Callable[[str, Severity], None]):
        """Create the client; raises StartUpError for an invalid name, or without nav2_msgs."""
        self.goals: dict[str, list[PoseInPlane]] = {}
        self.unreachable: dict[str, str] = {}
        self._node = node
        self._settings = settings
        self._note = note
        self._action = navigate_to_pose()
        self._name = settings.nav_action_name
        try:
            self._client = ActionClient(node, self._action, self._name)
        except ValueError as error:
            raise StartUpError(f'{self._name!r} is not an action name: {error}') from error
        self._statuses: dict[bytes, int] = {}  # of all goals of the server, by id
        self._own_goals: set[bytes] = set()
        self._tolerated_goals: set[bytes] = set()  # of other clients, before a resume
        self._status_topic = f'{self._name}/_action/status'
        node.create_subscription(
            GoalStatusArray, self._status_topic, self._on_statuses, qos_profile_action_status_default
        )
        self._goal: PoseInPlane | None = None
        self._no_goal = ''  # why there is none
        self._sent: _SentGoal | None = None  # for this goal
        self._not_over: list[_SentGoal] = []
        self._since: float | None = None  # the start, the end of the pause, or the sending
        self._rejected_since: float | None = None  # the first rejection in a row, or the end of the pause
        self._ended_at: float | None = None  # the goal, by its result
        self._has_warned = False  # of a server that is not ready

    def start(self, tag_id, now_seconds, pose=1):
        """Start to drive to an approach pose of a tag."""
        goal = self.goals[tag_id][pose - 1] if tag_id in self.goals else None
        self._set_off(goal, self.unreachable.get(tag_id, NOT_IN_LAYOUT), now_seconds)

    def count_poses(self, tag_id):
        """Return the number of poses of a tag."""
        return len(self.goals.get(tag_id, ()))

    def start_return(self, now_seconds):
        """Start to drive to the dock."""
        self._set_off(PoseInPlane(*self._settings.dock), '', now_seconds)

    def _set_off(self, goal: PoseInPlane | None, no_goal: str, now_seconds: float) -> None:
        self._goal, self._no_goal = goal, no_goal
        self._sent, self._since = None, now_seconds
        self._rejected_since = self._ended_at = None

    def arrival(self, now_seconds):
        """Return how the drive ended; None while the robot drives, or waits for its server."""
        if self._goal is None:
            return Arrival(self._no_goal, is_final=True)
        if self._since is None:
            self._since = now_seconds
        is_over = self.is_over()  # takes what has arrived
        elapsed_seconds, sent = now_seconds - self._since, self._sent
        if sent and sent.is_over and not (sent.is_given_up and sent.failure):
            # A robot that was there at the moment of a pause need not go again.
            return self._after_rejection(now_seconds) if sent.is_rejected else self._after_end(now_seconds)
        if sent and not sent.is_given_up:
            failure = self._failure_under_way(elapsed_seconds)
            if failure:
                sent.give_up()
            return Arrival(failure, is_stuck=sent.is_stuck()) if failure else None
        if not self._client.server_is_ready():
            if elapsed_seconds >= self._settings.dependency_timeout_s:
                return Arrival(f'there is no action server {self._name}: start Nav2', needs_person=True)
            if elapsed_seconds >= DISCOVERY_SECONDS:
                self._warn_once(f'waiting for the action server {self._name}: start Nav2')
        elif is_over or elapsed_seconds >= LONGEST_END_SECONDS:
            self._send(now_seconds)
        return None

    def _failure_under_way(self, elapsed_seconds: float) -> str:
        if not self._client.server_is_ready():
            self._not_over.clear()
            return f'{self._name} has gone'
        servers = self._servers()
        if self._sent.servers and servers - self._sent.servers:
            self._not_over.clear()
            return f'{self._name} has restarted'
        self._sent.servers = self._sent.servers or servers
        if not self._sent.is_accepted:
            is_late = elapsed_seconds >= LONGEST_REPLY_SECONDS
            return f'{self._name} did not reply to the goal' if is_late else ''
        self._has_warned = False
        limit_seconds = self._settings.nav_timeout_s
        is_late = limit_seconds and elapsed_seconds >= limit_seconds
        return f'the robot did not arrive within {limit_seconds:g} s' if is_late else ''

    def _servers(self) -> set[bytes]:
        """Return an id of each server; one that starts again under the same name has another id."""
        publishers = self._node.get_publishers_info_by_topic(self._status_topic)
        return {bytes(each.endpoint_gid) for each in publishers}

    def _after_rejection(self, now_seconds: float) -> Arrival | None:
        if self._rejected_since is None:
            self._rejected_since = now_seconds
            self._warn_once(f'{self._name} rejects goals: activate Nav2; trying again')
        if now_seconds - self._rejected_since >= self._settings.dependency_timeout_s:
            return Arrival(f'{self._name} rejects every goal: activate Nav2', needs_person=True)
        if not self._client.server_is_ready():
            self._sent, self._since = None, now_seconds
        elif now_seconds - self._since >= RESEND_SECONDS:
            self._send(now_seconds)
        return None

    def _after_end(self, now_seconds: float) -> Arrival | None:
        """Return how a goal ended. After a failure its status tells, too, whose goal the robot has now."""
        if not self._sent.failure:
            return Arrival()
        if self._ended_at is None:
            self._ended_at = now_seconds
        has_status = self._statuses.get(self._sent.goal_id, GoalStatus.STATUS_UNKNOWN) > max(MOVING)
        if not has_status and now_seconds - self._ended_at < STATUS_SECONDS:
            return None
        if self._goals_of_others() - self._tolerated_goals:
            return Arrival(ANOTHER_CLIENT, needs_person=True)
        return Arrival(self._sent.failure, is_stuck=self._sent.is_stuck())

    def _goals_of_others(self) -> set[bytes]:
        return {each for each, status in self._statuses.items() if status in MOVING} - self._own_goals

    def _on_statuses(self, message) -> None:
        self._statuses = {bytes(each.goal_info.goal_id.uuid): each.status for each in message.status_list}

    def _warn_once(self, event: str) -> None:
        if not self._has_warned:
            self._has_warned = True
            self._note(event, Severity.WARN)

    def _send(self, now_seconds: float) -> None:
        message, goal = self._action.Goal(), self._goal
        # Without a stamp, Nav2 takes the latest transform.
        message.pose.header.frame_id = self._settings.frame_id
        message.pose.pose = pose_message(*goal)
        self._sent, self._since = _SentGoal(self._client, message, self._name, self._note), now_seconds
        self._ended_at = None
        self._own_goals.add(self._sent.goal_id)
        self._not_over.append(self._sent)

    def stop(self):
        """Cancel the goal immediately, or as soon as it is accepted."""
        if self._sent:
            self._sent.give_up()

    def pause(self):
        """Cancel the goal. After the pause, it is sent again, unless the robot has already arrived."""
        self.stop()
        self._since = self._rejected_since = None

    def resume(self):
        """Continue to the same goal, even if another client drives the robot now."""
        self._tolerated_goals = self._goals_of_others()

    def is_over(self):
        """Return whether every sent goal has ended; a goal whose server has gone counts as ended."""
        for each in self._not_over:
            each.update()
        self._not_over = [each for each in self._not_over if not each.is_over]
        return not (self._not_over and self._client.server_is_ready())

    def close(self):
        """Destroy the client: rclpy does not do it with the node, which then would stay on the graph."""
        self._client.destroy()


class _SentGoal:
    """A goal from its request to its end."""

    def __init__(self, client: ActionClient, message, name: str, note: Callable[[str, Severity], None]):
        """Send it."""
        self.is_accepted = self.is_rejected = self.is_given_up = self.is_over = False
        self.servers: set[bytes] = set()  # once they are known
        self._start: tuple[float, float] | None = None  # where the robot was at the first feedback
        self._moved_m = 0.0  # at most, from there
        self.failure = ''  # of a goal that is over
        self._name = name
        self._note = note
        self._handle = self._result = self._cancel_reply = None
        self.goal_id = uuid.uuid4().bytes
        goal_uuid = UUID(uuid=list(self.goal_id))
        self._reply = self._expect(client.send_goal_async(message, self._on_feedback, goal_uuid))

    def is_stuck(self) -> bool:
        """Return whether the robot hardly moved, according to the feedback of the server."""
        return self._start is not None and self._moved_m < STUCK_M

    def _on_feedback(self, message) -> None:
        position = message.feedback.current_pose.pose.position
        at = (position.x, position.y)
        self._start = self._start or at
        self._moved_m = max(self._moved_m, math.dist(self._start, at))

    def give_up(self) -> None:
        """Cancel the goal immediately, or as soon as it is accepted."""
        if not (self.is_given_up or self.is_over):
            self.is_given_up = True
            if self.is_accepted:
                self._cancel()

    def update(self, _future=None) -> None:
        """Take what has arrived. A future calls this, unless its executor ends before it does."""
        if self._handle is None and self._reply.done():
            self._on_reply(self._reply.result())
        if self._result and self._result.done():
            self._on_result(self._result.result())
            self._result = None
        if self._cancel_reply and self._cancel_reply.done():
            self._on_cancel_reply(self._cancel_reply.result())
            self._cancel_reply = None

    def _expect(self, future):
        future.add_done_callback(self.update)
        return future

    def _cancel(self) -> None:
        self._cancel_reply = self._expect(self._handle.cancel_goal_async())

    def _on_reply(self, handle) -> None:
        self._handle, self.is_accepted = handle, handle.accepted
        if not self.is_accepted:
            self.is_rejected = True
            self._end(f'{self._name} rejected the goal')
            return
        self._result = self._expect(handle.get_result_async())
        if self.is_given_up:
            self._cancel()

    def _on_cancel_reply(self, response) -> None:
        # Of a server that has restarted.
        if response.return_code == CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID:
            self._end(f'{self._name} does not know the goal any more')
        has_ended = self.is_over or response.return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED
        if not (response.goals_canceling or has_ended):
            event = f'{self._name} refused to cancel the drive: the robot may still move'
            self._note(event, Severity.ERROR)

    def _on_result(self, response) -> None:
        if response.status == GoalStatus.STATUS_SUCCEEDED:
            self._end('')
        elif response.status == GoalStatus.STATUS_CANCELED:
            self._end('another client cancelled the drive')
        else:
            self._end(f'{self._name} aborted the drive{_reason_of(response.result)}')

    def _end(self, failure: str) -> None:
        self.is_over, self.failure = True, failure


def _reason_of(result) -> str:
    """Return the error code and message of a result, if the distro has them. Humble has neither."""
    code, text = getattr(result, 'error_code', 0), getattr(result, 'error_msg', '')
    return (f' with code {code}' if code else '') + (f': {escaped(text, 200)}' if text else '')
