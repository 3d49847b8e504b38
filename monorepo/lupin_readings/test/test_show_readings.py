"""show_readings: what it publishes of the readings that it hears."""

import json
import math
import signal

import numpy as np
import pytest
import yaml
from ament_index_python.packages import get_package_share_path
from hypothesis import given
from hypothesis import strategies as st
from lupin_greenhouse_bridge.interfaces import TagReading
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, find_layout
from lupin_greenhouse_bridge.testing.commands import SPINS
from lupin_greenhouse_bridge.testing.helpers import wait_until
from lupin_greenhouse_bridge.testing.slow_bridge import reading_of
from lupin_planning.poses import pose_in_plane
from lupin_planning.registration import Transform, write_transform
from lupin_planning.walls import Walls, find_walls
from lupin_readings import show_readings
from lupin_readings.colours import STOPS, colours_of, read_colour_ranges
from lupin_readings.markers import (
    FIELD_NAMESPACE,
    STALE_ALPHA,
    WHITE,
    FieldGrid,
    Scale,
    Scene,
    grid_over,
    interpolate,
)
from lupin_readings.show_readings import ShowReadingsNode
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

SHARE = get_package_share_path('lupin_readings')
TOPIC = '/tested/readings'
CONFIG = 'time: {debug_mode: false}\nsensors: {co2: [{}]}\n'
LATCHED, VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
BENCH = Layout(
    {'7': Tag(1.0, 1.0, ['co2']), '8': Tag(3.0, 1.0, ['co2', 'light'])}, {'bench': (1.0, 1.0, 3.0, 1.5)}
)
WALLS = Walls(0.0, 0.0, 4.0, 8.0)
CO2, TRANSFORM = Scale('co2', (300.0, 800.0)), Transform()


@pytest.fixture(scope='session')
def warm_tag_id(shipped_tags):
    """Return a tag with a temperature, which has no noise."""
    return next(tag_id for tag_id, tag in shipped_tags.items() if 'temperature' in tag['sensors'])


def of_namespace(markers, namespace) -> list[Marker]:
    return [each for each in markers.markers if each.ns == namespace]


def texts(markers, namespace='readings') -> list[str]:
    return [each.text for each in of_namespace(markers, namespace)]


def markers_of(*readings, at_seconds=100, layout=BENCH, layout_in_map=TRANSFORM) -> MarkerArray:
    scene = Scene(layout, WALLS if layout is BENCH else find_walls(layout), layout_in_map, CO2)
    header = Header(frame_id='map', stamp=Time(seconds=at_seconds).to_msg())
    aged = {each.tag_id: (each, float(at_seconds - each.stamp.sec)) for each in readings}
    return scene.markers(header, aged, 60.0, 'a caption', None)


def cell(field, x, y) -> int:
    info, origin = field.info, pose_in_plane(field.info.origin)
    yaw, dx, dy = origin.yaw, x - origin.x, y - origin.y
    column = math.floor((math.cos(yaw) * dx + math.sin(yaw) * dy) / info.resolution)
    row = math.floor((math.cos(yaw) * dy - math.sin(yaw) * dx) / info.resolution)
    return field.data[row * info.width + column]


def test_a_cell_at_a_tag_has_its_value_one_far_away_has_none_and_no_step_is_where_a_reach_ends():
    grid = FieldGrid(0.0, 0.0, 0.1, 40, 20)
    values = interpolate(grid, [(1.0, 1.0, 20.0), (1.32, 1.0, 10.0), (3.0, 1.0, 5.0)], radius_m=0.5)
    assert values[10, [10, 13, 34]] == pytest.approx([20.0, 10.0, 5.0], abs=1e-3)
    assert 10.0 < values[10, 11] < 20.0
    assert np.isnan(values[10, [20, 23, 36]]).all()
    grid = FieldGrid(0.0, 0.0, 0.01, 300, 1)
    values = interpolate(grid, [(0.0, 0.005, 0.0), (2.0, 0.005, 100.0)], radius_m=1.5)[0]
    assert np.nanmax(np.abs(np.diff(values))) < 3.0


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-1e6, 1e6)), max_size=5))
def test_every_cell_lies_between_the_readings_or_has_no_value(samples):
    layout = Layout({str(n): Tag(x, y, ['co2']) for n, (x, y, _) in enumerate(samples)}, {})
    grid = grid_over(layout, Walls(0.0, 0.0, 1.0, 1.0), 0.2)
    values = interpolate(grid, samples, 0.5)
    assert values.shape == (grid.rows, grid.columns)
    known, heard = values[~np.isnan(values)], [value for *_, value in samples]
    assert known.size == 0 or min(heard) - 1e-3 <= known.min() <= known.max() <= max(heard) + 1e-3
    for x, y, _ in samples:
        assert 0 <= (x - grid.x) / 0.2 <= grid.columns
        assert 0 <= (y - grid.y) / 0.2 <= grid.rows


