"""The node: one service that survives any request, in the ROS graph that its SROS2 policy allows."""

import dataclasses
import signal
from pathlib import Path
from xml.etree import ElementTree

import pytest
from greenhouse_sim.simulator import GreenhouseSimulator
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.contract import SERVICE_QOS, info_of, info_request
from lupin_greenhouse_bridge.interfaces import GetTagReading, TagReading
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.rclpy_internals import RCLError
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.testing.helpers import call, wait_until
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import get_rmw_implementation_identifier

UNKNOWN_TAG = GetTagReading.Response.STATUS_UNKNOWN_TAG
FORGED = '1\n[FATAL] [0.0] [greenhouse_bridge]: forged\r\x1b[2J'
POLICY_FILE = Path(__file__).resolve().parent.parent / 'security/policy.xml'
POLICY = ElementTree.parse(POLICY_FILE).getroot()
RIGHTS = {'reply': 'service', 'request': 'client', 'publish': 'publisher', 'subscribe': 'subscriber'}
# Distros before Jazzy do not have it; an unused right does no harm.
NOT_EVERYWHERE = {'~/get_type_description'}


def test_every_parameter_is_described_and_read_only_and_a_number_has_its_range(run_nodes, shipped_tags):
    """The list of the loaded tags is an output, which ignores overrides."""
    _, node = run_nodes(bridge_node.GreenhouseBridgeNode, debug_time_of_day=12.0, loaded_tag_ids=['none'])

    def ask(service_type, name, request):
        return call(node.create_client(service_type, f'/greenhouse_bridge/{name}'), request)

    assert info_of(ask(GetParameters, 'get_parameters', info_request())).tag_ids == list(shipped_tags)
    parameters = dataclasses.fields(Settings)
    names = [*(parameter.name for parameter in parameters), 'loaded_tag_ids']
    response = ask(DescribeParameters, 'describe_parameters', DescribeParameters.Request(names=names))
    described = [
        descriptor for descriptor in response.descriptors if descriptor.read_only and descriptor.description
    ]
    assert [descriptor.name for descriptor in described] == names
    ranges = {
        descriptor.name: (limits.from_value, limits.to_value)
        for descriptor in response.descriptors
        for limits in (*descriptor.floating_point_range, *descriptor.integer_range)
    }
    numbers = [parameter for parameter in parameters if parameter.type in (int, float)]
    assert ranges == {parameter.name: parameter.metadata['limits'] for parameter in numbers}

    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=6.0)
    request = SetParameters.Request(parameters=[Parameter(name='debug_time_of_day', value=value)])
    (result,) = ask(SetParameters, 'set_parameters', request).results
    assert not result.successful
    assert 'read-only' in result.reason
    response = ask(GetTagReading, 'get_tag_reading', GetTagReading.Request(tag_id='1'))
    assert response.reading.sim_time_of_day_seconds == 12 * 3600.0


def test_the_ready_line_names_tags_sensors_clock_and_rmw(bridge_here, shipped_tags):
    """Two machines can communicate only with the same RMW."""
    (line,) = (line.partition('ready: ')[2] for line in bridge_here().err.splitlines() if 'ready: ' in line)
    tags = f'{len(shipped_tags)} tags; sensors temperature, humidity, co2, light, soil_moisture; '
    assert line.startswith(f'{tags}clock live')
    assert line.endswith(f'; {get_rmw_implementation_identifier()}')


def test_one_handler_runs_at_a_time_in_any_executor_and_many_requests_can_wait(run_nodes):
    """The simulator is not thread-safe. Other callbacks need not wait for it."""
    bridge, _ = run_nodes(bridge_node.GreenhouseBridgeNode)
    (service,) = [service for service in bridge.services if service.srv_type is GetTagReading]
    assert service.qos_profile == SERVICE_QOS
    assert isinstance(service.callback_group, MutuallyExclusiveCallbackGroup)
    assert service.callback_group is not bridge.default_callback_group


@settings(suppress_health_check=HealthCheck)  # one bridge answers every example
@given(tag_id=st.text(max_size=80).map(lambda text: text.replace('\0', '')))
@example(tag_id='')
@example(tag_id='1 ')
@example(tag_id='１')  # noqa: RUF001
@example(tag_id='\u202e1\u202c')
def test_any_other_id_is_an_unknown_tag_and_the_next_request_is_answered(noon_bridge, shipped_tags, tag_id):
    response = noon_bridge.call(tag_id)
    if tag_id in shipped_tags:
        assert response.status == response.STATUS_OK
        return
    assert (response.status, response.reading) == (UNKNOWN_TAG, TagReading())
    assert response.error_message.isprintable()
    assert f'({len(shipped_tags)} tags known).' in response.error_message
    assert noon_bridge.values('1')


def test_a_megabyte_of_id_is_an_unknown_tag_in_a_short_message_and_a_nul_ends_an_id(noon_bridge):
    response = noon_bridge.call('x' * 2**20)
    assert response.status == UNKNOWN_TAG
    assert response.error_message.startswith(f"Tag '{'x' * 64}...' is not in the loaded greenhouse")
    # ROS strings end at a NUL: rclpy sends the part before it.
    assert noon_bridge.call('99\0').status == noon_bridge.call('\x001').status == UNKNOWN_TAG
    assert noon_bridge.call('1\x002').reading.tag_id in ('1', '')


