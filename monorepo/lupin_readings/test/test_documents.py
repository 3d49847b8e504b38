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
from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.interfaces import SensorReading, TagReading
from lupin_greenhouse_bridge.testing.documents import Page
from lupin_greenhouse_bridge.testing.helpers import wait_until
from lupin_readings.colours import read_colour_ranges
from lupin_readings.markers import scaled
from lupin_readings.read_on_sight import ReadOnSightNode
from lupin_readings.reading_file import read_file, read_route
from lupin_readings.record_readings import RecordReadingsNode
from lupin_readings.report_line import Outcome
from lupin_readings.rows import Row
from lupin_readings.show_readings import ShowReadingsNode
from lupin_readings.store import Store

DOC = Path(__file__).resolve().parent.parent / 'doc'
FORMATS, READINGS = Page(DOC / 'formats.md'), Page(DOC / 'readings.md')
NO_DETECTIONS = 'apriltag_msgs is missing'


def test_the_route_of_a_robot_is_read(tmp_path):
    route = FORMATS.write_example('report-route.csv', tmp_path)
    assert read_route(route) == [(0.5, 0.5), (0.9, 0.5), (1.4, 0.9)]


def test_the_table_of_readings_has_these_columns(tmp_path):
    path = tmp_path / 'readings.sqlite'
    Store(str(path))
    with contextlib.closing(sqlite3.connect(path)) as connection:
        columns = [(each[1], each[2]) for each in connection.execute('PRAGMA table_info(readings)')]
    assert [(name, kind) for name, kind, _ in FORMATS.table('readings.sqlite', 3)] == columns
    assert [name for name, _ in columns] == list(Row._fields)


def test_the_report_has_these_keys_and_outcomes(tmp_path):
    visits = read_file(FORMATS.write_example('report.jsonl', tmp_path)).visits
    assert [each.outcome for each in visits] == ['OK', 'UNKNOWN_TAG']
    assert [(each.seen, each.drive) for each in visits] == [(None, 'simulated')] * 2
    described = dict(FORMATS.table('report.jsonl', 2))
    assert re.findall('[A-Z_]{2,}', described['outcome']) == [each.value for each in Outcome]
    keys = re.findall(r'"(\w+)": ', replace(visits[1], goal=(1.0, 2.0)).to_line())
    assert [key for names in described for key in re.findall(r'\w+', names)] == keys


def test_a_cell_of_the_field_has_this_value():
    rows = FORMATS.table('~/field', 2)
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
        for node_names, topics, direction, reliability, durabilities, depth in FORMATS.table(
            'QoS of the topics', 6
        )
        for durability in durabilities.split(' and ')
        for node in re.findall(r'\w+', node_names)
        for topic in re.findall(r'[/\w]+', topics)
    ]
    assert sorted(described) == sorted(own)


def test_the_program_that_reacts_to_readings_runs_as_pasted_until_ctrl_c(start_node, robot):
    messages = TagReading.__module__.partition('.')[0]  # of the workspace
    example = READINGS.python_blocks()[0].replace('lupin_msgs', messages)
    react = start_node([sys.executable, '-c', example])
    readings = robot.create_publisher(TagReading, '/read_on_sight/readings', latched())
    values = [SensorReading(name='co2', value=501.0)]
    timer = robot.create_timer(0.1, lambda: readings.publish(TagReading(tag_id='1', readings=values)))
    react.wait_for_log('tag 1: ventilate')
    timer.cancel()
    # rclpy cannot be interrupted while it takes a message: this is the last one.
    readings.publish(TagReading(tag_id='2', readings=values))
    react.wait_for_log('tag 2: ventilate')
    assert react.stop(signal.SIGINT) == 0


def test_the_detector_of_the_readings_page_runs_as_pasted_until_ctrl_c(start_node, robot):
    messages = pytest.importorskip('apriltag_msgs.msg', reason=NO_DETECTIONS)
    detector, seen = start_node([sys.executable, '-c', READINGS.python_blocks()[1]]), []
    robot.create_subscription(messages.AprilTagDetectionArray, '/detections', seen.append, 5)
    wait_until(lambda: seen)
    assert detector.stop(signal.SIGINT) == 0