@pytest.mark.parametrize(('age_seconds', 'text'), [(59, '59 s ago'), (61, '1 min ago'), (7300, '2 h ago')])
def test_a_label_has_the_values_with_their_units_in_ascii_and_the_age(age_seconds, text):
    values = {'größe': 1.0, 'light': 899.0, 'co2': 612.345, 'soil_moisture': 0.25, 'temperature': 21.5}
    (label,) = texts(markers_of(reading_of('8', **values), at_seconds=100 + age_seconds))
    assert label.splitlines() == [
        'temperature 21.5 deg C',
        'co2 612 ppm',
        'light 899 lx',
        'soil moisture 0.250 m3/m3',
        'gr\\xf6\\xdfe 1.00',
        text,
    ]


def test_a_stale_reading_is_faded_and_an_unread_tag_is_not():
    for seconds, alpha in ((160, 1.0), (161, STALE_ALPHA)):
        markers = markers_of(reading_of('7', co2=500.0), at_seconds=seconds)
        shown = [each.color.a for name in ('tags', 'readings') for each in of_namespace(markers, name)]
        assert shown == pytest.approx([alpha, 1.0, alpha])


def test_a_tag_has_the_colour_of_its_value_and_is_white_without_this_sensor_and_another_unread():
    readings = reading_of('7', co2=550.0), reading_of('8', light=900.0)
    (value, white), (_, unread) = (
        [(each.color.r, each.color.g, each.color.b) for each in of_namespace(markers_of(*shown), 'tags')]
        for shown in (readings, readings[:1])
    )
    middle = [int(STOPS[5][at : at + 2], 16) / 255 for at in (1, 3, 5)]
    assert (value, white) == (pytest.approx(middle), WHITE)
    assert unread not in (value, white)
    beyond = colours_of([-1e9, 1e9, math.nan], 300.0, 800.0)
    assert beyond[:2] == pytest.approx(colours_of([300.0, 800.0], 300.0, 800.0))


def test_tables_plates_and_ids_lie_where_the_layout_lies_in_the_map():
    """Turned by a quarter to the left: the tags on the southern edge of the bench face east."""
    turn = math.pi / 2
    markers = markers_of(layout_in_map=Transform(10.0, 20.0, turn))
    (table,) = of_namespace(markers, 'tables')
    assert (table.pose.position.x, table.pose.position.y) == pytest.approx((8.75, 22.0))
    assert (table.scale.x, table.scale.y) == pytest.approx((2.0, 0.5))
    assert pose_in_plane(table.pose).yaw == pytest.approx(turn)
    for namespace in ('tags', 'ids'):
        places = [(each.pose.position.x, each.pose.position.y) for each in of_namespace(markers, namespace)]
        assert places == [pytest.approx((9.0, 21.0)), pytest.approx((9.0, 23.0))]
    assert texts(markers, 'ids') == ['7', '8']
    for plate in of_namespace(markers, 'tags'):
        assert pose_in_plane(plate.pose).yaw == pytest.approx(0.0)
    assert {each.header.frame_id for each in markers.markers} == {'map'}


