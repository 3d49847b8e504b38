"""`ros2 run lupin_planning approach_poses`, and its file of overrides."""

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS
from lupin_planning import approach_poses
from lupin_planning.overrides import EXAMPLE, read_overrides
from lupin_planning.poses import PoseInPlane
from lupin_planning.registration import Transform, write_transform

POSES = {'7': (2.0, 0.5, math.pi / 2), '21': (0.5, 1.25, 0.0)}
WALLS = ('--walls', '0', '0', '4', '8')


@pytest.fixture
def tag_file(write_layout):
    return write_layout({'7': (2.0, 1.0), '21': (1.0, 1.25)}, bench=(1.0, 1.0, 3.0, 1.5))


@pytest.fixture
def poses_of(tag_file, capsys):
    def run(*words):
        exit_code = approach_poses.main(['approach_poses', '--tag-file', tag_file, *words])
        return exit_code, *capsys.readouterr()

    return run


def test_the_table_has_a_line_for_each_tag_and_the_length_of_the_route(poses_of):
    exit_code, out, err = poses_of()
    assert (exit_code, err) == (0, '')
    assert [line.split() for line in out.splitlines()[1:3]] == [
        ['7', '2.00', '0.50', '90', '0.50', '0'],
        ['21', '0.50', '1.25', '0', '0.50', '0'],
    ]
    assert out.splitlines()[-1] == '2/2 tags have an approach pose; the route is 1.7 m long'


def test_each_format_has_the_same_poses_and_json_the_length(poses_of):
    ended = {
        form: poses_of('--order', 'given', '--start', '1', '0.3', '--format', form)
        for form in ('json', 'yaml')
    }
    assert {(exit_code, err) for exit_code, _, err in ended.values()} == {(0, '')}
    data = json.loads(ended['json'][1])
    assert list(data) == ['poses', 'unreachable', 'length_m']
    assert [each['tag_id'] for each in data['poses']] == ['7', '21']
    for each in data['poses']:
        assert (each['x'], each['y'], each['yaw']) == pytest.approx(POSES[each['tag_id']], abs=1e-6)
    assert data['length_m'] == pytest.approx(math.hypot(1.0, 0.2) + 1.7, abs=0.05)
    assert yaml.safe_load(ended['yaml'][1]) == data


def test_a_pose_with_less_room_than_the_clearance_is_warned_of(poses_of):
    exit_code, out, err = poses_of('--clearance', '0.7', '--largest-standoff', '0.8', '--walls', *'0044')
    rooms_m = dict(re.findall(r"approach_poses: tag '(\d+)': its pose has (0\.\d+) m of room beyond", err))
    assert exit_code == 0
    assert rooms_m.keys() == POSES.keys()
    assert all(0.2 < float(room_m) < 0.7 for room_m in rooms_m.values())
    need = 'less than the clearance of 0.7 m: the robot fits, so nothing needs to be done'
    assert err.splitlines()[0].endswith(need)
    assert '2/2 tags have an approach pose' in out


def test_tags_and_tables_outside_the_walls_are_warned_of(poses_of):
    _, _, err = poses_of('--walls', '1.1', '0', '4', '4')
    outside = 'outside the walls (x 1.1 to 4 m, y 0 to 4 m): tag 21, table bench'
    remedy = 'set --walls or --sim-config-file, all in metres'
    assert err.splitlines()[0] == f'approach_poses: {outside}: {remedy}'
    reason = 'outside the walls (x 1.1 to 4 m, y 0 to 4 m): correct them, or the config of the greenhouse'
    assert f"approach_poses: tag '21': {reason}\n" in err


def test_an_id_that_no_terminal_can_show_is_escaped(poses_of, write_layout):
    write_layout({'7\n\x1b[2J': (2.0, 1.0)})
    _, out, err = poses_of('--radius', '0.79', '--largest-standoff', '0.5')
    assert (out + err).count('7\\n\\x1b[2J') == 1
    assert '\x1b' not in out + err


