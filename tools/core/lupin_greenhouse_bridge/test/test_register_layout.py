"""register_layout: what it writes, what it prints, what it refuses, and the clicks over ROS."""

import contextlib
import itertools
import json
import math
import shlex
import signal
import threading

import pytest
from conftest import SPINS
from geometry_msgs.msg import PointStamped
from lupin_greenhouse_bridge.planning import register_layout
from lupin_greenhouse_bridge.planning.registration import Transform, best_to_click, read_registration
from rclpy.duration import Duration
from rclpy.qos import QoSProfile

TRANSFORM = Transform(2.0, -1.0, math.pi / 2)


@pytest.fixture
def places(shipped_tags):
    """Return the shipped tags in the map."""
    return {tag_id: list(TRANSFORM.point(tag['x'], tag['y'])) for tag_id, tag in shipped_tags.items()}


@pytest.fixture
def register(run_here, tmp_path):
    """Return a function that runs register_layout with these positions, to write layout.yaml."""

    def run(places, *arguments):
        (tmp_path / 'pairs.json').write_text(json.dumps(places), encoding='utf-8')
        pairs = ('--pairs', str(tmp_path / 'pairs.json'), '-o', str(tmp_path / 'layout.yaml'))
        return run_here(register_layout.main, *pairs, *arguments)

    return run


def refusal(ended) -> str:
    """Return the one line of a register_layout that refuses."""
    (line,) = [line for line in ended.err.splitlines() if line.startswith('register_layout: ')]
    return line.removeprefix('register_layout: ')


def test_pairs_of_a_file_are_fitted_and_written(register, places, tmp_path):
    places['7'][0] += 1.0
    ended = register(places)
    assert ended.code == 0, ended
    rows = {line.split()[0]: line.split()[1:] for line in ended.out.splitlines()}
    assert set(places) < set(rows)
    assert rows['7'][2:] == ['1.000', 'left', 'out']
    assert rows['1'] == [f'{places["1"][0]:.3f}', f'{places["1"][1]:.3f}', '0.000']
    assert f'{len(places) - 1} of {len(places)} tags fit within 0.1 m. The expected error is 0.0' in ended.out
    assert 'x 2.000 m, y -1.000 m, yaw 1.5708 rad in map.' in ended.out
    command = shlex.split(ended.out.splitlines()[-1].removeprefix('To publish it: '))
    assert command[:4] == ['ros2', 'run', 'tf2_ros', 'static_transform_publisher']
    options = dict(zip(command[4::2], command[5::2], strict=True))
    assert [float(options.pop(f'--{each}')) for each in ('x', 'y', 'yaw')] == pytest.approx(
        TRANSFORM, abs=1e-6
    )
    assert options == {'--frame-id': 'map', '--child-frame-id': 'greenhouse'}
    frame_id, transform = read_registration(tmp_path / 'layout.yaml')
    assert (frame_id, transform) == ('map', pytest.approx(TRANSFORM))


@pytest.mark.parametrize('count', [2, 3])
def test_two_tags_cannot_show_that_they_are_swapped_and_it_says_so(register, places, count):
    ended = register({tag_id: places[tag_id] for tag_id in best_to_click(places, count)})
    assert ended.code == 0
    warning = 'two tags cannot show whether they are swapped or mirrored: add a third'
    assert (warning in ended.err) == (count == 2)


def test_tags_on_one_line_cannot_show_that_they_are_mirrored_and_it_says_so(register, tmp_path):
    tag_file = tmp_path / 'tags.json'
    tags = {each: {'x': float(each), 'y': 2.0, 'sensors': ['co2']} for each in '135'}
    tag_file.write_text(json.dumps(tags), encoding='utf-8')
    ended = register({each: [float(each), 0.0] for each in '135'}, '--tag-file', str(tag_file))
    assert ended.code == 0
    assert 'the 3 tags lie almost on one line, and cannot show whether they are mirrored' in ended.err