def test_no_label_covers_another_one(shipped_tags):
    """With a reading of every sensor at every tag. The width of a text is that of RViz's font."""
    textpath = pytest.importorskip('matplotlib.textpath')
    layout, boxes = find_layout(''), []
    values = {sensor: 0.98765 * highest for sensor, (_, highest) in read_colour_ranges().items()}
    readings = [
        reading_of(tag_id, **{each: values[each] for each in tag.sensors})
        for tag_id, tag in layout.tags.items()
    ]
    for marker in markers_of(*readings, layout=layout, at_seconds=260).markers:
        if marker.type == Marker.TEXT_VIEW_FACING:
            size, at, lines = marker.scale.z, marker.pose.position, marker.text.split('\n')
            widths = [textpath.TextPath((0, 0), line, size=0.87 * size).get_extents().x1 for line in lines]
            boxes.append((at.x, at.y, max(widths), len(lines) * size))
    assert len(boxes) == 2 * len(shipped_tags) + 1
    x, y, width, height = np.array(boxes).T[:, :, np.newaxis]
    shared_x_m, shared_y_m = (width + width.T) / 2 - abs(x - x.T), (height + height.T) / 2 - abs(y - y.T)
    covered = np.clip(shared_x_m, 0, None) * np.clip(shared_y_m, 0, None) > 1e-4
    assert np.argwhere(np.triu(covered, k=1)).tolist() == []


class Publisher:
    def __init__(self, node, *readings, durability=LATCHED, topic=TOPIC):
        self.readings = readings
        publisher = node.create_publisher(TagReading, topic, QoSProfile(depth=50, durability=durability))
        node.create_timer(0.02, lambda: [publisher.publish(each) for each in self.readings])


class Viewer:
    """What a node with displays of both topics has received last."""

    def __init__(self, node, durability=LATCHED):
        self.markers, self.fields = [], []
        qos = QoSProfile(depth=10, durability=durability)
        node.create_subscription(MarkerArray, '/show_readings/markers', self.markers.append, qos)
        node.create_subscription(OccupancyGrid, '/show_readings/field', self.fields.append, qos)

    @property
    def texts(self) -> list[str]:
        """The labels of the last markers, without their ages."""
        return [text.rpartition('\n')[0] for text in texts(self.markers[-1])] if self.markers else []

    def wait_for(self, *wanted) -> None:
        wait_until(lambda: self.fields and set(wanted) <= set(self.texts))  # two topics


@pytest.fixture
def viewer(robot):
    return Viewer(robot)


@pytest.fixture
def start_here(monkeypatch, run_nodes):
    def start(publish_every_seconds=0.1, **parameters):
        monkeypatch.setattr(show_readings, 'PUBLISH_EVERY_SECONDS', publish_every_seconds)
        return run_nodes(ShowReadingsNode, **{'readings_topics': TOPIC, **parameters})[0]

    return start


@pytest.mark.parametrize('durability', [LATCHED, VOLATILE])
def test_a_reading_is_shown_as_a_marker_and_in_the_field(
    start_here, robot, shipped_tags, warm_tag_id, durability
):
    """A web client has no QoS, so it is volatile."""
    start_here(radius_m=0.5)
    publisher = Publisher(robot, reading_of(warm_tag_id, temperature=7.5), durability=durability)
    viewer = Viewer(robot, durability)
    viewer.wait_for('temperature 7.5 deg C')
    tag = shipped_tags[warm_tag_id]
    wait_until(lambda: cell(viewer.fields[-1], tag['x'], tag['y']) == 25)  # of 0 to 30 degrees
    assert cell(viewer.fields[-1], tag['x'], tag['y'] + 0.7) == -1
    assert texts(viewer.markers[-1], FIELD_NAMESPACE) == [
        'temperature (deg C): colours from 7.2 to 7.8\n'
        f'7.5 deg C at tag {warm_tag_id}\n'
        'field: interpolated from 1 received reading,\nnot from the model of the simulator'
    ]
    (cells,) = of_namespace(viewer.markers[-1], 'field')
    from_tag_m = [math.dist((each.x, each.y), (tag['x'], tag['y'])) for each in cells.points]
    colour = cells.colors[from_tag_m.index(min(from_tag_m))]
    assert (colour.r, colour.g, colour.b) == pytest.approx(colours_of(7.5, 7.2, 7.8))
    for second, value in enumerate((20.0, 13.0)):  # the colours are those of all values so far
        publisher.readings = [reading_of(warm_tag_id, 200 + second, temperature=value)]
        viewer.wait_for(f'temperature {value} deg C')
        (caption,) = texts(viewer.markers[-1], FIELD_NAMESPACE)
        assert caption.startswith('temperature (deg C): colours from 5 to 20\n')


