"""The drive with Nav2, against a real action server whose every step the test holds."""

import importlib.util
import math
import uuid

import pytest
import rclpy
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import PoseStamped
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS, wait_until
from lupin_mission.drive import Arrival
from lupin_mission.mission import Severity
from lupin_mission.nav2_drive import Nav2Drive
from lupin_mission.sent_goal import GoalState
from lupin_mission.settings import Settings
from lupin_planning.poses import PoseInPlane, pose_message
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

actions = importlib.import_module('nav2_msgs.action') if importlib.util.find_spec('nav2_msgs') else None
pytestmark = pytest.mark.skipif(not actions, reason='nav2_msgs is missing')
HOUR = 3600.0
HERE = Arrival()
NORTH = math.pi / 2
POSE_OF_A = (1.0, 2.0, NORTH)


class Trip:
    """A drive on a node of its own, spun by the test: a callback that waits would hang the test."""

    def __init__(self, node, held_navigator, **options):
        self.name = f'/test_{uuid.uuid4().hex[:8]}/navigate_to_pose'
        self.now_seconds = 0.0
        self.notes = []
        self.localized_pose = None  # a PoseStamped
        settings = Settings(drive='nav2', nav_action_name=self.name, **options)
        self.drive = Nav2Drive(
            node, settings, lambda *note: self.notes.append(note), lambda: self.localized_pose
        )
        self.drive.goals.update(a=[PoseInPlane(*POSE_OF_A)], b=[PoseInPlane(3.0, 4.0, 0.0)])
        self.navigator = held_navigator(self.name)
        self._node = node
        self.change_executor()

    def change_executor(self) -> None:
        self.executor = SingleThreadedExecutor(context=self._node.context)
        self.executor.add_node(self._node)

    def start(self, tag_id: str) -> None:
        self.drive.start(tag_id, self.now_seconds)

    def spin(self) -> Arrival | None:
        """Do what the mission's node does in a step."""
        self.executor.spin_once(timeout_sec=0.002)
        return self.drive.arrival(self.now_seconds)

    def spin_until(self, is_so) -> None:
        """Run callbacks, without steps, until something is so."""
        wait_until(lambda: self.executor.spin_once(timeout_sec=0.002) or is_so())

    def drive_until(self, is_so) -> None:
        """Drive until something is so, and do not arrive before."""

        def is_so_on_the_way():
            assert self.spin() is None
            return is_so()

        wait_until(is_so_on_the_way)

    def arrival(self) -> Arrival:
        """Return how the drive ends, without the passing of its time."""
        arrivals = []
        wait_until(lambda: arrivals.append(self.spin()) or arrivals[-1])
        return arrivals[-1]

    def accepted(self):
        """Return the handle of a goal that the server has accepted, and that the drive knows to be so."""
        self.drive_until(self.navigator.has_goal)
        self.navigator.wait_for_goal()
        goal = self.navigator.accept()
        self.drive_until(lambda: self.drive._sent.state is GoalState.ACCEPTED)
        return goal

    def under_way(self):
        """Set off to tag a, and return the handle of its goal, which the server has accepted."""
        self.start('a')
        return self.accepted()

    def rejected(self) -> None:
        self.drive_until(self.navigator.has_goal)
        self.navigator.wait_for_goal()
        self.navigator.reject()
        self.drive_until(lambda: self.drive._sent.state is GoalState.REJECTED)

    def arrives(self) -> bool:
        self.navigator.end(self.accepted(), 'succeed')
        return self.arrival() == HERE


@pytest.fixture
def make_trip(held_navigator):
    context = Context()
    rclpy.init(args=[], context=context)
    name = f'driver_{uuid.uuid4().hex[:8]}'  # of the node before, the graph may still know the clients
    driver = rclpy.create_node(name, context=context)
    trips = []

    def make(**options):
        trips.append(Trip(driver, held_navigator, **options))
        return trips[-1]

    yield make
    for trip in trips:  # the executor first: the thread of the test spins it
        trip.executor.shutdown()
        trip.drive.close()
    driver.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture
def trip(make_trip):
    return make_trip()


