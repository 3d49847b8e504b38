"""Readings become observations, with the place of the tag or of the robot, but not while a mission runs."""

import math
import threading

import pytest
from geometry_msgs.msg import Pose, PoseWithCovarianceStamped, Quaternion
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS, spinning_node, wait_until
from lupin_mission.passive_observer import PassiveObserver, Settings
from lupin_msgs.msg import DiscoveredTags, MissionState, Observation, SensorReading, TagReading
from lupin_planning.registration import Transform, write_transform
from mission_helpers import Subscriber, discovered, localized, publish
from rclpy.qos import QoSProfile

LATCHED = latched(50)


class Stack:
    """What is around the observer: read_on_sight, the mission, perception, AMCL and the twin."""

    def __init__(self, node, namespace='', amcl_qos=LATCHED, topic='/floranova/observations'):
        self.node, self._namespace, self._topic = node, namespace, topic
        self._readings = self._publisher(TagReading, 'read_on_sight/readings', LATCHED)
        self.states = self._publisher(MissionState, 'mission/state', LATCHED)
        self._tags = self._publisher(DiscoveredTags, 'perception/discovered_tags', LATCHED)
        self._poses = self._publisher(PoseWithCovarianceStamped, 'amcl_pose', amcl_qos)
        self.observations = self.subscribe()
        wait_until(lambda: node.count_publishers(self._topic) == 1)

    def _publisher(self, message_type, name, qos):
        publisher = self.node.create_publisher(message_type, f'{self._namespace}/{name}', qos)
        wait_until(lambda: publisher.get_subscription_count() > 0)
        return publisher

    def _send(self, publisher, message) -> None:
        """Publish a message, and return when the observer has handled it."""
        publish(publisher, message)
        for _ in range(2):  # the executor handles what has arrived between two tasks
            handled = threading.Event()
            self.node.executor.create_task(handled.set)
            assert handled.wait(PATIENCE_SECONDS)

    def subscribe(self) -> Subscriber:
        return Subscriber(self.node, Observation, self._topic, LATCHED)

    def read(self, tag_id: str, *values: float, sim_time: float = 0.0) -> None:
        sensors = [SensorReading(name='co2', value=value) for value in values]
        reading = TagReading(tag_id=tag_id, readings=sensors, sim_time_of_day_seconds=sim_time)
        self._send(self._readings, reading)

    def observe(self, tag_id: str) -> Observation:
        """Read a tag, and return its observation, which must be the next."""
        self.read(tag_id, 600.0)
        observation = self.observations.wait_for()
        assert observation.tag_reading.tag_id == tag_id
        return observation

    def place_of(self, tag_id: str) -> tuple[float, float] | None:
        """Read a tag, and return the place in its observation; None if it is unset."""
        pose = self.observe(tag_id).tag_pose_in_map
        assert pose.orientation.w in (0.0, 1.0)
        return (pose.position.x, pose.position.y) if pose.orientation.w else None

    def mission(self, lifecycle_state: str) -> None:
        self._send(self.states, MissionState(lifecycle_state=lifecycle_state))

    def discover(self, tag_id: str, x: float, y: float, w: float = 1.0, frame: str = 'map') -> None:
        self._send(self._tags, discovered((tag_id, x, y, w), frame_id=frame))

    def stand(self, x: float, y: float, frame: str = 'map') -> None:
        self.send_pose(localized(x, y, frame))

    def send_pose(self, message: PoseWithCovarianceStamped) -> None:
        self._send(self._poses, message)


@pytest.fixture
def stack(run_nodes):
    *_, node = run_nodes(PassiveObserver)
    return Stack(node)


def test_a_reading_becomes_an_observation(stack):
    """It is latched: the twin subscribes reliable and latched."""
    observation = stack.observe('7')
    assert (observation.kind, observation.status) == (observation.KIND_TAG_READING, observation.STATUS_OK)
    assert observation.source == 'PassiveObserver'
    assert observation.mission_id == observation.status_detail == ''
    assert observation.header.frame_id == 'map'
    assert observation.header.stamp.sec > 0
    assert [(sensor.name, sensor.value) for sensor in observation.tag_reading.readings] == [('co2', 600.0)]
    for unset in (observation.tag_pose_in_map, observation.flower.pose.pose, observation.anomaly.pose.pose):
        assert unset == Pose(orientation=Quaternion(w=0.0))
    assert stack.subscribe().wait_for() == observation


def test_the_place_is_the_tags_or_else_the_robots(stack):
    """A place in another frame, or without a finite or a set position, is ignored."""
    stack.discover('7', 3.0, 4.0, w=0.0)
    assert stack.place_of('7') is None
    for x, y, frame in ((3.0, 4.0, 'odom'), (math.nan, 2.0, 'map'), (1.0, math.inf, 'map')):
        stack.discover('7', x, y, frame=frame)
        stack.stand(x, y, frame=frame)
        assert stack.place_of('7') is None
    stack.stand(1.0, 2.0)
    assert stack.place_of('7') == (1.0, 2.0)
    stack.stand(5.0, 6.0)
    assert stack.place_of('7') == (5.0, 6.0)
    stack.discover('7', 3.0, 4.0)
    assert stack.place_of('7') == (3.0, 4.0)
    assert stack.place_of('8') == (5.0, 6.0)


