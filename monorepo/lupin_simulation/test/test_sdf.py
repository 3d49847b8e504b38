"""The world's boxes, plates, textures and tags, as numbers."""

import io
import math
from xml.etree import ElementTree

import numpy as np
import pytest
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag
from lupin_planning.tag_poses import find_tag_poses
from lupin_planning.walls import Walls
from lupin_simulation.sdf import SDF_FILE, world_files
from lupin_tag_confirmation.confirmation import UnknownTagId
from lupin_tag_confirmation.detector import TagDetector
from PIL import Image

LAYOUT = Layout(
    {'7': Tag(-1.0, 2.5, ['co2']), '8': Tag(4.0, 9.0, ['co2'])},
    {'long': (1.0, 2.0, 5.0, 3.0), 'turned': (2.0, 6.5, 1.0, 5.0)},
)
SIDE_M = 0.08
WALLS = Walls(-2.6, 0.4, 6.6, 10.6)


@pytest.fixture(scope='module')
def files():
    return world_files(LAYOUT, WALLS, SIDE_M)


@pytest.fixture(scope='module')
def world(files):
    return ElementTree.fromstring(files[SDF_FILE]).find('world')


def numbers(text) -> np.ndarray:
    return np.array(text.split(), dtype=float)


@pytest.mark.parametrize('part', ['visual', 'collision'])
@pytest.mark.parametrize(
    ('name', 'lowest', 'highest'),
    [
        ('floor', (-2.6, 0.4, -0.1), (6.6, 10.6, 0.0)),
        ('wall_south', (-2.7, 0.3, 0.0), (6.7, 0.4, 0.2)),
        ('wall_north', (-2.7, 10.6, 0.0), (6.7, 10.7, 0.2)),
        ('wall_west', (-2.7, 0.4, 0.0), (-2.6, 10.6, 0.2)),
        ('wall_east', (6.6, 0.4, 0.0), (6.7, 10.6, 0.2)),
        ('table_1', (1.0, 2.0, 0.0), (5.0, 3.0, 0.2)),
        ('table_2', (1.0, 5.0, 0.0), (2.0, 6.5, 0.2)),
    ],
)
def test_floor_walls_and_tables_fill_their_places(world, name, part, lowest, highest):
    model = world.find(f"model[@name='{name}']")
    solid = model.find(f'link/{part}')
    place, size = numbers(model.findtext('pose')), numbers(solid.findtext('geometry/box/size'))
    assert not any([*numbers(solid.findtext('pose')), *place[3:]])
    assert np.allclose([place[:3] - size / 2, place[:3] + size / 2], [lowest, highest])


@pytest.mark.parametrize('part', ['visual', 'collision'])
def test_the_plate_is_as_wide_as_the_paper_and_behind_the_tag(world, part):
    plate = world.find(f"model[@name='tag_7']/link/{part}[@name='plate']")
    width, height, thickness = numbers(plate.findtext('geometry/box/size'))
    x, y, z, *angles = numbers(plate.findtext('pose'))
    assert (width, height) == pytest.approx((0.1, 0.1))
    assert (x, y, *angles) == (0.0,) * 5
    assert 0.0 < -(z + thickness / 2) < 0.001  # a gap that no camera sees, and no renderer mixes up
    assert 0.002 <= thickness <= 0.01


def test_the_post_stands_on_the_floor_behind_the_plate_and_is_no_obstacle(world):
    link = world.find("model[@name='tag_7']/link")
    assert [each.get('name') for each in link.findall('collision')] == ['plate']
    edges = {}
    for part in ('plate', 'post'):
        solid = link.find(f"visual[@name='{part}']")
        middle, half = numbers(solid.findtext('pose'))[:3], numbers(solid.findtext('geometry/box/size')) / 2
        edges[part] = middle - half, middle + half
    lowest, highest = edges['post']
    assert lowest[1] == pytest.approx(-0.3)  # the floor, as the tag is 0.3 m above it
    assert highest[1] > edges['plate'][0][1]
    assert highest[2] == pytest.approx(edges['plate'][0][2])
    assert (highest - lowest)[0] < 0.02


def test_the_mesh_shows_the_texture_upright_and_to_the_front(files):
    lines = [line.split() for line in files['models/tag_7/tag_7.obj'].decode().splitlines()]
    points, places, (out,) = (
        [tuple(map(float, words)) for kind, *words in lines if kind == wanted] for wanted in ('v', 'vt', 'vn')
    )
    (face,) = [words for kind, *words in lines if kind == 'f']
    corners = {}
    for corner in face:
        point, place, normal = (int(number) - 1 for number in corner.split('/'))
        assert normal == 0
        corners[places[place]] = points[point]
    assert out == (0.0, 0.0, 1.0)
    half = pytest.approx(0.05)  # of the paper: 10 modules, where the side has 8
    assert corners == {
        (u, v): (half if u else -0.05, half if v else -0.05, 0.0) for u in (0.0, 1.0) for v in (0.0, 1.0)
    }
    (first, second, third, _) = (np.array(points[int(each.split('/')[0]) - 1]) for each in face)
    assert np.cross(second - first, third - second)[2] > 0.0  # counter-clockwise: seen from the front


def test_the_texture_has_the_tag_with_a_black_square_of_the_side_that_was_asked_for(files):
    """The side has 8 of the 10 modules of the paper, which is as wide as the mesh."""
    with Image.open(io.BytesIO(files['models/tag_7/tag_7.png'])) as picture:
        grey = np.asarray(picture.convert('L'))
    assert grey.shape == (160, 160)  # 10 modules of 16 pixels
    (detection,) = TagDetector().detect(np.pad(grey, 20, constant_values=255))
    assert detection.tag_number == 7
    assert np.allclose(detection.corners - 20, [(16, 144), (144, 144), (144, 16), (16, 16)], atol=1.0)


def test_each_tags_frame_has_z_out_of_the_face_x_to_the_viewers_right_and_y_up(world):
    poses = find_tag_poses(LAYOUT, WALLS)
    assert poses['7'].facing != poses['8'].facing
    for tag_id, (x, y, facing) in poses.items():
        *place, roll, pitch, yaw = numbers(world.findtext(f"model[@name='tag_{tag_id}']/pose"))
        about_x = [[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]]
        about_z = [[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]
        to_right, up, out = (np.array(about_z) @ about_x).T
        assert (place, pitch) == ([x, y, 0.3], 0.0)  # 0.3 m is the height of the camera
        assert np.allclose(out, (math.cos(facing), math.sin(facing), 0))
        assert np.allclose(up, (0, 0, 1))
        assert np.allclose(to_right, np.cross(-out, up))


@pytest.mark.parametrize('tag_id', ['A7', '587', '07', '-1'])
def test_an_id_that_is_no_tag36h11_is_refused(tag_id):
    with pytest.raises(UnknownTagId, match='is not an id of tag36h11: must be 0 to 586'):
        world_files(Layout({tag_id: Tag(0.0, 0.0, ['co2'])}, {}), WALLS, SIDE_M)