def test_the_goal_is_a_pose_of_the_tag_or_the_dock_in_the_map(make_trip):
    trip = make_trip(dock_pose='5.0 6.0 0.0')
    trip.drive.unreachable['c'] = 'cut off'
    for tag_id, reason in (('c', 'cut off'), ('d', 'the layout does not have this tag')):
        trip.start(tag_id)
        assert trip.spin() == Arrival(reason, is_final=True)
    trip.start('a')
    assert trip.arrives()
    trip.drive.start_return(0.0)
    assert trip.arrives()
    assert trip.drive.is_over()
    to_tag, to_dock = trip.navigator.goals
    assert to_tag.header.frame_id == 'map'
    assert (to_tag.header.stamp.sec, to_tag.header.stamp.nanosec) == (0, 0)  # the latest transform
    assert (to_tag.pose, to_dock.pose) == (pose_message(*POSE_OF_A), pose_message(5.0, 6.0, 0.0))


def test_a_server_that_rejects_goals_gets_the_goal_again_for_30_s(trip):
    warning = (f'{trip.name} rejects goals: activate Nav2; trying again', Severity.WARN)
    trip.start('a')
    for count, trip.now_seconds in enumerate((0.0, 0.5, 29.9), start=1):
        trip.rejected()
        assert trip.spin() is None
        assert (trip.notes, len(trip.navigator.goals)) == ([warning], count)
    trip.now_seconds = 30.0
    failure = f'{trip.name} rejects every goal: activate Nav2'
    assert trip.spin() == Arrival(failure, needs_person=True, code='dependency_timeout')
    trip.start('a')
    trip.rejected()
    assert trip.spin() is None  # for 30 s again
    trip.now_seconds += 0.5
    assert trip.arrives()
    assert trip.drive.is_over()
    assert trip.notes == [warning]
    trip.start('a')
    trip.rejected()
    assert trip.notes == [warning, warning]


def test_a_goal_that_another_client_preempts_needs_a_person(trip, node):
    """As RViz's 2D Goal Pose does; Nav2 aborts the goal before."""
    goal = trip.under_way()
    rviz = rclpy.create_node('rviz', context=node.context)
    # On a node that nobody spins: rclpy spins a client of an action before it is complete.
    someone = ActionClient(rviz, actions.NavigateToPose, trip.name)
    assert someone.wait_for_server(PATIENCE_SECONDS)
    someone.send_goal_async(actions.NavigateToPose.Goal())
    trip.drive_until(trip.navigator.has_goal)
    trip.navigator.wait_for_goal()
    trip.navigator.accept()
    trip.navigator.end(goal, 'abort')
    assert trip.arrival() == Arrival('another client drives the robot', needs_person=True)
    trip.drive.resume()
    trip.navigator.end(trip.under_way(), 'abort')  # it has taken the robot back
    assert trip.arrival() == Arrival(f'{trip.name} aborted the drive')
    someone.destroy()
    rviz.destroy_node()


@pytest.mark.parametrize(
    ('how', 'positions', 'is_stuck'),
    [
        ('abort', [], False),
        ('abort', [(1.0, 1.0), (1.0, 1.04)], True),
        ('abort', [(1.0, 1.0), (1.0, 1.06), (1.0, 1.0)], False),
        ('is late', [(1.0, 1.0), (1.0, 1.04)], True),
    ],
)
def test_a_drive_that_fails_where_it_began_is_stuck(trip, positions, is_stuck, how):
    goal = trip.under_way()
    sent = trip.drive._sent
    moved_m = max((math.dist(positions[0], each) for each in positions), default=0.0)
    for position in positions:
        trip.navigator.tell_pose(goal, *position)
    trip.drive_until(lambda: bool(sent._start) == bool(positions) and sent._farthest_m >= moved_m)
    if how == 'abort':
        trip.navigator.end(goal, how)
    else:
        trip.now_seconds = 60.0
    assert trip.arrival().is_stuck == is_stuck


OFF = (1.0, 2.389, NORTH - math.radians(32.0))


