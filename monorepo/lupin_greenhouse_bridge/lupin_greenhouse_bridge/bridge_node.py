"""ROS 2 node `greenhouse_bridge`: tells the climate at a tag, now."""

import signal
import sys
from dataclasses import fields
from pathlib import Path

import rclpy
from lupin_msgs.msg import SensorReading
from lupin_msgs.srv import GetTagReading
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import QoSProfile

from lupin_greenhouse_bridge import simulation
from lupin_greenhouse_bridge.errors import ReadingError, StartUpError, printable
from lupin_greenhouse_bridge.settings import Settings

NODE_NAME = 'greenhouse_bridge'
LOG_EVERY_SECONDS = 5.0  # a caller in a loop must not flood the log
LONGEST_WAIT_SECONDS = 0.5
# ROS's default depth is 10: of 16 requests that come at once some are dropped, and nobody is told.
SERVICE_QOS = QoSProfile(depth=1000)


def _config_path(value: str) -> Path | str | None:
    """Turn a path parameter into what the simulator takes for it; empty means its shipped file."""
    return Path(value) if value else None


class GreenhouseBridge(Node):
    """Serves `~/get_tag_reading` from one simulator, and nothing else."""

    def __init__(self):
        """Load and check the greenhouse, then offer the service; raises StartUpError."""
        super().__init__(NODE_NAME)
        settings = self._declare_settings()
        greenhouse = simulation.load(
            settings,
            tag_file=_config_path(settings.tag_file),
            sim_config_file=_config_path(settings.sim_config_file),
        )
        for warning in greenhouse.warnings:
            self.get_logger().warning(warning)
        self._sim = greenhouse.sim
        self._tag_set = greenhouse.tag_ids

        # One handler at a time, whatever the executor: the simulator is not thread-safe.
        self._cb_group = MutuallyExclusiveCallbackGroup()
        self._service = self.create_service(
            GetTagReading,
            '~/get_tag_reading',
            self._handle_get_tag_reading,
            qos_profile=SERVICE_QOS,
            callback_group=self._cb_group,
        )
        self.get_logger().info(f'ready: {greenhouse.summary}')

    def _declare_settings(self) -> Settings:
        for each in fields(Settings):
            # Typed by Settings and not by ROS, which would refuse 3600 for a double.
            descriptor = ParameterDescriptor(
                description=each.metadata['description'], read_only=True, dynamic_typing=True
            )
            self.declare_parameter(each.name, each.default, descriptor)
        for name in getattr(self, '_parameter_overrides', ()):  # private to rclpy: it may go one day
            if not self.has_parameter(name):  # ROS says nothing of a mistyped name
                self.get_logger().warning(f'parameter {printable(name, 64)} is unknown, and ignored')
        return Settings(**{each.name: self.get_parameter(each.name).value for each in fields(Settings)})

    def _handle_get_tag_reading(self, request, response):
        tag_id = request.tag_id
        if tag_id not in self._tag_set:
            # Left to itself the simulator gives {}: an OK without readings, the worst answer.
            response.status = GetTagReading.Response.STATUS_UNKNOWN_TAG
            response.error_message = (
                f"Tag '{printable(tag_id, 64)}' is not in the loaded greenhouse"
                f' ({len(self._tag_set)} tags known).'
            )
            self.get_logger().warning(response.error_message, throttle_duration_sec=LOG_EVERY_SECONDS)
            return response
        try:
            stamp = self.get_clock().now().to_msg()
            sim_time, values = simulation.read(self._sim, tag_id)
        except ReadingError as error:
            response.status = GetTagReading.Response.STATUS_SIMULATOR_ERROR
            response.error_message = str(error)
            self.get_logger().error(response.error_message, throttle_duration_sec=LOG_EVERY_SECONDS)
            return response
        response.status = GetTagReading.Response.STATUS_OK
        response.reading.tag_id = tag_id
        response.reading.stamp = stamp
        response.reading.sim_time_of_day_seconds = sim_time
        response.reading.readings = [SensorReading(name=name, value=value) for name, value in values.items()]
        return response


def main(args=None):
    """Serve until Ctrl-C or SIGTERM (exit 0); what cannot be served is one FATAL line (exit 1)."""
    try:
        rclpy.init(args=args)
    except RuntimeError as error:
        return _refuse(StartUpError(f'the ROS arguments are not understood: {error}'))
    try:
        executor = SingleThreadedExecutor()
        executor.add_node(GreenhouseBridge())
        # Not spin(): a SIGTERM that falls between two of its endless waits is never noticed.
        while rclpy.ok():
            executor.spin_once(timeout_sec=LONGEST_WAIT_SECONDS)
    except (KeyboardInterrupt, ExternalShutdownException):
        # `ros2 launch` passes on the Ctrl-C that the terminal has sent already: one is enough.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    except StartUpError as error:
        return _refuse(error)
    except (NameValidationException, ParameterException) as error:
        return _refuse(StartUpError(f'the ROS arguments do not fit the node: {error}'))
    except Exception:
        if rclpy.ok():  # else a signal took the context away during start-up
            raise
    finally:
        rclpy.get_default_context().try_shutdown()  # rclpy.try_shutdown() would undo SIG_IGN
    return 0


def _refuse(error: StartUpError) -> int:
    get_logger(NODE_NAME).fatal(str(error))
    return 1


if __name__ == '__main__':
    sys.exit(main())
