"""The robot's map: how its file is read, the room that it leaves, and the poses of approach_poses in it."""

import cmath
import json
import math
import random
import re
import sys

import numpy as np
import pytest
import yaml
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag
from lupin_planning import approach_poses
from lupin_planning.grid import FAR_M, SMALLEST_ROOM_M, Grid
from lupin_planning.occupancy import OccupancyMap, read_map
from lupin_planning.registration import Transform, write_transform
from lupin_planning.walls import Walls
from PIL import Image

BENCH = (1.0, 1.0, 3.0, 1.5)
WALLS = ('--walls', '0', '0', '4', '3')
CELL_M = 0.04
NEEDED_M = 0.2 + SMALLEST_ROOM_M  # from the robot's centre to an obstacle
ORIGIN = (0.0, 0.0, 0.0)


@pytest.fixture
def write_map(tmp_path):
    """Return a function that writes an image of rows from the top, and its YAML file, which it names."""

    def write(pixels, name='map.pgm', **values):
        image = Image.fromarray(np.asarray(pixels, dtype=np.uint8))
        image.save(tmp_path / name)
        data = {'resolution': 1.0, 'origin': [0.0, 0.0, 0.0]}
        data |= {'image': name, 'occupied_thresh': 0.65, 'free_thresh': 0.196, **values}
        path = tmp_path / 'map.yaml'
        path.write_text(yaml.safe_dump(data), encoding='utf-8')
        return path

    return write


@pytest.fixture
def poses_of(write_layout, capsys):
    """Return a function that runs approach_poses; it returns the exit code, the data and the errors."""
    tag_file = write_layout({'7': (2.0, 1.0)}, bench=BENCH)

    def run(*words):
        options = ('--tag-file', tag_file, *WALLS, '--format', 'json')
        exit_code = approach_poses.main(['approach_poses', *options, *map(str, words)])
        out, err = capsys.readouterr()
        return exit_code, json.loads(out or 'null'), err

    return run


def percents(found: OccupancyMap) -> list[str]:
    """Return the rows of a map from the top: # occupied, ? unknown, . free."""
    letters = np.where(found.is_occupied, '#', np.where(found.is_unknown, '?', '.'))
    return [''.join(row) for row in letters[::-1]]


def room(is_taken, value=0) -> np.ndarray:
    """Return the pixels of the room of 4 m x 3 m, with this value where is_taken(x, y) holds."""
    middles = [((column + 0.5) * CELL_M, (row + 0.5) * CELL_M) for row in range(75) for column in range(100)]
    return np.array([value if is_taken(*each) else 254 for each in middles]).reshape(75, 100)[::-1]


GREY = [[254, 205, 204, 128], [90, 89, 88, 0]]  # 0, 0.196, 0.2, 0.498; 0.647, 0.651, 0.655 and 1 occupied


@pytest.mark.parametrize(
    ('pixels', 'values', 'rows'),
    [
        (GREY, {}, ['.???', '?###']),
        (GREY, {'free_thresh': 0.25}, ['...?', '?###']),
        (GREY, {'mode': 'trinary', 'negate': 0, 'occupied_thresh': 0.9}, ['.???', '???#']),
    ],
)
@pytest.mark.parametrize('name', ['map.pgm', 'map.png'])
def test_the_grey_is_read_as_nav2_does(write_map, name, pixels, values, rows):
    assert percents(read_map(write_map(pixels, name, **values))) == rows


@pytest.mark.parametrize('mode', ['1', 'P', 'RGB'])
def test_a_grey_image_may_have_few_colours_or_a_palette(write_map, tmp_path, mode):
    path = write_map([[255, 0]], 'map.png')
    Image.open(tmp_path / 'map.png').convert(mode).save(tmp_path / 'map.png')
    assert percents(read_map(path)) == ['.#']


@pytest.mark.parametrize('mode', ['LA', 'RGBA', 'I;16'])
def test_an_image_that_is_not_8_bit_grey_is_refused(write_map, tmp_path, mode):
    path = write_map([[255, 0]], 'map.png')
    Image.new(mode, (2, 1)).save(tmp_path / 'map.png')
    with pytest.raises(StartUpError, match=r"map.png' is not 8-bit grey: save it again"):
        read_map(path)


