"""read_on_sight: what it requests, how often, and what it publishes."""

import importlib.util
import os
import re
import threading

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.read_on_sight import Settings
from lupin_greenhouse_bridge.sightings import MOST_IN_FLIGHT, Limits, Sightings
from lupin_greenhouse_bridge.testing import executable, spinning_node, wait_until
from lupin_msgs.msg import TagReading
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data

needs_detections = pytest.mark.skipif(
    not importlib.util.find_spec('apriltag_msgs'),
    reason='apriltag_msgs is missing: sudo apt install ros-$ROS_DISTRO-apriltag-msgs',
)
TOPIC = '/tested/detections'
LIMITS = Limits(cooldown_seconds=10.0, request_timeout_seconds=2.0, max_attempts=3)


def asked(sightings, now) -> list[str]:
    """Return the tags that are requested now."""
    tag_ids = []
    while (tag_id := sightings.next()) is not None:
        sightings.asked(tag_id, now)
        tag_ids.append(tag_id)
    return tag_ids


def test_a_tag_is_asked_for_once_per_cooldown():
    sightings = Sightings(LIMITS)
    for now in (0.0, 0.1):
        sightings.see('7', now)
    assert asked(sightings, 0.1) == ['7']
    sightings.see('7', 0.2)
    assert asked(sightings, 0.2) == []
    sightings.answered('7', 1.0)
    for now, expected in ((10.9, []), (11.0, ['7'])):
        sightings.forget(now)
        sightings.see('7', now)
        assert asked(sightings, now) == expected


def test_few_requests_are_under_way_at_a_time_and_every_tag_has_its_turn():
    sightings = Sightings(LIMITS)
    tag_ids = [str(number) for number in range(30)]
    done = []
    while len(done) < len(tag_ids):
        for tag_id in tag_ids:
            sightings.see(tag_id, 0.0)
        batch = asked(sightings, 0.0)
        assert 0 < len(batch) <= MOST_IN_FLIGHT
        for tag_id in batch:
            sightings.answered(tag_id, 0.0)
        done += batch
    assert done == tag_ids


def test_an_unanswered_request_is_tried_again_so_many_times_and_then_left_for_as_long():
    sightings = Sightings(LIMITS)
    sightings.see('7', 0.0)
    for attempts, now in enumerate((0.0, 2.0, 4.0), 1):
        assert asked(sightings, now) == ['7']
        assert sightings.overdue(now + 1.9) == []
        assert sightings.overdue(now + 2.0) == ['7']
        assert sightings.lost('7', now + 2.0) == (attempts < 3)
    sightings.see('7', 6.0)
    assert asked(sightings, 6.0) == []
    sightings.see('7', 11.9)
    assert asked(sightings, 11.9) == []
    sightings.see('7', 12.0)  # three times two seconds later, before the cooldown of a reading
    assert asked(sightings, 12.0) == ['7']
    assert sightings.lost('7', 14.0)  # the attempts start again


def test_a_tag_that_has_gone_out_of_view_is_not_asked_for():
    sightings = Sightings(LIMITS)
    sightings.see('7', 0.0)
    sightings.see('8', 1.0)
    sightings.forget(2.5)
    assert asked(sightings, 2.5) == ['8']


@pytest.mark.parametrize(
    ('tag_id_format', 'tag_id'),
    [('{id}', '7'), ('tag_{id}', 'tag_7'), ('{id:03d}', '007'), ('{id:2d}.', ' 7.')],
)
def test_a_number_becomes_a_tag_id(tag_id_format, tag_id):
    assert Settings(tag_id_format=tag_id_format).tag_id(7) == tag_id


@pytest.mark.parametrize(
    'tag_id_format', ['', 'tag', '{}', '{id', '{id}{id}', '{id.real}', '{id:999999999d}', '{0}', '{id!r}']
)
def test_a_format_without_the_number_is_refused(tag_id_format):
    with pytest.raises(StartUpError, match=r'parameter tag_id_format is .*: must hold \{id\} once'):
        Settings(tag_id_format=tag_id_format)


class Reader:
    """The node, a detector that repeats its detections, and a late subscriber."""

    def __init__(self, process, node):
        from apriltag_msgs.msg import AprilTagDetection, AprilTagDetectionArray

        self._detection, self._array = AprilTagDetection, AprilTagDetectionArray
        self.process = process
        process.wait_for_log('ready:')
        self._node = node
        self._detections = node.create_publisher(AprilTagDetectionArray, TOPIC, qos_profile_sensor_data)
        wait_until(lambda: self._detections.get_subscription_count() == 1)
        self.readings = []
        self._pause = threading.Event()

    def see(self, numbers, family='tag36h11') -> None:
        """Show these tags for a thirtieth of a second."""
        detections = [self._detection(family=family, id=number) for number in numbers]
        self._detections.publish(self._array(detections=detections))
        self._pause.wait(1 / 30)

    def listen(self) -> None:
        """Subscribe to the readings, the earlier ones included."""
        latched = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        topic = f'{self.process.namespace}/read_on_sight/readings'
        self._node.create_subscription(TagReading, topic, self.readings.append, latched)

    def ids(self) -> list[str]:
        return [each.tag_id for each in self.readings]


@pytest.fixture
def start_reader(start_node):
    """Return a function that starts the node with these parameters."""
    with spinning_node('detector') as node:

        def start(**parameters):
            command = [executable('lupin_greenhouse_bridge', 'read_on_sight')]
            return Reader(start_node(command, detections_topic=TOPIC, **parameters), node)

        yield start