@pytest.mark.parametrize('name', ['pairs.json', 'link.json', 'tags.json'])
def test_no_input_is_overwritten(register, places, tmp_path, name):
    (tmp_path / 'link.json').symlink_to('pairs.json')
    (tmp_path / 'tags.json').write_text('{}', encoding='utf-8')
    output, tag_file = (str(tmp_path / each) for each in (name, 'tags.json'))
    ended = register(places, '-o', output, '--tag-file', tag_file)
    option = '--tag-file' if output == tag_file else '--pairs'
    expected = f"--output '{output}' is the file of {option} itself: name another file"
    assert (ended.code, refusal(ended)) == (2, expected)
    assert json.loads((tmp_path / 'pairs.json').read_text(encoding='utf-8')) == places
    assert (tmp_path / 'tags.json').read_text(encoding='utf-8') == '{}'


def test_an_expected_error_above_the_tolerance_is_refused(register, places, tmp_path):
    near = min(itertools.combinations(places, 2), key=lambda ids: math.dist(*(places[each] for each in ids)))
    near = {tag_id: places[tag_id] for tag_id in near}
    ended = register(near)
    assert (ended.code, ended.out) == (1, '')
    assert refusal(ended).startswith('the expected error is ')
    assert not (tmp_path / 'layout.yaml').exists()
    ended = register(near, '--click-error', '0.001')
    assert ended.code == 0
    assert 'The expected error is 0.0' in ended.out


def test_the_tags_that_are_best_to_click_are_printed_with_their_command(run_here, shipped_tags):
    ended = run_here(register_layout.main, '--suggest', '4')
    assert (ended.code, ended.err) == (0, '')
    *rows, command = ended.out.splitlines()
    tag_ids = command.removeprefix('To click them: ros2 run lupin_greenhouse_bridge register_layout --click ')
    at = {tag_id: (shipped_tags[tag_id]['x'], shipped_tags[tag_id]['y']) for tag_id in tag_ids.split()}
    assert [line.split() for line in rows[1:]] == [
        [tag_id, f'{x:.2f}', f'{y:.2f}'] for tag_id, (x, y) in at.items()
    ]
    assert len(at) == 4
    for axis, name in enumerate('xy'):  # two tags towards each wall
        values = sorted(tag[axis] for tag in at.values())
        everywhere = [tag[name] for tag in shipped_tags.values()]
        assert values[2] - values[1] > 0.5 * (max(everywhere) - min(everywhere))


def test_a_layout_that_does_not_fit_is_not_written(register, places, tmp_path):
    ended = register({'1': places['1'], '2': [100.0, 0.0]}, '--tolerance', '0.2')
    assert (ended.code, ended.out) == (1, '')
    assert 'the layout does not fit the map' in refusal(ended)
    assert 'the tolerance is 0.2 m' in refusal(ended)
    assert not (tmp_path / 'layout.yaml').exists()


def test_a_tag_that_the_layout_lacks_is_refused(register, places, tmp_path):
    ended = register({**places, '99': [0.0, 0.0]})
    assert ended.code == 2
    assert refusal(ended).startswith(f"tag '99' is not one of the {len(places)} tags of the layout")
    tag_file = tmp_path / 'tags.json'
    tags = {tag_id: {'x': x, 'y': 2.0, 'sensors': ['co2']} for tag_id, x in (('99', 0.0), ('100', 3.0))}
    tag_file.write_text(json.dumps(tags), encoding='utf-8')
    assert register({'99': [0.0, 0.0], '100': [3.0, 0.0]}, '--tag-file', str(tag_file)).code == 0


