# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""No request, and no fault of the simulator, kills, blocks or floods the bridge."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.interfaces import GetTagReading, TagReading
from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS, call, greet

OK = GetTagReading.Response.STATUS_OK
UNKNOWN_TAG = GetTagReading.Response.STATUS_UNKNOWN_TAG
SIMULATOR_ERROR = GetTagReading.Response.STATUS_SIMULATOR_ERROR


@settings(max_examples=300, suppress_health_check=HealthCheck)  # one bridge answers every example
@given(tag_id=st.text(max_size=80).map(lambda text: text.replace('\0', '')))
@example(tag_id='')
@example(tag_id=' ')
@example(tag_id='1 ')
@example(tag_id='01')
@example(tag_id='１')  # noqa: RUF001
@example(tag_id='\u202e1\u202c')
@example(tag_id='🍅')
@example(tag_id="'; DROP TABLE tags; --")
@example(tag_id='%s%n{0}${HOME}')
@example(tag_id='../../etc/passwd')
@example(tag_id='1\n[FATAL] [greenhouse_bridge]: forged')
@example(tag_id='\x1b[2J\x1b]0;owned\x07')
def test_any_other_id_is_an_unknown_tag_and_the_next_request_is_answered(noon_bridge, shipped_tags, tag_id):
    response = noon_bridge.call(tag_id)
    if tag_id in shipped_tags:
        assert response.status == OK
        return
    assert (response.status, response.reading) == (UNKNOWN_TAG, TagReading())
    assert response.error_message.isprintable()
    assert f'({len(shipped_tags)} tags known).' in response.error_message
    assert noon_bridge.values('1')


def test_a_megabyte_of_id_is_an_unknown_tag_in_a_short_message(noon_bridge):
    response = noon_bridge.call('x' * 2**20)
    assert response.status == UNKNOWN_TAG
    assert response.error_message.startswith(f"Tag '{'x' * 64}...' is not in the loaded greenhouse")
    assert noon_bridge.values('1')


def test_a_nul_ends_an_id_in_the_client_and_never_reaches_a_longer_tag(noon_bridge):
    """ROS strings end at a NUL: rclpy sends the part before it."""
    assert noon_bridge.call('99\0').status == UNKNOWN_TAG
    assert noon_bridge.call('\x001').status == UNKNOWN_TAG
    assert noon_bridge.call('1\x002').reading.tag_id in ('1', '')


@pytest.mark.parametrize('checks_fields', ['0', '1'])
def test_a_simulator_that_fails_is_reported_with_its_cause_and_survived(start_bridge, altered, checks_fields):
    environment = {'ROS_PYTHON_CHECK_FIELDS': checks_fields}
    bridge = start_bridge(altered('faulty_simulator'), environment=environment)
    response = bridge.call('fault')
    assert (response.status, response.reading) == (SIMULATOR_ERROR, TagReading())
    assert 'RuntimeError: the sensor is on fire two' in response.error_message
    assert response.error_message.isprintable()
    assert bridge.values('good') == {'co2': 21.5}
    assert bridge.values('numpy') == {'co2': 3.0}


def test_the_cause_of_a_failure_is_logged_once_and_not_with_every_request(start_bridge, altered):
    bridge = start_bridge(altered('faulty_simulator'))
    bridge.connect(greeting='99')
    for _ in range(200):
        assert bridge.call('fault').status == SIMULATOR_ERROR
        assert bridge.call('99').status == UNKNOWN_TAG
    bridge.stop()
    log = bridge.log
    assert 1 <= len([line for line in log if 'the sensor is on fire' in line]) <= 20
    assert 1 <= len([line for line in log if "Tag '99' is not in" in line]) <= 20


def test_a_reply_that_cannot_be_sent_is_a_warning_and_the_next_request_is_answered(start_bridge, altered):
    bridge = start_bridge(altered('unsendable_reply'))
    lost = bridge.connect().call_async(GetTagReading.Request(tag_id='1'))
    bridge.wait_for_log('continued after: failed to send response')
    assert bridge.values('1')
    assert not lost.done()


def test_a_hostile_id_cannot_forge_a_log_line(start_bridge):
    bridge = start_bridge(debug_time_of_day=12.0)
    bridge.connect(greeting='1\n[FATAL] [0.0] [greenhouse_bridge]: forged\r\x1b[2J')
    bridge.stop()
    log = bridge.log
    (line,) = [line for line in log if 'forged' in line]
    assert line.startswith('[WARN]')
    assert '\\n[FATAL]' in line
    assert line.isprintable()


def test_sixteen_clients_at_once_lose_nothing_and_get_their_own_answers(noon_bridge, shipped_tags):
    noon_bridge.connect()
    tag_ids = list(shipped_tags)
    clients = [
        noon_bridge.node.create_client(GetTagReading, noon_bridge.service_name, qos_profile=SERVICE_QOS)
        for _ in range(16)
    ]
    for client in clients:  # the clients and the bridge have discovered each other
        assert client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
        greet(client, GetTagReading.Request(tag_id='1'))
    with ThreadPoolExecutor(len(clients)) as pool:
        for shift in range(20):
            asked = [tag_ids[(number + shift) % len(tag_ids)] for number in range(len(clients))]
            requests = [GetTagReading.Request(tag_id=tag_id) for tag_id in asked]
            answered = [response.reading.tag_id for response in pool.map(call, clients, requests)]
            assert answered == asked