@pytest.mark.parametrize('form', ['table', 'json'])
def test_a_yaw_just_below_0_is_0(poses_of, tmp_path, form):
    write_transform(tmp_path / 'layout.yaml', Transform(yaw=-1e-9))
    assert '-0' not in poses_of('--layout-in-map', str(tmp_path / 'layout.yaml'), '--format', form)[1]


def test_overrides_are_in_the_frame_that_their_file_names(poses_of, tmp_path):
    path, registration = tmp_path / 'approach_overrides.yaml', tmp_path / 'layout.yaml'
    write_transform(registration, Transform(10.0, 20.0, math.pi / 2))
    words = ('--format', 'json', '--overrides', str(path))
    for frame, x, y, yaw, options in (
        ('layout', 2.0, 0.6, 1.57, ()),
        ('map', 9.4, 22.0, 3.14, ('--layout-in-map', str(registration))),
    ):
        pose = f'{{x: {x}, y: {y}, yaw: {yaw}}}'
        path.write_text(f'frame: {frame}\noverrides: {{"7": {pose}, "99": {pose}}}', encoding='utf-8')
        exit_code, out, err = poses_of(*words, *options)
        distances_m = {each['tag_id']: each['distance_m'] for each in json.loads(out)['poses']}
        assert distances_m == {'7': pytest.approx(0.4), '21': 0.5}
        assert (exit_code, err.count("tag '99' is not in the layout")) == (0, 1)
    exit_code, out, err = poses_of(*words)
    assert (exit_code, out, err.count('\n')) == (2, '', 1)
    assert 'frame is map: set --layout-in-map' in err


def test_an_override_two_metres_from_its_tag_is_warned_of(poses_of, tmp_path):
    path = tmp_path / 'approach_overrides.yaml'
    path.write_text('frame: layout\noverrides: {"7": {x: 2.0, y: -1.0, yaw: 1.57}}', encoding='utf-8')
    exit_code, _, err = poses_of('--overrides', str(path), '--walls', '0', '-2', '4', '4')
    assert exit_code == 0
    assert "tag '7': the camera cannot see it from its override: it is 2.00 m" in err


def test_an_angle_of_one_degree_is_taken(poses_of):
    assert poses_of('--angle', '1')[0] == 0


@pytest.mark.parametrize(
    ('words', 'problem'),
    [
        (
            [*WALLS, '--radius', '1.99'],
            'a robot of radius 1.99 m does not fit between the walls, which are 4 m',
        ),
        (['--sim-config-file', '/missing.yaml'], "sim_config_file '/missing.yaml': cannot be read"),
        (['--smallest-standoff', '0.6'], 'the standoffs are 0.6, 0.5 and 1 m'),
        (['--standoff', '2'], 'the standoffs are 0.3, 2 and 1 m: must be above 0, and the smallest'),
        (['--angle', '90'], 'the largest incidence angle is 90 degrees: must be from 0 to below 90'),
        (['--radius', '-0.1'], 'the radius of the robot is -0.1 m and its clearance 0.05 m: must not be'),
        (['--clearance', '-1'], 'its clearance -1 m: must not be below 0'),
        (['--arrival-tolerance', '-1'], 'the arrival tolerance is -1 m: must be from 0 to 1 m'),
        (['--largest-standoff', '100'], 'the standoffs are 0.3, 0.5 and 100 m'),
        (['--unknown', 'free'], '--unknown needs a map'),
        (['--camera-offset', '0.3'], "the camera is 0.3 m ahead of the robot's centre: must be less than"),
        (['--camera-offset', '-0.3'], 'the camera is -0.3 m ahead'),
        (['--start', '2', '1.2'], 'the start at (2, 1.2) is not free'),
        (['--end', '0', '0'], 'the end at (0, 0) is not free for a robot of radius'),
        (['--end', '1e9', '1'], 'is not free for a robot of radius 0.2 m: choose another within x 0'),
        (['--picture', '/missing/a.png'], "--picture '/missing/a.png': there is no folder '/missing': name"),
        (['--picture', 'route', '--start', '2', '1.2'], "--picture 'route': the ending must be one of "),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(poses_of, words, problem):
    exit_code, out, err = poses_of(*words)
    (line,) = err.splitlines()
    assert (exit_code, out) == (2, '')
    assert line.startswith('approach_poses: ')
    assert problem in line


def test_the_poses_are_computed_without_ros(tag_file):
    program = (
        "import sys; sys.modules['rclpy'] = None;"
        ' from lupin_planning import approach_poses;'
        ' sys.exit(approach_poses.main(sys.argv))'
    )
    command = [sys.executable, '-c', program, '--tag-file', tag_file]
    subprocess.run(command, check=True, timeout=PATIENCE_SECONDS)


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('overrides: {"7": {x: 1, y: 1, yaw: 1}}', 'frame is None: must be layout or map'),
        ('frame: odom\noverrides: {}', "frame is 'odom': must be layout or map"),
        ('frame: layout\noverrides: {"7": {x: 1, y: 1}}', "tag '7': yaw is missing: must be a number"),
        ('frame: layout\noverrides: {"7": {x: 1, y: 1, yaw: 90}}', "tag '7': yaw is 90: must be a number"),
        ('frame: layout\noverrides: {"7": {x: 1, z: 2}}', "tag '7': unknown key 'z': use x, y, yaw"),
        ('frame: layout\n"7": {x: 1}\n', "unknown key '7': use frame, overrides"),
        ('frame: layout', 'overrides is missing'),
        ('frame: layout\noverrides: [7]', 'overrides is [7]: must be a mapping'),
        ('[7]', 'must be a mapping, such as'),
        ('frame: layout\noverrides: {"7": 1.5}', '7 is 1.5: must be a mapping'),
    ],
)
def test_a_malformed_override_is_refused_with_its_place(tmp_path, text, problem):
    path = tmp_path / 'approach_overrides.yaml'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(StartUpError, match=re.escape(problem)):
        read_overrides(path, {'7', '21'})


