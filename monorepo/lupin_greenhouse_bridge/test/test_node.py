"""The node in the ROS graph: one service, read-only parameters, one handler at a time."""

import contextlib
import threading
from concurrent.futures import ThreadPoolExecutor

import rclpy
from greenhouse_sim import simulator
from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.client import SERVICE_QOS, tag_ids_of, tag_ids_request
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.testing import PATIENCE_SECONDS, call, greet, spinning_node, wait_until
from lupin_msgs.srv import GetTagReading
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.utilities import get_rmw_implementation_identifier


def call_node_service(bridge, service_type, name, request):
    bridge.connect()
    client = bridge.node.create_client(service_type, bridge.service_name.replace('get_tag_reading', name))
    assert client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
    return call(client, request)


def test_the_node_offers_one_service_and_no_topic_of_its_own(noon_bridge):
    noon_bridge.connect()
    node, namespace = noon_bridge.node, noon_bridge.service_name.rpartition('/greenhouse_bridge/')[0]
    of_any_node = {
        name.replace('/bridge_test/', f'{namespace}/greenhouse_bridge/')
        for name, _ in node.get_service_names_and_types_by_node('bridge_test', '/')
    }
    package = GetTagReading.__module__.split('.')[0]

    def services_of_the_bridge():
        if ('greenhouse_bridge', namespace) not in node.get_node_names_and_namespaces():
            return {}
        return dict(node.get_service_names_and_types_by_node('greenhouse_bridge', namespace))

    wait_until(lambda: services_of_the_bridge().keys() >= of_any_node | {noon_bridge.service_name})
    services = services_of_the_bridge()
    assert services.pop(noon_bridge.service_name) == [f'{package}/srv/GetTagReading']
    assert services.keys() == of_any_node
    topics = node.get_publisher_names_and_types_by_node('greenhouse_bridge', namespace)
    assert {name for name, _ in topics} == {'/parameter_events', '/rosout'}


def test_every_parameter_is_described_and_read_only(noon_bridge):
    arguments = list(Settings.__dataclass_fields__)
    assert arguments == ['tag_file', 'sim_config_file', 'debug_time_of_day', 'speedup_factor', 'debug_seed']
    names = [*arguments, 'loaded_tag_ids']
    response = call_node_service(
        noon_bridge, DescribeParameters, 'describe_parameters', DescribeParameters.Request(names=names)
    )
    assert [each.name for each in response.descriptors if each.read_only and each.description] == names


def test_a_parameter_cannot_be_set_while_the_bridge_runs(noon_bridge):
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=6.0)
    request = SetParameters.Request(parameters=[Parameter(name='debug_time_of_day', value=value)])
    (result,) = call_node_service(noon_bridge, SetParameters, 'set_parameters', request).results
    assert not result.successful
    assert 'read-only' in result.reason
    assert noon_bridge.call('1').reading.sim_time_of_day_seconds == 12 * 3600.0


def test_the_loaded_tag_ids_are_a_parameter_that_ignores_overrides(start_bridge, shipped_tags):
    bridge = start_bridge(loaded_tag_ids='[none]')
    response = call_node_service(bridge, GetParameters, 'get_parameters', tag_ids_request())
    assert tag_ids_of(response) == list(shipped_tags)
    value = ParameterValue(type=ParameterType.PARAMETER_STRING_ARRAY, string_array_value=['none'])
    request = SetParameters.Request(parameters=[Parameter(name='loaded_tag_ids', value=value)])
    (result,) = call_node_service(bridge, SetParameters, 'set_parameters', request).results
    assert not result.successful


def test_the_ready_line_names_tags_sensors_and_clock(start_bridge, shipped_tags):
    assert (
        f'{len(shipped_tags)} tags; sensors temperature, humidity, co2, light, soil_moisture; clock live'
        in (start_bridge().wait_for_log('ready:'))
    )
    assert 'clock frozen at 6.5 h' in start_bridge(debug_time_of_day=6.5).wait_for_log('ready:')


def test_the_ready_line_names_the_rmw(start_bridge):
    """Two machines can communicate only with the same RMW."""
    assert start_bridge().wait_for_log('ready:').endswith(f'; {get_rmw_implementation_identifier()}')


def most_handlers_at_once(monkeypatch) -> int:
    """Return the largest number of simultaneous handlers with 8 clients and 8 executor threads."""

    class Recorder(simulator.GreenhouseSimulator):
        most = 0
        _inside = 0
        _lock = threading.Lock()
        _company = threading.Event()

        def get_sensor_data(self, tag_id):
            cls = type(self)
            with cls._lock:
                cls._inside += 1
                cls.most = max(cls.most, cls._inside)
                if cls._inside > 1:
                    cls._company.set()
            cls._company.wait(0.05)  # waits, so that another handler could run at the same time
            data = super().get_sensor_data(tag_id)
            with cls._lock:
                cls._inside -= 1
            return data

    with contextlib.ExitStack() as stack:
        with monkeypatch.context() as patch:
            patch.setattr(simulator, 'GreenhouseSimulator', Recorder)
            rclpy.init(args=['--ros-args', '-p', 'debug_time_of_day:=12.0', '-r', '__ns:=/overlap'])
            stack.callback(rclpy.shutdown)
            node = bridge_node.GreenhouseBridgeNode()
            stack.callback(node.destroy_node)
        executor = MultiThreadedExecutor(num_threads=8)
        executor.add_node(node)
        spinner = threading.Thread(target=executor.spin, daemon=True)
        spinner.start()
        stack.callback(spinner.join, PATIENCE_SECONDS)
        stack.callback(executor.shutdown)
        clients = []
        for number in range(8):
            client_node = stack.enter_context(spinning_node(f'client{number}'))
            clients.append(
                client_node.create_client(
                    GetTagReading, '/overlap/greenhouse_bridge/get_tag_reading', qos_profile=SERVICE_QOS
                )
            )
            assert clients[-1].wait_for_service(timeout_sec=PATIENCE_SECONDS)
        for client in clients:
            greet(client, GetTagReading.Request(tag_id='1'))
        Recorder.most = 0  # start-up and the greetings also read tags
        with ThreadPoolExecutor(8) as pool:
            asked = [pool.submit(call, client, GetTagReading.Request(tag_id='1')) for client in clients * 3]
            assert [each.result().status for each in asked] == [GetTagReading.Response.STATUS_OK] * 24
        return Recorder.most


def test_at_most_one_handler_is_in_the_simulator_whatever_the_executor(monkeypatch):
    assert most_handlers_at_once(monkeypatch) == 1


def test_without_the_mutually_exclusive_group_handlers_would_overlap(monkeypatch):
    """The check above can fail: it fails with a reentrant group."""
    monkeypatch.setattr(bridge_node, 'MutuallyExclusiveCallbackGroup', ReentrantCallbackGroup)
    assert most_handlers_at_once(monkeypatch) > 1
