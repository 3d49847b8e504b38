"""The check of a world, as far as it needs no Drake; ci/tests/test_world.py has the rest."""

import subprocess
from types import SimpleNamespace

import numpy as np
import pytest
from lupin_greenhouse_bridge.planning.tag_poses import Table
from lupin_greenhouse_bridge.testing._helpers import executable
from lupin_simulation import check_world
from lupin_simulation.pinhole_camera import PinholeCamera
from lupin_simulation.rendered_world import TagModel, View, viewpoint
from lupin_simulation.tag36h11 import marker

BLANK = np.full((480, 640), 255, np.uint8)
TABLES = [Table(1.0, 1.0, 3.0, 1.5), Table(1.0, 4.0, 3.0, 4.5)]


def tag(x: float, y: float, out) -> TagModel:
    """Return a tag 0.3 m above the floor that faces this way."""
    out = np.array([*out, 0.0], dtype=float)
    up = np.array([0.0, 0.0, 1.0])
    return TagModel(np.array([x, y, 0.3]), np.cross(up, out), up, out)


@pytest.mark.parametrize(
    ('angle_degrees', 'place'),
    [(0, (2.0, 0.5, 0.3)), (90, (2.5, 1.0, 0.3)), (-90, (1.5, 1.0, 0.3)), (60, (2.433013, 0.75, 0.3))],
)
def test_a_viewpoint_is_in_front_of_a_tag_and_turned_to_its_right(angle_degrees, place):
    assert viewpoint(tag(2.0, 1.0, (0, -1)), 0.5, angle_degrees) == pytest.approx(place)


@pytest.mark.parametrize(
    ('x', 'y', 'out', 'tables', 'is_right'),
    [
        (2.0, 1.0, (0, -1), TABLES, True),
        (2.0, 1.0, (0, 1), TABLES, False),
        (2.0, 4.5, (0, 1), TABLES, True),  # its own table counts, not the first
        (2.0, 4.5, (0, -1), TABLES, False),
        (2.0, 0.9, (0, -1), TABLES, True),  # beside the table
        (2.0, 0.9, (0, 1), TABLES, False),
        (2.0, 1.25, (1, 0), TABLES, True),  # in its middle
        (0.0, 2.0, (1, 0), [], True),
        (0.0, 2.0, (-1, 0), [], False),
    ],
)
def test_a_tag_must_face_away_from_its_table_or_else_to_the_middle(x, y, out, tables, is_right):
    assert check_world.faces_outwards(tag(x, y, out), tables, np.array([2.0, 2.0])) == is_right


def test_a_tag_is_read_in_all_or_in_any_of_its_views_which_are_counted(monkeypatch, capsys):
    for name in ('FIRST_SECONDS', 'NEXT_SECONDS'):
        monkeypatch.setattr(check_world.Progress, name, 0.0)
    front = PinholeCamera().look_at(marker(7, 30), np.random.default_rng(0))
    world = SimpleNamespace(look=lambda eye, _at: np.stack([eye] * 3, axis=-1))
    both = [View(BLANK, BLANK), View(front, BLANK)]

    def tags_read(in_all: bool) -> set[int]:
        setting = check_world.Setting('here', {n: check_world.TagViews(both, in_all) for n in (7, 8)})
        return check_world.tags_read(world, setting, check_world.Progress('check_world'))

    assert tags_read(in_all=False) == {7}
    assert capsys.readouterr().err.splitlines() == ['check_world: here: 0 of 2', 'check_world: here: 1 of 2']
    assert tags_read(in_all=True) == set()


def refusal(*arguments: str) -> str:
    """Return the one line of a check that cannot be made."""
    command = [executable('lupin_simulation', 'check_world'), *arguments]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (2, ''), result.stderr
    (line,) = result.stderr.splitlines()
    return line


@pytest.mark.usefixtures('without_drake')
def test_a_missing_drake_is_one_line_that_names_the_command():
    assert refusal() == 'check_world: Drake is missing (No Drake in this test): pip install drake'


def test_a_tag_file_that_cannot_be_read_is_told_in_one_line():
    assert refusal('--tag-file', '/missing.json').startswith(
        "check_world: tag_file '/missing.json': cannot be read"
    )
