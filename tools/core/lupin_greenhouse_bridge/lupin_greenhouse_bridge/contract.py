"""What the bridge and its clients share: names, statuses, QoS, and the meaning of a reply."""

import math
from typing import NamedTuple

from rcl_interfaces.srv import GetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile

from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.interfaces import GetTagReading, TagReading

NODE_NAME = 'greenhouse_bridge'
DEFAULT_SERVICE = '/greenhouse_bridge/get_tag_reading'
TAG_IDS_PARAMETER = 'loaded_tag_ids'
TAG_FILE_PARAMETER = 'tag_file'
# ROS's default depth is 10, and DDS silently drops requests and replies beyond it. Each service receives the
# requests of all its clients, and each client the replies to all of them.
SERVICE_QOS = QoSProfile(depth=1000)
STATUS_NAMES = {
    getattr(GetTagReading.Response, f'STATUS_{name}'): name
    for name in ('OK', 'UNKNOWN_TAG', 'SIMULATOR_ERROR')
}


def latched(depth: int = 1) -> QoSProfile:
    """Return the QoS of a topic that also delivers its last messages to late subscribers."""
    return QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Answer(NamedTuple):
    """The reply to a request for a tag. It has a reading if and only if the status is OK."""

    tag_id: str
    status: str  # OK, UNKNOWN_TAG, SIMULATOR_ERROR, or BAD_READING for a reading that no bridge sends
    error_message: str
    reading: TagReading | None

    @property
    def is_ok(self) -> bool:
        """Whether the tag was read."""
        return self.reading is not None


def answer_of(tag_id: str, response: GetTagReading.Response) -> Answer:
    """Return the Answer in a response to a request for this tag."""
    if response.status != GetTagReading.Response.STATUS_OK:
        status = STATUS_NAMES.get(response.status, str(response.status))
        return Answer(tag_id, status, response.error_message, None)
    fault = fault_of_reading(response.reading)
    if not fault and response.reading.tag_id != tag_id:
        fault = f"it is of tag '{escaped(response.reading.tag_id, 64)}'"
    if fault:
        return Answer(tag_id, 'BAD_READING', f"the reading of tag '{escaped(tag_id, 64)}': {fault}", None)
    return Answer(tag_id, 'OK', response.error_message, response.reading)


def fault_of_reading(reading: TagReading) -> str:
    """Return why no bridge can have sent this TagReading; '' if a bridge can."""
    names = [value.name for value in reading.readings]
    values = [value.value for value in reading.readings]
    faults = (
        (not (reading.tag_id and names), 'it has no tag id or no values'),
        (not all(names), 'a value has no sensor name'),
        (len(set(names)) < len(names), 'two values have the same sensor name'),
        (not all(map(math.isfinite, values)), 'a value is not finite'),
        (
            reading.stamp.sec < 0 or reading.stamp.nanosec >= 1_000_000_000,
            'its stamp is not a time since 1970',
        ),
        (not 0.0 <= reading.sim_time_of_day_seconds < 86400.0, 'its time of day is outside [0, 86400) s'),
    )
    return next((fault for is_wrong, fault in faults if is_wrong), '')


def parameter_service_of(service_name: str) -> str:
    """Return the parameter service of the node that offers `~/get_tag_reading` under this name."""
    return f'{service_name.rpartition("/")[0]}/get_parameters'


class BridgeInfo(NamedTuple):
    """The parameters of a bridge that its clients read."""

    tag_ids: list[str]  # in the order of its tag file; [] if the node is not a bridge
    tag_file: str  # '' for the one of mdp-greenhouse


def info_request() -> GetParameters.Request:
    """Return the request that a node's parameter service answers with its BridgeInfo."""
    return GetParameters.Request(names=[TAG_IDS_PARAMETER, TAG_FILE_PARAMETER])


def info_of(response: GetParameters.Response) -> BridgeInfo:
    """Return the BridgeInfo in a response to info_request()."""
    # A node without one of the parameters returns none of them.
    values = dict(zip(info_request().names, response.values, strict=False))
    if len(values) < 2:
        return BridgeInfo([], '')
    tag_ids = list(values[TAG_IDS_PARAMETER].string_array_value)
    return BridgeInfo(tag_ids, values[TAG_FILE_PARAMETER].string_value)
