"""register_layout: what it fits, leaves out and refuses, what it writes and prints, and the clicks."""

import contextlib
import json
import math
import random
import re
import shlex
import threading

import pytest
from geometry_msgs.msg import PointStamped
from hypothesis import given
from hypothesis import strategies as st
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.simulator.layout import find_layout
from lupin_greenhouse_bridge.testing.commands import SIGNALS, SPINS
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS, spinning_node, wait_until
from lupin_planning import register_layout
from lupin_planning.registration import (
    CannotFit,
    Transform,
    fit,
    read_places,
    read_registration,
    read_transform,
    write_transform,
)
from rclpy.duration import Duration
from rclpy.qos import QoSProfile

SHIPPED_M = {tag_id: tag[:2] for tag_id, tag in find_layout('').tags.items()}
SQUARE_M = {'a': (0.0, 0.0), 'b': (4.0, 0.0), 'c': (4.0, 3.0), 'd': (0.0, 3.0)}
CORNERS = [
    max(SHIPPED_M, key=lambda tag_id: sign_x * SHIPPED_M[tag_id][0] + sign_y * SHIPPED_M[tag_id][1])
    for sign_x, sign_y in ((1, 1), (-1, -1), (1, -1), (-1, 1))
]
SPOT_M = {'a': (1.0, 1.0), 'b': (1.05, 1.0), 'c': (1.0, 1.05)}
TWINS_M = dict.fromkeys('ab', (1.0, 1.0))
METRES, YAWS = st.floats(-1000.0, 1000.0), st.floats(-math.pi, math.pi)
TRANSFORMS = st.builds(Transform, METRES, METRES, YAWS)


def moved(layout_m: dict, transform: Transform) -> dict:
    return {tag_id: transform.point(*place) for tag_id, place in layout_m.items()}


def shifted(places_m: dict, tag_id: str, metres: float, direction: float = 0.0) -> dict:
    x, y = places_m[tag_id]
    return {**places_m, tag_id: (x + metres * math.cos(direction), y + metres * math.sin(direction))}


def noisy(places_m: dict, noise: random.Random, sigma_m: float) -> dict:
    return {each: tuple(noise.gauss(value, sigma_m) for value in place) for each, place in places_m.items()}


def part(places_m: dict, tag_ids) -> dict:
    return {tag_id: places_m[tag_id] for tag_id in tag_ids}


@given(TRANSFORMS, st.sets(st.sampled_from(sorted(SHIPPED_M)), max_size=14), st.integers(0, 2**32))
def test_any_transform_is_found_again_without_a_minority_of_outliers(transform, tag_ids, seed):
    chance = random.Random(seed)
    places_m = moved(SHIPPED_M, transform)
    for tag_id in tag_ids:
        places_m = shifted(places_m, tag_id, chance.uniform(0.5, 5.0), chance.uniform(-math.pi, math.pi))
    try:
        fitted = fit(SHIPPED_M, places_m)
    except CannotFit:
        assert len(tag_ids) > 7  # never with a quarter of the tags
        return
    assert abs(math.remainder(fitted.transform.yaw - transform.yaw, math.tau)) < 1e-9
    assert set(fitted.left_out) == tag_ids or (len(tag_ids) > 1 and set(fitted.left_out) > tag_ids)
    for tag_id, place in moved(SHIPPED_M, transform).items():
        assert fitted.transform.point(*SHIPPED_M[tag_id]) == pytest.approx(place, abs=1e-9)
        assert fitted.residuals_m[tag_id] == pytest.approx(math.dist(place, places_m[tag_id]), abs=1e-8)


def test_the_tag_is_left_out_without_which_the_others_fit_best():
    """Not the one with the largest residual: 'e' lies far out, and turns the fit of all towards itself."""
    layout_m = {**SQUARE_M, 'e': (30.0, 1.0)}
    places_m = shifted(layout_m, 'e', 3.0, direction=math.pi / 2)
    fitted = fit(layout_m, places_m, tolerance_m=0.2)
    assert fitted.left_out == ['e']
    assert fitted.transform == pytest.approx(Transform(), abs=1e-9)