def test_a_frame_other_than_the_maps_is_named_once(stack, capfd):
    for _ in range(2):
        stack.stand(1.0, 2.0, frame='/map')
        stack.discover('7', 1.0, 2.0, frame='/map')
    assert stack.place_of('7') is None
    log = capfd.readouterr().err
    for topic in ('amcl_pose', 'perception/discovered_tags'):
        assert log.count(f"{topic} is in the frame '/map' and is ignored: must be in 'map'") == 1


def test_a_pose_without_a_direction_is_ignored(stack):
    """A twin draws the robot with it."""
    message = localized(1.0, 2.0)
    message.pose.pose.orientation.z = math.nan
    stack.send_pose(message)
    assert stack.place_of('7') is None


def test_the_place_in_a_registered_layout_comes_after_that_of_perception(run_nodes, tmp_path):
    (tmp_path / 'tags.json').write_text('{"7": {"x": 1.0, "y": 2.0, "sensors": ["co2"]}}', encoding='utf-8')
    write_transform(tmp_path / 'layout.yaml', Transform(10.0, 20.0, math.pi / 2))
    files = {'layout_in_map': tmp_path / 'layout.yaml', 'tag_file': tmp_path / 'tags.json'}
    *_, node = run_nodes(PassiveObserver, **files)
    stack = Stack(node)
    stack.stand(5.0, 6.0)
    assert stack.place_of('7') == pytest.approx((8.0, 21.0))
    stack.discover('7', 3.0, 4.0)
    assert stack.place_of('7') == (3.0, 4.0)
    assert stack.place_of('888') == (5.0, 6.0)


def test_a_layout_that_cannot_be_used_is_refused(tmp_path):
    with pytest.raises(StartUpError, match='tag_file has no effect without layout_in_map: set both'):
        Settings(tag_file='/tags.json')
    write_transform(tmp_path / 'layout.yaml', Transform(), 'odom')
    with pytest.raises(StartUpError, match="frame_id is 'odom', but the map's frame is 'map'"):
        Settings(layout_in_map=str(tmp_path / 'layout.yaml')).positions_in_layout()


def test_a_localiser_that_is_older_than_the_observer_is_used(run_nodes):
    """AMCL publishes its pose when the robot moves, and latches it."""
    with spinning_node('amcl') as amcl:
        poses = amcl.create_publisher(PoseWithCovarianceStamped, 'amcl_pose', LATCHED)
        poses.publish(localized(1.0, 2.0))
        *_, node = run_nodes(PassiveObserver)
        stack = Stack(node)
        wait_until(lambda: stack.place_of('7') == (1.0, 2.0))


def test_a_reading_that_cannot_be_is_no_observation(stack, capfd):
    for tag_id, values, sim_time in (
        ('7', [math.nan], 0.0),
        ('7', [600.0, math.inf], 0.0),
        ('7', [600.0], math.nan),
        ('7', [], 0.0),
        ('', [600.0], 0.0),
    ):
        stack.read(tag_id, *values, sim_time=sim_time)
    stack.observe('8')
    assert len(stack.observations.received) == 1
    assert "reading of tag '7' ignored: " in capfd.readouterr().err


def test_it_is_silent_while_a_mission_runs(stack):
    for busy in ('PREPARE', 'EXPLORING', 'INSPECTING', 'MONITORING', 'RETURNING'):
        stack.mission(busy)
        stack.read('7', 600.0)
    for idle in ('BOOT', 'READY', 'DONE', 'FAULT'):
        stack.mission(idle)
        stack.observe('8')
    assert len(stack.observations.received) == 4
    stack.mission('INSPECTING')
    stack.node.destroy_publisher(stack.states)  # it has crashed
    wait_until(lambda: stack.node.count_publishers('/mission/state') == 0)
    stack.observe('8')


def test_its_names_move_with_the_namespace_and_its_topic_and_frame_are_those_of_the_teams_launch_file(
    run_nodes, capfd
):
    """
    The localiser does not latch its pose here.

    It names the arguments of their observer that have no effect, and warns of none.
    """
    theirs = {'observations_topic': 'seen', 'map_frame': 'world', 'refresh_period_s': 2.0}
    *_, node = run_nodes(PassiveObserver, arguments=['-r', '__ns:=/robot1'], **theirs)
    log = capfd.readouterr().err
    assert 'without effect in this node: refresh_period_s' in log
    assert '[WARN]' not in log
    stack = Stack(node, '/robot1', amcl_qos=QoSProfile(depth=50), topic='/robot1/seen')
    stack.stand(1.0, 2.0)
    stack.discover('7', 3.0, 4.0, frame='world')
    assert [stack.place_of(tag_id) for tag_id in '78'] == [(3.0, 4.0), None]
    stack.stand(1.0, 2.0, 'world')
    assert stack.place_of('8') == (1.0, 2.0)
    assert {each.header.frame_id for each in stack.observations.received} == {'world'}