@pytest.mark.parametrize('unknown_is_free', [False, True])
@pytest.mark.parametrize(('yaw', 'side_m'), [(0.0, 0.13), (math.pi / 2, 0.05), (-2.3, 0.13), (0.4, 0.01)])
def test_the_grid_has_the_distance_to_the_nearest_cell_of_the_map(yaw, side_m, unknown_is_free):
    """By brute force: in complex numbers, over the corners and sides of all taken cells."""
    chance = random.Random(f'{yaw}')
    width, height, x, y = 17, 11, 1.5, 1.5
    data = [chance.choice([0, 0, 0, 0, 0, 0, 0, 10, -1, 50, 100]) for _ in range(width * height)]
    found = OccupancyMap(width, height, side_m, (x, y, yaw), data, unknown_is_free=unknown_is_free)
    layout = Layout({'1': Tag(0.0, 0.0, [])}, {})
    grid = Grid(layout, Walls(-2.0, -2.0, 5.0, 5.0), 0.1, occupancy=found)
    points = [(chance.uniform(0.5, 2.5), chance.uniform(0.5, 2.5)) for _ in range(300)]
    for point, gap_m in zip(points, grid.obstacle_distances_m(points), strict=True):
        at = (complex(*point) - complex(x, y)) * cmath.exp(-1j * yaw) / side_m
        nearest_m = min(math.hypot(*point), FAR_M)
        for number, value in enumerate(data):
            row, column = divmod(number, width)
            to = complex(min(max(at.real, column), column + 1), min(max(at.imag, row), row + 1))
            if value not in ((0, 10, -1, 50) if unknown_is_free else (0, 10)):
                nearest_m = min(nearest_m, abs(at - to) * side_m)
        edge_m = max(0.0, min(at.real, at.imag, width - at.real, height - at.imag)) * side_m
        assert gap_m == pytest.approx(
            nearest_m if unknown_is_free else min(nearest_m, edge_m), abs=grid.cell_m
        )


@pytest.mark.parametrize(
    ('fields', 'fault'),
    [
        ((2, 2, 0.1, ORIGIN, [0] * 3), 'the map has 3 cells, but its size is 2 x 2'),
        ((0, 0, 0.1, ORIGIN, []), 'the map has 0 cells'),
        ((1, 1, 0.0, ORIGIN, [0]), 'the map has the resolution 0 '),
        ((1, 1, 0.1, (math.nan, 0.0, 0.0), [0]), 'the origin nan, 0, 0'),
    ],
)
def test_fields_that_do_not_fit_are_refused(fields, fault):
    with pytest.raises(StartUpError, match=fault):
        OccupancyMap(*fields)


@pytest.mark.parametrize('grey', [0, 205])
def test_a_tag_that_the_map_costs_is_unreachable(write_map, poses_of, grey):
    """A corridor of 0.24 m in front of the tag: in its middle, 0.6 m from it, both sides are 0.12 m away."""
    path = write_map(room(lambda _x, y: y < 1.0 and not 0.28 < y < 0.52, grey), resolution=CELL_M)
    exit_code, data, err = poses_of('--map', path)
    reason = 'the map has an obstacle or an unknown cell at each place from which the robot would see it'
    assert (exit_code, data['poses']) == (1, [])
    assert err.splitlines() == [
        'approach_poses: without --layout-in-map, the map is taken to be in the frame of the layout',
        f"approach_poses: tag '7': {reason}",
    ]
    assert data['unreachable'] == [{'tag_id': '7', 'reason': reason}]
    exit_code, data, _ = poses_of('--map', path, '--radius', 0.11 - SMALLEST_ROOM_M)
    assert (exit_code, data['poses'][0]['y']) == (0, pytest.approx(0.4, abs=0.02))
    exit_code, data, _ = poses_of('--map', path, '--unknown', 'free')
    assert (exit_code, bool(data['poses'])) == ((1, False) if grey == 0 else (0, True))


@pytest.mark.parametrize('transform', [Transform(), Transform(-3.0, 5.0, 2.1)])
@pytest.mark.parametrize(
    ('door_m', 'start', 'seen'),
    [
        (2 * NEEDED_M + CELL_M, (2.0, 0.5), {'7', '8'}),
        (0.34, (2.0, 2.5), {'8'}),
        (0.34, (2.0, NEEDED_M), {'7'}),  # It stands as near to the wall as it can, as on a dock.
        (0.34, None, {'7'}),
    ],
)
def test_a_pose_that_the_map_walls_off_is_cut_off(
    write_map, poses_of, write_layout, tmp_path, transform, door_m, start, seen
):
    """A barrier between the tags is in the map alone. The layout lets the robot drive around the bench."""
    write_layout({'7': (2.0, 1.0), '8': (2.0, 1.5)}, bench=BENCH)
    words = ('--start', *start) if start else ()
    assert {each['tag_id'] for each in poses_of(*words)[1]['poses']} == {'7', '8'}
    pixels = room(lambda x, y: x > door_m and 1.2 < y < 1.28)
    write_transform(tmp_path / 'layout.yaml', transform)
    # The image is turned by 90 degrees in the frame of the layout.
    origin = [*transform.point(4.0, 0.0), transform.yaw + math.pi / 2]
    path = write_map(np.rot90(pixels, -1), resolution=CELL_M, origin=origin)
    exit_code, data, _ = poses_of('--map', path, '--layout-in-map', tmp_path / 'layout.yaml', *words)
    assert {each['tag_id'] for each in data['poses']} == seen
    origin = 'the start at ({:g}, {:g})'.format(*start) if start else 'the rest of the free space'
    reasons = [each['reason'] for each in data['unreachable']]
    robot = 'no passage between is wide enough for a robot of radius 0.2 m'
    assert reasons == [f'cut off from {origin}: {robot}'] * exit_code
    assert exit_code == 2 - len(seen)


