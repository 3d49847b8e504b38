"""The node in the ROS graph: one service, read-only parameters, one handler at a time."""

import contextlib
import dataclasses
import threading

import rclpy
from greenhouse_sim import simulator
from lupin_greenhouse_bridge import bridge_node
from lupin_greenhouse_bridge.contract import SERVICE_QOS, tag_ids_of, tag_ids_request
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS, call, greet, spinning_node, wait_until
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.executors import MultiThreadedExecutor
from rclpy.utilities import get_rmw_implementation_identifier


def call_node_service(bridge, service_type, name, request):
    bridge.connect()
    client = bridge.node.create_client(service_type, bridge.service_name.replace('get_tag_reading', name))
    assert client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
    greet(client, request)
    return call(client, request)


def test_every_parameter_is_described_and_read_only_and_a_number_has_a_range(noon_bridge):
    arguments = dataclasses.fields(Settings)
    names = [*(each.name for each in arguments), 'loaded_tag_ids']
    response = call_node_service(
        noon_bridge, DescribeParameters, 'describe_parameters', DescribeParameters.Request(names=names)
    )
    assert [each.name for each in response.descriptors if each.read_only and each.description] == names
    ranges = {
        descriptor.name: (limits.from_value, limits.to_value)
        for descriptor in response.descriptors
        for limits in (*descriptor.floating_point_range, *descriptor.integer_range)
    }
    numbers = {each.name: each.metadata['limits'] for each in arguments if each.type in (int, float)}
    assert ranges == numbers != {}


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


def test_the_ready_line_names_tags_sensors_clock_and_rmw(bridge_here, shipped_tags):
    """Two machines can communicate only with the same RMW."""
    live, frozen = (
        next(line for line in bridge_here(**parameters).err.splitlines() if 'ready: ' in line)
        for parameters in ({}, {'debug_time_of_day': 6.5})
    )
    assert (
        f'ready: {len(shipped_tags)} tags; sensors temperature, humidity, co2, light, soil_moisture; ' in live
    )
    assert '; clock live' in live
    assert live.endswith(f'; {get_rmw_implementation_identifier()}')
    assert '; clock frozen at 6.5 h' in frozen


def test_at_most_one_handler_is_in_the_simulator_whatever_the_executor(monkeypatch):
    """More requests wait than ROS's default depth keeps, while 8 threads run other callbacks."""

    class HeldSimulator(simulator.GreenhouseSimulator):
        inside = most = 0
        let_go = threading.Event()

        def get_sensor_data(self, tag_id):
            cls = type(self)
            cls.inside += 1
            cls.most = max(cls.most, cls.inside)
            assert cls.let_go.wait(PATIENCE_SECONDS)
            cls.inside -= 1
            return super().get_sensor_data(tag_id)

    HeldSimulator.let_go.set()  # start-up also reads tags
    name = '/overlap/greenhouse_bridge'
    with contextlib.ExitStack() as stack:
        with monkeypatch.context() as patch:
            patch.setattr(simulator, 'GreenhouseSimulator', HeldSimulator)
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
        stack.callback(HeldSimulator.let_go.set)
        client_node = stack.enter_context(spinning_node('client'))
        client = client_node.create_client(GetTagReading, f'{name}/get_tag_reading', qos_profile=SERVICE_QOS)
        other = client_node.create_client(GetParameters, f'{name}/get_parameters')
        for each, request in ((client, GetTagReading.Request(tag_id='1')), (other, tag_ids_request())):
            assert each.wait_for_service(timeout_sec=PATIENCE_SECONDS)
            greet(each, request)
        HeldSimulator.let_go.clear()
        HeldSimulator.most, asked = 0, []
        for _ in range(24):
            asked.append(client.call_async(GetTagReading.Request(tag_id='1')))
            wait_until(lambda: HeldSimulator.inside)
            assert tag_ids_of(call(other, tag_ids_request()))
        HeldSimulator.let_go.set()
        wait_until(lambda: all(each.done() for each in asked))
        assert [each.result().status for each in asked] == [GetTagReading.Response.STATUS_OK] * 24
        assert HeldSimulator.most == 1
