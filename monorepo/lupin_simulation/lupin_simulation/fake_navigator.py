"""
A navigator for simulations without Nav2: serves NavigateToPose, and moves a disc robot around the tables.

Publishes `odom` and `amcl_pose`, both with the exact pose of the robot in the layout. Aborts a goal that it
cannot reach, and the current goal when a new one arrives. Has no localisation, no costmap and no recovery.

    ros2 run lupin_simulation fake_navigator --ros-args -p speedup:=20.0
"""

import math
import random
import time
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from geometry_msgs.msg import PoseStamped, PoseWithCovariance, PoseWithCovarianceStamped
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.runtime.output import check_output_file
from lupin_greenhouse_bridge.runtime.parameters import declare_parameters
from lupin_greenhouse_bridge.runtime.rclpy_internals import steady_timer
from lupin_greenhouse_bridge.runtime.run import run
from lupin_mission.nav2_drive import navigate_to_pose
from lupin_planning.poses import PoseInPlane, pose_in_plane, pose_message
from nav_msgs.msg import Odometry
from rclpy.action.server import ActionServer, CancelResponse, GoalResponse, ServerGoalHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from lupin_simulation.disc_robot import DiscRobot, arrival_at
from lupin_simulation.settings import Settings

GoalHandle: TypeAlias = 'ServerGoalHandle[Any, Any, Any]'

NODE_NAME = 'navigator'
MAP_FRAME, ODOMETRY_FRAME, ROBOT_FRAME = 'map', 'odom', 'base_link'
STEP_SECONDS = 0.05
ROUTE_HEADER = 'x,y'
# The error codes of Nav2's planner.
GOAL_OCCUPIED, NO_VALID_PATH = 206, 208


class FakeNavigator(Node):
    """Serves one goal at a time. No callback blocks, because a timer moves the robot."""

    def __init__(self) -> None:
        """Read the layout, and serve the action; raises StartUpError."""
        self._server: ActionServer[Any, Any, Any] | None = None  # stays None if the start fails
        super().__init__(NODE_NAME)
        self._settings = settings = declare_parameters(self, Settings)
        if settings.route_file:
            check_output_file(Path(settings.route_file), 'route_file', mark=ROUTE_HEADER.encode())
        self._grid = settings.grid()
        self._chance = random.Random(0)  # noqa: S311 - not for cryptography
        self._action = navigate_to_pose('fake_navigator', '')
        self._robot = DiscRobot(settings.start, settings.speed_m_per_s)
        self._goal: GoalHandle | None = None  # of the current drive
        self._results_due = 0
        self._moved_at = time.monotonic()
        self._odometry = self.create_publisher(Odometry, 'odom', QoSProfile(depth=10))
        self._poses = self.create_publisher(PoseWithCovarianceStamped, 'amcl_pose', latched())
        self._server = ActionServer(
            self,
            self._action,
            settings.nav_action_name,
            execute_callback=self._result,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=lambda _goal: CancelResponse.ACCEPT,
        )
        steady_timer(self, STEP_SECONDS, self._step)
        self._publish()
        self._write_route()
        self.get_logger().info(f'ready: a robot of radius {settings.robot_radius_m:g} m')

    def destroy_node(self) -> None:
        """Destroy the action server too."""
        if self._server:
            self._server.destroy()
        super().destroy_node()

    def send_results(self) -> int:
        """Send the results that are due, because rclpy warns of missing ones; return the exit code."""
        while self._results_due and self.executor:
            self.executor.spin_once(timeout_sec=0)
        return 0

    def _on_goal(self, request: Any) -> GoalResponse:
        is_finite = all(map(math.isfinite, pose_in_plane(request.pose.pose)))
        if is_finite and request.pose.header.frame_id == MAP_FRAME:
            return GoalResponse.ACCEPT
        self.get_logger().warning(f'goal rejected: must be finite and in the frame {MAP_FRAME}')
        return GoalResponse.REJECT

    def _on_accepted(self, goal: GoalHandle) -> None:
        if self._goal:
            self._end(self._goal, 'replaced by a newer goal')
        self._goal = goal
        start, target = self._robot.pose, pose_in_plane(goal.request.pose.pose)
        path = self._grid.path(start[:2], target[:2])
        if path is None:
            self._end(goal, *self._failure_of(start, target))
        else:
            arrival = arrival_at(target, self._settings, self._chance, self._grid)
            self._robot.follow([*path, arrival[:2]], arrival.yaw)

    def _failure_of(self, start: PoseInPlane, target: PoseInPlane) -> tuple[str, int]:
        """Return why there is no path, and Nav2's code for it."""
        here, there = (f'{pose.x:.2f}, {pose.y:.2f} m' for pose in (start, target))
        if not self._grid.is_free(*target[:2]):
            return f'the goal at {there} is occupied', GOAL_OCCUPIED
        return f'no path from {here} to goal {there}', NO_VALID_PATH

    def _step(self) -> None:
        """Move the robot for the time since the last step, and end its goal if it has arrived."""
        goal, now = self._goal, time.monotonic()
        if goal and goal.is_cancel_requested:
            self._robot.stop()
        seconds, self._moved_at = (now - self._moved_at) * self._settings.speedup, now
        self._robot.advance(seconds)
        self._publish()
        if not goal:
            return
        pose = PoseStamped(header=self._header(MAP_FRAME), pose=pose_message(*self._robot.pose))
        goal.publish_feedback(self._action.Feedback(current_pose=pose, distance_remaining=self._robot.left_m))
        if not self._robot.is_moving:
            self._end(goal)

    def _end(self, goal: GoalHandle, failure: str = '', error_code: int = 0) -> None:
        """Stand still, and end the goal."""
        self._robot.stop()
        self._write_route()
        self._goal = None
        self._results_due += 1
        # Only now, because an executing goal waits for its result.
        goal.execute(partial(self._result, failure=failure, error_code=error_code))

    def _result(self, goal: GoalHandle, failure: str = '', error_code: int = 0) -> Any:
        """Set the status of a goal that has ended; return its result, with the reason if it has a field."""
        self._results_due -= 1
        result = self._action.Result()
        if failure:
            self.get_logger().warning(f'goal aborted: {failure}')
            for name, value in (('error_code', error_code), ('error_msg', failure)):
                if hasattr(result, name):  # error_code since Iron, error_msg since Kilted
                    setattr(result, name, value)
            goal.abort()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.succeed()
        return result

    def _header(self, frame_id: str) -> Header:
        return Header(stamp=self.get_clock().now().to_msg(), frame_id=frame_id)

    def _publish(self) -> None:
        """Publish where the robot is."""
        pose = PoseWithCovariance(pose=pose_message(*self._robot.pose))
        odometry = Odometry(header=self._header(ODOMETRY_FRAME), child_frame_id=ROBOT_FRAME, pose=pose)
        self._odometry.publish(odometry)
        self._poses.publish(PoseWithCovarianceStamped(header=self._header(MAP_FRAME), pose=pose))

    def _write_route(self) -> None:
        if path := self._settings.route_file:
            lines = [ROUTE_HEADER, *(f'{x:.3f},{y:.3f}' for x, y in self._robot.route), '']
            try:
                Path(path).write_text('\n'.join(lines), encoding='utf-8')
            except OSError as error:
                raise StartUpError(f"route_file '{path}': {error.strerror}: name another file") from error


def main(args: list[str] | None = None) -> int:
    """Navigate until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, FakeNavigator, args, conclude=FakeNavigator.send_results)
