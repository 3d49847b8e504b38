"""
ROS 2 node `greenhouse_bridge`: returns the simulated climate at a tag, at the time of the request.

ros2 run lupin_greenhouse_bridge bridge_node --ros-args -p debug_time_of_day:=12.0
"""

from pathlib import Path

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier

from lupin_greenhouse_bridge.contract import NODE_NAME, SERVICE_QOS, TAG_IDS_PARAMETER
from lupin_greenhouse_bridge.errors import escaped, pluralized
from lupin_greenhouse_bridge.interfaces import GetTagReading, SensorReading, TagReading
from lupin_greenhouse_bridge.runtime.parameters import declare_parameters
from lupin_greenhouse_bridge.runtime.run import run
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation

LOG_EVERY_SECONDS = 5.0  # a caller in a loop must not flood the log


def _config_path(value: str) -> Path | str | None:
    """
    Turn a path parameter into an argument of the simulator; None selects its shipped file.

    The two trees differ in this line on purpose: see "Serve your own tags" in the mirror's README.
    """
    return Path(value) if value else None


class GreenhouseBridgeNode(Node):
    """Serves `~/get_tag_reading` from one simulator, and nothing else."""

    def __init__(self) -> None:
        """Load and validate the greenhouse, then offer the service; raises StartUpError."""
        super().__init__(NODE_NAME)
        # A file from `ros2 param dump` also has the bridge's own output.
        settings = declare_parameters(self, Settings, without_effect=[TAG_IDS_PARAMETER])
        greenhouse = simulation.load(
            settings,
            tag_file=_config_path(settings.tag_file),
            sim_config_file=_config_path(settings.sim_config_file),
        )
        for warning in greenhouse.warnings:
            self.get_logger().warning(warning)
        self._wall_clock = Clock()  # with use_sim_time, the node's own clock follows /clock
        self._sim = greenhouse.sim
        self._tag_set = frozenset(greenhouse.tag_ids)
        descriptor = ParameterDescriptor(
            description='The ids of the tags that the bridge serves.', read_only=True
        )
        self.declare_parameter(TAG_IDS_PARAMETER, greenhouse.tag_ids, descriptor, ignore_override=True)
        self.create_service(
            GetTagReading,
            '~/get_tag_reading',
            self._handle_get_tag_reading,
            qos_profile=SERVICE_QOS,
            # The simulator is not thread-safe: only one handler runs at a time, in any executor.
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
        self.get_logger().info(f'ready: {greenhouse.summary}; {get_rmw_implementation_identifier()}')

    def _handle_get_tag_reading(
        self, request: GetTagReading.Request, response: GetTagReading.Response
    ) -> GetTagReading.Response:
        tag_id = request.tag_id
        if tag_id not in self._tag_set:
            # For an unknown tag the simulator returns {}, which would become STATUS_OK without readings.
            response.status = response.STATUS_UNKNOWN_TAG
            response.error_message = (
                f"Tag '{escaped(tag_id, 64)}' is not in the loaded greenhouse"
                f' ({pluralized(len(self._tag_set), "tag")} known).'
            )
            self.get_logger().warning(response.error_message, throttle_duration_sec=LOG_EVERY_SECONDS)
            return response
        try:
            stamp = self._wall_clock.now().to_msg()
            sim_time, values = simulation.read(self._sim, tag_id)
        except simulation.ReadingError as error:
            response.status = response.STATUS_SIMULATOR_ERROR
            response.error_message = str(error)
            self.get_logger().error(response.error_message, throttle_duration_sec=LOG_EVERY_SECONDS)
            return response
        response.status = response.STATUS_OK
        response.reading = TagReading(
            tag_id=tag_id,
            stamp=stamp,
            sim_time_of_day_seconds=sim_time,
            readings=[SensorReading(name=name, value=value) for name, value in values.items()],
        )
        return response


def main(args: list[str] | None = None) -> int:
    """Serve until Ctrl-C or SIGTERM (exit code 0); a start-up error is one FATAL line (exit code 1)."""
    return run(NODE_NAME, GreenhouseBridgeNode, args)
