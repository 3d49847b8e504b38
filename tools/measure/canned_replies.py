"""
A server that sends one prepared reply, without a simulator: the shortest time of a service of rclpy.

python canned_replies.py [SECONDS_LATE]    SECONDS_LATE is the time that each reply takes; default: 0
"""

import sys
import time
from typing import Any

import rclpy
from lupin_greenhouse_bridge.contract import NODE_NAME, SERVICE_QOS
from lupin_greenhouse_bridge.interfaces import GetTagReading, SensorReading, TagReading

SECONDS_LATE = float(sys.argv[1]) if sys.argv[1:2] != ['--ros-args'] else 0.0
READINGS = [SensorReading(name=name, value=21.5) for name in ('temperature', 'co2')]
REPLY = GetTagReading.Response(
    reading=TagReading(tag_id='1', sim_time_of_day_seconds=43200.0, readings=READINGS)
)


def handle(_request: Any, _response: Any) -> Any:
    """Return the reply."""
    if SECONDS_LATE:
        time.sleep(SECONDS_LATE)
    return REPLY


if __name__ == '__main__':
    rclpy.init()
    node = rclpy.create_node(NODE_NAME)
    node.create_service(GetTagReading, '~/get_tag_reading', handle, qos_profile=SERVICE_QOS)
    print('ready: canned replies', flush=True)
    rclpy.spin(node)