def test_a_late_viewer_sees_the_latched_messages(start_here, viewer, shipped_tags):
    start_here(publish_every_seconds=3600.0)
    wait_until(lambda: viewer.markers and viewer.fields)
    assert len(of_namespace(viewer.markers[-1], 'ids')) == len(shipped_tags)
    assert set(viewer.fields[-1].data) == {-1}


def test_the_reading_that_arrived_last_is_shown_with_its_age_since_then(start_here, robot, viewer):
    start_here(readings_topics=f'{TOPIC} /tested/other')
    publisher = Publisher(robot, reading_of('1', 7200, co2=600.0))
    viewer.wait_for('co2 600 ppm')
    assert texts(viewer.markers[-1])[0].endswith(' s ago')
    publisher.readings = []
    Publisher(robot, reading_of('1', 10, co2=500.0), topic='/tested/other')
    viewer.wait_for('co2 500 ppm')


def test_a_field_of_too_many_cells_is_not_drawn_as_markers_and_the_caption_claims_none(
    start_here, robot, viewer, warm_tag_id, monkeypatch, capfd
):
    monkeypatch.setattr(show_readings, 'MOST_CELLS_MARKED', 10)
    start_here()
    Publisher(robot, reading_of(warm_tag_id, temperature=7.5))
    viewer.wait_for('temperature 7.5 deg C')
    (caption,) = texts(viewer.markers[-1], FIELD_NAMESPACE)
    assert 'field' not in caption
    assert of_namespace(viewer.markers[-1], 'field') == []
    wait_until(lambda: 25 in viewer.fields[-1].data)
    assert capfd.readouterr().err.count('more than the 10 that markers can show') == 1


def test_readings_reach_only_the_cells_around_them():
    """The same as of each reading alone, because their reaches do not touch."""
    grid = FieldGrid(0.0, 0.0, 0.1, 100, 100)
    samples = [(x + 0.5, y + 0.5, float(x * y)) for x in range(10) for y in range(10)]
    values = interpolate(grid, samples, radius_m=0.3)
    for x, y, value in samples:
        alone = interpolate(grid, [(x, y, value)], radius_m=0.3)
        assert values[~np.isnan(alone)] == pytest.approx(value)
        assert alone[int(y * 10), int(x * 10)] == pytest.approx(value)
    assert np.isnan(values[::10, ::10]).all()


def test_an_unknown_tag_and_an_infinite_value_change_no_other(start_here, robot, viewer, shipped_tags, capfd):
    start_here(radius_m=0.01)
    first, second = [tag_id for tag_id, tag in shipped_tags.items() if 'temperature' in tag['sensors']][:2]
    unknown = [reading_of('x\n1', seconds, co2=500.0) for seconds in (100, 200)]
    values = {first: math.inf, second: 7.5}
    Publisher(robot, *unknown, *(reading_of(tag_id, temperature=each) for tag_id, each in values.items()))
    viewer.wait_for('temperature inf deg C', 'temperature 7.5 deg C')
    wait_until(lambda: set(viewer.fields[-1].data) == {-1, 25})
    assert len(viewer.texts) == 2
    warning = "tag 'x\\n1' is not in the layout: its readings are not shown"
    assert capfd.readouterr().err.count(warning) == 1


def test_a_custom_layout_and_config_are_shown_in_the_map(start_here, robot, viewer, write_layout, tmp_path):
    config = 'time: {debug_mode: false}\nsensors: {co2: [{}]}\n'
    config += 'visualization: {colorbar_ranges: {ozone: {min: 0, max: 10}}}'
    (tmp_path / 'greenhouse.yaml').write_text(config)
    transform = Transform(10.0, -5.0, 2.0)
    write_transform(tmp_path / 'layout_in_map.yaml', transform, 'site')
    start_here(
        tag_file=write_layout({'A7': (1.0, 2.0)}),
        sim_config_file=tmp_path / 'greenhouse.yaml',
        sensor='ozone',
        map_frame='site',
        layout_in_map=tmp_path / 'layout_in_map.yaml',
        radius_m=0.5,
    )
    Publisher(robot, reading_of('A7', ozone=3.0))
    viewer.wait_for('ozone 3.00')  # a sensor that is not the simulator's has no unit
    wait_until(lambda: cell(viewer.fields[-1], *transform.point(1.0, 2.0)) == 30)
    assert cell(viewer.fields[-1], *transform.point(1.0, 2.7)) == -1
    (caption,) = texts(viewer.markers[-1], FIELD_NAMESPACE)
    assert caption.startswith('ozone: colours from 2.9 to 3.1\n3.00 at tag A7\n')
    assert viewer.fields[-1].header.frame_id == 'site'
    assert {each.header.frame_id for each in viewer.markers[-1].markers} == {'site'}


