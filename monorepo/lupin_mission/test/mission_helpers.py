"""
Fixtures: the real mission, in a thread of the test or as a process, and what is around it.

No test of a mission depends on how fast DDS or the machine is. A state that a test acts in lasts until the
test ends it: a reply is withheld, a dwell of an hour is skipped, or the clock of the process is moved.
"""

import contextlib
import queue
import signal
import threading
import time
import uuid
from collections import defaultdict
from concurrent.futures import Future
from functools import partial
from pathlib import Path

import lupin_mission.mission
import lupin_msgs.msg
import pytest
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from lupin_greenhouse_bridge.contract import SERVICE_QOS, latched
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.run import spin_once
from lupin_greenhouse_bridge.testing import NodeProcess
from lupin_greenhouse_bridge.testing.helpers import (
    PATIENCE_SECONDS,
    ManualClock,
    call,
    greet,
    has_found_a_client,
    overrides,
    wait_until,
)
from lupin_mission import mission_orchestrator
from lupin_mission.nav2_drive import navigate_to_pose
from lupin_msgs.msg import DiscoveredTag, DiscoveredTags, MissionState, SensorReading, TagReading
from lupin_msgs.srv import ConfirmTag, GetTagReading, StartMission
from lupin_planning.poses import pose_message
from lupin_readings.report_line import Observation, Outcome, parse_report
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.utilities import get_default_context
from std_srvs.srv import Trigger

HOUR = 3600.0  # of a state that only the test ends
READER = {'bridge_service_name': '/held/get_tag_reading'}
CAMERA = {**READER, 'visual_confirmation_service': '/held/confirm_tag', 'require_visual_confirmation': True}
# DDS can drop a reply of the bridge while both discover each other: the mission asks until it has one.
REAL = {'scan_timeout_s': 1.0, 'max_attempts': 1000}
TWIN_QOS = latched(50)  # reliable, as by default
WEB_QOS = QoSProfile(depth=10)  # a web client has no durability
SERVICES = {
    **dict.fromkeys(['pause', 'resume', 'skip_current', 'abort', 'dock', 'reset'], Trigger),
    'start': StartMission,
}


@pytest.fixture
def clock(monkeypatch):
    """Return the monotonic clock of this process, which stands still but for what the test adds."""
    clock = ManualClock()
    monkeypatch.setattr(time, 'monotonic', clock)
    return clock


@pytest.fixture
def node():
    """Return a node of the test, spun by threads: a request that waits for its reply blocks no other."""
    context = Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node('mission_test', context=context)
    executor = MultiThreadedExecutor(16, context=context)
    executor.add_node(node)
    ended = threading.Event()

    def spin():
        while not ended.is_set():
            spin_once(executor, node)  # survives the end of an action server that a callback still takes from

    spinner = threading.Thread(target=spin, daemon=True)
    spinner.start()
    yield node
    ended.set()
    executor.create_task(int)  # wakes it up
    spinner.join()  # rclpy raises in a thread that spins an executor while another closes it
    executor.shutdown(timeout_sec=0)
    node.destroy_node()
    rclpy.shutdown(context=context)


