"""ROS 2 node `mission`: visits the tags, has each read over ROS, and writes the report."""

import sys
import time
from dataclasses import fields
from functools import partial

import rclpy
from lupin_greenhouse_bridge import simulation
from lupin_greenhouse_bridge.errors import BridgeError, StartUpError, printable
from lupin_msgs.srv import ConfirmTag, GetTagReading
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidServiceNameException, NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import Trigger

from lupin_mission.drive import ImmediateDrive, TimedDrive
from lupin_mission.mission import Mission, Request, Service, State
from lupin_mission.report import Observation, Outcome, Reading, Report, last_of_each_tag, summary_table
from lupin_mission.settings import Settings

ALL_READ, SOME_NOT_READ, REFUSED = 0, 1, 2
NODE_NAME = 'mission'
STEP_SECONDS = 0.02
LONGEST_WAIT_SECONDS = 0.5
# Every client hears the replies to all; at ROS's depth of 10 those to others can push out its own.
SERVICE_QOS = QoSProfile(depth=1000)
LATCHED_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
REFUSALS = {
    GetTagReading.Response.STATUS_UNKNOWN_TAG: Outcome.UNKNOWN_TAG,
    GetTagReading.Response.STATUS_SIMULATOR_ERROR: Outcome.SIMULATOR_ERROR,
}


