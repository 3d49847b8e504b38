"""The tags and their places: of a world, as discovered, by the registered layout, or that of the robot."""

import json
import math
import threading

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.runtime.rclpy_internals import pending_requests
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS, has_found_a_client, wait_until
from lupin_mission import tags as tags_of_bridge
from lupin_mission.settings import Settings
from lupin_mission.tags import Tags
from lupin_mission.world import read_world
from lupin_msgs.srv import GetTagReading
from lupin_planning.registration import Transform, write_transform
from mission_helpers import CAMERA, READER, TWIN_QOS, discovered, localized, publish
from rclpy.client import Client

TRANSFORM = Transform(10.0, 20.0, math.pi / 2)
MODEL = '<model name="tag_{}"><pose>{}</pose></model>'
NESTED_ENTITIES = ''.join(f'<!ENTITY x{each + 1} "{f"&x{each};" * 10}">' for each in range(8))


def world(*models: str) -> str:
    return f'<sdf version="1.6"><world name="w">{"".join(models)}</world></sdf>'


def tags_of(**parameters) -> Tags:
    """Return the tags of a file; no bridge is needed for them."""
    tags = Tags(Settings(drive='simulated', **parameters))
    tags.find(None, None, lambda: None, lambda: None)
    return tags


def test_the_tags_of_a_world_come_in_numeric_order_with_their_places(tmp_path):
    longest = '1' * 5000  # digits, more than int() takes
    places = {longest: '3 4 0', '10': '1.5 -2 0.3 0 0 0', '9': '0.1 7.3 0'}
    path = tmp_path / 'world.sdf'
    path.write_text(world(*(MODEL.format(*each) for each in places.items()), '<model name="table_1"/>'))
    tags = tags_of(world_file=str(path))
    assert tags.ids == ['9', '10', longest]
    assert tags.positions_m == {'9': (0.1, 7.3), '10': (1.5, -2.0), longest: (3.0, 4.0)}


@pytest.mark.parametrize(
    ('text', 'fragment'),
    [
        (world(MODEL.format('x', '0 0 0'), MODEL.format('07', '0 0 0')), 'has no model tag_<id>'),
        (world(MODEL.format(7, '0 0 0'), MODEL.format(7, '1 0 0')), 'has the model tag_7 twice'),
        (world(MODEL.format(7, 'nan 0 0')), 'the model tag_7 has no pose'),
        (
            f'<!DOCTYPE sdf [<!ENTITY x0 "xxxxxxxxxx">{NESTED_ENTITIES}]>'
            + world('&x8;', MODEL.format(7, '0 0 0')),
            'is not an SDF world',
        ),
        (None, "^world_file '.*world.sdf': cannot be read"),
    ],
    ids=lambda each: each[:30] if each else '',
)
def test_a_world_without_clear_tags_is_refused(tmp_path, text, fragment):
    path = tmp_path / 'world.sdf'
    if text is not None:
        path.write_text(text)
    with pytest.raises(StartUpError, match=fragment):
        read_world(str(path))


def test_perception_comes_first_then_the_registered_layout_if_it_lies_in_the_map_then_the_robot(
    start_waiting_mission, reader, confirmer, twin, node, tmp_path, shipped_tags
):
    """The layout has tags 1 and 2; perception has discovered 1 and 777. The robot stands at x = 5."""
    frame_id, tag_ids, subscriber = 'robot1/map', ('1', '2', '777', '888'), twin()
    write_transform(tmp_path / 'layout.yaml', TRANSFORM, frame_id)
    parameters = {'layout_in_map': tmp_path / 'layout.yaml', 'frame_id': frame_id}
    mission, operator = start_waiting_mission(**CAMERA, **parameters, tag_sequence=' '.join(tag_ids))
    tags = discovered(('1', 7.0, 0.0, 1.0), ('777', 7.0, 0.0, 1.0), frame_id=frame_id)
    robot = localized(5.0, 0.0, frame_id)
    for name, message in (('amcl_pose', robot), ('perception/discovered_tags', tags)):
        publish(node.create_publisher(type(message), f'{mission.namespace}/{name}', TWIN_QOS), message)
    operator.start()
    for tag_id in tag_ids:
        confirmer.answer(detected=True)
        reader.answer_ok(tag_id)
    wait_until(lambda: len(subscriber.received) == 4)
    assert mission.stop() == 0
    places = [
        (each.tag_pose_in_map.position.x, each.tag_pose_in_map.position.y) for each in subscriber.received
    ]
    second = TRANSFORM.point(shipped_tags['2']['x'], shipped_tags['2']['y'])
    assert places == [(7.0, 0.0), pytest.approx(second), (7.0, 0.0), (5.0, 0.0)]
    assert {each.tag_pose_in_map.orientation.w for each in subscriber.received} == {1.0}


