"""
A navigator for simulations without Nav2: serves NavigateToPose, and moves a disc robot around the tables.

Publishes `odom` and `amcl_pose`, which agree: both say where the robot is in the layout. Aborts a goal that
has no path to it, and the goal before a new one. There is no localisation, no costmap and no recovery.

It has the life cycle of Nav2's bt_navigator: once it is configured it offers its action, and it rejects goals
until it is active. `~/change_state` changes its state, as for each managed node.

    ros2 run lupin_simulation fake_navigator --ros-args -p speedup:=20.0
"""

import math
import time
from functools import partial
from pathlib import Path

from geometry_msgs.msg import PoseWithCovarianceStamped
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.runtime.parameters import declare_parameters
from lupin_greenhouse_bridge.runtime.poses import pose_in_plane, pose_message
from lupin_greenhouse_bridge.runtime.run import run
from lupin_mission.nav2_drive import navigate_to_pose
from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidTopicNameException
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import QoSProfile
from rclpy.validate_topic_name import validate_topic_name
from std_srvs.srv import SetBool

from lupin_simulation.disc_robot import ArrivalError, DiscRobot, Settings

NODE_NAME = 'navigator'
MAP_FRAME, ODOMETRY_FRAME, ROBOT_FRAME = 'map', 'odom', 'base_link'
STEP_SECONDS = 0.05
PROGRESS_SECONDS = 10.0  # without a move, as movement_time_allowance of Nav2's progress checker
# The error codes of Nav2's controller and planner.
FAILED_TO_MAKE_PROGRESS, START_OCCUPIED, NO_VALID_PATH = 105, 205, 208


