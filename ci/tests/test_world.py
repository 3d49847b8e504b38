"""`make world-check` on other layouts, and on wrong worlds."""

import json
import subprocess
import sys

import pytest
from conftest import needs_drake, run
from lupin_greenhouse_bridge.testing._helpers import executable

pytestmark = [pytest.mark.heavy, needs_drake]
CHANGED = """
import dataclasses, math, sys
from lupin_simulation import check_world, sdf
tag_poses, approaches = sdf.find_tag_poses, check_world.find_approaches
def moved(poses, name, change):
    return {tag_id: each._replace(**{name: getattr(each, name) + change}) for tag_id, each in poses.items()}
CHANGE
sys.exit(check_world.main(sys.argv[1:]))
"""
TAGS_MOVED = 'sdf.find_tag_poses = lambda *given: moved(tag_poses(*given), "x", 0.01)'
TAGS_TURNED = 'sdf.find_tag_poses = lambda *given: moved(tag_poses(*given), "facing", math.pi)'
LOOKING_ASIDE = """def turned(*given):
    found = approaches(*given)
    return dataclasses.replace(found, poses=moved(found.poses, "yaw", math.pi / 2))
check_world.find_approaches = turned"""
TABLES = {
    'a': {'x0': 1.0, 'y0': 1.0, 'x1': 2.0, 'y1': 1.5},
    'b': {'x0': 4.0, 'y0': 1.0, 'x1': 4.5, 'y1': 2.0},
}
THREE_TABLES = TABLES | {'in front of tag 0': {'x0': 1.0, 'y0': 0.6, 'x1': 2.0, 'y1': 0.8}}
TAGS = {
    '0': {'x': 1.5, 'y': 1.0, 'sensors': ['co2']},
    '7': {'x': 4.5, 'y': 2.0, 'sensors': ['co2']},
    '586': {'x': 1.0, 'y': 1.25, 'sensors': ['co2']},
}


def with_drake(*arguments: str) -> subprocess.CompletedProcess:
    """Run Python with Drake."""
    return run(sys.executable, 'ci/within.py', '--drake', 'python', *arguments)


def check_world(folder, layout, change=''):
    """Run the check on a layout, after a change of its code."""
    tag_file = folder / 'tags.json'
    tag_file.write_text(json.dumps(layout), encoding='utf-8')
    walls = ('--walls', '-2', '-2', '7', '5')
    command = [executable('lupin_simulation', 'check_world')]
    if change:
        command = ['-c', CHANGED.replace('CHANGE', change)]
    return with_drake(*command, '--tag-file', str(tag_file), *walls)


@pytest.mark.parametrize(
    ('tables', 'places', 'in_sight'),
    [(THREE_TABLES, {2: 12, 3: 6}, 2), ({}, {3: 18}, 3)],  # a table hides tag 0 wherever there is a place
    ids=['three tables', 'no tables'],
)
def test_a_layout_of_ones_own_becomes_a_world_whose_tags_can_be_read(tmp_path, tables, places, in_sight):
    result = check_world(tmp_path, {'tags': TAGS, 'tables': tables})
    assert result.returncode == 0, result.stdout + result.stderr
    lines = result.stdout.splitlines()
    for tags, count in places.items():
        setting = f': 3 of 3 read (a robot can stand there at {tags})'
        assert sum(line.endswith(setting) for line in lines) == count
    all_read = f': {in_sight} of {in_sight} read'
    assert sum('approach poses' in line and line.endswith(all_read) for line in lines) == 6
    assert sum('from behind: 0 of 3 read' in line for line in lines) == 2


@pytest.mark.parametrize(
    ('change', 'finding'),
    [
        (TAGS_MOVED, 'NOT where the layout has them'),
        (TAGS_TURNED, 'NOT where the layout has them'),
        (LOOKING_ASIDE, '4 cm, approach poses of a robot of radius 0.20 m: 0 of 3 read, not 0, 7, 586'),
    ],
)
def test_a_wrong_world_is_noticed(tmp_path, change, finding):
    result = check_world(tmp_path, {'tags': TAGS, 'tables': TABLES}, change)
    assert result.returncode == 1
    assert finding in result.stdout
    assert result.stdout.endswith('the world is WRONG\n')


def test_the_camera_refuses_a_file_that_is_no_world_in_one_line(tmp_path):
    world_file = tmp_path / 'broken.sdf'
    world_file.write_text('<sdf version="1.6"><world>', encoding='utf-8')
    camera = executable('lupin_simulation', 'world_camera')
    result = with_drake(camera, '--ros-args', '-p', f'world_file:="{world_file}"')
    assert result.returncode == 1
    (fatal,) = result.stderr.splitlines()
    assert '[FATAL]' in fatal
    assert f"'{world_file}' is not an SDF world: use a world made by generate_world: " in fatal
