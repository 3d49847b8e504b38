"""The documents: each example of a format loads, and its table describes the code."""

from pathlib import Path

import yaml
from lupin_greenhouse_bridge.testing.documents import Page
from lupin_planning import approach_poses
from lupin_planning.registration import read_places, read_registration

FORMATS = Page(Path(__file__).resolve().parent.parent / 'doc/formats.md')


def test_the_files_of_poses_are_read(tmp_path):
    frame_id, transform = read_registration(FORMATS.write_example('layout_in_map.yaml', tmp_path))
    assert (frame_id, transform) == ('map', (1.510735, 0.593302, 0.000819))
    assert read_places(FORMATS.write_example('pairs.yaml', tmp_path))['21'] == (3.11, 8.08)


def test_the_file_of_poses_has_these_keys(tmp_path, capsys, write_layout):
    tag_file = write_layout({'1': (1.0, 1.2), '2': (3.0, 1.2)}, left=(0.8, 1.2, 1.2, 2.0))
    walls = ['--walls', '0', '0', '2.5', '4']  # leave tag 2 outside
    assert approach_poses.main(['approach_poses', '--tag-file', tag_file, *walls, '--format', 'yaml']) == 1
    found = capsys.readouterr().out
    described = FORMATS.write_example('poses.yaml', tmp_path).read_text(encoding='utf-8')
    keys, described_keys = (
        [list(data), list(data['poses'][0]), list(data['unreachable'][0])]
        for data in map(yaml.safe_load, (found, described))
    )
    assert keys == described_keys