class FakeNavigator(LifecycleNode):
    """Serves one goal at a time. No callback blocks, because a timer moves the robot."""

    _server: ActionServer | None = None  # not yet configured, or cleaned up

    def __init__(self):
        """Read the layout, and serve the action; raises StartUpError."""
        super().__init__(NODE_NAME)
        self._settings = settings = declare_parameters(self, Settings)
        self._free_space = settings.free_space(settings.padding_m)
        self._arrival_error = ArrivalError(settings)
        self._action = navigate_to_pose()
        try:
            validate_topic_name(settings.nav_action_name)
        except InvalidTopicNameException as error:
            raise StartUpError(f'parameter nav_action_name: {error}') from error
        self._robot = DiscRobot(settings.start, settings.speed_m_per_s)
        self._goal = None  # the handle of the goal that the robot drives to
        self._ending = 0  # goals whose result is due
        self._reached = 0  # goals
        self._is_wedged = settings.wedged_after == 0
        self._stuck_seconds = 0.0
        self._is_active = False
        self._moved_at = time.monotonic()
        self._odometry = self.create_publisher(Odometry, 'odom', QoSProfile(depth=10))
        self._poses = self.create_publisher(PoseWithCovarianceStamped, 'amcl_pose', latched())
        self.create_service(SetBool, '~/set_wedged', self._on_set_wedged)
        if settings.autostart:
            self.trigger_configure()
            self.trigger_activate()
        self.create_timer(STEP_SECONDS, self._step, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._publish()
        self._write_route()
        self.get_logger().info(f'ready: a robot of radius {settings.robot_radius_m:g} m')

    def on_configure(self, _state) -> TransitionCallbackReturn:
        """Offer the action."""
        self._server = ActionServer(
            self,
            self._action,
            self._settings.nav_action_name,
            execute_callback=self._result,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=lambda _goal: CancelResponse.ACCEPT,
        )
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, _state) -> TransitionCallbackReturn:
        """Accept goals."""
        self._is_active = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, _state) -> TransitionCallbackReturn:
        """Abort the goal, and accept none."""
        self._is_active = False
        if self._goal:
            self._end('the navigator was deactivated')
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, _state) -> TransitionCallbackReturn:
        """Withdraw the action."""
        self._server.destroy()
        self._server = None
        return TransitionCallbackReturn.SUCCESS

    def destroy_node(self) -> None:
        """Destroy the action server too."""
        if self._server:
            self._server.destroy()
        super().destroy_node()

    def farewell(self) -> int:
        """Send the results that are due, because rclpy warns of missing ones; return the exit code."""
        while self._ending:
            self.executor.spin_once(timeout_sec=0)
        return 0

    def _on_set_wedged(self, request, response):
        self._is_wedged, response.success = request.data, True
        return response

    def _on_goal(self, request) -> GoalResponse:
        if not self._is_active:
            self.get_logger().warning('goal rejected: the navigator is inactive')
            return GoalResponse.REJECT
        goal = request.pose
        is_finite = all(map(math.isfinite, pose_in_plane(goal.pose)))
        if goal.header.frame_id == MAP_FRAME and is_finite:
            return GoalResponse.ACCEPT
        self.get_logger().warning(f'goal rejected: must be finite and in the frame {MAP_FRAME}')
        return GoalResponse.REJECT

    def _on_accepted(self, goal) -> None:
        if self._goal:
            self._end('a newer goal has come')
        self._goal, self._stuck_seconds = goal, 0.0
        start, target = self._robot.pose, pose_in_plane(goal.request.pose.pose)
        path = self._free_space.path(start[:2], target[:2])
        if path is None:
            failure = f'no path from {start.x:.2f}, {start.y:.2f} to {target.x:.2f}, {target.y:.2f}'
            self._end(failure, NO_VALID_PATH if self._free_space.is_free(*start[:2]) else START_OCCUPIED)
        else:
            arrival = self._arrival_error.applied_to(target)
            self._robot.follow([*path, arrival[:2]], arrival.yaw)

    def _step(self) -> None:
        if self._goal and self._goal.is_cancel_requested:
            self._robot.stop()
        now = time.monotonic()
        seconds, self._moved_at = (now - self._moved_at) * self._settings.speedup, now
        if self._is_wedged:
            self._stuck_seconds += seconds
        else:
            self._robot.advance(seconds)
        self._publish()
        if not self._goal:
            return
        if not self._robot.is_moving:
            self._reached += not self._goal.is_cancel_requested
            self._is_wedged = self._is_wedged or self._reached == self._settings.wedged_after
            self._end()
        elif self._stuck_seconds >= PROGRESS_SECONDS:
            self._end('the robot does not move', FAILED_TO_MAKE_PROGRESS)
        else:
            self._publish_feedback()

    def _end(self, failure: str = '', error_code: int = 0) -> None:
        """Stand still, and end the goal."""
        self._robot.stop()
        self._write_route()
        goal, self._goal = self._goal, None
        self._ending += 1
        # Not earlier: a goal that executes waits for its result.
        goal.execute(partial(self._result, failure=failure, error_code=error_code))

    def _result(self, goal, failure: str = '', error_code: int = 0):
        """Set the status of a goal that has ended; return its result, with the reason if it has a field."""
        self._ending -= 1
        result = self._action.Result()
        if failure:
            self.get_logger().warning(f'goal aborted: {failure}')
            if hasattr(result, 'error_code'):  # since Iron
                result.error_code = error_code
            if hasattr(result, 'error_msg'):  # since Kilted
                result.error_msg = failure
            goal.abort()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.succeed()
        return result

    def _publish(self) -> None:
        pose = pose_message(*self._robot.pose)
        odometry = Odometry(child_frame_id=ROBOT_FRAME)
        odometry.pose.pose = pose
        estimate = PoseWithCovarianceStamped()
        estimate.pose.pose = pose
        for message, frame_id, publisher in (
            (odometry, ODOMETRY_FRAME, self._odometry),
            (estimate, MAP_FRAME, self._poses),
        ):
            message.header.stamp = self.get_clock().now().to_msg()
            message.header.frame_id = frame_id
            publisher.publish(message)

    def _publish_feedback(self) -> None:
        feedback = self._action.Feedback(distance_remaining=self._robot.left_m)
        feedback.current_pose.header.stamp = self.get_clock().now().to_msg()
        feedback.current_pose.header.frame_id = MAP_FRAME
        feedback.current_pose.pose = pose_message(*self._robot.pose)
        self._goal.publish_feedback(feedback)

    def _write_route(self) -> None:
        if not (path := self._settings.route_file):
            return
        lines = ['x,y', *(f'{x:.3f},{y:.3f}' for x, y in self._robot.route), '']
        try:
            Path(path).write_text('\n'.join(lines), encoding='utf-8')
        except OSError as error:
            raise StartUpError(f"route_file '{path}': {error.strerror}: name another file") from error


def main(args=None) -> int:
    """Navigate until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, FakeNavigator, args, conclude=FakeNavigator.farewell)
