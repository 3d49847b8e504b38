"""
Servers that send prepared replies, without a simulator. They show the shortest time of a rclpy service.

`tag_reading [SECONDS_LATE]` serves the bridge's service type. A reply has two readings.
`trigger` serves std_srvs/Trigger with a reading as JSON in its message, which needs no message package.
"""

import json
import sys
import time

import rclpy
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_msgs.msg import SensorReading, TagReading
from lupin_msgs.srv import GetTagReading

NAME = '~/get_tag_reading'


def serve_trigger(node) -> None:
    """Serve std_srvs/Trigger."""
    from std_srvs.srv import Trigger

    text = json.dumps({'tag_id': '1', 'sim_time_of_day_seconds': 43200.0, 'temperature': 21.5, 'co2': 600.0})
    answer = Trigger.Response(success=True, message=text)
    node.create_service(Trigger, NAME, lambda _request, _response: answer, qos_profile=SERVICE_QOS)


def serve_tag_reading(node) -> None:
    """Serve GetTagReading."""
    seconds_late = float(sys.argv[2]) if len(sys.argv) > 2 and sys.argv[2][0].isdecimal() else 0.0
    readings = [SensorReading(name=name, value=21.5) for name in ('temperature', 'co2')]
    reading = TagReading(tag_id='1', sim_time_of_day_seconds=43200.0, readings=readings)
    reading.stamp.sec = 1795189973
    answer = GetTagReading.Response(reading=reading)

    def handle(_request, _response):
        if seconds_late:
            time.sleep(seconds_late)
        return answer

    node.create_service(GetTagReading, NAME, handle, qos_profile=SERVICE_QOS)


def main() -> None:
    """Serve until the process is ended."""
    rclpy.init()
    node = rclpy.create_node('greenhouse_bridge')
    {'tag_reading': serve_tag_reading, 'trigger': serve_trigger}[sys.argv[1]](node)
    print('ready: canned replies', flush=True)
    rclpy.spin(node)


if __name__ == '__main__':
    main()