@pytest.mark.parametrize(
    ('told', 'frame_id', 'localized', 'localized_at_seconds', 'miss'),
    [
        (POSE_OF_A, 'map', None, 0, ''),
        ((1.0, 2.1, -1.5 * math.pi - 0.24), 'map', None, 0, ''),  # near enough
        ((1.0, 2.12, NORTH), 'map', None, 0, '0.12 m and 0 degrees'),
        ((1.0, 2.0, NORTH - 0.27), 'map', None, 0, '0.00 m and 15 degrees'),
        (OFF, 'odom', None, 0, ''),
        (OFF, 'map', POSE_OF_A, 101, ''),
        (OFF, 'map', POSE_OF_A, 99, '0.39 m and 32 degrees'),
        (POSE_OF_A, 'map', OFF, 101, '0.39 m and 32 degrees'),
        (None, 'map', OFF, 99, ''),
    ],
)
def test_a_drive_that_succeeded_elsewhere_tells_how_far_off_the_robot_stands(
    trip, told, frame_id, localized, localized_at_seconds, miss
):
    if localized:
        trip.localized_pose = PoseStamped(pose=pose_message(*localized))
        trip.localized_pose.header.frame_id = 'map'
        trip.localized_pose.header.stamp.sec = localized_at_seconds
    goal = trip.under_way()
    if told:
        trip.navigator.tell_pose(goal, *told, frame_id=frame_id)
        trip.drive_until(lambda: trip.drive._sent.pose)
    trip.navigator.end(goal, 'succeed')
    if miss:  # a newer pose may still come
        trip.drive_until(lambda: trip.drive._sent.ended_at_seconds is not None)
        trip.now_seconds += 1.0
    assert trip.arrival() == Arrival(miss=miss)


def test_a_pose_that_is_not_finite_is_no_pose(trip):
    goal = trip.under_way()
    for pose in ((math.nan, 2.0, NORTH), (0.0, 0.0, math.nan), (0.0, 0.0, NORTH), POSE_OF_A):
        trip.navigator.tell_pose(goal, *pose)
    trip.drive_until(lambda: trip.drive.position_m() == POSE_OF_A[:2])
    trip.navigator.end(goal, 'abort')
    assert not trip.arrival().is_stuck


def test_a_pose_in_another_frame_is_named_once(trip):
    for _ in range(2):
        goal = trip.under_way()
        trip.navigator.tell_pose(goal, *POSE_OF_A, frame_id='/map')
        trip.drive_until(lambda: trip.drive._sent.pose)
        trip.navigator.end(goal, 'succeed')
        assert trip.arrival() == HERE
    (note,) = trip.notes
    assert "'/map', not 'map'" in note[0]


# The stand-in for nav2_msgs has the actions of three distros, and the real one only that of its own.
ABORTS = [
    ('NavigateToPoseHumble', {}, ''),
    ('NavigateToPoseIron', {'error_code': 104}, ' with code 104'),
    ('NavigateToPose', {'error_code': 104, 'error_msg': 'no\nway'}, r' with code 104: no\nway'),
]


def has_fields(name: str, fields) -> bool:
    action = getattr(actions, name, None)
    return action is not None and all(hasattr(action.Result, field) for field in fields)


@pytest.mark.parametrize(('name', 'result', 'reason'), [each for each in ABORTS if has_fields(*each[:2])])
def test_an_abort_is_a_failed_drive_with_code_and_message(make_trip, monkeypatch, name, result, reason):
    monkeypatch.setattr(actions, 'NavigateToPose', getattr(actions, name))
    trip = make_trip()
    trip.navigator.end(trip.under_way(), 'abort', **result)
    assert trip.arrival() == Arrival(f'{trip.name} aborted the drive{reason}')


@pytest.mark.parametrize('is_accepted', [False, True])
def test_a_goal_without_a_reply_or_an_end_is_given_up_and_cancelled_once_it_is_accepted(trip, is_accepted):
    trip.start('a')
    if is_accepted:
        goal = trip.accepted()
        limit_seconds, failure = 60.0, 'the robot did not arrive within 60 s'
    else:
        limit_seconds, failure = 5.0, f'{trip.name} did not reply to the goal'
        trip.drive_until(trip.navigator.has_goal)
    trip.now_seconds = limit_seconds - 0.1
    assert trip.spin() is None
    trip.now_seconds = limit_seconds
    assert trip.spin() == Arrival(failure)
    trip.start('a')
    goal = goal if is_accepted else trip.navigator.accept()
    trip.drive_until(trip.navigator.has_cancel)
    trip.navigator.grant_cancel(goal)
    trip.drive_until(lambda: len(trip.navigator.goals) == 2)


