"""`make mission` in simulation and with a camera: the report and the picture that it writes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import needs_drake

ROOT = Path(__file__).resolve().parents[2]


def run_mission(output: Path, *arguments: str) -> subprocess.CompletedProcess:
    is_rendered = {'--world', 'image'} <= set(arguments)
    wrapper = 'ci/with_drake' if is_rendered else 'ci/with_stand_ins'
    return subprocess.run(
        [wrapper, sys.executable, 'ci/mission.py', '--output', str(output), *arguments],
        cwd=ROOT,
        env={**os.environ, 'TREE': 'monorepo'},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ('arguments', 'name', 'tag_ids'),
    [
        ([], 'simulation', None),
        (['--camera', 'image', 'tag_ids:="1 5 7"'], 'camera', ['1', '5', '7']),
        pytest.param(
            ['--camera', 'compressed', 'tag_ids:="1 5"'], 'camera', ['1', '5'], marks=pytest.mark.heavy
        ),
        pytest.param(
            ['--camera', 'detections', 'tag_ids:="1 5"'], 'camera', ['1', '5'], marks=pytest.mark.heavy
        ),
    ],
    ids=['simulation', 'images', 'compressed images', 'detections'],
)
def test_the_mission_reads_every_tag_and_leaves_a_report_and_a_picture(tmp_path, arguments, name, tag_ids):
    result = run_mission(tmp_path, *arguments)
    assert result.returncode == 0, result.stdout + result.stderr
    lines = [
        json.loads(line) for line in (tmp_path / f'{name}.jsonl').read_text(encoding='utf-8').splitlines()
    ]
    assert {line['outcome'] for line in lines} == {'OK'}
    assert len(lines) == len({line['tag_id'] for line in lines})
    assert tag_ids in (None, [line['tag_id'] for line in lines])
    assert f'{len(lines)}/{len(lines)} tags read' in result.stdout
    assert (tmp_path / f'{name}.png').read_bytes().startswith(b'\x89PNG')
    assert 'Traceback' not in result.stderr


def test_a_tag_that_the_camera_never_sees_is_not_read(tmp_path):
    result = run_mission(tmp_path, '--camera', 'image', 'tag_ids:="600"')
    assert result.returncode == 1
    (line,) = (tmp_path / 'camera.jsonl').read_text(encoding='utf-8').splitlines()
    assert json.loads(line)['outcome'] == 'NOT_CONFIRMED'


def test_the_mirror_has_no_mission():
    result = subprocess.run(
        ['bash', '-c', 'source ci/ros_env.bash && exec "$0" ci/mission.py', sys.executable],
        cwd=ROOT,
        env={**os.environ, 'TREE': 'lupin_greenhouse_ros'},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 2
    assert result.stderr == 'mission: it is in the monorepo only: make mission TREE=monorepo\n'


@needs_drake
@pytest.mark.heavy
def test_the_mission_reads_the_tags_of_the_world_that_its_camera_sees(tmp_path):
    result = run_mission(tmp_path, '--camera', 'image', '--world', 'tag_ids:="1 13 30"')
    assert result.returncode == 0, result.stdout + result.stderr
    lines = (tmp_path / 'world.jsonl').read_text(encoding='utf-8').splitlines()
    assert [(json.loads(each)['tag_id'], json.loads(each)['outcome']) for each in lines] == [
        ('1', 'OK'),
        ('13', 'OK'),
        ('30', 'OK'),
    ]


def test_a_world_without_its_camera_is_refused_in_one_line(tmp_path):
    result = run_mission(tmp_path, '--camera', 'detections', '--world')
    assert result.returncode == 2
    assert result.stderr.splitlines()[-1] == 'mission: WORLD=1 needs CAMERA=1, and publishes images only'
