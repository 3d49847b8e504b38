"""read_on_sight: what it requests, how often, and what it publishes."""

import contextlib
import importlib.util
import os
import re
import sys
from types import SimpleNamespace

import pytest
import rclpy
from lupin_greenhouse_bridge.contract import SERVICE_QOS, latched
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.interfaces import TagReading
from lupin_greenhouse_bridge.runtime.graph import duplicate_server_warning, servers_of
from lupin_greenhouse_bridge.runtime.rclpy_internals import RCLError, pending_requests
from lupin_greenhouse_bridge.testing.helpers import (
    PATIENCE_SECONDS,
    ManualClock,
    executable,
    greet,
    spinning_node,
    wait_until,
)
from lupin_greenhouse_bridge.testing.slow_bridge import SlowBridge, running_slow_bridge
from lupin_greenhouse_bridge.units import value_text
from lupin_readings import read_on_sight
from lupin_readings.detections import Sightings
from lupin_readings.read_on_sight import GetTagReading, ReadOnSightNode, Settings
from rclpy.qos import qos_profile_sensor_data

NO_DETECTIONS = 'apriltag_msgs is missing'
TOPIC, READINGS = '/tested/detections', '/read_on_sight/readings'


@pytest.fixture
def sightings():
    return Sightings(Settings(cooldown_seconds=10.0, request_timeout_seconds=2.0, max_attempts=3))


def asked(sightings, now, *seen) -> list[str]:
    """Return the tags that are requested now, when these are in view."""
    for tag_id in seen:
        sightings.see(tag_id, now)
    tag_ids = []
    while (tag_id := sightings.next()) is not None:
        sightings.asked(tag_id, now)
        tag_ids.append(tag_id)
    return tag_ids


def test_one_request_is_under_way_at_a_time_and_every_tag_has_its_turn(sightings):
    tag_ids, done = [str(number) for number in range(30)], []
    while len(done) < len(tag_ids):
        (tag_id,) = asked(sightings, 0.0, *tag_ids)
        sightings.answered(tag_id, 0.0)
        done.append(tag_id)
    assert done == tag_ids


def test_an_unanswered_request_is_tried_again_so_many_times_and_then_left_for_as_long(sightings):
    assert asked(sightings, -5.0, '7') == ['7']
    assert sightings.timed_out('7', -3.0)
    sightings.forget(-0.5)  # the attempts start again for a tag that comes back into view
    for attempts, now in enumerate((0.0, 2.0, 4.0), 1):
        assert asked(sightings, now, '7') == ['7']
        assert sightings.overdue(now + 1.9) == []
        assert sightings.overdue(now + 2.0) == ['7']
        assert sightings.timed_out('7', now + 2.0) == (attempts < 3)
    assert asked(sightings, 6.0, '7') == asked(sightings, 11.9, '7') == []
    assert asked(sightings, 12.0, '7') == ['7']  # three times two seconds later, before the cooldown
    assert sightings.timed_out('7', 14.0)  # the attempts start again


def test_a_tag_that_left_the_view_while_its_request_was_pending_is_not_requested_again(sightings):
    requests = [asked(sightings, 0.0, '7'), asked(sightings, 1.0, '7')]
    for now in (2.0, 4.0, 6.0):
        for tag_id in sightings.overdue(now):
            sightings.timed_out(tag_id, now)
        requests.append(asked(sightings, now))
    # At 2.0, the tag has been out of view for less than a timeout.
    assert requests == [['7'], [], ['7'], [], []]


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
    with pytest.raises(StartUpError, match=r'parameter tag_id_format is .*: must be a text with \{id\} once'):
        Settings(tag_id_format=tag_id_format)


class Camera:
    """A detector that keeps showing the tags `in_view`, which are pairs of a family and a number."""

    def __init__(self, node):
        from apriltag_msgs.msg import AprilTagDetection, AprilTagDetectionArray

        def show():
            shown = [AprilTagDetection(family=family, id=number) for family, number in self.in_view]
            publisher.publish(AprilTagDetectionArray(detections=shown))

        publisher = node.create_publisher(AprilTagDetectionArray, TOPIC, qos_profile_sensor_data)
        node.create_timer(1 / 30, show)
        self.in_view = []

    def look_at(self, *numbers) -> None:
        self.in_view = [('tag36h11', number) for number in numbers]


