"""The parameters: their defaults, as documented, and what they mean."""

import math
from dataclasses import asdict, replace

import pytest
import yaml
from ament_index_python.packages import get_package_share_path
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.testing.helpers import check_settings
from lupin_mission import passive_observer, settings
from lupin_mission.settings import Settings
from lupin_mission.visit import Service
from lupin_planning.viewpoints import ViewingLimits


def test_a_reply_of_the_camera_may_take_3_seconds_more_than_its_look():
    settings = Settings(visual_confirmation_timeout_s=5.0, scan_timeout_s=6.0)
    assert [settings.timeout_seconds(each) for each in (Service.CONFIRM, Service.READ)] == [8.0, 6.0]


@pytest.mark.parametrize(
    ('tag_sequence', 'ids'),
    [
        (' ', []),
        (' 6,21  29, ', ['6', '21', '29']),
        (None, []),  # of rclpy, for an empty array
        ('[]', []),
        ('[6, "21"]', ['6', '21']),  # of a launch argument
        ('["Tomate 7", 010]', ['Tomate 7', '010']),
        ([6, 21], ['6', '21']),
        (['Tomate 7'], ['Tomate 7']),
        (6, ['6']),
    ],
)
def test_the_ids_are_taken_from_text_and_arrays(tag_sequence, ids):
    assert Settings(tag_sequence=tag_sequence).chosen_tag_ids == ids


@pytest.mark.parametrize('has_camera', [True, False])
def test_tag_poses_follow_the_camera_unless_they_are_set(has_camera):
    for value, has_poses in (('', not has_camera), (True, True), ('true', True), ('false', False)):
        settings = Settings(tag_poses_in_map=value, require_visual_confirmation=has_camera)
        assert settings.has_poses_in_map == has_poses
        assert replace(settings, layout_in_map='/a').has_poses_in_map == (has_poses or value == '')


@pytest.mark.parametrize('node', [settings, passive_observer])
def test_each_parameter_has_its_type_and_its_limits(node):
    check_settings(node.Settings)


@pytest.mark.parametrize(
    ('parameters', 'reason'),
    [
        ({'drive': 'nav3'}, "parameter drive is 'nav3': must be nav2 or simulated"),
        ({'order': 'given'}, "parameter order is 'given': must be numeric or shortest"),
        (
            {'drive': 'simulated', 'order': 'shortest'},
            'order:=shortest is for a robot that drives: set drive to nav2',
        ),
        ({'drive': 'nav2', 'world_file': '/a.sdf'}, 'world_file does not name the tables'),
        (
            {'drive': 'simulated', 'world_file': '/a.sdf', 'tag_locations_file': '/b.json'},
            'world_file and tag_locations_file are both set: set one of them',
        ),
        *(({'tag_sequence': each}, 'must be ids such as') for each in (False, [True], '[1', '[[1]]')),
        ({'camera_offset_m': 0.25, 'approach_standoff_m': 0.2}, 'must be less than approach_standoff_m'),
        ({'tag_sequence': '2 1 1'}, "tag_sequence names '1' twice: a mission visits a tag once"),
        *(({'tag_poses_in_map': each}, 'must be true, false or empty') for each in ('yes', 'True', 2, None)),
        ({'bridge_service_name': ''}, "parameter bridge_service_name is '': must be words of letters"),
        *(({each: 'a-b'}, 'must be words') for each in ('map_topic', 'visual_confirmation_service')),
        ({'mission_id_prefix': 'a/b'}, 'parameter mission_id_prefix is .*: must be'),
        ({'estop_topic': ''}, 'parameter estop_topic is .*: must be the name'),
        *(({'report_file': each}, 'parameter report_file is .*: must be') for each in ('.', '/', 'a/..')),
        *(
            ({'dock_pose': each}, 'parameter dock_pose is .*: must be empty, or x, y and yaw')
            for each in ('1 2', '1 2 90', [1.0, 2.0, math.nan], 'a b c', True, 1.0)
        ),
    ],
)
def test_what_cannot_be_is_refused(parameters, reason):
    with pytest.raises(StartUpError, match=reason):
        Settings(**parameters)


def test_the_limits_of_the_approach_poses_are_those_of_the_parameters():
    """A preferred standoff beyond the usual ones is allowed too."""
    names = ('robot_radius_m', 'arrival_tolerance_m', 'camera_offset_m')
    limits = {name: number / 100 for number, name in enumerate(names, 1)}
    for standoff_m, extreme in ((0.28, 'smallest'), (1.3, 'largest')):
        standoffs = {'preferred_standoff_m': standoff_m, f'{extreme}_standoff_m': standoff_m}
        expected = ViewingLimits(**limits, **standoffs, clearance_m=0.3)
        settings = Settings(**limits, approach_standoff_m=standoff_m, approach_clearance_m=0.3)
        assert settings.viewing_limits == expected


def test_the_parameter_file_has_every_parameter_and_its_default():
    share = get_package_share_path('lupin_mission')
    nodes = yaml.safe_load((share / 'config/mission_orchestrator.yaml').read_text(encoding='utf-8'))
    assert nodes == {'/**/mission_orchestrator': {'ros__parameters': asdict(Settings())}}
