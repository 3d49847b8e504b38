"""The files that generate_world writes, and those that it does not touch."""

import importlib.util
import json
import math
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from lupin_greenhouse_bridge.simulator.layout import find_layout
from lupin_mission.world import read_world
from lupin_planning.tag_poses import find_tag_poses, tables_of
from lupin_planning.walls import find_walls
from lupin_simulation import generate_world
from lupin_simulation.sdf import SDF_FILE, TAG_HEIGHT_M
from lupin_tag_confirmation.detector import TagDetector
from PIL import Image

TAGS = {'tags': {str(n): {'x': n / 10, 'y': 0.0, 'sensors': ['co2']} for n in (0, 7, 586)}}
TABLES = {
    'a': {'x0': 0.0, 'y0': 0.0, 'x1': 1.0, 'y1': 0.5},
    '<b> & "c"': {'x0': 50, 'y0': 0, 'x1': 60, 'y1': 1},
}


def make(folder: Path, *arguments: str) -> int:
    return generate_world.main(['--output', str(folder), *arguments])


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob('*') if path.is_file()}


@pytest.fixture
def tag_file(tmp_path):
    """Return the path of a tag file with two tables and three tags."""
    path = tmp_path / 'tags.json'
    path.write_text(json.dumps({**TAGS, 'tables': TABLES}), encoding='utf-8')
    return str(path)


def test_the_world_of_the_shipped_layout(tmp_path, capsys):
    assert make(tmp_path / 'world') == 0
    layout = find_layout('')
    counts = f'{len(layout.tags)} tags, {len(layout.tables)} tables'
    assert capsys.readouterr().out == f'{tmp_path}/world/greenhouse.sdf: {counts}\n'
    world = ElementTree.parse(tmp_path / 'world' / SDF_FILE).getroot()
    assert (world.tag, world.get('version')) == ('sdf', '1.6')
    places = read_world(str(tmp_path / 'world' / SDF_FILE))  # as the mission does
    assert places == {tag_id: tag[:2] for tag_id, tag in layout.tags.items()}
    models = [model.get('name') for model in world.iter('model')]
    tags = [each for each in models if each.startswith('tag_')]
    assert tags == [f'tag_{tag_id}' for tag_id in sorted(layout.tags, key=int)]
    assert len(models) == len(set(models)) == 5 + len(layout.tables) + len(layout.tags)
    assert {model.findtext('static') for model in world.iter('model')} == {'true'}
    assert not list(world.iter('plugin'))
    for uri in world.iter('uri'):
        assert (tmp_path / 'world' / uri.text).is_file()


def shown_by(folder: Path, model: ElementTree.Element) -> list[int]:
    """Return the numbers of the tags in the picture of a tag's model, found as a renderer finds it."""
    mesh = folder / model.findtext("link/visual[@name='tag']/geometry/mesh/uri")
    material = mesh.with_name(re.search(r'^mtllib (.+)$', mesh.read_text(), re.MULTILINE)[1])
    picture = material.with_name(re.search(r'^map_Kd (.+)$', material.read_text(), re.MULTILINE)[1])
    with Image.open(picture) as image:
        grey = np.pad(np.asarray(image.convert('L')), 20, constant_values=255)
    return [each.tag_number for each in TagDetector().detect(grey)]


def test_each_tag_of_the_shipped_world_is_where_the_tag_file_says_faces_the_aisle_and_shows_its_id(tmp_path):
    assert make(tmp_path) == 0
    layout = find_layout('')
    walls = find_walls(layout)
    models = ElementTree.parse(tmp_path / SDF_FILE).getroot().iter('model')
    tags = {each.get('name').removeprefix('tag_'): each for each in models if each.get('name')[:4] == 'tag_'}
    assert tags.keys() == layout.tags.keys()
    for tag_id, (x, y, facing) in find_tag_poses(layout, walls).items():
        *place, roll, pitch, yaw = map(float, tags[tag_id].findtext('pose').split())
        assert place == [*layout.tags[tag_id][:2], TAG_HEIGHT_M]
        assert (roll, pitch, yaw) == pytest.approx((math.pi / 2, 0.0, facing + math.pi / 2))
        ahead_m = x + 0.2 * math.sin(yaw), y - 0.2 * math.cos(yaw)
        assert walls[0] < ahead_m[0] < walls[2]
        assert walls[1] < ahead_m[1] < walls[3]
        on_tables = [x0 < ahead_m[0] < x1 and y0 < ahead_m[1] < y1 for x0, y0, x1, y1 in tables_of(layout)]
        assert not any(on_tables)
        assert shown_by(tmp_path, tags[tag_id]) == [int(tag_id)]


