"""
A plain wrapper of the simulator, which teams used before this bridge; `make bench` compares the two.

It offers the same service from the same simulator, and checks nothing. It has no parameters, because they
would not change the measured times.
"""

from typing import Any

import rclpy
from greenhouse_sim.simulator import GreenhouseSimulator
from lupin_msgs.msg import SensorReading
from lupin_msgs.srv import GetTagReading
from rclpy.node import Node


class PlainWrapper(Node):
    """Serves `~/get_tag_reading` from one simulator with ROS's defaults."""

    def __init__(self) -> None:
        super().__init__('greenhouse_bridge')
        self._sim = GreenhouseSimulator(None, None)
        self._tag_set = set(self._sim.tags())
        self._service = self.create_service(GetTagReading, '~/get_tag_reading', self._handle_get_tag_reading)
        self.get_logger().info(f'ready: {len(self._tag_set)} tags')

    def _handle_get_tag_reading(self, request: Any, response: Any) -> Any:
        if request.tag_id not in self._tag_set:
            response.status = GetTagReading.Response.STATUS_UNKNOWN_TAG
            known = f'({len(self._tag_set)} tags known)'
            response.error_message = f"Tag '{request.tag_id}' is not in the loaded greenhouse {known}."
            return response
        response.status = GetTagReading.Response.STATUS_OK
        response.reading.tag_id = request.tag_id
        response.reading.stamp = self.get_clock().now().to_msg()
        response.reading.sim_time_of_day_seconds = float(self._sim.current_time())
        for name, value in self._sim.get_sensor_data(request.tag_id).items():
            if name != 'timestamp':
                response.reading.readings.append(SensorReading(name=name, value=float(value)))
        return response


if __name__ == '__main__':
    rclpy.init()
    rclpy.spin(PlainWrapper())
