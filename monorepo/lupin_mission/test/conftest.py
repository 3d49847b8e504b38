"""The real mission, with services that the test controls or with the real bridge."""

import queue
from pathlib import Path

import pytest
from lupin_mission.client import SERVICE_QOS
from lupin_mission.report import Outcome, read_report
from lupin_msgs.msg import SensorReading, TagReading
from lupin_msgs.srv import ConfirmTag, GetTagReading

pytest_plugins = ['lupin_greenhouse_bridge.testing']
PATIENCE_SECONDS = 30.0


class Commanded:
    """A service that replies only when the test says so."""

    def __init__(self, node, service_type, name: str):
        self.name = name
        self.tag_ids = []  # of the requests, in the order of arrival
        self._type = service_type
        self._arrived = queue.SimpleQueue()
        self._answers = queue.SimpleQueue()
        self._service = node.create_service(service_type, name, self._handle, qos_profile=SERVICE_QOS)

    def _handle(self, request, _response):
        tag_id = getattr(request, 'tag_id', None) or request.expected_tag_id
        self.tag_ids.append(tag_id)
        self._arrived.put(tag_id)
        return self._answers.get(timeout=2 * PATIENCE_SECONDS)

    def wait_for_request(self) -> str:
        """Return the tag id of the next request."""
        return self._arrived.get(timeout=PATIENCE_SECONDS)

    def answer(self, **fields) -> None:
        """Send the next reply, to a request that has arrived or will arrive."""
        response = self._type.Response()
        for name, value in fields.items():
            setattr(response, name, value)
        self._answers.put(response)

    def answer_ok(self, tag_id: str, **values: float) -> None:
        """Reply like the bridge."""
        readings = [SensorReading(name=name, value=value) for name, value in values.items()]
        reading = TagReading(tag_id=tag_id, sim_time_of_day_seconds=43200.0, readings=readings)
        self.answer(reading=reading)


class RunningMission:
    """One real mission and its report."""

    def __init__(self, process, report_file: Path):
        self.process = process  # a NodeProcess
        self.report_file = report_file

    def outcomes(self) -> list[tuple[str, Outcome]]:
        """Return (tag id, outcome) for each line of the report so far."""
        return [(each.tag_id, each.outcome) for each in read_report(self.report_file)]

    def __getattr__(self, name):
        return getattr(self.process, name)


@pytest.fixture
def start_mission(start_node, tmp_path):
    """Return a function that starts a mission with these parameters; it ends with the test."""
    from lupin_greenhouse_bridge.testing import executable

    def start(command=None, environment=None, **parameters):
        report_file = tmp_path / 'report.jsonl'
        settings = {'dwell_seconds': 0.0, 'retry_delay_seconds': 0.05, 'report_file': f'"{report_file}"'}
        command = command or [executable('lupin_mission', 'mission_node')]
        process = start_node(command, environment=environment, **{**settings, **parameters})
        return RunningMission(process, report_file)

    return start


@pytest.fixture
def node():
    """Return a node of the test, spun by a thread."""
    from lupin_greenhouse_bridge.testing import spinning_node

    with spinning_node('mission_test') as node:
        yield node


@pytest.fixture
def reader(node):
    """Return a GetTagReading service that the test controls."""
    return Commanded(node, GetTagReading, '/commanded/get_tag_reading')


@pytest.fixture
def confirmer(node):
    """Return a ConfirmTag service that the test controls."""
    return Commanded(node, ConfirmTag, '/commanded/confirm_tag')
