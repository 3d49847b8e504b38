"""
What the bridge is measured against: the least that a rclpy node can do to answer the same question.

`floor [SECONDS_LATE]` serves the bridge's own service type with answers that were made beforehand, of the
size of the bridge's: two readings for every tag id, or N for an id such as `n5`. `trigger` serves
std_srvs/Trigger with a reading as JSON in its message, as one might without messages of one's own.
`wrapper` is the thinnest node that does what was asked for: asks mdp-greenhouse, stamps and fills the answer,
checks nothing.
"""

import json
import sys
import time

import rclpy
from lupin_greenhouse_bridge.client import SERVICE_QOS
from lupin_msgs.msg import SensorReading, TagReading
from lupin_msgs.srv import GetTagReading

NAMES = ('temperature', 'co2', 'humidity', 'light', 'soil_moisture')
NAME = '~/get_tag_reading'


def canned(tag_id: str, count: int) -> GetTagReading.Response:
    """Return an answer of `count` readings."""
    readings = [SensorReading(name=name, value=21.5) for name in NAMES[:count]]
    reading = TagReading(tag_id=tag_id, sim_time_of_day_seconds=43200.0, readings=readings)
    reading.stamp.sec = 1795189973
    return GetTagReading.Response(reading=reading)


def serve_trigger(node) -> None:
    """Serve std_srvs/Trigger."""
    from std_srvs.srv import Trigger

    text = json.dumps({'tag_id': '1', 'sim_time_of_day_seconds': 43200.0, 'temperature': 21.5, 'co2': 600.0})
    answer = Trigger.Response(success=True, message=text)
    node.create_service(Trigger, NAME, lambda _request, _response: answer, qos_profile=SERVICE_QOS)


def serve_wrapper(node) -> None:
    """Serve the simulator as directly as can be."""
    from greenhouse_sim.simulator import GreenhouseSimulator

    simulator = GreenhouseSimulator()

    def handle(request, response):
        values = simulator.get_sensor_data(request.tag_id)
        response.reading.tag_id = request.tag_id
        response.reading.stamp = node.get_clock().now().to_msg()
        response.reading.sim_time_of_day_seconds = float(values.pop('timestamp'))
        response.reading.readings = [SensorReading(name=name, value=value) for name, value in values.items()]
        return response

    node.create_service(GetTagReading, NAME, handle, qos_profile=SERVICE_QOS)


def serve_floor(node) -> None:
    """Serve what was made beforehand."""
    seconds_late = float(sys.argv[2]) if len(sys.argv) > 2 and sys.argv[2][0].isdecimal() else 0.0
    answers = {f'n{count}': canned(f'n{count}', count) for count in range(1, 6)}
    usual = canned('1', 2)

    def handle(request, _response):
        if seconds_late:
            time.sleep(seconds_late)
        return answers.get(request.tag_id, usual)

    node.create_service(GetTagReading, NAME, handle, qos_profile=SERVICE_QOS)


def main() -> None:
    """Serve until the process is ended."""
    rclpy.init()
    node = rclpy.create_node('greenhouse_bridge')
    {'floor': serve_floor, 'wrapper': serve_wrapper, 'trigger': serve_trigger}[sys.argv[1]](node)
    print('ready: floor', flush=True)
    rclpy.spin(node)


if __name__ == '__main__':
    main()
