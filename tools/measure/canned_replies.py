"""
Servers that send replies made beforehand, without a simulator: the least time that a rclpy service takes.

`tag_reading [SECONDS_LATE]` serves the bridge's service type. A reply has the size of the bridge's: two
readings for every tag id, or N for an id such as `n5`. `trigger` serves std_srvs/Trigger with a reading as
JSON in its message, which needs no message package.
"""

import json
import sys
import time

import rclpy
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_msgs.msg import SensorReading, TagReading
from lupin_msgs.srv import GetTagReading

NAMES = ('temperature', 'co2', 'humidity', 'light', 'soil_moisture')
NAME = '~/get_tag_reading'


def canned(tag_id: str, count: int) -> GetTagReading.Response:
    """Return a reply of `count` readings."""
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


def serve_tag_reading(node) -> None:
    """Serve GetTagReading."""
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
    {'tag_reading': serve_tag_reading, 'trigger': serve_trigger}[sys.argv[1]](node)
    print('ready: canned replies', flush=True)
    rclpy.spin(node)


if __name__ == '__main__':
    main()