class HeldService:
    """A service that holds every request until the test replies to it."""

    def __init__(self, node, service_type, name: str):
        self.name = name
        self.tag_ids = []  # of the requests, in the order of arrival
        self._node = node
        self._type = service_type
        self._lock = threading.Lock()
        self._arrived = queue.SimpleQueue()
        self._replies = defaultdict(Future)  # by the number of the request
        self._replied = 0
        self._is_closed = False
        node.create_service(
            service_type, name, self._handle, qos_profile=SERVICE_QOS, callback_group=ReentrantCallbackGroup()
        )

    def _handle(self, request, _response):
        """Wait in a thread of this request alone: the executor and other requests go on."""
        tag_id = getattr(request, 'tag_id', None) or getattr(request, 'expected_tag_id', None)
        with self._lock:
            reply = self._replies[len(self.tag_ids)]
            self.tag_ids.append(tag_id)
            if self._is_closed:
                return self._type.Response()
        self._arrived.put(tag_id)
        response = reply.result()
        wait_until(lambda: self._is_closed or has_found_a_client(self._node, self.name))
        return response

    def wait_for_request(self) -> str:
        return self._arrived.get(timeout=PATIENCE_SECONDS)

    def answer(self, **fields) -> None:
        """Reply to the first request without a reply, which has arrived or will arrive."""
        with self._lock:
            reply = self._replies[self._replied]
            self._replied += 1
        reply.set_result(self._type.Response(**fields))

    def answer_ok(self, *tag_ids: str, **values: float) -> None:
        """Reply like the bridge for each of these tags, with 1 ppm of CO2 unless other values are given."""
        values = values or {'co2': 1.0}
        readings = [SensorReading(name=name, value=value) for name, value in values.items()]
        for tag_id in tag_ids:
            reading = TagReading(tag_id=tag_id, sim_time_of_day_seconds=43200.0, readings=readings)
            self.answer(reading=reading)

    def answer_tags(self, *tag_ids: str, tag_file: str = '') -> None:
        self.answer(
            values=[ParameterValue(string_array_value=tag_ids), ParameterValue(string_value=tag_file)]
        )

    def close(self) -> None:
        """Reply to every request that still waits."""
        with self._lock:
            self._is_closed = True
            for reply in self._replies.values():
                if not reply.done():
                    reply.set_result(self._type.Response())


@pytest.fixture
def held_service(node):
    with contextlib.ExitStack() as stack:
        yield lambda *words: stack.enter_context(contextlib.closing(HeldService(node, *words)))


@pytest.fixture
def reader(held_service):
    return held_service(GetTagReading, '/held/get_tag_reading')


@pytest.fixture
def confirmer(held_service):
    return held_service(ConfirmTag, '/held/confirm_tag')


@pytest.fixture
def bridge_parameters(held_service):
    return held_service(GetParameters, '/held/get_parameters')


class HeldNavigator:
    """An action server that holds every goal, every cancel and every end until the test decides."""

    def __init__(self, node, name: str):
        self.goals = []  # that have arrived, as PoseStamped
        self._node = node
        self._type = navigate_to_pose()
        self._name = name
        self._arrived, self._accepted, self._cancels = (queue.SimpleQueue() for _ in range(3))
        self._goal_replies, self._cancel_replies = queue.SimpleQueue(), queue.SimpleQueue()
        self._is_closed = threading.Event()
        self._server = ActionServer(
            node,
            self._type,
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
            find = partial(has_found_a_client, self._node, f'{self._name}/_action/{each}')
            wait_until(lambda find=find: self._is_closed.is_set() or find())
        return reply

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
        self._goal_replies.put(GoalResponse.REJECT)

    def wait_for_cancel(self) -> None:
        """Wait for a request to cancel, which is not answered yet."""
        self._cancels.get(timeout=PATIENCE_SECONDS)

    def has_cancel(self) -> bool:
        """Return whether a request to cancel has arrived that no one has waited for."""
        return not self._cancels.empty()

    def answer_cancel(self, *, accept: bool = True) -> None:
        self._cancel_replies.put(CancelResponse.ACCEPT if accept else CancelResponse.REJECT)

    def end(self, goal, how: str, **result_fields) -> None:
        """End a goal: succeed, abort, or canceled, once its cancel was accepted."""
        if how == 'canceled':
            wait_until(lambda: goal.is_cancel_requested)

        def execute(_goal):
            getattr(goal, how)()
            return self._type.Result(**result_fields)

        goal.execute(execute)

    def tell_pose(self, goal, x: float, y: float, yaw: float = 0.0, *, frame_id: str = 'map') -> None:
        """Send the feedback that the robot is here, 100 s after the start of the clock."""
        feedback = self._type.Feedback()
        feedback.current_pose.header.frame_id = frame_id
        feedback.current_pose.header.stamp.sec = 100
        feedback.current_pose.pose = pose_message(x, y, yaw)
        goal.publish_feedback(feedback)

    def grant_cancel(self, goal) -> None:
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


@pytest.fixture
def held_navigator(node):
    with contextlib.ExitStack() as stack:
        yield lambda name: stack.enter_context(contextlib.closing(HeldNavigator(node, name)))


def publish(publisher, message) -> None:
    """Publish a message once somebody subscribes, and wait until it has arrived there."""
    wait_until(publisher.get_subscription_count)
    publisher.publish(message)
    assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE_SECONDS))