def test_a_sensor_that_the_config_lacks_is_refused(tmp_path, capsys):
    path = tmp_path / 'tags.json'
    path.write_text('{"7": {"x": 1, "y": 1, "sensors": ["CO2"]}}', encoding='utf-8')
    assert approach_poses.main(['approach_poses', '--tag-file', str(path)]) == 2
    fault = f"tag_file '{path}': tag '7' has the sensor 'CO2', which sim_config_file '"
    assert fault in capsys.readouterr().err


def test_the_ids_of_overrides_need_no_quotes(tmp_path):
    path = tmp_path / 'approach_overrides.yaml'
    path.write_text('frame: layout\noverrides: {7: {x: 1, y: 2.5, yaw: 0}}', encoding='utf-8')
    assert read_overrides(path, {'7', '8'}) == ({'7': PoseInPlane(1.0, 2.5, 0.0)}, [])


def test_the_overrides_of_the_documents_show_the_robot_their_tags(tmp_path, capsys):
    """On the shipped layout. Tag 7 faces east at (2.6, 7.4), so the robot is 0.4 m east of it."""
    formats = (Path(__file__).parents[1] / 'doc' / 'formats.md').read_text(encoding='utf-8')
    (in_formats,) = re.findall(r'## approach_overrides.yaml\n.*?```yaml\n(.*?)```', formats, re.DOTALL)
    for text in (in_formats, EXAMPLE):
        (tmp_path / 'overrides.yaml').write_text(text, encoding='utf-8')
        words = ('--overrides', str(tmp_path / 'overrides.yaml'), '--format', 'json', '--order', 'given')
        exit_code = approach_poses.main(['approach_poses', *words])
        out, err = capsys.readouterr()
        poses = {each['tag_id']: each for each in json.loads(out)['poses']}
        if len(poses) == 29:  # other versions of the simulator have the tags in other places
            assert (exit_code, 'override' in err) == (0, False)
            assert [poses['7'][key] for key in ('x', 'y', 'yaw')] == pytest.approx([3.0, 7.4, 3.14], abs=1e-3)


def test_without_matplotlib_the_package_to_install_is_named(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'matplotlib', None)
    assert approach_poses.main(['approach_poses', '--picture', 'route.png']) == 2
    assert capsys.readouterr().err.endswith(': sudo apt install python3-matplotlib\n')
