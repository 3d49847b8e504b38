# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The documents: their Python runs, each example of a format loads, and its table describes the code."""

import contextlib
import re
import signal
import sqlite3
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rclpy
import yaml
from conftest import NO_DETECTIONS
from lupin_greenhouse_bridge.contract import SERVICE_QOS, latched
from lupin_greenhouse_bridge.display.colours import read_colour_ranges
from lupin_greenhouse_bridge.display.markers import scaled
from lupin_greenhouse_bridge.display.reading_file import read_file, read_route
from lupin_greenhouse_bridge.display.report_line import Outcome
from lupin_greenhouse_bridge.display.show_readings import ShowReadingsNode
from lupin_greenhouse_bridge.interfaces import GetTagReading, SensorReading, TagReading
from lupin_greenhouse_bridge.planning import approach_poses
from lupin_greenhouse_bridge.planning.registration import read_places, read_registration
from lupin_greenhouse_bridge.reading.read_on_sight import ReadOnSightNode
from lupin_greenhouse_bridge.recording.record_readings import RecordReadingsNode
from lupin_greenhouse_bridge.recording.rows import Row
from lupin_greenhouse_bridge.recording.store import Store
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation
from lupin_greenhouse_bridge.simulator.files import schema_of
from lupin_greenhouse_bridge.simulator.layout import read_layout
from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS, call, wait_until
from lupin_greenhouse_bridge.units import UNITS
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_srvs.srv import Trigger

PAGE = Path(__file__).resolve().parent.parent / 'doc/formats.md'
SECTIONS = dict(
    part.split('\n', 1) for part in re.split('^## ', PAGE.read_text(encoding='utf-8'), flags=re.MULTILINE)
)


def table(name: str, columns: int) -> list[list[str]]:
    """Return the cells of the last table of a section, without its head."""
    rows = [row.split('|')[1:-1] for row in re.findall(r'^\|.*\|$', SECTIONS[name], re.MULTILINE)]
    rows = [[cell.strip(' `') for cell in row] for row in rows if len(row) == columns]
    return rows[2:]


@pytest.fixture
def example(tmp_path):
    """Return a function that writes the example of a section to a file of its name."""

    def written(name: str) -> Path:
        path = tmp_path / name
        path.write_text(re.search('```.*?\n(.*?)```', SECTIONS[name], re.DOTALL)[1], encoding='utf-8')
        return path

    return written


def test_the_tag_file_and_the_config_are_served(example, shipped_tags):
    tag_file, config = example('tag_locations.json'), example('greenhouse_config.yaml')
    layout = read_layout(tag_file)
    assert (list(layout.tags), list(layout.tables)) == (['1', '2', '3'], ['left', 'right', 'back'])
    assert simulation.load(Settings(), tag_file, None).tag_ids == ['1', '2', '3']
    assert simulation.load(Settings(), None, config).tag_ids == list(shipped_tags)
    assert read_colour_ranges(str(config)) == {'temperature': (0.0, 30.0)}


def test_the_schemas_and_the_page_name_every_sensor_and_the_defaults():
    tags = schema_of('tag_locations')['definitions']['tags']['additionalProperties']
    assert tags['properties']['sensors']['items']['examples'] == list(UNITS)
    config = schema_of('greenhouse_config')
    assert config['properties']['sensors']['propertyNames']['enum'] == list(UNITS)
    (on_page,) = [meaning for key, _, meaning in table('greenhouse_config.yaml', 3) if key == 'sensors']
    assert re.findall('`(.*?)`', on_page.partition(' a list')[0]) == list(UNITS)
    component = config['definitions']['component']['properties']
    defaults = {key: value['default'] for key, value in component.items()}
    on_page = {}
    for keys, required, _ in table('greenhouse_config.yaml', 3):
        values = re.findall(r'[\w.]+|\[.*?\]', required.partition('default: ')[2].replace(' and ', ' '))
        on_page.update(zip(re.findall(r'\w+', keys), values, strict=False))
    assert on_page == {key: str(value) for key, value in defaults.items()}


def test_the_table_of_readings_has_these_columns(tmp_path):
    path = tmp_path / 'readings.sqlite'
    Store(str(path))
    with contextlib.closing(sqlite3.connect(path)) as connection:
        columns = [(each[1], each[2]) for each in connection.execute('PRAGMA table_info(readings)')]
    assert [(name, kind) for name, kind, _ in table('readings.sqlite', 3)] == columns
    assert [name for name, _ in columns] == list(Row._fields)