@pytest.mark.parametrize(
    ('arguments', 'fault'),
    [
        ([], 'one of the arguments --pairs --click --suggest is required'),
        (['--pairs', 'none.json'], "pairs 'none.json': cannot be read"),
        (['--pairs', 'none.json', '-o', 'none/a.yaml'], "there is no folder 'none'"),
        (
            ['--pairs', 'none.json', '-o', 'a.yaml', '--tolerance', 'nan'],
            '--tolerance is nan: must be a number of metres',
        ),
        (['--pairs', 'none.json', '--click-error', '0'], '--click-error is 0: must be a number of metres'),
        (['--suggest', '1'], '--suggest is 1: must be from 2 to'),
        (['--suggest', '999'], '--suggest is 999: must be from 2 to'),
        (['--click', '1', '2', '-o', '/'], "--output '/' is a folder: name a file in it"),
        (['--click', '1', '2', '-o', 'a' * 300], 'File name too long: name another file'),
        (['--click', '1', '1', '-o', 'a.yaml'], '--click needs at least 2 tags'),
        (['--click', '1', '99', '-o', 'a.yaml'], "tag '99' is not one of the"),
    ],
)
def test_wrong_usage_is_refused_in_one_line(run_here, tmp_path, monkeypatch, arguments, fault):
    monkeypatch.chdir(tmp_path)
    ended = run_here(register_layout.main, *arguments)
    assert (ended.code, ended.out) == (2, '')
    assert fault in ended.err
    assert list(tmp_path.iterdir()) == []


@contextlib.contextmanager
def person(act):
    """Act in a thread, on a node, while the test runs a main() in its own."""
    from lupin_greenhouse_bridge.testing._helpers import spinning_node

    with spinning_node('person') as node:
        thread = threading.Thread(target=act, args=[node])
        thread.start()
        yield
        thread.join()


def clicks(*points):
    """Return a function that clicks at these (frame, x, y)."""
    from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS, wait_until

    def act(node):
        publisher = node.create_publisher(PointStamped, '/clicked_point', QoSProfile(depth=10))
        wait_until(lambda: publisher.get_subscription_count() == 1)
        for frame_id, x, y in points:
            message = PointStamped()
            message.header.frame_id = frame_id
            message.point.x, message.point.y = x, y
            publisher.publish(message)
        publisher.wait_for_all_acked(Duration(seconds=PATIENCE_SECONDS))

    return act


def test_each_tag_is_clicked_in_turn(run_here, places, tmp_path):
    output = tmp_path / 'layout.yaml'
    points = [('robot1/map', *places[tag_id]) for tag_id in ('1', '20', '7')]
    points.insert(1, ('odom', 0.0, 0.0))
    points.insert(1, ('robot1/map', math.nan, 0.0))
    with person(clicks(('', 0.0, 0.0), *points)):
        ended = run_here(register_layout.main, '--click', '1', '20', '7', '-o', str(output))
    assert ended.code == 0, ended
    asked = [line.split()[2] for line in ended.out.splitlines() if line.startswith('click tag')]
    assert asked == ['1', '20', '7']
    ignored = [line for line in ended.err.splitlines() if 'ignored a click' in line]
    assert [line.split('a click ')[1].split(':')[0] for line in ignored] == [
        'without a frame or a position',
        'without a frame or a position',
        "in the frame 'odom'",
    ]
    assert "the first was in 'robot1/map'" in ignored[-1]
    assert 'x in robot1/map (m)' in ended.out
    assert 'the positions are in the frame' not in ended.err
    frame_id, transform = read_registration(output)
    assert (frame_id, transform) == ('robot1/map', pytest.approx(TRANSFORM))


def test_clicks_in_a_frame_that_is_no_map_are_said_to_be(run_here, places, tmp_path):
    points = [('odom', *places[tag_id]) for tag_id in ('1', '20', '7')]
    with person(clicks(*points)):
        ended = run_here(register_layout.main, '--click', '1', '20', '7', '-o', str(tmp_path / 'layout.yaml'))
    assert (ended.code, 'x in odom (m)' in ended.out) == (0, True)
    assert "the positions are in the frame 'odom': set RViz's Fixed Frame to map" in ended.err


def test_ctrl_c_keeps_nothing_and_says_so(run_here, tmp_path):
    ended = run_here(
        register_layout.main,
        *('--click', '1', '2', '-o', str(tmp_path / 'layout.yaml')),
        signals_at={SPINS: (signal.SIGINT,)},
    )
    assert ended.code == 130
    assert refusal(ended) == 'interrupted: nothing is kept, and nothing is written'
    assert not (tmp_path / 'layout.yaml').exists()