@needs_detections
def test_every_tag_in_view_is_read_though_the_bridge_is_restarted(start_bridge, start_reader, shipped_tags):
    """Thirty-two tags at 30 Hz, some of them unknown, without a bridge half of the time."""
    in_view = [*map(int, shipped_tags), 400, 401, 402]
    service = '/tested/get_tag_reading'
    command = [executable('lupin_greenhouse_bridge', 'bridge_node')]
    command += ['--ros-args', '-r', f'~/get_tag_reading:={service}']
    first = start_bridge(command)
    first.wait_for_log('ready:')
    reader = start_reader(bridge_service_name=service, cooldown_seconds=3600.0, request_timeout_seconds=0.5)
    reader.listen()
    half = in_view[: len(in_view) // 2]
    wait_until(lambda: reader.see(half) or len(reader.readings) == len(half))
    first.close()
    for _ in range(15):
        reader.see(in_view)
    start_bridge(command)
    wait_until(lambda: reader.see(in_view) or len(reader.readings) >= len(shipped_tags))
    assert sorted(reader.ids(), key=int) == sorted(shipped_tags, key=int)
    assert all(each.readings for each in reader.readings)
    said = [reader.process.wait_for_log('is not in the loaded greenhouse') for _ in range(3)]
    assert sorted(re.search(r"Tag '(\d+)'", line)[1] for line in said) == ['400', '401', '402']
    assert reader.process.stop() == 0


@needs_detections
def test_a_late_subscriber_hears_what_was_read_before(start_bridge, start_reader):
    bridge = start_bridge()
    bridge.connect()
    reader = start_reader(bridge_service_name=bridge.service_name, cooldown_seconds=3600.0)
    for _ in range(60):
        reader.see([1])
    reader.listen()
    wait_until(lambda: reader.ids() == ['1'])


@needs_detections
def test_a_tag_in_view_is_published_again_after_its_cooldown(start_bridge, start_reader):
    bridge = start_bridge()
    bridge.connect()
    reader = start_reader(bridge_service_name=bridge.service_name, cooldown_seconds=0.3)
    reader.listen()
    wait_until(lambda: reader.see([1]) or len({each.stamp.nanosec for each in reader.readings}) >= 3)
    assert set(reader.ids()) == {'1'}


@needs_detections
def test_other_families_are_ignored_the_format_makes_the_id_and_an_unknown_one_is_said_once(
    start_bridge, start_reader
):
    bridge = start_bridge()
    bridge.connect()
    reader = start_reader(
        bridge_service_name=bridge.service_name, tag_id_format='x{id}', cooldown_seconds=0.1
    )
    reader.see([5], family='tag25h9')
    for _ in range(30):
        reader.see([6], family='tf36h11')
    unknown = "Tag 'x6' is not in the loaded greenhouse"
    reader.process.wait_for_log(unknown)
    for _ in range(30):
        reader.see([6])
    assert reader.process.stop() == 0
    assert sum(unknown in line for line in reader.process.log) == 1
    assert not any("'x5'" in line for line in reader.process.log)


@needs_detections
def test_a_tag_that_was_seen_long_before_the_bridge_came_is_not_read(start_bridge, start_reader):
    service = '/tested/late/get_tag_reading'
    reader = start_reader(bridge_service_name=service, request_timeout_seconds=0.3)
    reader.listen()
    reader.see([1])
    for _ in range(30):
        reader.see([])
    command = [executable('lupin_greenhouse_bridge', 'bridge_node')]
    start_bridge([*command, '--ros-args', '-r', f'~/get_tag_reading:={service}'])
    wait_until(lambda: reader.see([2]) or reader.readings)
    assert set(reader.ids()) == {'2'}


@needs_detections
def test_without_a_bridge_it_says_so_now_and_then_and_ends_at_once(start_reader):
    reader = start_reader(bridge_service_name='/nobody/get_tag_reading')
    for _ in range(30):
        reader.see([1])
    reader.process.wait_for_log('no service /nobody/get_tag_reading: start the bridge')
    assert reader.process.stop() == 0
    assert len([line for line in reader.process.log if 'no service' in line]) == 1


def test_without_apriltag_msgs_it_is_refused_in_one_line(start_node, tmp_path, monkeypatch):
    hidden = tmp_path / 'apriltag_msgs'
    hidden.mkdir()
    (hidden / '__init__.py').write_text("raise ImportError('hidden')", encoding='utf-8')
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}:{os.environ.get("PYTHONPATH", "")}')
    refusal = start_node([executable('lupin_greenhouse_bridge', 'read_on_sight')]).refusal()
    assert 'package apriltag_msgs' in refusal
    assert 'sudo apt install ros-$ROS_DISTRO-apriltag-msgs' in refusal


@pytest.mark.parametrize(
    ('name', 'value', 'fragment'),
    [
        ('max_attempts', 0, 'parameter max_attempts is 0: must be a whole number from 1 to 1000'),
        ('bridge_service_name', 'no name', 'parameter bridge_service_name is not a service name'),
        ('tag_id_format', 'tag', "parameter tag_id_format is 'tag': must hold {id} once"),
        pytest.param('detections_topic', 'no name', 'no name', marks=needs_detections),
    ],
)
def test_a_wrong_parameter_is_refused_in_one_line(start_node, name, value, fragment):
    process = start_node([executable('lupin_greenhouse_bridge', 'read_on_sight')], **{name: value})
    assert fragment in process.refusal()