@pytest.mark.parametrize(
    ('parameter', 'text'),
    [
        ('world_file', world(MODEL.format(7, '1 2 0'))),
        ('tag_locations_file', json.dumps({'7': {'x': 1.0, 'y': 2.0, 'sensors': ['co2']}})),
    ],
)
def test_the_tags_of_a_file_are_moved_to_the_map(tmp_path, parameter, text):
    path = tmp_path / 'tags'
    path.write_text(text, encoding='utf-8')
    write_transform(tmp_path / 'layout.yaml', TRANSFORM)
    files = {parameter: str(path), 'layout_in_map': str(tmp_path / 'layout.yaml')}
    for has_poses, positions_m in ((True, {'7': pytest.approx((8.0, 21.0))}), (False, {})):
        tags = tags_of(**files, tag_poses_in_map=has_poses)
        assert (tags.ids, tags.positions_m) == (['7'], positions_m)


def test_a_bridge_that_was_there_is_awaited_though_it_is_gone_for_a_moment(
    bridge_parameters, node, monkeypatch
):
    tags = Tags(Settings(drive='simulated', tag_sequence='1', **READER))
    tags.find(node, lambda: False, lambda: None, lambda: None)
    bridge_parameters.wait_for_request()
    assert tags.is_waiting_for_tags()
    monkeypatch.setattr(Client, 'service_is_ready', lambda _client: False)
    assert tags.is_waiting_for_tags()


def test_requests_without_a_reply_are_given_up(bridge_parameters, node, monkeypatch):
    """ROS would keep each of them for ever."""
    monkeypatch.setattr(tags_of_bridge, 'MOST_PENDING_REQUESTS', 3)
    tags = Tags(Settings(drive='simulated', **READER))
    found = threading.Event()
    tags.find(node, lambda: False, found.set, lambda: None)
    for _ in range(6):
        bridge_parameters.wait_for_request()
        assert len(pending_requests(tags._client)) <= 3
    for _ in range(6):
        bridge_parameters.answer_tags('7')
    assert found.wait(PATIENCE_SECONDS)
    assert not pending_requests(tags._client)


def test_a_sequence_has_no_poses_if_the_bridge_has_its_own_tag_file(
    start_waiting_mission, held_service, bridge_parameters, twin, node
):
    """The mission awaits the bridge's word before it reads a tag."""
    subscriber = twin()
    mission, operator = start_waiting_mission(**READER, tag_sequence='1')
    operator.start()
    bridge_parameters.wait_for_request()
    reader = held_service(GetTagReading, '/held/get_tag_reading')
    wait_until(lambda: has_found_a_client(node, reader.name))
    operator.states.wait_for_steps()
    assert reader.tag_ids == []
    bridge_parameters.answer_tags('1', tag_file='/home/me/tags.json')
    reader.answer_ok('1')
    assert subscriber.wait_for().tag_pose_in_map.orientation.w == 0.0
    assert mission.stop() == 0
    warning = mission.warnings()[-1]
    assert "the positions of the tags are unknown: set tag_locations_file to the bridge's tag_file" in warning
