"""
ROS 2 node `mission_orchestrator`: visits the tags, reads each over ROS, and publishes what it finds.

ros2 run lupin_mission mission_orchestrator --ros-args -p tag_sequence:="6 21 29"
"""

import contextlib
import time
import uuid
from collections.abc import Callable
from concurrent.futures import Future as PlanFuture
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, escaped, names_text, pluralized
from lupin_greenhouse_bridge.runtime.output import print_line
from lupin_greenhouse_bridge.runtime.parameters import declare_parameters
from lupin_greenhouse_bridge.runtime.rclpy_internals import steady_timer
from lupin_greenhouse_bridge.runtime.run import run
from lupin_greenhouse_bridge.simulator.layout import natural_order
from lupin_msgs.srv import StartMission
from lupin_readings.report_line import Observation, Outcome
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from lupin_mission.announcer import Announcer
from lupin_mission.drive import Drive, SimulatedDrive
from lupin_mission.messages import MISSION_TYPE, Run, lifecycle_of, reply_of
from lupin_mission.mission import Mission, Severity, State
from lupin_mission.nav2_drive import Nav2Drive
from lupin_mission.plan import Place, Plan
from lupin_mission.planner import Drives, Planner
from lupin_mission.report import Report, ReportError, read_tags, summary_table
from lupin_mission.settings import WITHOUT_EFFECT, Settings
from lupin_mission.tag_positions import TagPositions
from lupin_mission.tags import Tags
from lupin_mission.transport import Transport
from lupin_mission.visit import Request, Service

ALL_READ, SOME_NOT_READ, REFUSED, NOT_WRITTEN = 0, 1, 2, 4
NODE_NAME = 'mission_orchestrator'
STEP_SECONDS = 0.02
LONGEST_STOP_SECONDS = 2.0
MOST_NAMED = 30  # tags in one line of the log
NOT_KNOWN_YET = 'the tags are not known yet: start the bridge'
OTHER_MISSION = 'another mission publishes mission/state: end it, or give one of them a namespace'
TAG_TWICE = 'tag_sequence names a tag twice: a mission visits a tag once'
RELEASE_ESTOP = 'the e-stop is engaged: release it first'
INTERRUPTED = 'the node was ended'