def listen(node, topic) -> list[TagReading]:
    readings = []
    node.create_subscription(TagReading, topic, readings.append, latched(50))
    return readings


@pytest.fixture
def detector(robot):
    pytest.importorskip('apriltag_msgs', reason=NO_DETECTIONS)
    return robot


@contextlib.contextmanager
def logged_to(path):
    """Write standard error to a file, because capfd loses what a thread writes while it is read."""
    before = os.dup(2)
    with path.open('ab') as file:
        os.dup2(file.fileno(), 2)
    yield
    os.dup2(before, 2)
    os.close(before)


@pytest.fixture
def start_reader(monkeypatch, run_nodes, detector, tmp_path):
    """
    Return a function that starts the node with a camera, and waits for its service.

    It returns the node, what it has published, and the tags as it sees them. Its clock stands still.
    """

    def start(*, is_served=True, **parameters):
        clock, seen, looks = ManualClock(), [], []
        see, forget = Sightings.see, Sightings.forget
        monkeypatch.setattr(read_on_sight, 'time', SimpleNamespace(monotonic=clock))
        monkeypatch.setattr(Sightings, 'see', lambda *each: seen.append(each[1]) or see(*each))
        monkeypatch.setattr(Sightings, 'forget', lambda *each: looks.append(each[1]) or forget(*each))
        parameters = {'detections_topic': TOPIC, 'bridge_service_name': SlowBridge.name, **parameters}
        stack.enter_context(logged_to(tmp_path / 'log'))
        node, _ = run_nodes(ReadOnSightNode, **parameters)
        (client,) = node.clients
        if is_served:
            assert client.wait_for_service(PATIENCE_SECONDS)
            greet(client, GetTagReading.Request())

        def look(seconds=0.0):
            """Let this time pass, and wait until the node has looked at its pending requests."""
            clock.pass_seconds(seconds)
            wanted = len(looks) + 2
            wait_until(lambda: len(looks) >= wanted)

        def log():
            return (tmp_path / 'log').read_text(encoding='utf-8', errors='replace')

        camera, readings = Camera(detector), listen(detector, READINGS)
        return SimpleNamespace(
            node=node, seen=seen, camera=camera, readings=readings, look=look, log=log, clock=clock
        )

    with contextlib.ExitStack() as stack:
        yield start


def tag_ids_of(readings) -> list[str]:
    return [each.tag_id for each in readings]


