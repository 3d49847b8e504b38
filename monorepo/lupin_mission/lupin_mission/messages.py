"""Convert between the mission's objects and the team's messages."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion
from lupin_greenhouse_bridge.contract import answer_of
from lupin_msgs.msg import MissionState, SensorReading, TagReading
from lupin_msgs.msg import Observation as ObservationMessage
from lupin_readings.report_line import Observation, Outcome, Reading

from lupin_mission.mission import Mission, State
from lupin_mission.visit import Request, Service

MISSION_TYPE = 'InspectionMission'
OBSERVATIONS_TOPIC = '/floranova/observations'  # absolute: the robots share one twin
LIFECYCLE_STATES = {
    State.PREPARE: 'PREPARE',
    State.DRIVING: 'INSPECTING',
    State.INSPECTING: 'INSPECTING',
    State.DOCKING: 'RETURNING',
    State.DOCKED: 'RETURNING',
    State.RETURNING: 'RETURNING',
    State.DONE: 'DONE',
}
# The other outcomes are failed scans.
STATUSES = {
    Outcome.OK: ObservationMessage.STATUS_OK,
    Outcome.SKIPPED: ObservationMessage.STATUS_SKIPPED,
    Outcome.UNREACHABLE: ObservationMessage.STATUS_UNREACHABLE,
}


@dataclass
class Run:
    """One mission from its start on, with its results."""

    mission_id: str
    mission: Mission
    tag_ids: list[str]  # includes the tags that were read before
    observations: list[Observation]  # includes those that the report had before
    started_at: Time
    is_planning: bool = True
    fault: str = ''  # why the report is lost


def reply_of(request: Request, response: Any) -> tuple[Outcome, str, Reading | None]:
    """Return the outcome, the detail and the reading in a response, for Mission.on_reply()."""
    tag = f'tag {request.tag_id}: '  # A reply may start with it, and the mission's messages name the tag too.
    if request.service is Service.CONFIRM:
        outcome = Outcome.OK if response.detected else Outcome.NOT_CONFIRMED
        return outcome, response.error_message.removeprefix(tag), None
    answer = answer_of(request.tag_id, response)
    if answer.reading is None:
        outcome = Outcome.__members__.get(answer.status, Outcome.BAD_READING)
        return outcome, answer.error_message.removeprefix(tag), None
    message = answer.reading
    values = {sensor.name: sensor.value for sensor in message.readings}
    stamp = message.stamp.sec, message.stamp.nanosec
    return Outcome.OK, '', Reading(message.tag_id, stamp, message.sim_time_of_day_seconds, values)


def status_of(outcome: Outcome) -> int:
    """Return the status of an Observation with this outcome. The counts of MissionState use it too."""
    return int(STATUSES.get(outcome, ObservationMessage.STATUS_SCAN_FAILED))


def observation_message(
    observation: Observation, mission_id: str, position: Point | None
) -> ObservationMessage:
    """
    Return the message for the observation of one tag, without its header.

    Only a tag that was read gets a reading and, if its position in the map is known, a pose. The team's nodes
    assume that a tag was inspected if a reading has its id.
    """
    message = ObservationMessage(
        kind=ObservationMessage.KIND_TAG_READING,
        mission_id=mission_id,
        source=MISSION_TYPE,
        status=status_of(observation.outcome),
        tag_pose_in_map=pose_at(position if observation.reading else None),
    )
    message.flower.pose.pose = message.anomaly.pose.pose = pose_at(None)
    if observation.reading:
        pose = f'read from pose {observation.pose}' if observation.pose > 1 else ''
        message.status_detail = '; '.join(filter(None, (pose, observation.detail)))
        message.tag_reading = tag_reading_message(observation.reading)
    else:
        outcome = observation.outcome.value
        message.status_detail = f'tag {observation.tag_id}: {outcome}: {observation.detail}'
    return message


def tag_reading_message(reading: Reading) -> TagReading:
    """Return the message with these contents."""
    seconds, nanoseconds = reading.stamp
    return TagReading(
        tag_id=reading.tag_id,
        stamp=Time(sec=seconds, nanosec=nanoseconds),
        sim_time_of_day_seconds=reading.sim_time_of_day_seconds,
        readings=[SensorReading(name=name, value=value) for name, value in reading.values.items()],
    )


def pose_at(position: Point | None) -> Pose:
    """Return a pose at a position, without a direction. An unset pose has w = 0; the default of ROS is 1."""
    return Pose(position=position or Point(), orientation=Quaternion(w=float(position is not None)))


def lifecycle_of(run: Run | None, *, has_tags: bool) -> str:
    """Return the lifecycle_state of MissionState. The replies of the node depend on it too."""
    if run is None:
        return 'READY' if has_tags else 'BOOT'
    return 'FAULT' if run.fault else LIFECYCLE_STATES[run.mission.state]


def state_message(run: Run | None, lifecycle: str) -> MissionState:
    """Return the state of a mission, or of a node without one; the caller adds the header and the events."""
    if run is None:
        return MissionState(lifecycle_state=lifecycle, battery_percentage=1.0)
    mission = run.mission
    counts = Counter(map(status_of, mission.outcomes.values()))
    return MissionState(
        mission_id=run.mission_id,
        mission_type=MISSION_TYPE,
        lifecycle_state=lifecycle,
        mission_phase=mission.phase,
        current_target=mission.target or '',
        targets_total=len(mission.tag_ids),
        targets_completed=counts[ObservationMessage.STATUS_OK],
        targets_skipped=counts[ObservationMessage.STATUS_SKIPPED],
        targets_unreachable=counts[ObservationMessage.STATUS_UNREACHABLE],
        targets_failed=counts[ObservationMessage.STATUS_SCAN_FAILED],
        paused=mission.is_paused,
        battery_percentage=1.0,
        started_at=run.started_at,
    )