class MissionNode(Node):
    """
    Connects a Mission to its clock, services, report and publishers.

    No callback blocks. One mission runs at a time. It starts when mission/start is called, or immediately.
    """

    # ROS also destroys a node whose constructor has raised.
    _drive: Drive = SimulatedDrive(0.0)
    _planner: Planner | None = None
    _report: Report | None = None

    def __init__(self) -> None:
        """Open the report and start; raises StartUpError and ReportError."""
        super().__init__(NODE_NAME)
        self._settings = settings = declare_parameters(self, Settings, without_effect=WITHOUT_EFFECT)
        self._tags = Tags(settings)
        self._positions = TagPositions(self, settings.frame_id, settings.amcl_pose_topic)
        if ids := settings.chosen_tag_ids:  # ROS reads 010 as the number 8
            self.get_logger().info(f'tag_sequence: {names_text("tag", ids, MOST_NAMED)}')
        self._transport = Transport(self, settings)
        self.current: Run | None = None
        is_simulated = settings.drive == 'simulated'
        remark = 'simulated drive' if is_simulated else ''
        self._announcer = Announcer(self, settings.frame_id, remark)
        if not settings.wait_for_start:
            self._report = self._open_report('')
        self._deadline_for_subscriber: float | None = None
        self._is_estop_engaged = False
        self._is_ending = False
        self._stop_deadline: float | None = None
        if is_simulated:
            self._drive = SimulatedDrive(settings.drive_seconds)
            self.get_logger().info('the drive is simulated, so no robot moves: set drive:=nav2 on a robot')
        else:
            self._drive = Nav2Drive(self, settings, self.note, lambda: self._positions.robot_pose)
            self._planner = Planner(self, settings, self._tags)
        self._planned: Plan | None = None
        self._first_plan: PlanFuture[Drives] | None = None
        for name, operate in (
            ('pause', Mission.pause),
            ('resume', Mission.resume),
            ('skip_current', Mission.skip),
            ('abort', Mission.abort),
        ):
            self.create_service(Trigger, f'mission/{name}', partial(self._trigger, operate))
        self.create_service(Trigger, 'mission/dock', self._dock)
        self.create_service(Trigger, 'mission/reset', self._reset)
        # mission/start waits for the plan, and no other callback may wait for mission/start.
        own_group = MutuallyExclusiveCallbackGroup()
        self.create_service(StartMission, 'mission/start', self._start, callback_group=own_group)
        self.create_subscription(Bool, settings.estop_topic, self._on_estop, QoSProfile(depth=10))
        steady_timer(self, 1.0 / settings.state_publish_rate_hz, self._publish_state)
        steady_timer(self, STEP_SECONDS, self._step)
        has_service = partial(self._transport.is_available, Service.READ)
        self._tags.find(self, has_service, self._on_tags, self._on_tag_positions)

    @property
    def mission(self) -> Mission | None:
        """The mission that was started last."""
        return self.current.mission if self.current else None

    def is_done(self) -> bool:
        """Return True once a mission that started without a call is done."""
        is_over = bool(self.mission and self.mission.state is State.DONE)
        return is_over and not self._settings.wait_for_start

    def is_idle(self) -> bool:
        """Return True if the node waits for its first mission/start, or for one after a reset."""
        return self._settings.wait_for_start and self.current is None

    def _open_report(self, mission_id: str) -> Report | None:
        """Open the report of a mission; None, with a warning, if the folder is read-only."""
        path = Path(self._settings.report_file or time.strftime('mission-%Y%m%dT%H%M%S.jsonl'))
        try:
            return Report(path.with_name(f'{path.stem}-{mission_id}{path.suffix}') if mission_id else path)
        except ReportError as error:
            if self._settings.report_file:
                raise
            self.note(f'the mission writes no report: {error}', Severity.WARN)
            return None

    def farewell(self) -> None:
        """Stop the robot, close all tags, and publish the state once more; wait for both, with timeouts."""
        if self.executor:
            self._stop_robot(self.executor)
        if self.mission:
            self.mission.end(INTERRUPTED)
        self._publish_state()
        self._announcer.wait_for_subscribers()

    def _stop_robot(self, executor: Executor) -> None:
        """Stop the drive, and wait until it has ended. farewell() and destroy_node() share the timeout."""
        self._is_ending = True
        self._drive.stop()
        if self._stop_deadline is None:
            self._stop_deadline = time.monotonic() + LONGEST_STOP_SECONDS
        while not self._drive.is_over() and time.monotonic() < self._stop_deadline:
            executor.spin_once(timeout_sec=STEP_SECONDS)

    def destroy_node(self) -> None:
        """Stop the robot, and close the report, so that another mission can continue it."""
        if not self._drive.is_over():
            executor = SingleThreadedExecutor(context=self.context)  # The executor of run() is closed.
            executor.add_node(self)
            with contextlib.suppress(OneLineError):  # The first error has been logged.
                self._stop_robot(executor)
            executor.shutdown(timeout_sec=0)
        self._drive.close()
        self._drive = SimulatedDrive(0.0)
        if self._planner:
            self._planner.close()
        if self._report:
            self._report.close()
            self._report = None
        super().destroy_node()

    # The mission

    def _on_tags(self) -> None:
        """Schedule the start of the mission, unless it waits for mission/start."""
        self.note(f'{pluralized(len(self._chosen_ids()), "tag")} known', Severity.INFO)
        self._on_tag_positions()
        if not self._settings.wait_for_start:
            self._deadline_for_subscriber = time.monotonic() + self._settings.dependency_timeout_s

    def _begin_when_heard(self, deadline: float) -> None:
        """Start the mission when its readings have a subscriber, or at the deadline."""
        if self._settings.wait_for_subscriber and not self._announcer.is_heard():
            if time.monotonic() < deadline:
                return
            event = 'mission/readings has no subscriber: the mission starts without one'
            self.note(event, Severity.WARN)
        self._deadline_for_subscriber = None
        if self.executor:
            self.executor.create_task(self._plan_and_begin, self._new_mission_id(), self._chosen_ids())

    def _on_tag_positions(self) -> None:
        """Plan the drives once, so that wrong settings are reported early."""
        self._positions.in_layout = self._tags.positions_m
        if self._settings.has_poses_in_map and not self._tags.positions_m:
            event = "the positions of the tags are unknown: set tag_locations_file to the bridge's tag_file"
            self.note(event, Severity.WARN)
        if self._planner:
            self._first_plan = self._planner.plan(self._chosen_ids())

    def _take(self, drives: Drives) -> None:
        self._planned = drives.plan
        if isinstance(self._drive, Nav2Drive):
            self._drive.goals, self._drive.unreachable = drives.plan.goals, drives.plan.unreachable
        for warning in drives.warnings:
            self.note(warning, Severity.WARN)

    def _chosen_ids(self) -> list[str]:
        """Return the tags of tag_sequence, or all tags in natural order if it is empty."""
        return self._settings.chosen_tag_ids or sorted(self._tags.ids, key=natural_order)

    async def _plan_and_begin(self, mission_id: str, tag_ids: list[str]) -> None:
        """Visit the tags that have no reading in the report; raises StartUpError and ReportError."""
        before = self.current
        # With wait_for_start, each mission has its own report.
        is_continued = not self._settings.wait_for_start
        observations = list(self._report.observations) if self._report and is_continued else []
        read_before = read_tags(observations)
        to_visit = [tag_id for tag_id in tag_ids if tag_id not in read_before]
        mission = Mission(to_visit, self, self._drive, self._settings)
        if self._is_estop_engaged:
            mission.engage_estop()
        self.current = run = Run(mission_id, mission, tag_ids, observations, self.get_clock().now().to_msg())
        try:
            if self._planner:
                await self._plan(self._planner, mission)
            if self._settings.wait_for_start and mission.state is not State.DONE:
                report = self._open_report(mission_id)
                if self._report:
                    self._report.close()
                self._report = report
        except OneLineError:
            self.current = before
            raise
        run.is_planning = False
        if mission.state is State.DONE:  # It was aborted during the planning.
            return
        count = f'{pluralized(len(to_visit), "tag")} to visit, {len(tag_ids) - len(to_visit)} read before'
        self._announcer.begin_anew(f'{count}; report: {self._report.path if self._report else "none"}')
        self._step()

    async def _plan(self, planner: Planner, mission: Mission) -> None:
        """Wait for the plan of a mission without blocking the executor; raises StartUpError."""
        plan = planner.plan_mission(list(mission.tag_ids), self._robot_m())
        is_planned: Future[None] = Future()
        plan.add_done_callback(lambda _plan: is_planned.set_result(None))
        await is_planned
        self._take(plan.result())
        mission.reorder(plan.result().tag_ids)

    def _robot_m(self) -> Place | None:
        """Return the robot's x and y in the map, from its localization or from the last drive."""
        if robot := self._positions.robot_position:
            return robot.x, robot.y
        return self._drive.position_m()

    def _step(self) -> None:
        if self._first_plan and self._first_plan.done():
            drives, self._first_plan = self._first_plan.result(), None
            self._take(drives)
        if self._deadline_for_subscriber is not None:
            self._begin_when_heard(self._deadline_for_subscriber)
        run = self.current
        if run is None or run.is_planning or self._is_ending or self._tags.is_waiting_for_tags():
            return
        if run.fault:
            run.mission.end('the report is lost')
        if not run.mission.is_paused:
            self._transport.send_when_ready()
        run.mission.step(time.monotonic())
        self._announcer.moved(run.mission)

    def _publish_state(self) -> None:
        lifecycle = self._lifecycle()
        self._announcer.publish_state(self.current, lifecycle, is_estop_engaged=self._is_estop_engaged)

    def _lifecycle(self) -> str:
        return lifecycle_of(self.current, has_tags=self._tags.has_tags_to_visit())

    # The MissionPorts of the mission

    def send(self, request: Request) -> None:
        """Send a request as soon as its service is available. The mission handles the timeout."""
        if self.mission:
            self._transport.send(request, partial(self._on_response, self.mission, request))

    def abandon(self, request: Request) -> Outcome:
        """Forget a request; a late reply is ignored."""
        return self._transport.abandon(request)

    def _on_response(self, mission: Mission, request: Request, response: Any) -> None:
        if not mission.on_reply(request, *reply_of(request, response)):
            self.note(f'ignored a late reply for tag {request.tag_id!r}', Severity.WARN)
        self._step()

    def record(self, observation: Observation) -> None:
        """Publish an observation and write it to the report. The next step ends a mission if this fails."""
        run = self.current
        if run is None:
            return
        position = self._positions.position_of(observation.tag_id)
        self._announcer.closed(observation, run.mission_id, position)
        drive = '' if self._settings.drive == 'nav2' else self._settings.drive
        goal = None
        if self._planned and observation.outcome is Outcome.UNREACHABLE:
            goal = self._planned.goal_in_layout_m(observation.tag_id, observation.pose)
        run.observations.append(replace(observation, drive=drive, goal=goal))
        if self._report and not (run.fault or run.is_planning):
            try:
                self._report.record(run.observations[-1])
            except ReportError as error:
                run.fault, run.mission.is_paused = str(error), True
                self.note(run.fault, Severity.ERROR)
        self._publish_state()

    def fault(self) -> str:
        """Return why the report of the last mission is lost; '' if it is not."""
        if not self.current or not self._report:
            return ''
        return self.current.fault or self._report.fault()

    def note(self, event: str, severity: Severity, code: str = '') -> None:
        """Report an event."""
        self._announcer.note(event, severity, code)

    # The commands of people

    def _on_estop(self, message: Bool) -> None:
        """Stop the robot immediately; after a release, it does not move until resume()."""
        if message.data == self._is_estop_engaged:
            return
        self._is_estop_engaged = message.data
        # This note comes after the pause, which reports an event too.
        if message.data:
            if self.mission:
                self.mission.engage_estop()
            self.note('e-stop engaged', Severity.WARN)
            return
        if self.mission:
            self.mission.release_estop()
        is_paused = bool(self.mission and self.mission.is_paused)
        next_step = ': call mission/resume to go on' if is_paused else ''
        self.note(f'e-stop released{next_step}', Severity.WARN if is_paused else Severity.INFO)

    def _trigger(
        self, operate: Callable[[Mission], bool], _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        verb = operate.__name__
        response.success = bool(self.mission and operate(self.mission))
        response.message = f'{verb}: done' if response.success else f'there is nothing to {verb}'
        if operate is Mission.resume and self._is_estop_engaged:
            response.message = RELEASE_ESTOP
        self._step()
        return response

    def _dock(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        lifecycle = self._lifecycle()
        if self.mission and self.mission.dock():
            response.success, response.message = True, 'heading to dock'
        elif lifecycle in ('BOOT', 'READY'):
            response.success, response.message = True, 'no mission runs: nothing moves'
        elif lifecycle == 'RETURNING':
            response.message = 'already returning to dock'
        elif lifecycle == 'INSPECTING':
            response.message = 'there is no dock: set dock_pose'
        else:
            response.message = f'cannot dock in state {lifecycle}'
        self._step()
        return response

    def _reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget a mission that has lost its report, so that the state is READY again."""
        self._step()  # This ends a mission that has lost its report.
        run = self.current
        if self._settings.wait_for_start and run and run.fault and run.mission.state is State.DONE:
            self.current = None
            self._announcer.begin_anew('reset: ready for mission/start')
            response.success = True
        response.message = 'reset: done' if response.success else 'there is nothing to reset'
        return response

    async def _start(
        self, request: StartMission.Request, response: StartMission.Response
    ) -> StartMission.Response:
        self._step()  # This ends a mission that has lost its report.
        mission_id = self._new_mission_id()
        reason = self._reason_against(request)
        if not reason:
            try:
                await self._plan_and_begin(mission_id, list(request.tag_sequence) or self._chosen_ids())
            except (StartUpError, ReportError) as error:
                reason = str(error)
        if reason:
            self.note(f'start rejected: {reason}', Severity.WARN)
            response.error_message = reason
            return response
        response.accepted, response.mission_id = True, mission_id
        return response

    def _new_mission_id(self) -> str:
        prefix = self._settings.mission_id_prefix
        return f'{prefix}-{time.strftime("%Y%m%dT%H%M%S")}-{uuid.uuid4().hex[:6]}'

    def _reason_against(self, request: StartMission.Request) -> str:
        """Return why a mission cannot be started as requested; '' if it can."""
        run, sequence, kind = self.current, list(request.tag_sequence), escaped(request.mission_type, 40)
        is_running = self._lifecycle() in ('PREPARE', 'INSPECTING', 'RETURNING')
        known = set(self._tags.ids or self._settings.chosen_tag_ids)
        unknown = [tag_id for tag_id in sequence if tag_id not in known]
        shown = escaped(unknown[0], 40) if unknown else ''
        reasons = (
            (self._is_ending, 'the node is about to end'),
            (is_running, f'mission already running: abort {run and run.mission_id}, or wait for its end'),
            (self._is_estop_engaged, RELEASE_ESTOP),
            (self._announcer.has_other_mission(), OTHER_MISSION),
            (not known or (unknown and not self._tags.ids), NOT_KNOWN_YET),
            (kind not in ('', MISSION_TYPE), f"mission_type is '{kind}': must be {MISSION_TYPE} or empty"),
            (unknown, f"tag '{shown}' is unknown: must be one of the {len(known)} tags of the greenhouse"),
            (len(set(sequence)) < len(sequence), TAG_TWICE),
        )
        return next((reason for applies, reason in reasons if applies), '')


def main(args: list[str] | None = None) -> int:
    """Run the mission; exit code 0: all tags read, 1: some not, 2: start-up error, 4: output not written."""
    return run(
        NODE_NAME, MissionNode, args, is_done=MissionNode.is_done, conclude=_conclude, refusal_code=REFUSED
    )


def _conclude(node: MissionNode) -> int:
    """Print the table, even of an interrupted mission; return the exit code."""
    fault = node.fault()
    node.farewell()
    if node.is_idle():
        return ALL_READ
    observations, tag_ids = (node.current.observations, node.current.tag_ids) if node.current else ([], [])
    print_line(summary_table(observations, tag_ids))
    if fault := fault or node.fault():
        node.get_logger().fatal(fault)
        return NOT_WRITTEN
    return ALL_READ if tag_ids and read_tags(observations).issuperset(tag_ids) else SOME_NOT_READ
