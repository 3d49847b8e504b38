"""Drive with Nav2: an action client of nav2_msgs/action/NavigateToPose. No call blocks."""

import importlib
import math
from collections import deque
from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatus, GoalStatusArray
from geometry_msgs.msg import PoseStamped
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_planning.poses import PoseInPlane, pose_in_plane, pose_message
from rclpy.action.client import ActionClient
from rclpy.node import Node
from rclpy.qos import qos_profile_action_status_default

from lupin_mission.drive import DEPENDENCY_TIMEOUT, Arrival, Drive
from lupin_mission.mission import Severity
from lupin_mission.sent_goal import GoalState, SentGoal
from lupin_mission.settings import Settings

DISCOVERY_SECONDS = 2.0  # The client may find a server that late.
LONGEST_REPLY_SECONDS = 5.0  # From a goal to its acceptance or rejection.
LONGEST_END_SECONDS = 2.0  # From a cancel to the end of the goal.
RESEND_SECONDS = 0.5  # Between two goals to a server that rejects them.
STATUS_SECONDS = 1.0  # The status of a goal, and the pose at its end, follow its result within this time.
# Localisation still corrects a pose that Nav2 has compared with the goal: by up to a cell of a usual map, or
# about 0.1 rad at the standoff of 0.5 m.
LOCALIZATION_NOISE_M, LOCALIZATION_NOISE_RAD = 0.05, 0.1
MOVING = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)


def navigate_to_pose(
    who: str = 'drive:=nav2', otherwise: str = ', or set drive:=simulated on a machine without a robot'
) -> Any:
    """Return the action NavigateToPose; raises StartUpError if the package nav2_msgs is missing."""
    try:
        return importlib.import_module('nav2_msgs.action').NavigateToPose
    except ImportError as error:
        raise StartUpError(
            f'{who} needs the package nav2_msgs ({error}):'
            f' sudo apt install ros-$ROS_DISTRO-nav2-msgs{otherwise}'
        ) from error