@pytest.mark.parametrize(
    ('tag_ids', 'wrong', 'is_refused'),
    [('abcdef', 'bdf', True), ('abcdef', 'df', False), ('abc', 'c', True), ('abcd', 'c', False)],
)
def test_a_majority_of_more_than_two_tags_overrules_the_others(tag_ids, wrong, is_refused):
    layout_m = part({**SQUARE_M, 'e': (2.0, 5.0), 'f': (6.0, 1.0)}, tag_ids)
    places_m = layout_m
    for direction, tag_id in enumerate(wrong):
        places_m = shifted(places_m, tag_id, 2.0, float(direction))
    if is_refused:
        with pytest.raises(CannotFit, match='does not fit the map: the largest residual is'):
            fit(layout_m, places_m)
    else:
        assert fit(layout_m, places_m).left_out == list(wrong)


def test_two_tags_are_enough_and_their_residuals_must_be_within_the_tolerance():
    fitted = fit(SQUARE_M, {'a': (1.0, 1.0), 'c': (-2.0, 5.0)})
    assert fitted.transform == pytest.approx(Transform(1.0, 1.0, math.pi / 2))
    layout_m = part(SQUARE_M, 'ab')
    places_m = shifted(layout_m, 'b', 0.3)
    assert fit(layout_m, places_m, tolerance_m=0.3).left_out == []
    with pytest.raises(CannotFit, match=r"residual is 0\.15 m, of tag '.', and the tolerance is 0\.14 m"):
        fit(layout_m, places_m, tolerance_m=0.14)


@pytest.mark.parametrize(
    ('layout_m', 'places_m', 'fault'),
    [
        (SQUARE_M, {}, 'position in the map: 0: at least 2 are needed'),
        (SQUARE_M, {'a': (1.0, 2.0)}, 'position in the map: 1: at least 2 are needed'),
        ({**SPOT_M, 'far': (4.0, 3.0)}, SPOT_M, 'the expected error is'),
        ({**TWINS_M, 'far': (4.0, 3.0)}, TWINS_M, 'the expected error is'),
        (SQUARE_M, dict.fromkeys(SQUARE_M, (1.0, 2.0)), 'the largest residual is'),
    ],
)
def test_positions_that_give_no_rotation_are_refused(layout_m, places_m, fault):
    with pytest.raises(CannotFit, match=fault):
        fit(layout_m, places_m)


@pytest.mark.parametrize('tag_ids', ['ab', 'abcd'])
def test_the_expected_error_is_that_of_many_fits_at_the_farthest_tag(tag_ids):
    noise, squares = random.Random(1), []
    layout_m = {**SQUARE_M, 'far': (10.0, 8.0)}
    for _ in range(1000):
        places_m = noisy(part(SQUARE_M, tag_ids), noise, 0.01)
        fitted = fit(layout_m, places_m, tolerance_m=1.0, click_error_m=0.01)
        assert fitted.farthest == 'far'
        squares.append(math.dist(fitted.transform.point(10.0, 8.0), (10.0, 8.0)) ** 2)
    clean = fit(layout_m, part(SQUARE_M, tag_ids), click_error_m=0.01)
    assert clean.expected_error_m == pytest.approx(math.sqrt(sum(squares) / len(squares)), rel=0.1)


def test_residuals_above_the_click_error_raise_the_expected_error():
    noise = random.Random(2)
    fits = [fit(SQUARE_M, noisy(SQUARE_M, noise, 0.04), 0.5, click_error_m=0.001) for _ in range(200)]
    # sqrt(2 / 4 + 1 / 4) of the noise: every corner is as far from the middle
    mean_m = sum(each.expected_error_m for each in fits) / len(fits)
    assert mean_m == pytest.approx(0.04 * math.sqrt(0.75), rel=0.1)