def discovered(*tags: tuple, frame_id: str = 'map') -> DiscoveredTags:
    """Return the message of perception for tags of (id, x, y, w), where w is 0 if the pose is unset."""
    message = DiscoveredTags()
    message.header.frame_id = frame_id
    for tag_id, x, y, w in tags:
        message.tags.append(DiscoveredTag(tag_id=tag_id, pose_in_map=pose_message(x, y, 0.0)))
        message.tags[-1].pose_in_map.orientation.w = w
    return message


def localized(x: float, y: float, frame_id: str = 'map') -> PoseWithCovarianceStamped:
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame_id
    message.pose.pose = pose_message(x, y, 1.0)  # turned, as no tag is
    return message


class Subscriber:
    def __init__(self, node, message_type, topic: str, qos):
        self.received = []
        self._seen = 0
        node.create_subscription(message_type, topic, self.received.append, qos)

    def wait_for(self, is_it=lambda _message: True):
        """Return the first message that matches and that no wait has seen."""
        while True:
            wait_until(lambda: len(self.received) > self._seen)
            message = self.received[self._seen]
            self._seen += 1
            if is_it(message):
                return message

    def wait_for_steps(self) -> None:
        """Wait for more of a mission's states: it has taken more steps than that."""
        received = len(self.received)
        wait_until(lambda: len(self.received) > received + 2)


@pytest.fixture
def states_of(node):
    """Return a function that subscribes to the state of a mission like a web client."""
    return lambda mission: Subscriber(node, MissionState, f'{mission.namespace}/mission/state', WEB_QOS)


@pytest.fixture
def twin(node):
    """Return a function that subscribes like the digital twin."""
    topic = '/floranova/observations'
    return lambda: Subscriber(node, lupin_msgs.msg.Observation, topic, TWIN_QOS)


class Operator:
    """A person with the state and all services of a mission that waits for its start."""

    def __init__(self, node, namespace: str):
        """Let each service find its client by calls that change nothing before the first start."""
        self.states = Subscriber(node, MissionState, f'{namespace}/mission/state', WEB_QOS)
        self._clients = {
            name: node.create_client(service_type, f'{namespace}/mission/{name}')
            for name, service_type in SERVICES.items()
        }
        assert self.states.wait_for().lifecycle_state in ('BOOT', 'READY')
        for name, client in self._clients.items():
            greeting = {'mission_type': 'none'} if name == 'start' else {}
            wait_until(client.service_is_ready)
            greet(client, client.srv_type.Request(**greeting))
            self._call(name, **greeting)  # follows the last greeting, so that none is under way

    def _call(self, name: str, **fields):
        client = self._clients[name]
        return call(client, client.srv_type.Request(**fields))

    def start(self, **fields) -> str:
        response = self._call('start', **fields)
        assert (response.accepted, response.error_message) == (True, '')
        return response.mission_id

    def start_later(self):
        return self._clients['start'].call_async(StartMission.Request())

    def rejection(self, **fields) -> str:
        response = self._call('start', **fields)
        assert (response.accepted, response.mission_id) == (False, '')
        return response.error_message

    def trigger(self, name: str) -> bool:
        """Call a Trigger service, and return whether there was something to do."""
        response = self._call(name)
        verb = name.removesuffix('_current')
        assert response.message == (f'{verb}: done' if response.success else f'there is nothing to {verb}')
        return response.success

    def dock(self) -> tuple[bool, str]:
        response = self._call('dock')
        return response.success, response.message

    def wait_for(self, **fields) -> MissionState:
        """Return the first new state with these fields. The test holds it: others can be missed."""
        return self.states.wait_for(
            lambda state: all(getattr(state, name) == value for name, value in fields.items())
        )