def test_every_tag_in_view_is_read_after_a_restart(start_bridge, start_node, detector, shipped_tags):
    in_view = [*map(int, shipped_tags), 400, 401, 402]
    first = start_bridge()
    first.wait_for_log('ready:')
    service = first.service_name
    parameters = {'detections_topic': TOPIC, 'bridge_service_name': service, 'request_timeout_seconds': 0.3}
    reader = start_node(
        [executable('lupin_readings', 'read_on_sight')], cooldown_seconds=3600.0, **parameters
    )
    reader.wait_for_log(f'ready: detections from {TOPIC}, readings from {service}')
    line = reader.wait_for_log(f'no publisher of {TOPIC} is found yet on domain ')
    assert 'wait for a detector that starts' in line
    camera, readings = Camera(detector), listen(detector, f'{reader.namespace}{READINGS}')
    half = in_view[: len(in_view) // 2]
    camera.look_at(*half)
    wait_until(lambda: len(readings) >= len(half))
    first.close()
    camera.look_at(*in_view)
    reader.wait_for_log('no reply from')
    start_bridge(namespace=first.namespace)
    wait_until(lambda: len(readings) >= len(shipped_tags))
    assert sorted((each.tag_id for each in readings), key=int) == sorted(shipped_tags, key=int)
    assert all(each.readings for each in readings)
    said = [reader.wait_for_log('is not in the loaded greenhouse') for _ in range(3)]
    assert sorted(re.search(r"Tag '(\d+)'", line)[1] for line in said) == ['400', '401', '402']
    assert reader.stop() == 0


def test_a_tag_in_view_is_published_after_each_cooldown(noon_bridge, start_reader, detector):
    reader = start_reader(bridge_service_name=noon_bridge.service_name)
    reader.camera.look_at(1)
    for count in (1, 2, 3):
        wait_until(lambda: len(reader.readings) >= count)  # noqa: B023 (called at once)
        reader.look(9.75)
        assert tag_ids_of(reader.readings) == ['1'] * count
        reader.clock.pass_seconds(0.25)
    late = listen(detector, READINGS)
    wait_until(lambda: len(late) >= 3)
    assert late[:3] == reader.readings[:3]
    values = {each.name: each.value for each in reader.readings[0].readings}
    shown = ', '.join(f'{name} {value_text(name, value)}' for name, value in values.items())
    assert reader.log().count(f"tag '1': {shown}") == reader.log().count("tag '1': ") == 1


def test_other_families_are_ignored_and_an_unknown_id_is_said_once(slow_bridge, start_reader):
    slow_bridge.status, slow_bridge.error_message = GetTagReading.Response.STATUS_UNKNOWN_TAG, 'Unknown x6.'
    slow_bridge.reply(1000)
    reader = start_reader(tag_id_format='x{id}', cooldown_seconds=0.01)
    reader.camera.in_view = [('tag25h9', 5), ('tf36h11', 6)]
    wait_until(lambda: reader.clock.pass_seconds(0.01) or len(slow_bridge.requests) >= 4)
    assert set(slow_bridge.requests) == {'x6'}
    shown = reader.log()
    assert shown.count('Unknown x6.') == 1
    assert shown.count("ignored a tag of the family 'tag25h9': the tags of the greenhouse are tag36h11") == 1
    assert reader.readings == []


def test_what_is_no_reading_of_this_tag_is_said_and_not_published(slow_bridge, start_reader, monkeypatch):
    """The tests of read_tag have the other faults."""
    slow_bridge.reply(1000)
    reader = start_reader()
    with monkeypatch.context() as patch:
        patch.setattr(slow_bridge, 'fields', {'tag_id': '8'})
        reader.camera.look_at(7)
        wait_until(lambda: "tag '7': BAD_READING: the reading of tag '7': it is of tag '8'" in reader.log())
    reader.camera.look_at(9)
    wait_until(lambda: reader.readings)
    assert tag_ids_of(reader.readings) == ['9']


def test_two_servers_of_the_service_are_named_once_by_any_name(slow_bridge, start_reader):
    with spinning_node('other') as other:
        other.create_service(GetTagReading, slow_bridge.name, lambda _request, response: response)
        reader = start_reader(arguments=('-r', f'remapped:={slow_bridge.name}'))
        wait_until(lambda: servers_of(reader.node, slow_bridge.name) == ['/other', '/slow'])
        reader.camera.look_at(7, 8)
        named = f'{slow_bridge.name} is offered by /other and /slow: clients use the first reply'
        wait_until(lambda: named in reader.log())
        reader.look()
        assert reader.log().count('is offered by') == 1
        for name in ('slow/get_tag_reading', 'remapped'):
            assert duplicate_server_warning(reader.node, name).startswith(named)


def test_a_late_reply_counts_if_its_request_is_the_last_for_its_tag(slow_bridge, start_reader):
    reader = start_reader(max_attempts=2)
    reader.camera.look_at(7)
    wait_until(lambda: slow_bridge.requests)
    reader.look(2.0)
    assert 'no reply' not in reader.log()
    slow_bridge.reply(2)  # to both requests
    wait_until(lambda: reader.readings)
    reader.camera.look_at(7, 8)
    wait_until(lambda: slow_bridge.requests == ['7', '7', '8'])
    reader.camera.look_at()
    reader.look(3.0)  # the tag has left the view, and its request is over
    slow_bridge.reply()
    wait_until(lambda: len(reader.readings) >= 2)
    assert [each.sim_time_of_day_seconds for each in reader.readings] == [2.0, 3.0]
    assert tag_ids_of(reader.readings) == ['7', '8']


def test_a_tag_without_any_reply_is_said_and_its_request_forgotten(slow_bridge, start_reader):
    reader = start_reader(max_attempts=2)
    reader.camera.look_at(9)
    wait_until(lambda: slow_bridge.requests)
    for _ in range(2):
        reader.look(2.0)
    wait_until(lambda: f"tag '9': no reply from {slow_bridge.name}" in reader.log())
    reader.camera.look_at()
    # rclpy would keep them for ever. A last picture of the camera may still arrive, and cause one more.
    wait_until(lambda: reader.clock.pass_seconds(4.0) or not pending_requests(reader.node._client))


def test_every_tag_is_read_of_a_bridge_that_takes_almost_the_timeout(slow_bridge, start_reader):
    reader = start_reader()
    reader.camera.look_at(*range(5))
    for count in range(1, 6):
        wait_until(lambda: len(slow_bridge.requests) == count)  # noqa: B023 (it is called at once)
        reader.look(1.5)
        slow_bridge.reply()
    wait_until(lambda: len(reader.readings) == 5)
    assert sorted(slow_bridge.requests) == sorted(tag_ids_of(reader.readings)) == list('01234')


def test_a_reply_to_a_request_that_is_given_up_is_ignored(slow_bridge, start_reader, monkeypatch):
    """The executor can have the callback of the reply in its queue when the request is removed."""
    monkeypatch.setattr(rclpy.client.Client, 'remove_pending_request', lambda *_arguments: None)
    reader = start_reader(max_attempts=1)
    reader.camera.look_at(7)
    wait_until(lambda: slow_bridge.requests == ['7'])
    reader.clock.pass_seconds(2.0)
    wait_until(lambda: "tag '7': no reply" in reader.log())
    slow_bridge.reply()
    reader.clock.pass_seconds(2.0)
    wait_until(lambda: slow_bridge.requests == ['7', '7'])
    slow_bridge.reply()
    wait_until(lambda: reader.readings)
    assert [each.sim_time_of_day_seconds for each in reader.readings] == [2.0]


def test_a_request_that_ros_refuses_to_send_is_sent_again(slow_bridge, start_reader, monkeypatch):
    call_async, refused = rclpy.client.Client.call_async, []

    def refuse_the_first(client, request):
        if not refused:
            refused.append(request.tag_id)
            raise RCLError('failed to send request')
        return call_async(client, request)

    slow_bridge.reply()
    reader = start_reader()
    monkeypatch.setattr(rclpy.client.Client, 'call_async', refuse_the_first)
    reader.camera.look_at(7)
    wait_until(lambda: 'continued after: failed to send request' in reader.log())
    wait_until(lambda: reader.readings)
    assert (refused, slow_bridge.requests) == (['7'], ['7'])


def test_without_a_bridge_it_says_so_and_reads_when_one_comes(start_reader):
    reader = start_reader(is_served=False)
    (client,) = reader.node.clients
    assert client.qos_profile == SERVICE_QOS  # keeps as many replies to other clients as the bridge sends
    for number in (1, 2):  # the node has seen all of the first when it sees the second
        reader.camera.look_at(number)
        wait_until(lambda: str(number) in reader.seen)  # noqa: B023 (called at once)
    assert 'no service' not in reader.log()  # DDS may not have discovered a bridge that runs
    reader.look(3.0)
    wait_until(lambda: f'no service {SlowBridge.name} on domain ' in reader.log())
    reader.camera.look_at(3)
    with running_slow_bridge() as service:
        service.reply(1000)
        wait_until(lambda: reader.clock.pass_seconds(0.01) or '3' in service.requests)
        wait_until(lambda: f'{SlowBridge.name} is available now' in reader.log())
    assert '1' not in service.requests
    assert reader.log().count('no service') == 1


def test_without_apriltag_msgs_it_is_refused_in_one_line(run_here, monkeypatch):
    for name in ('apriltag_msgs', 'apriltag_msgs.msg'):
        monkeypatch.setitem(sys.modules, name, None)
    refusal = run_here(read_on_sight.main).refusal
    assert 'package apriltag_msgs' in refusal
    assert 'apriltag-msgs' in refusal


@pytest.mark.skipif(not importlib.util.find_spec('apriltag_msgs'), reason=NO_DETECTIONS)
@pytest.mark.parametrize('name', ['bridge_service_name', 'detections_topic'])
def test_a_wrong_parameter_is_refused_in_one_line(run_here, name):
    refusal = run_here(read_on_sight.main, '--ros-args', '-p', f'{name}:=no name').refusal
    assert f"parameter {name} is 'no name': must be words of letters" in refusal
