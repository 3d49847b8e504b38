"""The readings that a mission publishes, and what the bridge's recorder keeps of them."""

from lupin_greenhouse_bridge.display.input_file import read_file
from lupin_greenhouse_bridge.testing._helpers import executable, wait_until
from lupin_msgs.msg import TagReading
from mission_helpers import READER, REAL, TWIN_QOS, Subscriber
from rclpy.qos import QoSProfile

READINGS = 'mission/readings'


def test_the_reading_of_each_tag_that_was_read_is_published_and_latched(start_mission, reader, node, twin):
    mission = start_mission(**READER, tag_sequence='9 7 1')
    reader.answer_ok('9', co2=9.0)
    reader.answer(status=1, error_message='unknown')
    assert [reader.wait_for_request() for _ in range(3)] == ['9', '7', '1']
    late, observer = Subscriber(node, TagReading, f'{mission.namespace}/{READINGS}', TWIN_QOS), twin()
    wait_until(lambda: len(late.received) == 1 and len(observer.received) == 2)
    reader.answer_ok('1', co2=1.0)
    assert mission.end() == 1
    wait_until(lambda: len(late.received) == 2 and len(observer.received) == 3)
    assert late.received == [each.tag_reading for each in observer.received if each.status == each.STATUS_OK]
    assert [each.tag_id for each in late.received] == ['9', '1']


def test_a_mission_can_wait_for_a_subscriber_of_its_readings(start_mission, reader, node, states_of):
    mission = start_mission(**READER, tag_sequence='1', wait_for_subscriber=True)
    state = states_of(mission)
    # A mission that does not wait starts before it can publish this.
    state.wait_for(lambda each: each.last_event == '1 tag known (simulated drive)')
    recorder = Subscriber(node, TagReading, f'{mission.namespace}/{READINGS}', QoSProfile(depth=10))
    assert reader.wait_for_request() == '1'
    reader.answer_ok('1', co2=1.0)
    assert mission.end() == 0
    wait_until(lambda: [each.tag_id for each in recorder.received] == ['1'])


def test_a_mission_without_a_subscriber_starts_after_its_patience(start_mission, reader):
    mission = start_mission(**READER, tag_sequence='1', wait_for_subscriber=True, dependency_timeout_s=0.0)
    assert reader.wait_for_request() == '1'
    reader.answer_ok('1', co2=1.0)
    assert mission.end() == 0
    assert any('mission/readings has no subscriber' in line for line in mission.log)


def test_a_recorded_mission_leaves_every_value_of_its_report(
    start_waiting_mission, start_bridge, start_node, tmp_path
):
    """The recorder starts when the mission is done, and receives what the mission latched."""
    service = start_bridge(debug_time_of_day=12.0).service_name
    mission, operator = start_waiting_mission(bridge_service_name=service, **REAL)
    operator.wait_for(lifecycle_state='READY')
    mission_id = operator.start()
    operator.wait_for(lifecycle_state='DONE', mission_id=mission_id)
    report = read_file(tmp_path / f'report-{mission_id}.jsonl')
    recorder = start_node(
        [executable('lupin_greenhouse_bridge', 'record_readings')],
        readings_topics=f'{mission.namespace}/{READINGS}',
        file=tmp_path / 'readings.sqlite',
    )
    recorder.wait_for_log(f'{len(report.rows)} rows kept')
    assert recorder.stop() == 0
    kept = read_file(tmp_path / 'readings.sqlite').rows
    assert {row.source for row in kept} == {f'{mission.namespace}/{READINGS}'}
    assert [row._replace(source='mission report') for row in kept] == report.rows
    assert {visit.outcome for visit in report.visits} == {'OK'}
    assert {row.tag_id for row in kept} == {visit.tag_id for visit in report.visits}
    assert all(row.x_m is not None for row in kept)