def test_the_same_input_gives_the_same_bytes_and_tags_of_5_cm_unless_told(tmp_path, tag_file):
    sides = {'default': [], 'same': ['--side', '0.05'], 'largest': ['--side', '0.15']}
    for folder, side in sides.items():
        assert make(tmp_path / folder, '--tag-file', tag_file, *side) == 0
    assert content(tmp_path / 'default') == content(tmp_path / 'same') != content(tmp_path / 'largest')
    assert make(tmp_path / 'same', '--tag-file', tag_file, '--side', '0.01') == 0  # over its own files
    assert make(tmp_path / 'same', '--tag-file', tag_file) == 0
    assert content(tmp_path / 'default') == content(tmp_path / 'same')


def test_files_of_an_earlier_world_go_and_those_of_a_person_stay(tmp_path, tag_file):
    folder = tmp_path / 'world'
    assert make(folder) == 0
    (folder / 'notes.txt').write_text('mine')
    (folder / 'models/tag_2/tag_2.obj').unlink()
    assert make(folder, '--tag-file', tag_file) == 0
    models = {path.parent.name for path in folder.rglob('models/*/*')}
    assert models == {'tag_0', 'tag_7', 'tag_586'}
    assert (folder / 'notes.txt').read_text() == 'mine'


def test_a_file_that_it_did_not_make_is_refused_and_nothing_is_written(tmp_path, tag_file, capsys):
    folder = tmp_path / 'world'
    (folder / 'models/tag_7').mkdir(parents=True)
    (folder / 'models/tag_7/tag_7.png').write_text('mine')
    assert make(folder, '--tag-file', tag_file) == 2
    assert 'exists and is not from generate_world: choose another --output' in capsys.readouterr().err
    assert content(folder) == {'models/tag_7/tag_7.png': b'mine'}


@pytest.mark.parametrize(
    ('arguments', 'fragment'),
    [
        (['--side', '0.1501'], '--side is 0.1501: must be between 0.01 and 0.15 m'),
        (['--side', '0.0099'], '--side is 0.0099: must be between 0.01 and 0.15 m'),
        (['--tag-file', '/missing.json'], "tag_file '/missing.json': cannot be read"),
        (['--output', '/proc/nowhere'], 'No such file or directory: name another folder'),
        ([], "mdp-greenhouse is not installed here: name the bridge's tag file with --tag-file"),
    ],
)
def test_what_cannot_be_made_is_said_in_one_line(tmp_path, monkeypatch, arguments, fragment, capsys):
    if not arguments:
        monkeypatch.setattr(importlib.util, 'find_spec', lambda _name: None)
    assert make(tmp_path, *arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('generate_world: ')
    assert fragment in line


def test_a_missing_library_is_named_with_its_packages(tmp_path, tag_file, monkeypatch, capsys):
    for module in ('lupin_simulation.sdf', 'lupin_simulation.tag36h11'):
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, 'cv2', None)  # as if it was not installed
    assert make(tmp_path / 'world', '--tag-file', tag_file) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.match(
        'generate_world: .*cv2.*: sudo apt install python3-opencv python3-pil python3-numpy$', line
    )
    assert not (tmp_path / 'world').exists()


@pytest.mark.parametrize('outside', ['../notes.txt', 'models/../../notes.txt', '{absolute}'])
def test_a_manifest_that_names_files_outside_the_folder_removes_none_of_them(tmp_path, tag_file, outside):
    own = tmp_path / 'notes.txt'
    own.write_text('mine')
    folder = tmp_path / 'world'
    (folder / 'models').mkdir(parents=True)
    (folder / generate_world.MANIFEST).write_text(outside.format(absolute=own))
    assert make(folder, '--tag-file', tag_file) == 0
    assert own.read_text() == 'mine'


def test_a_layout_without_tables_is_warned_of(tmp_path, capsys):
    path = tmp_path / 'tags.json'
    path.write_text(json.dumps(TAGS), encoding='utf-8')
    assert make(tmp_path / 'world', '--tag-file', str(path)) == 0
    assert 'the layout has no tables: the tags face its middle' in capsys.readouterr().err
