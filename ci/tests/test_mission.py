"""`make mission` with the cameras that take long, and without the mission."""

import json

import pytest
from conftest import make, needs_drake

# A busy machine may not see a tag within a second.
PATIENCE = 'max_attempts:=1000 scan_timeout_s:=20 visual_confirmation_timeout_s:=20 retry_delay_seconds:=0.1'


@pytest.mark.heavy
@pytest.mark.parametrize(
    'options',
    [
        ['CAMERA=compressed'],
        ['CAMERA=detections'],
        pytest.param(['CAMERA=1', 'WORLD=1'], marks=needs_drake),
    ],
    ids=['compressed images', 'detections', 'world'],
)
def test_the_mission_reads_the_tags_that_its_camera_sees(tmp_path, options):
    arguments = f'ARGS=--output {tmp_path} tag_sequence:="1 13 30" {PATIENCE}'
    result = make('mission', *options, arguments)
    assert result.returncode == 0, result.stdout + result.stderr
    (report,) = tmp_path.glob('*.jsonl')
    lines = report.read_text(encoding='utf-8').splitlines()
    assert [(json.loads(each)['tag_id'], json.loads(each)['outcome']) for each in lines] == [
        ('1', 'OK'),
        ('13', 'OK'),
        ('30', 'OK'),
    ]
    assert report.with_suffix('.png').exists()


@pytest.mark.heavy
def test_a_robot_drives_to_every_tag_and_its_camera_sees_each_from_there(tmp_path):
    arguments = f'ARGS=--output {tmp_path} {PATIENCE}'
    record = tmp_path / 'readings.sqlite'
    result = make('mission', 'DRIVE=1', 'CAMERA=1', f'RECORD={record}', arguments)
    assert result.returncode == 0, result.stdout + result.stderr
    assert '29/29 tags read' in result.stdout.splitlines()
    (report,) = tmp_path.glob('*.jsonl')
    route = report.with_name(f'{report.stem}-route.csv')
    assert len(route.read_text(encoding='utf-8').splitlines()) > 29
    assert report.with_suffix('.png').exists()
    values = sum(len(json.loads(line)['readings']) for line in report.read_text().splitlines())
    assert result.stdout.splitlines()[-1] == f'{values} rows kept in {record}'


def test_the_mirror_has_no_mission():
    result = make('mission', TREE='lupin_greenhouse_ros')
    assert result.returncode == 2
    assert result.stderr.splitlines()[0] == 'mission: it is in the monorepo only: make mission TREE=monorepo'
