"""
A navigator for simulations without Nav2: serves NavigateToPose, and moves a disc robot around the tables.

Publishes `odom` and `amcl_pose`, which agree: both say where the robot is in the layout. Aborts a goal that
has no way to it, and the goal before a new one. There is no localisation, no costmap and no recovery.
"""

import math
import sys
import time
from functools import partial
from pathlib import Path

from geometry_msgs.msg import Point, PoseWithCovarianceStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMessage
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.runtime.parameters import declare_parameters
from lupin_greenhouse_bridge.runtime.run import run
from lupin_mission.nav2_drive import navigate_to_pose
from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from lupin_simulation.disc_robot import DiscRobot, Pose, Settings
from lupin_simulation.odometry import pose_in_plane

NODE_NAME = 'navigator'
MAP_FRAME, ODOMETRY_FRAME, ROBOT_FRAME = 'map', 'odom', 'base_link'
STEP_SECONDS = 0.05
NO_VALID_PATH = 208  # as Nav2's planner says it


class FakeNavigator(Node):
    """One goal at a time. No callback waits: a timer moves the robot."""

    _server = None  # ROS destroys a node whose constructor raised, too

    def __init__(self):
        """Read the layout, and serve the action; raises StartUpError."""
        super().__init__(NODE_NAME)
        self._settings = settings = declare_parameters(self, Settings)
        self._floor = settings.floor()
        self._action = navigate_to_pose()
        self._robot = DiscRobot(settings.start, settings.speed_m_per_s)
        self._goal = None  # the handle of the goal that the robot drives to
        self._ending = 0  # goals whose result is due
        self._moved_at = time.monotonic()
        self._odometry = self.create_publisher(Odometry, 'odom', QoSProfile(depth=10))
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._poses = self.create_publisher(PoseWithCovarianceStamped, 'amcl_pose', latched)
        self._server = ActionServer(
            self,
            self._action,
            settings.nav_action_name,
            execute_callback=self._result,
            goal_callback=self._judge,
            handle_accepted_callback=self._set_off,
            cancel_callback=lambda _goal: CancelResponse.ACCEPT,
        )
        self.create_timer(STEP_SECONDS, self._step, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._publish()
        self._write_route()
        self.get_logger().info(f'ready: a robot of radius {settings.robot_radius_m:.2f} m')

    def destroy_node(self) -> None:
        """Destroy the action server too."""
        if self._server:
            self._server.destroy()
        super().destroy_node()

    def farewell(self) -> int:
        """Send the results that are due, for which rclpy would complain; return the exit code."""
        while self._ending:
            self.executor.spin_once(timeout_sec=0)
        return 0

    def _judge(self, request) -> GoalResponse:
        goal = request.pose
        is_finite = all(map(math.isfinite, pose_in_plane(goal.pose)))
        if goal.header.frame_id == MAP_FRAME and is_finite:
            return GoalResponse.ACCEPT
        self.get_logger().warning(f'goal rejected: must be finite and in the frame {MAP_FRAME}')
        return GoalResponse.REJECT

    def _set_off(self, goal) -> None:
        if self._goal:
            self._end('a newer goal has come')
        self._goal = goal
        start, target = self._robot.pose, pose_in_plane(goal.request.pose.pose)
        way = self._floor.way(start[:2], target[:2])
        if way is None:
            failure = f'no way from {start.x:.2f}, {start.y:.2f} to {target.x:.2f}, {target.y:.2f}'
            self._end(failure, NO_VALID_PATH)
        else:
            self._robot.set_off(way, target.yaw)

    def _step(self) -> None:
        if self._goal and self._goal.is_cancel_requested:
            self._robot.stop()
        now = time.monotonic()
        self._robot.advance((now - self._moved_at) * self._settings.speedup)
        self._moved_at = now
        self._publish()
        if self._goal and not self._robot.is_moving:
            self._end()

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
        pose = message_of(self._robot.pose)
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

    def _write_route(self) -> None:
        if not (path := self._settings.route_file):
            return
        lines = ['x,y', *(f'{x:.3f},{y:.3f}' for x, y in self._robot.route), '']
        try:
            Path(path).write_text('\n'.join(lines), encoding='utf-8')
        except OSError as error:
            raise StartUpError(f"route_file '{path}': {error.strerror}: name another file") from error


def message_of(pose: Pose) -> PoseMessage:
    """Return the message of a pose in the plane."""
    turn = Quaternion(z=math.sin(pose.yaw / 2), w=math.cos(pose.yaw / 2))
    return PoseMessage(position=Point(x=pose.x, y=pose.y), orientation=turn)


def main(args=None) -> int:
    """Navigate until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, FakeNavigator, args, conclude=FakeNavigator.farewell)


if __name__ == '__main__':
    sys.exit(main())
