# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""A stand-in for the bridge that replies when the test says so."""

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from rclpy.node import Node

from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.interfaces import GetTagReading, SensorReading, TagReading
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS, spinning_node


def reading_of(
    tag_id: str, seconds: int = 100, nanoseconds: int = 0, time_of_day: float = 0.0, **values: float
) -> TagReading:
    """Return a reading with this stamp, this time of day in seconds and these values by sensor name."""
    readings = [SensorReading(name=name, value=value) for name, value in values.items()]
    reading = TagReading(tag_id=tag_id, sim_time_of_day_seconds=time_of_day, readings=readings)
    reading.stamp.sec, reading.stamp.nanosec = seconds, nanoseconds
    return reading


class SlowBridge:
    """
    A service of readings that withholds each reply until reply(), to test timeouts and late replies.

    `requests` lists the tag ids so far. `status`, `error_message` and `fields` (of the reading) change the
    replies. A request without a tag id is answered at once.
    """

    name = '/slow/get_tag_reading'

    def __init__(self, node: Node) -> None:
        self.status, self.error_message = GetTagReading.Response.STATUS_OK, ''
        self.fields: dict[str, Any] = {}
        self.node = node
        self.requests: list[str] = []
        self._replies = threading.Semaphore(0)
        node.create_service(GetTagReading, self.name, self._reply, qos_profile=SERVICE_QOS)

    def _reply(self, request: Any, response: Any) -> Any:
        if request.tag_id:
            self.requests.append(request.tag_id)
            self._replies.acquire(timeout=PATIENCE_SECONDS)
        response.status, response.error_message = self.status, self.error_message
        fields = {
            'tag_id': request.tag_id,
            'sim_time_of_day_seconds': float(len(self.requests)),
            'readings': [SensorReading(name='co2', value=400.0)],
        }
        response.reading = TagReading(**{**fields, **self.fields})
        return response

    def reply(self, times: int = 1) -> None:
        """Send as many replies, of present requests and of later ones."""
        for _ in range(times):
            self._replies.release()


@contextlib.contextmanager
def running_slow_bridge() -> Iterator[SlowBridge]:
    """Yield a SlowBridge on its own node."""
    with spinning_node('slow') as node:
        bridge = SlowBridge(node)
        try:
            yield bridge
        finally:
            bridge.reply(1000)  # without a reply, its node could not end


@pytest.fixture
def slow_bridge() -> Iterator[SlowBridge]:
    """Return a service that replies only when the test says so."""
    with running_slow_bridge() as bridge:
        yield bridge