def test_a_map_of_another_place_is_refused_with_both_extents(write_map, poses_of):
    path = write_map(room(lambda _x, _y: False), resolution=CELL_M, origin=[10.0, 0.0, math.pi / 2])
    exit_code, data, err = poses_of('--map', path)
    assert (exit_code, data, err.count('\n')) == (2, None, 1)
    assert 'the map holds only 0 of the 1 tags' in err
    assert 'from x 7 to 10 m, y 0 to 4 m, and the greenhouse from x 0 to 4 m, y 0 to 3 m' in err


@pytest.mark.parametrize(
    ('values', 'fault'),
    [
        ({'image': 'none.pgm'}, "none.pgm' cannot be read (No such file or directory): correct image"),
        ({'image': '/dev/null'}, "/dev/null' cannot be read (cannot identify image file"),
        ({'image': ''}, 'image is missing or no text'),
        ({'resolution': 0}, 'resolution is 0: must be a number from'),
        ({'resolution': 5}, 'resolution is 5: must be a number from 0.0001 to 1 (metres per cell)'),
        ({'origin': [0.0, 0.0, 90.0]}, 'origin: yaw is 90.0: must be a number from -10 to 10 (radians)'),
        ({'resolution': '0.05 m'}, "resolution is '0.05 m': must be a number"),
        ({'origin': [0.0, 0.0]}, 'origin is missing or not a list of three'),
        ({'mode': 'scale'}, "mode is 'scale': only trinary is read: save it again with Nav2's map_saver_cli"),
        ({'negate': 1}, 'negate is 1: only 0 is read: save it again'),
        ({'occupied_thresh': 1.5}, 'occupied_thresh is 1.5: must be a number from 0 to 1'),
        ({'free_thresh': 0.65}, 'free_thresh must be below occupied_thresh'),
    ],
)
def test_a_bad_map_is_one_line_and_exit_code_2(write_map, poses_of, values, fault):
    path = write_map([[254]], **values)
    exit_code, data, err = poses_of('--map', path)
    assert (exit_code, data, err.count('\n')) == (2, None, 1)
    assert err.startswith(f"approach_poses: map '{path}': ")
    assert fault in err


def test_what_is_no_map_is_refused(write_map, poses_of, tmp_path, monkeypatch):
    path = write_map(room(lambda _x, _y: False), 'map.png')
    assert f"map '{tmp_path / 'map.png'}': " in poses_of('--map', tmp_path / 'map.png')[2]
    assert 'cannot be read (No such file' in poses_of('--map', tmp_path / 'none.yaml')[2]
    image = tmp_path / 'map.png'
    image.write_bytes(image.read_bytes()[:60])
    assert re.search(r"image '.*map\.png' cannot be read \(", poses_of('--map', path)[2])
    monkeypatch.setitem(sys.modules, 'PIL', None)
    assert poses_of('--map', path)[2].endswith(': sudo apt install python3-pil\n')
    path.write_text('[1, 2]', encoding='utf-8')
    assert 'must be a mapping with image' in poses_of('--map', path)[2]


def test_the_picture_shows_the_map_and_never_replaces_it(write_map, poses_of, tmp_path):
    path = write_map(room(lambda x, _y: x > 3.5), 'map.png', resolution=CELL_M)
    image = tmp_path / 'map.png'
    before = image.read_bytes()
    exit_code, _, err = poses_of('--map', path, '--picture', image)
    assert (exit_code, image.read_bytes()) == (2, before)
    assert f"--picture '{image}' is the file of --map itself: name another file" in err
    exit_code, _, err = poses_of('--map', path, '--picture', tmp_path / 'with.png')
    assert (exit_code, f'approach_poses: picture: {tmp_path / "with.png"}' in err) == (0, True), err
    red, green, blue = np.asarray(Image.open(tmp_path / 'with.png').convert('RGB'), dtype=int).T
    is_orange = (red > 220) & (abs(green - 178) < 20) & (blue < 80)
    assert is_orange.sum() > 1000
