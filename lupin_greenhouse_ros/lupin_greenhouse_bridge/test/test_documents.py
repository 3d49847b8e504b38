# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The documents: their Python runs, each example of a format loads, and its table describes the code."""

import re
import sys
from pathlib import Path

import pytest
import rclpy
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation
from lupin_greenhouse_bridge.simulator.files import schema_of
from lupin_greenhouse_bridge.simulator.layout import read_layout
from lupin_greenhouse_bridge.testing.documents import Page
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS, call
from lupin_greenhouse_bridge.units import UNITS
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_srvs.srv import Trigger

DOC = Path(__file__).resolve().parent.parent / 'doc'
FORMATS, CLIENTS = Page(DOC / 'formats.md'), Page(DOC / 'clients.md')
SERVICE = '/greenhouse_bridge/get_tag_reading'


def test_the_tag_file_and_the_config_are_served(tmp_path, shipped_tags):
    tag_file = FORMATS.write_example('tag_locations.json', tmp_path)
    config = FORMATS.write_example('greenhouse_config.yaml', tmp_path)
    layout = read_layout(tag_file)
    assert (list(layout.tags), list(layout.tables)) == (['1', '2', '3'], ['left', 'right', 'back'])
    assert simulation.load(Settings(), tag_file, None).tag_ids == ['1', '2', '3']
    assert simulation.load(Settings(), None, config).tag_ids == list(shipped_tags)


def test_the_schemas_and_the_page_name_every_sensor_and_the_defaults():
    tags = schema_of('tag_locations')['definitions']['tags']['additionalProperties']
    assert tags['properties']['sensors']['items']['examples'] == list(UNITS)
    config = schema_of('greenhouse_config')
    assert config['properties']['sensors']['propertyNames']['enum'] == list(UNITS)
    (on_page,) = [
        meaning for key, _, meaning in FORMATS.table('greenhouse_config.yaml', 3) if key == 'sensors'
    ]
    assert re.findall('`(.*?)`', on_page.partition(' a list')[0]) == list(UNITS)
    component = config['definitions']['component']['properties']
    defaults = {key: value['default'] for key, value in component.items()}
    on_page = {}
    for keys, required, _ in FORMATS.table('greenhouse_config.yaml', 3):
        values = re.findall(r'[\w.]+|\[.*?\]', required.partition('default: ')[2].replace(' and ', ' '))
        on_page.update(zip(re.findall(r'\w+', keys), values, strict=False))
    assert on_page == {key: str(value) for key, value in defaults.items()}


def names_of_the_examples() -> dict:
    """Return the classes and functions of clients.md by name, without its scripts."""
    names = {}
    blocks = [block for block in CLIENTS.python_blocks() if 'class ' in block or 'def ' in block]
    exec(compile(''.join(blocks), 'clients.md', 'exec'), names)  # noqa: S102 (our own document)
    return names


def test_the_script_prints_the_reading_or_asks_to_be_called_again(start_node, noon_bridge):
    remapping = ['--ros-args', '-r', f'{SERVICE}:={noon_bridge.service_name}']
    printed = ''
    while "'co2': " not in printed:
        script = start_node([sys.executable, '-c', CLIENTS.python_blocks()[0], *remapping])
        (printed,) = script.rest_of_log()
        assert "'co2': " in printed or printed == 'no reply: call again'


@pytest.fixture
def start_check(run_nodes):
    """Return a function that runs the example, and returns the reply of its service."""

    def start(service_name: str, serve=lambda _node: None):
        check = names_of_the_examples()['VentilationCheck']
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
    client = names_of_the_examples()['ReadingClient'](node, noon_bridge.service_name)

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
    page = names_of_the_examples()

    class PatientClient(page['ReadingClient']):
        async def read(self, tag_id):
            return await super().read(tag_id, attempts=1000)

    page['ReadingClient'] = PatientClient
    page['test_my_node'](start_bridge, run_nodes)


def test_a_parameter_that_is_a_text_of_digits_stays_a_text(run_nodes):
    def asking():
        return rclpy.create_node('asking', automatically_declare_parameters_from_overrides=True)

    node, _ = run_nodes(asking, tag_id='7', yes='true', seed=7)
    assert [node.get_parameter(name).value for name in ('tag_id', 'yes', 'seed')] == ['7', 'true', 7]