def test_the_report_has_these_keys_and_outcomes(example):
    visits = read_file(example('report.jsonl')).visits
    assert [each.outcome for each in visits] == ['OK', 'UNKNOWN_TAG']
    assert [(each.seen, each.drive) for each in visits] == [(None, 'simulated')] * 2
    described = dict(table('report.jsonl', 2))
    assert re.findall('[A-Z_]{2,}', described['outcome']) == [each.value for each in Outcome]
    keys = re.findall(r'"(\w+)": ', replace(visits[1], goal=(1.0, 2.0)).to_line())
    assert [key for names in described for key in re.findall(r'\w+', names)] == keys


def test_the_route_and_the_files_of_poses_are_read(example):
    assert read_route(example('report-route.csv')) == [(0.5, 0.5), (0.9, 0.5), (1.4, 0.9)]
    frame_id, transform = read_registration(example('layout_in_map.yaml'))
    assert (frame_id, transform) == ('map', (1.510735, 0.593302, 0.000819))
    assert read_places(example('pairs.yaml'))['21'] == (3.11, 8.08)


def test_the_file_of_poses_has_these_keys(example, capsys):
    tag_file = str(example('tag_locations.json'))
    walls = ['--walls', '0', '0', '2.5', '4']  # leave tag 2 outside
    assert approach_poses.main(['approach_poses', '--tag-file', tag_file, *walls, '--format', 'yaml']) == 1
    found, described = capsys.readouterr().out, example('poses.yaml').read_text(encoding='utf-8')
    keys, described_keys = (
        [list(data), list(data['poses'][0]), list(data['unreachable'][0])]
        for data in map(yaml.safe_load, (found, described))
    )
    assert keys == described_keys


def test_a_cell_of_the_field_has_this_value():
    rows = table('~/field', 2)
    values = np.array([np.nan if value == 'none' else float(value) for value, _ in rows])
    assert scaled(values, *read_colour_ranges()['temperature']).tolist() == [int(cell) for _, cell in rows]


def test_every_topic_has_this_qos(run_nodes, tmp_path):
    pytest.importorskip('apriltag_msgs', reason=NO_DETECTIONS)
    file = str(tmp_path / 'readings.sqlite')
    *nodes, _ = run_nodes(ReadOnSightNode, RecordReadingsNode, ShowReadingsNode, file=file)
    found = []
    for node in nodes:
        for direction, ends in (('publishes', node.publishers), ('subscribes', node.subscriptions)):
            for end in ends:
                qos = end.qos_profile
                policies = [each.name.lower().replace('_', ' ') for each in (qos.reliability, qos.durability)]
                found.append([node.get_name(), end.topic_name, direction, *policies, str(qos.depth)])
    own = [row for row in found if row[1] not in ('/parameter_events', '/rosout')]
    described = [
        [node, topic, direction, reliability, durability, depth]
        for node_names, topics, direction, reliability, durabilities, depth in table('QoS of the topics', 6)
        for durability in durabilities.split(' and ')
        for node in re.findall(r'\w+', node_names)
        for topic in re.findall(r'[/\w]+', topics)
    ]
    assert sorted(described) == sorted(own)
    assert f'service of the bridge has a depth of {SERVICE_QOS.depth}.' in SECTIONS['QoS of the topics']


SERVICE = '/greenhouse_bridge/get_tag_reading'


def blocks_of(page: str) -> list[str]:
    return re.findall(r'^```python\n(.*?)^```', (PAGE.parent / page).read_text(encoding='utf-8'), re.M | re.S)


def example_of(page: str) -> dict:
    names = {}
    blocks = [block for block in blocks_of(page) if 'class ' in block or 'def ' in block]  # no script
    exec(compile(''.join(blocks), page, 'exec'), names)  # noqa: S102 (our own document)
    return names


def test_the_program_that_reacts_to_readings_runs_as_pasted_until_ctrl_c(start_node, robot):
    react = start_node([sys.executable, '-c', blocks_of('readings.md')[0]])
    readings = robot.create_publisher(TagReading, '/read_on_sight/readings', latched())
    reading = TagReading(tag_id='1', readings=[SensorReading(name='co2', value=501.0)])
    robot.create_timer(0.1, lambda: readings.publish(reading))
    react.wait_for_log('tag 1: ventilate')
    assert react.stop(signal.SIGINT) == 0