def test_a_goal_that_another_client_cancels_is_a_failed_drive(trip, node):
    goal = trip.under_way()
    someone = node.create_client(CancelGoal, f'{trip.name}/_action/cancel_goal')
    wait_until(someone.service_is_ready)
    someone.call_async(CancelGoal.Request())  # cancels all goals
    trip.navigator.grant_cancel(goal)
    assert trip.arrival() == Arrival('another client cancelled the drive')


def test_a_cancel_that_is_refused_is_an_error_and_the_next_goal_is_sent_after_2_s(trip):
    trip.under_way()
    trip.drive.stop()
    trip.start('b')
    trip.navigator.answer_cancel(accept=False)
    refusal = f'{trip.name} refused to cancel the drive: the robot may still move'
    trip.drive_until(lambda: trip.notes == [(refusal, Severity.ERROR)])
    assert not trip.drive.is_over()
    trip.now_seconds = 1.9
    assert trip.spin() is None
    assert len(trip.navigator.goals) == 1
    trip.now_seconds = 2.0
    assert trip.arrives()


def test_a_server_that_dies_under_way_is_a_failed_drive_and_its_successor_gets_the_goal(trip, held_navigator):
    trip.under_way()
    trip.navigator.close()
    assert trip.arrival() == Arrival(f'{trip.name} has gone')
    trip.start('a')
    assert trip.spin() is None
    trip.navigator = held_navigator(trip.name)
    assert trip.arrives()
    assert trip.drive.is_over()


def test_without_a_limit_a_drive_lasts_until_its_server_starts_again(make_trip, held_navigator):
    """Even between two looks."""
    trip = make_trip(nav_timeout_s=0.0)
    trip.under_way()
    trip.now_seconds = HOUR
    trip.drive_until(lambda: trip.drive._sent.servers)
    trip.navigator.close()
    held_navigator(trip.name)
    before, drive = trip.drive._sent.servers, trip.drive
    trip.spin_until(lambda: drive._client.server_is_ready() and drive._servers() - before)
    assert trip.arrival() == Arrival(f'{trip.name} has restarted')


@pytest.mark.parametrize('how', ['succeed', 'canceled'])
def test_a_result_that_comes_after_a_cancel_is_not_that_of_the_next_drive(trip, how):
    goal = trip.under_way()
    trip.drive.stop()
    trip.start('b')
    trip.drive_until(trip.navigator.has_cancel)
    assert len(trip.navigator.goals) == 1  # the next goal waits for the end of this one
    trip.navigator.answer_cancel()
    trip.navigator.end(goal, how)
    assert trip.arrives()
    assert len(trip.navigator.goals) == 2


def test_a_success_at_the_moment_of_a_pause_counts(trip):
    goal = trip.under_way()
    trip.drive.pause()
    trip.navigator.wait_for_cancel()
    trip.navigator.end(goal, 'succeed')
    trip.navigator.answer_cancel()
    trip.drive.resume()
    assert trip.arrival() == HERE
    assert len(trip.navigator.goals) == 1


def test_a_reply_whose_executor_has_ended_is_taken_under_the_next(trip):
    """An error in another callback ends the executor between a reply and the callback of its future."""
    trip.start('a')
    trip.drive_until(trip.navigator.has_goal)
    goal = trip.navigator.accept()
    trip.spin_until(trip.drive._sent._awaited[0][0].done)
    trip.executor.shutdown()
    trip.change_executor()
    trip.drive.stop()
    trip.spin_until(lambda: trip.drive.is_over() or trip.navigator.has_cancel())
    trip.navigator.grant_cancel(goal)
    trip.spin_until(trip.drive.is_over)


def test_after_a_pause_of_an_hour_the_goal_is_sent_again_with_all_its_time(trip):
    goal = trip.under_way()
    trip.now_seconds = 50.0
    assert trip.spin() is None
    trip.drive.pause()
    trip.spin_until(trip.navigator.has_cancel)
    trip.navigator.grant_cancel(goal)
    trip.spin_until(trip.drive.is_over)
    trip.now_seconds += HOUR
    trip.drive.resume()
    goal = trip.accepted()
    trip.now_seconds += 59.9
    assert trip.spin() is None
    trip.navigator.end(goal, 'succeed')
    assert trip.arrival() == HERE
    assert [each.pose.position.x for each in trip.navigator.goals] == [1.0, 1.0]
