"""ROS 2 node `mission`: visits the tags, has each read over ROS, and writes the report."""

import sys
import time
from functools import partial

from lupin_msgs.srv import ConfirmTag, GetTagReading
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidServiceNameException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import Trigger

from lupin_mission import client, life_cycle
from lupin_mission.drive import TimedDrive
from lupin_mission.errors import StartUpError, printable
from lupin_mission.layout import read_layout
from lupin_mission.mission import Mission, Request, Service, State
from lupin_mission.report import Observation, Outcome, Reading, Report, last_of_each_tag, summary_table
from lupin_mission.settings import Settings

ALL_READ, SOME_NOT_READ, REFUSED = 0, 1, 2
NODE_NAME = 'mission'
STEP_SECONDS = 0.02
LONGEST_WAIT_FOR_TAGS_SECONDS = 30.0
ASK_FOR_TAGS_EVERY_SECONDS = 0.5
REFUSALS = {each.value: each for each in (Outcome.UNKNOWN_TAG, Outcome.SIMULATOR_ERROR)}
LATCHED_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class MissionNode(Node):
    """The surroundings of one Mission: its clock, its two services, its report. Nothing here ever waits."""

    def __init__(self):
        """Open the report and start; raises StartUpError and ReportError."""
        super().__init__(NODE_NAME)
        self._settings = settings = life_cycle.declare_parameters(self, Settings)
        tag_ids = settings.chosen_tag_ids
        if not tag_ids and settings.tag_file:
            tag_ids = list(read_layout(settings.tag_file).tags)
        self._service_clients = {
            Service.CONFIRM: self._client(ConfirmTag, settings.confirm_service_name),
            Service.READ: self._client(GetTagReading, settings.bridge_service_name),
        }
        self.tag_ids: list[str] = []
        self.mission: Mission | None = None  # until the tags are known
        self.report = Report(settings.report_file or time.strftime('mission-%Y%m%dT%H%M%S.jsonl'))
        self._unsent: Request | None = None  # until its service is there
        self._future = None  # of the request that is on its way
        self._at_tag = self.create_publisher(String, '~/at_tag', LATCHED_QOS)
        self._published_tag = None
        self.create_service(Trigger, '~/pause', self._pause)
        self.create_service(Trigger, '~/resume', self._resume)
        if tag_ids:
            self._set_out(tag_ids)
        else:
            self._ask_for_tags()

    def _ask_for_tags(self) -> None:
        """Ask the bridge which tags it has loaded, again and again, as an early request may be dropped."""
        parameters = self._client(
            GetParameters, client.parameter_service_of(self._service_clients[Service.READ].srv_name)
        )
        deadline = time.monotonic() + LONGEST_WAIT_FOR_TAGS_SECONDS

        def ask():
            if self.mission:
                timer.cancel()
            elif time.monotonic() >= deadline:
                raise StartUpError(
                    f'{parameters.srv_name} named no tags within {LONGEST_WAIT_FOR_TAGS_SECONDS:g} s:'
                    ' start the bridge, or set tag_ids or tag_file'
                )
            elif parameters.service_is_ready():
                parameters.call_async(client.tag_ids_request()).add_done_callback(on_reply)

        def on_reply(future):
            if not self.mission and (tag_ids := client.tag_ids_of(future.result())):
                self._set_out(tag_ids)

        self.get_logger().info(f'waiting for the tags of {parameters.srv_name}')
        timer = self._timer(ASK_FOR_TAGS_EVERY_SECONDS, ask)

    def _set_out(self, tag_ids: list[str]) -> None:
        """Make the mission to those tags that the report has no reading of."""
        found = last_of_each_tag(self.report.observations)
        to_visit = [tag for tag in tag_ids if tag not in found or found[tag].outcome is not Outcome.OK]
        self.tag_ids = tag_ids
        self.mission = Mission(
            to_visit,
            self,
            TimedDrive(self._settings.drive_seconds),
            self._settings.limits,
            require_visual_confirmation=self._settings.require_visual_confirmation,
        )
        self.get_logger().info(
            f'{len(to_visit)} tags to visit, {len(tag_ids) - len(to_visit)} read before;'
            f' report: {self.report.path}'
        )
        self._timer(STEP_SECONDS, self._step)

    def _timer(self, seconds: float, callback):
        # A clock that neither jumps nor stops, whatever use_sim_time says.
        return self.create_timer(seconds, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def is_done(self) -> bool:
        """Return True once every tag has its outcome."""
        return bool(self.mission and self.mission.state is State.DONE)

    def _client(self, service_type, name: str):
        try:
            return self.create_client(service_type, name, qos_profile=client.SERVICE_QOS)
        except InvalidServiceNameException as error:
            raise StartUpError(f'{name!r} is not a service name: {error}') from error

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
            outcome = REFUSALS.get(client.STATUS_NAMES.get(response.status), Outcome.BAD_READING)
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
        response.success = bool(self.mission and self.mission.pause())
        response.message = 'paused' if response.success else 'nothing to pause'
        return response

    def _resume(self, _request, response):
        response.success = bool(self.mission and self.mission.resume())
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
    return life_cycle.run(
        NODE_NAME, MissionNode, args, is_done=MissionNode.is_done, conclude=_conclude, refused=REFUSED
    )


def _conclude(node: MissionNode) -> int:
    """Print the table, whether the mission came to its end or not; return the exit code."""
    print(summary_table(node.report.observations, node.tag_ids), flush=True)
    found = last_of_each_tag(node.report.observations)
    all_read = all(tag in found and found[tag].outcome is Outcome.OK for tag in node.tag_ids)
    return ALL_READ if node.tag_ids and all_read else SOME_NOT_READ


if __name__ == '__main__':
    sys.exit(main())