class Mission(NodeProcess):
    """A mission in a thread of the test: the whole run, but for the signals, which belong to the process."""

    def __init__(self, monkeypatch, capture, folder: Path, **parameters):  # no process is started
        self.namespace = f'/test_{uuid.uuid4().hex[:8]}'
        self.report_file = folder / 'report.jsonl'
        self.log = []  # once it has ended: what ROS logs, then what the mission prints
        self._capture = capture
        self._is_asked_to_end = threading.Event()
        self._exit_code = Future()
        monkeypatch.setattr(process, 'is_asked_to_end', self._is_asked_to_end.is_set)
        args = ['--ros-args', '-r', f'__ns:={self.namespace}', *overrides(parameters)]
        self._thread = threading.Thread(target=self._run, args=[args], daemon=True)
        self._thread.start()

    def _run(self, args):
        try:
            exit_code = mission_orchestrator.main(args)
        except BaseException as error:
            self._exit_code.set_exception(error)
        else:
            get_default_context(shutting_down=True)  # what follows needs a new one
            self._exit_code.set_result(exit_code)

    def send(self, *_numbers) -> None:
        """Ask the mission to end, like a signal."""
        self._is_asked_to_end.set()

    def close(self) -> None:
        self.send()
        self._thread.join(PATIENCE_SECONDS)

    def end(self) -> int:
        exit_code = self._exit_code.result(PATIENCE_SECONDS)
        printed, logged = self._capture.readouterr()
        self.log += (logged + printed).splitlines()
        assert 'Traceback' not in logged, logged
        return exit_code

    def observations(self, mission_id: str = '') -> list[Observation]:
        """Return the lines of the report so far; a mission that waits for its start has one for each id."""
        name = f'{self.report_file.stem}-{mission_id}.jsonl' if mission_id else self.report_file.name
        path = self.report_file.with_name(name)
        return observations_in(path) if path.exists() else []

    def outcomes(self, mission_id: str = '') -> list[tuple[str, Outcome]]:
        return [(each.tag_id, each.outcome) for each in self.observations(mission_id)]

    def lines_with(self, fragment: str) -> list[str]:
        return [line for line in self.log if fragment in line]

    def warnings(self) -> list[str]:
        """Return what the node of a mission that has ended logged above INFO."""
        lines = self.lines_with(f'{self.namespace[1:]}.mission_orchestrator]')
        assert lines, self.log
        return [line for line in lines if '[INFO]' not in line]


def observations_in(report: Path) -> list[Observation]:
    """Return the observations of a report, without an incomplete last line."""
    return parse_report(report.read_bytes())[0]


@pytest.fixture
def settings(tmp_path):
    """Return the parameters of a mission that moves on only when the test replies."""
    return {
        'drive': 'simulated',
        'dock_pose': "''",
        'scan_timeout_s': HOUR,
        'visual_confirmation_timeout_s': HOUR,
        'wait_for_start': False,
        'report_file': f'"{tmp_path / "report.jsonl"}"',
    }


@pytest.fixture
def start_mission(settings, tmp_path, monkeypatch, capfd):
    """Return a function that runs a mission in a thread, one at a time; it ends with the test."""
    monkeypatch.setattr(lupin_mission.mission.Mission, 'retry_delay_seconds', 0.05)
    monkeypatch.setattr(signal, 'signal', lambda *_arguments: None)  # Python refuses it in a thread
    monkeypatch.setattr(signal, 'set_wakeup_fd', lambda *_arguments, **_keywords: -1)  # as above
    with contextlib.ExitStack() as stack:

        def start(**parameters):
            mission = Mission(monkeypatch, capfd, tmp_path, **{**settings, **parameters})
            return stack.enter_context(contextlib.closing(mission))

        yield start


@pytest.fixture
def start_waiting_mission(start_mission, node):
    """Return a function that starts a mission which waits for its start; it returns it and its operator."""

    def start(**parameters):
        mission = start_mission(**parameters, wait_for_start=True)
        return mission, Operator(node, mission.namespace)

    return start