@pytest.mark.parametrize('tag_ids', [CORNERS, CORNERS[:3], SHIPPED_M])
def test_swapped_axes_are_refused_as_a_mirror_image_whatever_the_noise(tag_ids):
    noise = random.Random(3)
    mirrored_m = {tag_id: (y, x) for tag_id, (x, y) in SHIPPED_M.items()}
    with pytest.raises(CannotFit, match='mirror image'):
        fit(SHIPPED_M, shifted(mirrored_m, '7', 1.0))
    for _ in range(300 // len(tag_ids)):
        transform = Transform(1.0, 2.0, noise.uniform(-math.pi, math.pi))
        swapped_m = moved({tag_id: SHIPPED_M[tag_id][::-1] for tag_id in tag_ids}, transform)
        with pytest.raises(CannotFit, match='mirror image'):
            fit(SHIPPED_M, noisy(swapped_m, noise, 0.05))


@pytest.mark.parametrize('aside_m', [0.06, 0.5])
def test_a_mirror_image_of_tags_almost_on_one_line_is_refused_if_it_fits_better(aside_m):
    layout_m = {'a': (0.0, 0.0), 'b': (2.0, aside_m), 'c': (4.0, 0.0)}
    assert fit(layout_m, layout_m).left_out == []
    with pytest.raises(CannotFit, match='mirror image'):
        fit(layout_m, {tag_id: (y, x) for tag_id, (x, y) in layout_m.items()})


@given(TRANSFORMS, st.sampled_from(['map', 'robot1/map', '7', 'Gewächshaus']))
def test_a_written_transform_is_read_again(tmp_path_factory, transform, frame_id):
    path = tmp_path_factory.getbasetemp() / 'layout_in_map.yaml'
    write_transform(path, transform, frame_id)
    assert read_registration(path) == (frame_id, transform)
    assert read_transform(path) == read_transform(path, frame_id) == transform


def in_another_map(path):
    return read_transform(path, 'robot1/map')


GOOD = 'frame_id: map\nx: 1.5\ny: 2\nyaw: 0.3\n'


@pytest.mark.parametrize(
    ('read', 'text', 'fault'),
    [
        (read_transform, GOOD.replace('x: 1.5', 'x: one'), "x is 'one': must be a number from -1e+12"),
        (read_transform, GOOD.replace('0.3', '90'), 'yaw is 90: must be a number from -10 to 10 (radians)'),
        (read_transform, GOOD.replace('map', ''), 'frame_id is missing or no text'),
        (read_transform, f'{GOOD}z: 0.1', "unknown key 'z': use frame_id, x, y, yaw, as in {frame_id: map"),
        (read_transform, '[1, 2]', 'must be a mapping, such as'),
        (in_another_map, GOOD, "frame_id is 'map', but the map's frame is 'robot1/map'"),
        (read_places, '7: [1.5, 2]', "tag '7' is not text: put quotes around the id"),
        (read_places, '"7": [1.5]', "tag '7': must be a list of x and y"),
        (read_places, '"7": [1.5, .inf]', "tag '7': y is inf: must be a number"),
        (read_places, '[1, 2]', 'must be positions in the map by tag id'),
    ],
)
def test_a_malformed_file_is_refused_with_its_key_or_tag(tmp_path, read, text, fault):
    path = tmp_path / 'layout.yaml'
    path.write_text(text, encoding='utf-8')
    where = 'pairs' if read is read_places else 'registration'
    with pytest.raises(StartUpError, match=re.escape(f"{where} '{path}': {fault}")):
        read(path)


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(StartUpError, match=r'none/a\.yaml.* cannot be written .*: name another file'):
        write_transform(tmp_path / 'none' / 'a.yaml', Transform())


TRANSFORM = Transform(2.0, -1.0, math.pi / 2)


@pytest.fixture
def places():
    return {tag_id: list(place) for tag_id, place in moved(SHIPPED_M, TRANSFORM).items()}


@pytest.fixture
def register(run_here, tmp_path):
    """Return a function that runs register_layout with these positions, to write layout.yaml."""

    def run(places, *arguments):
        (tmp_path / 'pairs.json').write_text(json.dumps(places), encoding='utf-8')
        pairs = ('--pairs', str(tmp_path / 'pairs.json'), '-o', str(tmp_path / 'layout.yaml'))
        return run_here(register_layout.main, *pairs, *arguments)

    return run


def refusal(ended) -> str:
    (line,) = [line for line in ended.err.splitlines() if line.startswith('register_layout: ')]
    return line.removeprefix('register_layout: ')


def test_pairs_of_a_file_are_fitted_and_written(register, places, tmp_path):
    places['7'][0] += 1.0
    ended = register(places)
    assert ended.code == 0, ended
    rows = {line.split()[0]: line.split()[1:] for line in ended.out.splitlines()}
    assert set(places) < set(rows)
    assert 'cannot show' not in ended.err
    assert rows['7'][2:] == ['1.000', 'left', 'out']
    assert rows['1'] == [f'{places["1"][0]:.3f}', f'{places["1"][1]:.3f}', '0.000']
    assert f'{len(places) - 1} of {len(places)} tags fit within 0.1 m. The expected error is 0.0' in ended.out
    assert 'x 2.000 m, y -1.000 m, yaw 1.5708 rad in map.' in ended.out
    command = shlex.split(ended.out.splitlines()[-1].removeprefix('With ROS installed, publish it: '))
    assert command[:4] == ['ros2', 'run', 'tf2_ros', 'static_transform_publisher']
    options = dict(zip(command[4::2], command[5::2], strict=True))
    found = [float(options.pop(f'--{each}')) for each in ('x', 'y', 'yaw')]
    assert found == pytest.approx(TRANSFORM, abs=1e-6)
    assert options == {'--frame-id': 'map', '--child-frame-id': 'greenhouse'}
    frame_id, transform = read_registration(tmp_path / 'layout.yaml')
    assert (frame_id, transform) == ('map', pytest.approx(TRANSFORM))


def test_two_tags_cannot_show_whether_they_are_mirrored(register, places):
    ended = register(part(places, CORNERS[:2]))
    assert ended.code == 0
    assert 'two tags cannot show whether they are swapped or mirrored: add a third' in ended.err


@pytest.mark.parametrize(
    ('name', 'fault'),
    [
        ('link.json', 'is the file of --pairs itself'),
        ('tags.json', 'is the file of --tag-file itself'),
        ('map.pgm', 'exists and is not from this program'),
    ],
)
def test_only_an_earlier_registration_is_replaced(register, places, tmp_path, name, fault):
    output, tag_file, picture = (tmp_path / each for each in (name, 'tags.json', 'map.pgm'))
    (tmp_path / 'link.json').symlink_to('pairs.json')
    for each in (tag_file, picture):
        each.write_text('P5 1 1 255 0', encoding='utf-8')
    ended = register(places, '-o', str(output), '--tag-file', str(tag_file))
    assert (ended.code, refusal(ended)) == (2, f"--output '{output}' {fault}: name another file")
    assert json.loads((tmp_path / 'pairs.json').read_text(encoding='utf-8')) == places
    assert tag_file.read_text(encoding='utf-8') == picture.read_text(encoding='utf-8') == 'P5 1 1 255 0'
    output = tmp_path / 'earlier.yaml'
    write_transform(output, Transform())
    assert register(places, '-o', str(output)).code == 0
    assert read_transform(output) == pytest.approx(TRANSFORM)


def test_strangers_misfits_and_large_errors_are_refused(register, places, write_layout, tmp_path):
    ended = register({**places, '99': [0.0, 0.0]})
    assert ended.code == 2
    assert refusal(ended).startswith(f"tag '99' is not one of the {len(places)} tags of the layout")
    ended = register({'1': places['1'], '2': [30.0, 0.0]}, '--tolerance', '0.2')
    assert (ended.code, ended.out) == (1, '')
    assert 'the layout does not fit the map' in refusal(ended)
    assert 'the tolerance is 0.2 m' in refusal(ended)
    tag_file = write_layout({'a': (0.0, 0.0), 'b': (0.22, 0.0), 'far': (0.11, 6.0)})
    ended = register({'a': [0.0, 0.0], 'b': [0.22, 0.0]}, '--tag-file', tag_file)
    # 0.03 m * sqrt(2 / 2 + 6.0**2 / (2 * 0.11**2)) = 1.157 m
    fault = "the expected error is 1.16 m at tag 'far', which is 6.0 m from the 2 tags that fit, and the"
    assert (ended.code, ended.out) == (1, '')
    assert refusal(ended).startswith(fault)
    assert not (tmp_path / 'layout.yaml').exists()
    ended = register({'a': [0.0, 0.0], 'b': [0.22, 0.0]}, '--tag-file', tag_file, '--click-error', '0.002')
    assert ended.code == 0
    assert 'The expected error is 0.077 m at the farthest tag, far.' in ended.out


@pytest.mark.parametrize(
    ('arguments', 'fault'),
    [
        ([], 'one of the arguments --pairs --click is required'),
        (['--pairs='], "pairs ''"),
        (['--click', '1', ''], "tag '' is not one of the"),
        (['--pair', 'none.json'], 'one of the arguments --pairs --click is required'),
        (['--click', '1', '2', '-o', 'a.json'], "--output 'a.json' is YAML: its name must end in .yaml"),
        (['--pairs', 'none.json'], "pairs 'none.json': cannot be read"),
        (['--pairs', 'none.json', '--click-error', '0'], "--click-error: '0': must be above 0 and below 1 m"),
        (['--pairs', 'none.json', '--tolerance', '1'], "--tolerance: '1': must be above 0 and below 1 m"),
        (['--click', '1,2', '3'], 'correct its id (ids have spaces between them)'),
        (['--click', '1', '2', '-o', 'a' * 300], 'File name too long: name another file'),
        (['--click', '1', '1', '-o', 'a.yaml'], '--click needs at least 2 tags'),
    ],
)
def test_wrong_usage_is_refused_in_one_line(run_here, tmp_path, monkeypatch, arguments, fault):
    monkeypatch.chdir(tmp_path)
    ended = run_here(register_layout.main, *arguments)
    assert (ended.code, ended.out) == (2, '')
    assert fault in ended.err
    assert list(tmp_path.iterdir()) == []


@contextlib.contextmanager
def clicking(*points):
    """Click at these (frame, x, y) in a thread, while the test runs a main() in its own."""

    def click():
        publisher = node.create_publisher(PointStamped, '/clicked_point', QoSProfile(depth=10))
        wait_until(lambda: publisher.get_subscription_count() == 1)
        for frame_id, x, y in points:
            message = PointStamped()
            message.header.frame_id = frame_id
            message.point.x, message.point.y = x, y
            publisher.publish(message)
        publisher.wait_for_all_acked(Duration(seconds=PATIENCE_SECONDS))

    with spinning_node('person') as node:
        thread = threading.Thread(target=click)
        thread.start()
        yield
        thread.join()


@pytest.mark.parametrize(('frame', 'other'), [('robot1/map', 'odom'), ('odom', 'map')])
def test_each_tag_is_clicked_in_turn(run_here, places, tmp_path, frame, other):
    output = tmp_path / 'layout.yaml'
    points = [(frame, *places[tag_id]) for tag_id in ('1', '20', '7')]
    points.insert(1, (other, 0.0, 0.0))
    points.insert(1, (frame, math.nan, 0.0))
    with clicking(('', 0.0, 0.0), *points):
        ended = run_here(register_layout.main, '--click', '1', '20', '7', '-o', str(output))
    assert ended.code == 0, ended
    asked = [line.split()[2] for line in ended.out.splitlines() if line.startswith('click tag')]
    assert asked == ['1', '20', '7']
    ignored = re.findall('ignored a click (.*?):', ended.err)
    assert ignored == ['without a frame or a position'] * 2 + [f"in the frame '{other}'"]
    assert f"the first was in '{frame}'" in ended.err
    assert f'x in {frame} (m)' in ended.out
    is_no_map = "the positions are in the frame 'odom': set RViz's Fixed Frame to map" in ended.err
    assert is_no_map == (frame == 'odom')
    frame_id, transform = read_registration(output)
    assert (frame_id, transform) == (frame, pytest.approx(TRANSFORM))


def test_ctrl_c_keeps_nothing_and_says_so(run_here, tmp_path):
    words = ('--click', '1', '2', '-o', str(tmp_path / 'layout.yaml'))
    ended = run_here(register_layout.main, *words, signals_at={SPINS: SIGNALS['SIGTERM and Ctrl-C']})
    assert ended.code == 130
    assert ended.out.endswith(f'signalled in {SPINS}\n')
    assert refusal(ended) == 'interrupted: nothing is kept, and nothing is written'
    assert not (tmp_path / 'layout.yaml').exists()