def test_faults_are_reported_logged_now_and_then_and_survived(ask_here, monkeypatch, capfd):
    def fail(_sim, _tag_id):
        raise RuntimeError('the sensor is on fire\ntwo\x1b[2J')

    ask = ask_here()
    assert ask(FORGED).status == UNKNOWN_TAG
    with monkeypatch.context() as patch:
        patch.setattr(GreenhouseSimulator, 'get_sensor_data', fail)
        for _ in range(30):
            response = ask('1')
            assert (response.status, response.reading) == (response.STATUS_SIMULATOR_ERROR, TagReading())
            assert 'RuntimeError: the sensor is on fire two' in response.error_message
            assert response.error_message.isprintable()
            assert ask('99').status == UNKNOWN_TAG
    assert ask('1').status == response.STATUS_OK
    log = capfd.readouterr().err.splitlines()
    assert 1 <= len([line for line in log if 'the sensor is on fire' in line]) <= 20
    unknown = [line for line in log if 'is not in the loaded greenhouse' in line]
    assert 1 <= len(unknown) <= 20
    assert unknown[0].startswith('[WARN]')
    assert '\\n[FATAL]' in unknown[0]
    assert unknown[0].isprintable()


def test_an_error_of_rcl_in_a_callback_is_a_warning_and_the_bridge_goes_on(bridge_here, monkeypatch):
    """Humble's rclpy raises it for a reply to a client that has gone."""
    spin_once, errors = SingleThreadedExecutor.spin_once, [RCLError('failed to send response')]

    def fail_once(executor, **options):
        if errors:
            raise errors.pop()
        spin_once(executor, **options)

    monkeypatch.setattr(SingleThreadedExecutor, 'spin_once', fail_once)
    ended = bridge_here()
    assert (ended.code, ended.err.count('continued after: failed to send response')) == (0, 1)


def allowed(node):
    """Return what a node's profile of the policy allows, as what_has() returns what a node has."""
    (profile,) = [profile for profile in POLICY.iter('profile') if profile.get('node') == node]
    return {
        right: {name.text for group in profile if group.get(right) == 'ALLOW' for name in group}
        for right in RIGHTS
    }


def what_has(graph, node, namespace):
    """Return the names of what a node has on the graph, by the right that it needs for them."""
    if (node, namespace or '/') not in graph.get_node_names_and_namespaces():
        return {right: set() for right in RIGHTS}
    own = f'{namespace}/{node}/'
    return {
        right: {
            name.replace(own, '~/').removeprefix(namespace)
            for name, _ in getattr(graph, f'get_{kind}_names_and_types_by_node')(node, namespace or '/')
        }
        for right, kind in RIGHTS.items()
    }


def test_the_policy_has_the_form_of_sros2_0_2_0():
    assert (POLICY.tag, POLICY.attrib) == ('policy', {'version': '0.2.0'})
    with_comments = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    enclaves = ElementTree.parse(POLICY_FILE, with_comments).getroot().find('enclaves')
    # sros2 takes every child for an enclave, a comment too.
    assert [enclave.get('path') for enclave in enclaves] == ['/greenhouse_bridge', '/read_tag']
    for profile in POLICY.iter('profile'):
        assert profile.attrib.keys() == {'ns', 'node'}
        for group in profile:
            rights = {'topics': {'publish', 'subscribe'}, 'services': {'request', 'reply'}}[group.tag]
            assert group.attrib.items() <= {(right, 'ALLOW') for right in rights}
            assert {name.tag for name in group} == {group.tag.removesuffix('s')}


def test_the_bridge_offers_one_service_and_may_do_nothing_more(noon_bridge):
    noon_bridge.connect()
    graph, rights = noon_bridge.node, allowed('greenhouse_bridge')

    def has():
        found = what_has(graph, 'greenhouse_bridge', noon_bridge.namespace)
        return {**found, 'reply': found['reply'] | NOT_EVERYWHERE}

    wait_until(lambda: has() == rights)
    of_any_node = what_has(graph, 'bridge_test', '')['reply']
    assert has()['reply'] - of_any_node - NOT_EVERYWHERE == {'~/get_tag_reading'}


@pytest.mark.parametrize(('arguments', 'without'), [(['1'], 'get_parameters'), (['--all'], 'nothing')])
def test_the_client_may_do_nothing_more(noon_bridge, read_tag_here, monkeypatch, arguments, without):
    noon_bridge.connect()
    graph, rights = noon_bridge.node, allowed('read_tag')
    requests = {
        f'{noon_bridge.namespace}{name}' for name in rights.pop('request') if not name.endswith(without)
    }
    looks = []

    def look(_seconds):
        """Look at the graph while read_tag waits for the next round."""
        wait_until(lambda: what_has(graph, 'read_tag', '')['request'] == requests)
        found = what_has(graph, 'read_tag', '')
        looks.append([right for right, names in rights.items() if not found[right] <= names])
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(process, 'sleep', look)
    wait_until(lambda: not what_has(graph, 'read_tag', '')['publish'])  # of the test before
    ended = read_tag_here(*arguments, '--watch', '1', '--service', noon_bridge.service_name)
    assert (ended.code, looks) == (0, [[]])
