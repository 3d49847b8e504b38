"""A navigator of the test: a real action server, each of whose steps waits for the test."""

import math
import queue
import threading
import time
import uuid

from lupin_greenhouse_bridge.runtime.poses import PoseInPlane
from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS, has_found_a_client, wait_until
from lupin_mission.drive import Arrival
from lupin_mission.nav2_drive import Nav2Drive
from lupin_mission.settings import Settings
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor


class HeldNavigator:
    """An action server that holds every goal, every cancel and every end until the test decides."""

    def __init__(self, node, action_type, name: str):
        self.goals = []  # that have arrived, as PoseStamped
        self._node = node
        self._type = action_type
        self._name = name
        self._arrived, self._accepted, self._cancels = (queue.SimpleQueue() for _ in range(3))
        self._goal_replies, self._cancel_replies = queue.SimpleQueue(), queue.SimpleQueue()
        self._is_closed = threading.Event()
        self._server = ActionServer(
            node,
            action_type,
            name,
            execute_callback=lambda _goal: None,  # each goal gets its own by end()
            callback_group=ReentrantCallbackGroup(),
            goal_callback=self._on_goal,
            handle_accepted_callback=self._accepted.put,
            cancel_callback=self._on_cancel,
        )

    def _on_goal(self, request):
        """Wait in a thread of this request alone, then until DDS would not drop the reply."""
        if self._is_closed.is_set():
            return GoalResponse.REJECT
        self.goals.append(request.pose)
        self._arrived.put(request.pose)
        reply = self._goal_replies.get()
        for each in ('send_goal', 'cancel_goal', 'get_result'):
            service = f'{self._name}/_action/{each}'
            wait_until(lambda service=service: self._has_client(service))
        return reply

    def _has_client(self, service: str) -> bool:
        return self._is_closed.is_set() or has_found_a_client(self._node, service)

    def _on_cancel(self, goal):
        if self._is_closed.is_set():
            return CancelResponse.REJECT
        self._cancels.put(goal)
        return self._cancel_replies.get()

    def wait_for_goal(self):
        """Return the PoseStamped of the next goal, which is neither accepted nor rejected yet."""
        return self._arrived.get(timeout=PATIENCE_SECONDS)

    def has_goal(self) -> bool:
        """Return whether a goal has arrived that no one has waited for."""
        return not self._arrived.empty()

    def accept(self):
        """Accept the goal that is held, or the next one; return its handle."""
        self._goal_replies.put(GoalResponse.ACCEPT)
        return self._accepted.get(timeout=PATIENCE_SECONDS)

    def reject(self) -> None:
        """Reject the goal that is held, or the next one."""
        self._goal_replies.put(GoalResponse.REJECT)

    def wait_for_cancel(self) -> None:
        """Wait for a request to cancel, which is not answered yet."""
        self._cancels.get(timeout=PATIENCE_SECONDS)

    def has_cancel(self) -> bool:
        """Return whether a request to cancel has arrived that no one has waited for."""
        return not self._cancels.empty()

    def answer_cancel(self, *, accept: bool = True) -> None:
        """Answer the request to cancel that is held, or the next one."""
        self._cancel_replies.put(CancelResponse.ACCEPT if accept else CancelResponse.REJECT)

    def end(self, goal, how: str, **result_fields) -> None:
        """End a goal: succeed, abort, or canceled, once its cancel was accepted."""
        if how == 'canceled':
            wait_until(lambda: goal.is_cancel_requested)

        def execute(_goal):
            getattr(goal, how)()
            return self._type.Result(**result_fields)

        goal.execute(execute)

    def tell_position(self, goal, x: float, y: float) -> None:
        """Send the feedback that the robot is here."""
        feedback = self._type.Feedback()
        feedback.current_pose.pose.position.x, feedback.current_pose.pose.position.y = x, y
        goal.publish_feedback(feedback)

    def grant_cancel(self, goal) -> None:
        """Accept a request to cancel a goal, and end the goal."""
        self.wait_for_cancel()
        self.answer_cancel()
        self.end(goal, 'canceled')

    def close(self) -> None:
        """Take the server off the graph, as if its process had died."""
        if self._is_closed.is_set():
            return
        self._is_closed.set()
        for _ in range(16):
            self._goal_replies.put(GoalResponse.REJECT)
            self._cancel_replies.put(CancelResponse.REJECT)
        self._server.destroy()


class Trip:
    """A drive on a node of its own, spun by the test: a callback that waits would hang the test."""

    def __init__(self, node, **options):
        self.name = f'/test_{uuid.uuid4().hex[:8]}/navigate_to_pose'
        self.now_seconds = 0.0
        self.notes = []
        self._node = node
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        settings = Settings(drive='nav2', nav_action_name=self.name, **options)
        self.drive = Nav2Drive(node, settings, lambda *note: self.notes.append(note))
        self.drive.goals.update(a=[PoseInPlane(1.0, 2.0, math.pi / 2)], b=[PoseInPlane(3.0, 4.0, 0.0)])

    def change_executor(self) -> None:
        """End the executor, and go on with another."""
        self._executor.shutdown()
        self._executor = SingleThreadedExecutor(context=self._node.context)
        self._executor.add_node(self._node)

    def start(self, tag_id: str) -> None:
        """Set off."""
        self.drive.start(tag_id, self.now_seconds)

    def spin(self) -> Arrival | None:
        """Do what the mission's node does in a step."""
        self._executor.spin_once(timeout_sec=0.002)
        return self.drive.arrival(self.now_seconds)

    def spin_until(self, is_so, step=lambda: None) -> None:
        """Run callbacks, and these steps, until something is so."""
        deadline = time.monotonic() + PATIENCE_SECONDS
        while not is_so():
            assert time.monotonic() < deadline, 'the condition did not become true'
            self._executor.spin_once(timeout_sec=0.002)
            step()

    def drive_until(self, is_so) -> None:
        """Drive until something is so, and do not arrive before."""

        def step():
            assert self.drive.arrival(self.now_seconds) is None

        self.spin_until(is_so, step)

    def arrival(self) -> Arrival:
        """Return how the drive ends, without the passing of its time."""
        arrivals = []
        self.spin_until(lambda: any(arrivals), lambda: arrivals.append(self.drive.arrival(self.now_seconds)))
        return arrivals[-1]

    def close(self) -> None:
        """End the executor, which the thread of the test spins, and the drive."""
        self._executor.shutdown()
        self.drive.close()
