"""The check of a world, as far as it needs no Drake; ci/tests/test_world.py has the rest."""

import subprocess
from types import SimpleNamespace

import numpy as np
import pytest
from lupin_greenhouse_bridge.testing._helpers import executable
from lupin_simulation import check_world
from lupin_simulation.pinhole_camera import PinholeCamera
from lupin_simulation.rendered_world import TagModel, View, viewpoint

BLANK = np.full((480, 640), 255, np.uint8)


SOUTHWARDS = TagModel(
    np.array([2.0, 1.0, 0.3]), *np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
)


@pytest.mark.parametrize(
    ('angle_degrees', 'place'),
    [(0, (2.0, 0.5, 0.3)), (90, (2.5, 1.0, 0.3)), (-90, (1.5, 1.0, 0.3)), (60, (2.433013, 0.75, 0.3))],
)
def test_a_viewpoint_is_in_front_of_a_tag_and_turned_to_its_right(angle_degrees, place):
    assert viewpoint(SOUTHWARDS, 0.5, angle_degrees) == pytest.approx(place)


def test_a_tag_is_read_in_all_or_in_any_of_its_views_which_are_counted(monkeypatch, capsys):
    for name in ('FIRST_SECONDS', 'NEXT_SECONDS'):
        monkeypatch.setattr(check_world.Progress, name, 0.0)
    camera, random = PinholeCamera(), np.random.default_rng(0)
    front = camera.expose(camera.scene_of_tag(7, random, distance_m=0.5), random)
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