def test_the_detector_of_the_readings_page_runs_as_pasted_until_ctrl_c(start_node, robot):
    messages = pytest.importorskip('apriltag_msgs.msg', reason=NO_DETECTIONS)
    detector, seen = start_node([sys.executable, '-c', blocks_of('readings.md')[1]]), []
    robot.create_subscription(messages.AprilTagDetectionArray, '/detections', seen.append, 5)
    wait_until(lambda: seen)
    assert detector.stop(signal.SIGINT) == 0


def test_the_script_prints_the_reading_or_asks_to_be_called_again(start_node, noon_bridge):
    remapping = ['--ros-args', '-r', f'{SERVICE}:={noon_bridge.service_name}']
    printed = ''
    while "'co2': " not in printed:
        script = start_node([sys.executable, '-c', blocks_of('clients.md')[0], *remapping])
        (printed,) = script.rest_of_log()
        assert "'co2': " in printed or printed == 'no reply: call again'


@pytest.fixture
def start_check(run_nodes):
    """Return a function that runs the example, and returns the reply of its service."""

    def start(service_name: str, serve=lambda _node: None):
        check = example_of('clients.md')['VentilationCheck']
        # With a simulated clock that never comes.
        *_, node = run_nodes(check, arguments=['-r', f'{SERVICE}:={service_name}'], use_sim_time=True)
        serve(node)
        client = node.create_client(Trigger, '/ventilation_check/has_enough_co2')
        assert client.wait_for_service(PATIENCE_SECONDS)
        return call(client, Trigger.Request())

    return start


@pytest.mark.parametrize('is_served', [True, False])
def test_the_example_replies_with_the_reading_or_that_none_came(start_check, noon_bridge, is_served):
    reply = start_check(noon_bridge.service_name if is_served else '/nobody/get_tag_reading')
    assert reply.success == is_served
    assert re.fullmatch(r'\d{3} ppm' if is_served else 'the bridge did not reply', reply.message)


@pytest.mark.parametrize('executor_type', [SingleThreadedExecutor, MultiThreadedExecutor])
def test_a_hundred_reads_one_after_another_come_back_in_any_executor(noon_bridge, executor_type):
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('many', context=context)
    executor = executor_type(context=context)
    executor.add_node(node)
    client = example_of('clients.md')['ReadingClient'](node, noon_bridge.service_name)

    async def read_all():
        return [await client.read('1', attempts=1000) for _ in range(100)]

    task = executor.create_task(read_all)
    executor.spin_until_future_complete(task, PATIENCE_SECONDS)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown(context=context)
    assert [reply.status for reply in task.result()] == [GetTagReading.Response.STATUS_OK] * 100


def test_the_example_asks_again_for_a_lost_reply(start_check):
    asked_for = []

    def serve(node):
        async def reply(request, response):
            asked_for.append(request.tag_id)
            if len(asked_for) == 1:
                await Future()  # nothing completes it: the reply is lost
            response.status, response.error_message = response.STATUS_UNKNOWN_TAG, 'asked twice'
            return response

        both = ReentrantCallbackGroup()  # a second request is served beside the first
        node.create_service(GetTagReading, SERVICE, reply, qos_profile=SERVICE_QOS, callback_group=both)

    reply = start_check(SERVICE, serve)
    assert (reply.success, reply.message) == (False, 'asked twice')
    assert set(asked_for) == {'1'}


def test_the_test_of_the_page_passes(start_bridge, run_nodes):
    page = example_of('clients.md')

    class PatientClient(page['ReadingClient']):
        async def read(self, tag_id):
            return await super().read(tag_id, attempts=1000)

    page['ReadingClient'] = PatientClient
    page['test_my_node'](start_bridge, run_nodes)


def test_a_parameter_that_is_a_text_of_digits_stays_a_text(run_nodes):
    def asking():
        return rclpy.create_node('asking', automatically_declare_parameters_from_overrides=True)

    node, _ = run_nodes(asking, tag_id='7', yes='true', seed=7)
    assert [node.get_parameter(each).value for each in ('tag_id', 'yes', 'seed')] == ['7', 'true', 7]
