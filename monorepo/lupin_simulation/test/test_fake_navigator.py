"""The fake navigator in the test's process, with a client of its action. The test moves its clock."""

import gc
import importlib.util
import math
import sys
from types import SimpleNamespace

import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import OneLineError
from lupin_greenhouse_bridge.simulator.layout import find_layout
from lupin_greenhouse_bridge.testing.helpers import (
    PATIENCE_SECONDS,
    ManualClock,
    repeat_until_answered,
    running,
    wait_until,
)
from lupin_planning.approach import find_approaches
from lupin_planning.grid import Grid, length_m
from lupin_planning.poses import PoseInPlane, pose_in_plane, pose_message
from lupin_planning.viewpoints import ViewingLimits
from lupin_planning.walls import find_walls
from lupin_simulation import fake_navigator
from lupin_simulation.fake_navigator import FakeNavigator
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient

LAYOUT = find_layout('')
START = (0.5, 0.5)
WALLS = find_walls(LAYOUT)
POSES = find_approaches(LAYOUT, WALLS, ViewingLimits()).poses
NEAR, FAR = (PoseInPlane(*POSES[tag_id][:3]) for tag_id in ('1', '7'))
OCCUPIED = f'the goal at {FAR.x:.2f}, {FAR.y:.2f} m is occupied'
HOUR = 3600.0
actions = importlib.import_module('nav2_msgs.action') if importlib.util.find_spec('nav2_msgs') else None
pytestmark = pytest.mark.skipif(not actions, reason='nav2_msgs is missing')
# The stand-in for nav2_msgs has the actions of three distros, and the real one only that of its own.
ACTIONS = ('NavigateToPose', 'NavigateToPoseIron', 'NavigateToPoseHumble')


def result_of(future):
    wait_until(future.done)
    return future.result()


class Client:
    def __init__(self, node, action_type):
        self._node, self._type = node, action_type
        self.server = ActionClient(node, action_type, 'navigate_to_pose')
        self.odometry, self.estimates, self.feedback = [], [], []
        node.create_subscription(Odometry, '/odom', self.odometry.append, 10)
        node.create_subscription(PoseWithCovarianceStamped, '/amcl_pose', self.estimates.append, latched())

    def wait_for_server(self) -> 'Client':
        """
        Wait until the action has answered this client; return the client.

        DDS drops its replies until it has discovered the client. A goal without a frame is rejected.
        """
        assert self.server.wait_for_server(timeout_sec=PATIENCE_SECONDS)
        goal = self._type.Goal()
        repeat_until_answered(lambda: self._node.executor.create_task(self._reply_to, goal), 'the action')
        return self

    def send(self, pose: PoseInPlane, frame_id: str = 'map'):
        goal = self._type.Goal()
        goal.pose.header.frame_id = frame_id
        goal.pose.pose = pose_message(*pose)
        # In the thread that spins: rclpy can lose a reply that comes while another thread sends the goal.
        return result_of(self._node.executor.create_task(self._reply_to, goal))

    async def _reply_to(self, goal):
        return await self.server.send_goal_async(goal, feedback_callback=self.feedback.append)

    def status_of(self, goal) -> int:
        return result_of(goal.get_result_async()).status

    def is_aborted(self, goal, **reason) -> bool:
        """Return whether a goal ends aborted, for this reason in the fields that the distro's message has."""
        response = result_of(goal.get_result_async())
        told = {name: getattr(response.result, name, value) for name, value in reason.items()}
        return (response.status, told) == (GoalStatus.STATUS_ABORTED, reason)

    def arrives_at(self, pose: PoseInPlane, clock) -> bool:
        """Send a goal and let an hour pass; return whether the goal has succeeded."""
        goal = self.send(pose)
        clock.pass_seconds(HOUR)
        return self.status_of(goal) == GoalStatus.STATUS_SUCCEEDED

    def stays_at(self, here: PoseInPlane, clock) -> None:
        clock.pass_seconds(HOUR)
        for _ in range(3):
            assert self.wait_until_robot(lambda _pose: True) == here

    def wait_until_robot(self, is_it) -> PoseInPlane:
        heard = len(self.odometry)
        wait_until(lambda: len(self.odometry) > heard and is_it(pose_in_plane(self.odometry[-1].pose.pose)))
        return pose_in_plane(self.odometry[-1].pose.pose)


@pytest.fixture
def clock(monkeypatch):
    """Return the clock of the robot, which stands still but for what the test adds."""
    clock = ManualClock()
    monkeypatch.setattr(fake_navigator, 'time', SimpleNamespace(monotonic=clock))
    return clock


@pytest.fixture(autouse=True)
def collected():
    """Rclpy leaves clients of actions and life cycles, and with each its participant, to this collector."""
    yield
    gc.collect()


@pytest.fixture
def start(monkeypatch, run_nodes, clock):  # noqa: ARG001 - the robot has its clock from the start
    """Return a function that runs the navigator with these parameters, and returns its client."""

    def start_navigator(action='NavigateToPose', **parameters):
        action_type = getattr(actions, action)
        monkeypatch.setattr(fake_navigator, 'navigate_to_pose', lambda *_: action_type)
        _, node = run_nodes(FakeNavigator, **parameters)
        # In the thread that spins: rclpy spins a client of an action before it is complete.
        client = result_of(node.executor.create_task(Client, node, action_type))
        return client.wait_for_server()

    return start_navigator


