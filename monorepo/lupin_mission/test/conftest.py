"""Fixtures: the real mission, in a thread of the test or as a process, and what is around it."""

import contextlib
import importlib.util
import signal
import threading
import time

import hypothesis
import pytest
import rclpy
from lupin_greenhouse_bridge.runtime.run import spin_once
from lupin_msgs.msg import MissionState, Observation
from lupin_msgs.srv import ConfirmTag, GetTagReading
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor

pytest_plugins = ['lupin_greenhouse_bridge.testing']
# No test may depend on the speed of the machine.
hypothesis.settings.register_profile(
    'unhurried', deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile('unhurried')
# Without launch, the test of the launch file cannot run.
collect_ignore = [] if importlib.util.find_spec('launch_testing') else ['test_bring_up.py']


@pytest.fixture
def settings(tmp_path):
    """Return the parameters of a mission that moves on only when the test replies."""
    from mission_helpers import HOUR

    return {
        'drive': 'simulated',
        'dock_pose': "''",
        'retry_delay_seconds': 0.05,
        'scan_timeout_s': HOUR,
        'visual_confirmation_timeout_s': HOUR,
        'wait_for_start': False,
        'report_file': f'"{tmp_path / "report.jsonl"}"',
    }


@pytest.fixture
def start_mission(settings, tmp_path, monkeypatch, capfd):
    """Return a function that runs a mission in a thread, one at a time; it ends with the test."""
    from mission_helpers import MissionThread, RunningMission

    monkeypatch.setattr(signal, 'signal', lambda *_arguments: None)  # Python refuses it in a thread
    monkeypatch.setattr(signal, 'set_wakeup_fd', lambda *_arguments, **_keywords: -1)  # as above
    with contextlib.ExitStack() as stack:

        def start(**parameters):
            mission = MissionThread(monkeypatch, capfd, **{**settings, **parameters})
            stack.callback(mission.close)
            return RunningMission(mission, tmp_path / 'report.jsonl')

        yield start


@pytest.fixture
def clock(monkeypatch):
    """Return the monotonic clock of this process, which stands still but for what the test adds."""
    from lupin_greenhouse_bridge.testing._helpers import ManualClock

    clock = ManualClock()
    monkeypatch.setattr(time, 'monotonic', clock)
    return clock


@pytest.fixture
def start_process(settings, start_node, tmp_path):
    """Return a function that starts a mission as a process; it ends with the test."""
    from lupin_greenhouse_bridge.testing._helpers import executable
    from mission_helpers import RunningMission

    def start(command=None, environment=None, **parameters):
        command = command or [executable('lupin_mission', 'mission_orchestrator')]
        process = start_node(command, environment=environment, **{**settings, **parameters})
        return RunningMission(process, tmp_path / 'report.jsonl')

    return start


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


@pytest.fixture
def held_service(node):
    """Return a function that makes a service which the test controls."""
    from mission_helpers import HeldService

    with contextlib.ExitStack() as stack:

        def make(service_type, name):
            service = HeldService(node, service_type, name)
            stack.callback(service.close)
            return service

        yield make


@pytest.fixture
def held_navigator(node):
    """Return a function that makes an action server which the test controls."""
    import nav2_msgs.action
    from mission_helpers import HeldNavigator

    with contextlib.ExitStack() as stack:

        def make(name):
            navigator = HeldNavigator(node, nav2_msgs.action.NavigateToPose, name)
            stack.callback(navigator.close)
            return navigator

        yield make


@pytest.fixture
def reader(held_service):
    """Return a GetTagReading service that the test controls."""
    return held_service(GetTagReading, '/held/get_tag_reading')


@pytest.fixture
def confirmer(held_service):
    """Return a ConfirmTag service that the test controls."""
    return held_service(ConfirmTag, '/held/confirm_tag')


@pytest.fixture
def bridge_parameters(held_service):
    """Return the parameter service of a bridge that the test controls."""
    return held_service(GetParameters, '/held/get_parameters')


@pytest.fixture
def operate(node):
    """Return a function that returns the operator of a mission that waits for its start."""
    from mission_helpers import Operator

    return lambda mission: Operator(node, mission.namespace)


@pytest.fixture
def start_waiting_mission(start_mission, operate):
    """Return a function that starts a mission which waits for its start; it returns it and its operator."""

    def start(**parameters):
        mission = start_mission(**parameters, wait_for_start=True)
        return mission, operate(mission)

    return start


@pytest.fixture
def states_of(node):
    """Return a function that subscribes to the state of a mission like a web client."""
    from mission_helpers import WEB_QOS, Subscriber

    return lambda mission: Subscriber(node, MissionState, f'{mission.namespace}/mission/state', WEB_QOS)


@pytest.fixture
def twin(node):
    """Return a function that subscribes like the digital twin."""
    from mission_helpers import TWIN_QOS, Subscriber

    return lambda: Subscriber(node, Observation, '/floranova/observations', TWIN_QOS)
