# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The Python examples of the documents run as they stand."""

import json
import re
from pathlib import Path

import pytest
import rclpy
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS, call
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

DOCUMENTS = Path(__file__).resolve().parent.parent / 'doc'
SERVICE = '/greenhouse_bridge/get_tag_reading'


def example_of(page: str) -> dict:
    """Return the names that the Python blocks of a page define."""
    blocks = re.findall(r'^```python\n(.*?)^```', (DOCUMENTS / page).read_text(encoding='utf-8'), re.M | re.S)
    names = {}
    exec(compile(''.join(blocks), page, 'exec'), names)  # noqa: S102 (our own document)
    return names


@pytest.fixture
def start_check(run_nodes):
    """Return a function that runs the example, and returns the reply of its service."""

    def start(service_name: str, serve=lambda _node: None):
        *_, node = run_nodes(
            example_of('clients.md')['VentilationCheck'], arguments=['-r', f'{SERVICE}:={service_name}']
        )
        serve(node)
        client = node.create_client(Trigger, '/ventilation_check/has_enough_co2')
        assert client.wait_for_service(PATIENCE_SECONDS)
        return call(client, Trigger.Request())

    return start


def test_the_example_replies_with_the_reading_of_the_bridge(start_check, noon_bridge):
    reply = start_check(noon_bridge.service_name)
    assert reply.success
    assert re.fullmatch(r'\d{3} ppm', reply.message)


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


def test_the_example_says_that_no_reply_came(start_check):
    reply = start_check('/nobody/get_tag_reading')
    assert (reply.success, reply.message) == (False, 'the bridge did not reply')


def test_the_test_of_the_page_about_tests_passes(start_bridge, run_nodes):
    client = example_of('clients.md')['ReadingClient']

    class PatientClient(client):
        async def read(self, tag_id):
            return await super().read(tag_id, attempts=1000)

    page = example_of('tests.md')
    page['ReadingClient'] = PatientClient
    page['test_my_node'](start_bridge, run_nodes)


def test_a_parameter_that_is_a_text_of_digits_stays_a_text(run_nodes):
    def asking():
        return rclpy.create_node('asking', automatically_declare_parameters_from_overrides=True)

    node, _ = run_nodes(asking, tag_id='7', yes='true', seed=7)
    assert [node.get_parameter(each).value for each in ('tag_id', 'yes', 'seed')] == ['7', 'true', 7]


def test_json_keeps_the_keys_of_the_simulator(noon_bridge):
    reading = noon_bridge.call('1').reading
    found = json.loads(example_of('migrating.md')['as_json'](reading))
    assert found['timestamp'] == 12 * 3600.0
    assert {name for name in found if name not in ('tag_id', 'timestamp')} == set(noon_bridge.values('1'))