RVIZ = yaml.safe_load((SHARE / 'rviz/greenhouse.rviz').read_text(encoding='utf-8'))['Visualization Manager']
FOXGLOVE = json.loads((SHARE / 'foxglove/greenhouse.json').read_text(encoding='utf-8'))
PANEL = FOXGLOVE['configById'][FOXGLOVE['layout']]


def test_the_displays_of_rviz_and_foxglove_are_of_topics_that_are_published(start_here, viewer):
    node, frame = start_here(), RVIZ['Global Options']['Fixed Frame']
    wait_until(lambda: viewer.markers)
    assert viewer.markers[-1].markers[0].header.frame_id == PANEL['followTf'] == frame
    displays = {each['Topic']['Value']: each for each in RVIZ['Displays'] if 'Topic' in each}
    published = dict(node.get_publisher_names_and_types_by_node('show_readings', '/'))
    shown = {'/show_readings/markers': 'MarkerArray'}
    assert displays.keys() == {*shown, '/show_readings/field'}
    for topic, display in displays.items():
        kind = shown.get(topic, 'Map')
        assert display['Class'] == f'rviz_default_plugins/{kind}'
        assert published[topic][0].endswith(kind.replace('Map', 'nav_msgs/msg/OccupancyGrid'))
        assert display['Enabled'] == (topic in shown)
        assert display['Topic']['Durability Policy'] == 'Transient Local'
    assert {topic for topic, settings in PANEL['topics'].items() if settings['visible']} == shown.keys()


def test_it_says_what_it_shows_and_ends_with_exit_code_0(run_here):
    ended = run_here(show_readings.main, signals_at={SPINS: (signal.SIGTERM,)})
    assert 'field of temperature, readings from /read_on_sight/readings and /mission/readings' in ended.err
    assert ended.code == 0


def test_without_a_layout_of_a_drawable_size_it_is_refused_in_one_line(run_here, write_layout, monkeypatch):
    tag_file = write_layout({'1': (1e9, 0.0)})
    refusal = run_here(show_readings.main, '--ros-args', '-p', f'tag_file:={tag_file}').refusal
    assert 'parameter resolution_m is 0.1: the field would have 10000000000 x ' in refusal
    monkeypatch.setattr('lupin_greenhouse_bridge.simulator.layout.shipped_file', lambda _name: None)
    refusal = run_here(show_readings.main).refusal
    assert "mdp-greenhouse is not installed here: name the bridge's tag file with tag_file" in refusal


@pytest.mark.parametrize(
    ('name', 'value', 'fragment'),
    [
        ('sensor', 'ozone', "sensor is 'ozone': the greenhouse config has no"),
        ('map_frame', "' '", "is ' ': must be the name of a frame, such as map"),
        ('readings_topics', "''", "is '': must be the name of a topic"),
        ('layout_in_map', '/none.yaml', "'/none.yaml'"),
    ],
)
def test_a_bad_parameter_is_refused(run_here, name, value, fragment):
    assert fragment in run_here(show_readings.main, '--ros-args', '-p', f'{name}:={value}').refusal


def test_the_colour_ranges_are_those_of_the_config(tmp_path):
    config = tmp_path / 'config.yaml'
    for visualization, ranges in (
        ('', {}),
        ('visualization: {}', {}),
        ('visualization: {colorbar_ranges: {co2: {min: 0, max: 30}}}', {'co2': (0.0, 30.0)}),
    ):
        config.write_text(f'{CONFIG}{visualization}', encoding='utf-8')
        assert read_colour_ranges(str(config)) == ranges