class Nav2Drive(Drive):
    """
    Sends the robot to one pose at a time.

    `goals` has the poses for each tag, and `unreachable` the reason why a tag has none. A goal is sent when
    the server is available and the previous goal has ended. stop() and pause() cancel it. If the server is
    missing or rejects the goal, the goal is sent again for up to dependency_timeout_s.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        note: Callable[[str, Severity], None],
        localized_pose: Callable[[], PoseStamped | None],
    ):
        """
        Create the client; raises StartUpError without nav2_msgs.

        `localized_pose` returns the last pose of the robot from its localisation, in the frame of the goals.
        """
        self.goals: dict[str, list[PoseInPlane]] = {}
        self.unreachable: dict[str, str] = {}
        self._node, self._settings, self._note = node, settings, note
        self._localized_pose = localized_pose
        self._action = navigate_to_pose()
        self._name = settings.nav_action_name
        self._client: Any = ActionClient(node, self._action, self._name)
        self._status_by_goal_id: dict[bytes, int] = {}
        self._own_goal_ids: deque[bytes] = deque(maxlen=100)
        self._tolerated_goal_ids: set[bytes] = set()
        self._status_topic = f'{self._name}/_action/status'
        node.create_subscription(
            GoalStatusArray, self._status_topic, self._on_statuses, qos_profile_action_status_default
        )
        self._goal: Any = None
        self._reason_without_goal = ''
        self._sent: SentGoal | None = None
        self._position_m: tuple[float, float] | None = None  # at the end of the previous drive
        self._not_over: list[SentGoal] = []
        self._waiting_since: float | None = None  # when the wait for a server began; None after a pause
        self._has_warned_of_server = self._has_warned_of_frame = False

    def start(self, tag_id: str, now_seconds: float, pose: int = 1) -> None:
        """Start to drive to an approach pose of a tag."""
        self._reason_without_goal = self.unreachable.get(tag_id, 'the layout does not have this tag')
        poses = self.goals.get(tag_id)
        self._set_off(poses[pose - 1] if poses else None, now_seconds)

    def count_poses(self, tag_id: str) -> int:
        """Return the number of poses of a tag."""
        return len(self.goals.get(tag_id, ()))

    def start_return(self, now_seconds: float) -> None:
        """Start to drive to the dock."""
        self._set_off(PoseInPlane(*self._settings.dock), now_seconds)

    def _set_off(self, pose: PoseInPlane | None, now_seconds: float) -> None:
        self._position_m = self.position_m()
        self._goal = self._sent = None
        self._waiting_since = now_seconds
        if pose:
            self._goal = self._action.Goal()
            self._goal.pose.header.frame_id = self._settings.frame_id  # No stamp: the latest transform.
            self._goal.pose.pose = pose_message(*pose)

    def arrival(self, now_seconds: float) -> Arrival | None:
        """Return how the drive ended; None while the robot drives, or waits for its server."""
        if self._goal is None:
            return Arrival(self._reason_without_goal, is_final=True)
        if self._waiting_since is None:
            self._waiting_since = now_seconds
        waited_seconds = now_seconds - self._waiting_since
        is_free = self.is_over() or waited_seconds >= LONGEST_END_SECONDS
        sent = self._sent
        # A robot that had arrived when the pause began need not drive again.
        if sent is None or (sent.is_given_up and not sent.has_succeeded()):
            return self._send_when_ready(now_seconds, waited_seconds, is_free)
        if sent.state is GoalState.REJECTED:
            return self._after_rejection(sent, now_seconds, waited_seconds)
        if sent.state is GoalState.ENDED:
            return self._after_end(sent, now_seconds)
        failure = self._failure_under_way(sent, now_seconds - sent.sent_at_seconds)
        if not failure:
            return None
        sent.give_up()
        return Arrival(failure, is_stuck=sent.is_stuck())

    def _send_when_ready(self, now_seconds: float, waited_seconds: float, is_free: bool) -> Arrival | None:
        """Send the goal once the server is there, and free of the previous goal."""
        if self._client.server_is_ready():
            if is_free:
                self._send(now_seconds)
        elif waited_seconds >= self._settings.dependency_timeout_s:
            return Arrival(
                f'there is no action server {self._name}: start Nav2',
                needs_person=True,
                code=DEPENDENCY_TIMEOUT,
            )
        elif waited_seconds >= DISCOVERY_SECONDS:
            self._warn_once(f'waiting for the action server {self._name}: start Nav2')
        return None

    def _after_rejection(self, sent: SentGoal, now_seconds: float, waited_seconds: float) -> Arrival | None:
        if waited_seconds >= self._settings.dependency_timeout_s:
            return Arrival(
                f'{self._name} rejects every goal: activate Nav2', needs_person=True, code=DEPENDENCY_TIMEOUT
            )
        self._warn_once(f'{self._name} rejects goals: activate Nav2; trying again')
        if not self._client.server_is_ready():
            self._sent = None
        elif now_seconds - sent.sent_at_seconds >= RESEND_SECONDS:
            self._send(now_seconds)
        return None

    def _failure_under_way(self, sent: SentGoal, elapsed_seconds: float) -> str:
        """Return why the drive has failed although its server reported nothing; '' if it has not."""
        servers = self._servers()
        has_gone = not self._client.server_is_ready()
        if has_gone or (sent.servers and servers - sent.servers):
            self._not_over.clear()
            return f'{self._name} has {"gone" if has_gone else "restarted"}'
        sent.servers = sent.servers or servers
        if sent.state is GoalState.SENT:
            is_late = elapsed_seconds >= LONGEST_REPLY_SECONDS
            return f'{self._name} did not reply to the goal' if is_late else ''
        self._has_warned_of_server = False
        limit_seconds = self._settings.nav_timeout_s
        is_late = bool(limit_seconds) and elapsed_seconds >= limit_seconds
        return f'the robot did not arrive within {limit_seconds:g} s' if is_late else ''

    def _servers(self) -> set[bytes]:
        """Return the id of each server. A restarted server has a new id."""
        publishers = self._node.get_publishers_info_by_topic(self._status_topic)
        return {bytes(publisher.endpoint_gid) for publisher in publishers}

    def _after_end(self, sent: SentGoal, now_seconds: float) -> Arrival | None:
        """Return how a goal ended. After a failure, the action's status also shows goals of other clients."""
        if sent.ended_at_seconds is None:
            sent.ended_at_seconds = now_seconds
        is_recent = now_seconds - sent.ended_at_seconds < STATUS_SECONDS
        if sent.has_succeeded():
            miss = self._miss(sent)
            return None if miss and is_recent else Arrival(miss=miss)
        status = self._status_by_goal_id.get(sent.goal_id, GoalStatus.STATUS_UNKNOWN)
        if status <= max(MOVING) and is_recent:
            return None
        if self._goal_ids_of_others() - self._tolerated_goal_ids:
            return Arrival('another client drives the robot', needs_person=True)
        return Arrival(sent.failure, is_stuck=sent.is_stuck())

    def _miss(self, sent: SentGoal) -> str:
        """
        Return how far the robot is from its goal; '' if it is there, or if its pose is unknown.

        Nav2 also reports success at the nearest free cell within the tolerance of its planner.
        """
        if sent.pose is None:
            return ''
        localized = self._localized_pose()
        newest = localized if localized and _stamp(localized) > _stamp(sent.pose) else sent.pose
        if newest.header.frame_id != self._settings.frame_id:
            if not self._has_warned_of_frame:
                self._has_warned_of_frame = True
                frame = f"a pose of the robot is in the frame '{escaped(newest.header.frame_id, 64)}'"
                event = f"{frame}, not '{self._settings.frame_id}': arrivals cannot be checked"
                self._note(event, Severity.WARN)
            return ''
        robot, goal = pose_in_plane(newest.pose), pose_in_plane(self._goal.pose.pose)
        off_m, off_rad = math.dist(robot[:2], goal[:2]), abs(math.remainder(robot.yaw - goal.yaw, math.tau))
        is_near = off_m <= self._settings.arrival_tolerance_m + LOCALIZATION_NOISE_M
        if is_near and off_rad <= self._settings.arrival_tolerance_rad + LOCALIZATION_NOISE_RAD:
            return ''
        return f'{off_m:.2f} m and {math.degrees(off_rad):.0f} degrees'

    def _goal_ids_of_others(self) -> set[bytes]:
        moving = {goal_id for goal_id, status in self._status_by_goal_id.items() if status in MOVING}
        return moving.difference(self._own_goal_ids)

    def _on_statuses(self, message: GoalStatusArray) -> None:
        self._status_by_goal_id = {
            bytes(status.goal_info.goal_id.uuid): status.status for status in message.status_list
        }

    def _warn_once(self, event: str) -> None:
        if not self._has_warned_of_server:
            self._has_warned_of_server = True
            self._note(event, Severity.WARN)

    def _send(self, now_seconds: float) -> None:
        self._sent = SentGoal(self._client, self._goal, self._name, self._note, now_seconds)
        self._own_goal_ids.append(self._sent.goal_id)
        self._not_over.append(self._sent)

    def stop(self) -> None:
        """Cancel the goal immediately, or as soon as it is accepted."""
        if self._sent:
            self._sent.give_up()

    def pause(self) -> None:
        """Cancel the goal. After the pause, it is sent again, unless the robot has already arrived."""
        self.stop()
        self._waiting_since = None

    def resume(self) -> None:
        """Continue to the same goal, even if another client drives the robot now."""
        self._tolerated_goal_ids = self._goal_ids_of_others()

    def is_over(self) -> bool:
        """
        Handle the replies that have arrived; return whether every sent goal has ended.

        Without a server, all goals count as ended.
        """
        for goal in self._not_over:
            goal.update()
        self._not_over = [goal for goal in self._not_over if not goal.is_over()]
        return not (self._not_over and self._client.server_is_ready())

    def position_m(self) -> tuple[float, float] | None:
        """Return x and y of the last feedback of the server."""
        pose = self._sent and self._sent.pose
        return pose_in_plane(pose.pose)[:2] if pose else self._position_m

    def close(self) -> None:
        """Destroy the client. rclpy does not do this with the node, which would then stay on the graph."""
        self._client.destroy()


def _stamp(pose: PoseStamped) -> tuple[int, int]:
    return pose.header.stamp.sec, pose.header.stamp.nanosec