class MissionNode(Node):
    """The surroundings of one Mission: its clock, its two services, its report. Nothing here ever waits."""

    def __init__(self):
        """Open the report and start; raises StartUpError and ReportError."""
        super().__init__(NODE_NAME)
        settings = self._declare_settings()
        self.tag_ids = settings.chosen_tag_ids or simulation.served_tag_ids(settings.tag_file)
        self._service_clients = {
            Service.CONFIRM: self._client(ConfirmTag, settings.confirm_service_name),
            Service.READ: self._client(GetTagReading, settings.bridge_service_name),
        }
        self.report = Report(settings.report_file or time.strftime('mission-%Y%m%dT%H%M%S.jsonl'))
        found = last_of_each_tag(self.report.observations)
        to_visit = [tag for tag in self.tag_ids if tag not in found or found[tag].outcome is not Outcome.OK]

        self._unsent: Request | None = None  # until its service is there
        self._future = None  # of the request that is on its way
        self._at_tag = self.create_publisher(String, '~/at_tag', LATCHED_QOS)
        self._published_tag = None
        self.create_service(Trigger, '~/pause', self._pause)
        self.create_service(Trigger, '~/resume', self._resume)
        self.mission = Mission(
            to_visit,
            self,
            TimedDrive(settings.drive_seconds) if settings.drive_seconds > 0.0 else ImmediateDrive(),
            settings.limits,
            require_visual_confirmation=settings.require_visual_confirmation,
        )
        self.get_logger().info(
            f'{len(to_visit)} tags to visit, {len(self.tag_ids) - len(to_visit)} read before;'
            f' report: {self.report.path}'
        )
        # A clock that neither jumps nor stops, whatever use_sim_time says.
        self.create_timer(STEP_SECONDS, self._step, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _declare_settings(self) -> Settings:
        for each in fields(Settings):
            # Typed by Settings and not by ROS, which would refuse 2 for a double.
            descriptor = ParameterDescriptor(
                description=each.metadata['description'], read_only=True, dynamic_typing=True
            )
            self.declare_parameter(each.name, each.default, descriptor)
        for name in getattr(self, '_parameter_overrides', ()):  # private to rclpy: it may go one day
            if not self.has_parameter(name):  # ROS says nothing of a mistyped name
                self.get_logger().warning(f'parameter {printable(name, 64)} is unknown, and ignored')
        return Settings(**{each.name: self.get_parameter(each.name).value for each in fields(Settings)})

    def _client(self, service_type, name: str):
        try:
            return self.create_client(service_type, name, qos_profile=SERVICE_QOS)
        except InvalidServiceNameException as error:
            raise StartUpError(f'{name!r} is no service name: {" ".join(str(error).split())}') from error

    def _step(self) -> None:
        if self.mission.state is State.READY:
            self.mission.start(time.monotonic())
        self._send_when_ready()
        self.mission.step(time.monotonic())
        tag_id = self.mission.tag_at_hand or ''
        if tag_id != self._published_tag:
            self._published_tag = tag_id
            self._at_tag.publish(String(data=tag_id))

    def send(self, request: Request) -> None:
        """Send a request as soon as its service is there; the mission gives up on it where that is never."""
        self._unsent = request
        self._send_when_ready()

    def _send_when_ready(self) -> None:
        request = self._unsent
        if request is None or not self._service_clients[request.service].service_is_ready():
            return
        self._unsent = None
        if request.service is Service.CONFIRM:
            message = ConfirmTag.Request(expected_tag_id=request.tag_id)
        else:
            message = GetTagReading.Request(tag_id=request.tag_id)
        self._future = self._service_clients[request.service].call_async(message)
        self._future.add_done_callback(partial(self._on_reply, request))

    def abandon(self, request: Request) -> Outcome:
        """Forget a request; a reply that comes after all finds nobody."""
        name = self._service_clients[request.service].srv_name
        if self._unsent is request:
            self._unsent = None
            self.get_logger().warning(f'{name} is not there')
            return Outcome.NO_SERVICE
        self._service_clients[request.service].remove_pending_request(self._future)
        self.get_logger().warning(f'{name} did not answer in time')
        return Outcome.TIMEOUT

    def _on_reply(self, request: Request, future) -> None:
        response = future.result()
        if request.service is Service.CONFIRM:
            is_awaited = self.mission.on_confirmation(
                request.number, response.detected, response.error_message
            )
        elif response.status == GetTagReading.Response.STATUS_OK:
            is_awaited = self.mission.on_reading(request.number, _reading(response.reading))
        else:
            outcome = REFUSALS.get(response.status, Outcome.BAD_READING)
            is_awaited = self.mission.on_refusal(request.number, outcome, response.error_message)
        if not is_awaited:
            self.get_logger().warning(f'late answer for tag {request.tag_id!r} left aside')
        self._step()

    def record(self, observation: Observation) -> None:
        """Write an observation to the report, and say so."""
        self.report.record(observation)
        tag = f"tag '{printable(observation.tag_id, 64)}'"
        if observation.reading:
            values = ', '.join(f'{name} {value:.3f}' for name, value in observation.reading.values.items())
            self.get_logger().info(f'{tag}: {values}')
        else:
            reason = f'{observation.outcome.value}: {printable(observation.detail, 500)}'
            self.get_logger().warning(f'{tag}: scan failed after {observation.attempts} requests: {reason}')

    def _pause(self, _request, response):
        response.success = self.mission.pause()
        response.message = 'paused' if response.success else 'nothing to pause'
        return response

    def _resume(self, _request, response):
        response.success = self.mission.resume()
        response.message = 'resumed' if response.success else 'nothing to resume'
        return response


def _reading(message) -> Reading:
    return Reading(
        message.tag_id,
        (message.stamp.sec, message.stamp.nanosec),
        message.sim_time_of_day_seconds,
        {each.name: each.value for each in message.readings},
    )


def main(args=None):
    """Run one mission; exit code 0 all tags read, 1 some not, 2 what was asked for cannot be done."""
    try:
        rclpy.init(args=args)
    except RuntimeError as error:
        return _refuse(f'the ROS arguments are not understood: {error}')
    node = None
    try:
        executor = SingleThreadedExecutor()
        node = MissionNode()
        executor.add_node(node)
        # Not spin(): a SIGTERM that falls between two of its endless waits is never noticed.
        while rclpy.ok() and node.mission.state is not State.DONE:
            executor.spin_once(timeout_sec=LONGEST_WAIT_SECONDS)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (BridgeError, NameValidationException, ParameterException) as error:
        return _refuse(str(error))
    except Exception:
        if rclpy.ok():  # else a signal took the context away during start-up
            raise
    finally:
        rclpy.try_shutdown()
    if node is None:
        return SOME_NOT_READ
    print(summary_table(node.report.observations, node.tag_ids), flush=True)
    found = last_of_each_tag(node.report.observations)
    all_read = all(tag in found and found[tag].outcome is Outcome.OK for tag in node.tag_ids)
    return ALL_READ if all_read else SOME_NOT_READ


def _refuse(reason: str) -> int:
    get_logger(NODE_NAME).fatal(' '.join(reason.split()))
    return REFUSED


if __name__ == '__main__':
    sys.exit(main())