def test_the_robot_drives_around_the_tables_to_its_goal_and_says_where_it_is(start, clock, tmp_path):
    client = start(route_file=str(tmp_path / 'route.csv'), robot_radius_m=0.2)
    goal = client.send(FAR)
    wait_until(lambda: client.feedback and client.odometry and client.estimates)  # three topics
    clock.pass_seconds(5.0)
    wait_until(lambda: client.feedback[-1].feedback.distance_remaining < length_m([START, FAR[:2]]))
    feedback = client.feedback[-1].feedback
    assert feedback.current_pose.header.frame_id == 'map'
    assert 0.0 < feedback.distance_remaining < client.feedback[0].feedback.distance_remaining
    wait_until(lambda: client.odometry[-1].pose.pose == feedback.current_pose.pose)  # two topics
    clock.pass_seconds(HOUR)
    assert client.status_of(goal) == GoalStatus.STATUS_SUCCEEDED
    wait_until(lambda: client.feedback[-1].feedback.distance_remaining == 0.0)
    wait_until(lambda: pose_in_plane(client.estimates[-1].pose.pose) == pytest.approx(FAR))
    client.wait_until_robot(lambda pose: pose == pytest.approx(FAR))  # a topic of its own
    assert (client.odometry[-1].header.frame_id, client.odometry[-1].child_frame_id) == ('odom', 'base_link')
    assert client.estimates[-1].header.frame_id == 'map'
    header, *lines = (tmp_path / 'route.csv').read_text(encoding='utf-8').splitlines()
    route = [tuple(map(float, line.split(','))) for line in lines]
    assert (header, route[0], route[-1]) == ('x,y', START, pytest.approx(FAR[:2], abs=1e-3))
    assert length_m(route) > math.dist(START, FAR[:2]) + 0.1
    assert Grid(LAYOUT, WALLS, 0.19).are_in_sight(route[:-1], route[1:]).all()
    client.feedback.clear()
    client.send(FAR._replace(yaw=FAR.yaw + 3.0))
    clock.pass_seconds(0.1)  # it only turns
    wait_until(lambda: client.feedback and client.feedback[-1].feedback.distance_remaining == 0.0)


@pytest.mark.parametrize('action', [each for each in ACTIONS if hasattr(actions, each)])
def test_a_goal_in_an_obstacle_is_aborted_with_the_reason_that_the_distro_can_tell(start, clock, action):
    blocked = f'{FAR.x - 0.1} {FAR.y - 0.1} {FAR.x + 0.1} {FAR.y + 0.1}'
    client = start(action, blocked=blocked)
    assert client.is_aborted(client.send(FAR), error_code=206, error_msg=OCCUPIED)
    assert client.arrives_at(NEAR, clock)


def test_a_goal_that_is_cut_off_is_aborted_with_the_code_for_no_path(start):
    client = start(blocked='0.0 2.0 4.0 2.5')
    assert client.is_aborted(client.send(PoseInPlane(0.5, 4.0, 0.0)), error_code=208)


def test_a_goal_that_is_cancelled_or_replaced_ends_and_one_that_is_no_pose_in_the_map_is_rejected(
    start, clock
):
    client = start(speedup=20)
    for pose, frame_id in ((FAR, 'odom'), (FAR, ''), (PoseInPlane(math.nan, 1.0, 0.0), 'map')):
        assert not client.send(pose, frame_id).accepted
    goal = client.send(FAR)
    clock.pass_seconds(5.0 / 20)
    here = client.wait_until_robot(lambda pose: math.dist(pose[:2], START) > 0.5)
    result_of(goal.cancel_goal_async())
    client.stays_at(here, clock)
    assert client.status_of(goal) == GoalStatus.STATUS_CANCELED
    first, second = client.send(FAR), client.send(NEAR)
    assert client.is_aborted(first, error_msg='replaced by a newer goal')
    clock.pass_seconds(HOUR)
    assert client.status_of(second) == GoalStatus.STATUS_SUCCEEDED
    client.wait_until_robot(lambda pose: pose == pytest.approx(NEAR))


@pytest.mark.parametrize(
    ('path', 'problem'),
    [
        (__file__, 'exists and is not from this program: name another file'),
        ('/none/route.csv', "there is no folder '/none': name a folder that exists"),
    ],
)
def test_a_route_that_cannot_be_written_is_refused(start, path, problem):
    with pytest.raises(OneLineError, match=problem):
        start(route_file=path)


def test_without_nav2_msgs_it_advises_no_parameter_of_the_mission(monkeypatch):
    monkeypatch.setitem(sys.modules, 'nav2_msgs.action', None)
    refused = pytest.raises(OneLineError, match=r'^fake_navigator needs the package nav2_msgs')
    with refused as refusal, running(FakeNavigator):
        pass
    assert 'drive' not in str(refusal.value)
