"""The real mission, between services that the test commands, or with the real bridge."""

import contextlib
import importlib.util
import queue
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix
from lupin_mission.report import Outcome, read_report
from lupin_msgs.msg import SensorReading, TagReading
from lupin_msgs.srv import ConfirmTag, GetTagReading

# What the bridge's tests share, from beside this package: nodes as processes, on a domain of the run's own.
_path = Path(__file__).resolve().parents[2] / 'lupin_greenhouse_bridge/test/conftest.py'
_spec = importlib.util.spec_from_file_location('bridge_conftest', _path)
bridge = sys.modules['bridge_conftest'] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(bridge)
own_domain = bridge.own_domain
shipped_tags = bridge.shipped_tags

MISSION_NODE = str(Path(get_package_prefix('lupin_mission'), 'lib/lupin_mission/mission_node'))
PATIENCE_SECONDS = bridge.PATIENCE_SECONDS


class Commanded:
    """A service whose every answer the test gives; until then the caller waits."""

    def __init__(self, node, service_type, name: str):
        self.name = name
        self.tag_ids = []  # of the requests, in the order of their coming
        self._type = service_type
        self._arrived = queue.SimpleQueue()
        self._answers = queue.SimpleQueue()
        self._service = node.create_service(service_type, name, self._handle, qos_profile=bridge.CLIENT_QOS)

    def _handle(self, request, _response):
        tag_id = getattr(request, 'tag_id', None) or request.expected_tag_id
        self.tag_ids.append(tag_id)
        self._arrived.put(tag_id)
        return self._answers.get(timeout=2 * PATIENCE_SECONDS)

    def wait_for_request(self) -> str:
        """Return the tag id of the next request."""
        return self._arrived.get(timeout=PATIENCE_SECONDS)

    def answer(self, **fields) -> None:
        """Give the next answer, to a request that has come or will come."""
        response = self._type.Response()
        for name, value in fields.items():
            setattr(response, name, value)
        self._answers.put(response)

    def answer_ok(self, tag_id: str, **values: float) -> None:
        """Answer as the bridge does."""
        readings = [SensorReading(name=name, value=value) for name, value in values.items()]
        reading = TagReading(tag_id=tag_id, sim_time_of_day_seconds=43200.0, readings=readings)
        self.answer(reading=reading)


class MissionProcess(bridge.NodeProcess):
    """One real mission and its report."""

    def __init__(self, stack: contextlib.ExitStack, report_file: Path, parameters: dict):
        settings = {'dwell_seconds': 0.0, 'retry_delay_seconds': 0.05, 'report_file': f'"{report_file}"'}
        super().__init__(stack, [MISSION_NODE], {**settings, **parameters}, {})
        self.report_file = report_file

    def outcomes(self) -> list[tuple[str, Outcome]]:
        """Return (tag id, outcome) for each line of the report so far."""
        return [(each.tag_id, each.outcome) for each in read_report(self.report_file)]

    def end(self) -> int:
        """Wait until the mission ends by itself, and return its exit code."""
        assert 'Traceback' not in '\n'.join(self.rest_of_log())
        return self.process.wait(PATIENCE_SECONDS)


@pytest.fixture
def stack():
    with contextlib.ExitStack() as stack:
        yield stack


@pytest.fixture
def start_mission(stack, tmp_path):
    """Return a function that starts a mission with these parameters; it ends with the test."""
    return lambda **parameters: MissionProcess(stack, tmp_path / 'report.jsonl', parameters)


@pytest.fixture
def node(stack):
    """Return a node of the test's own, which a thread spins."""
    return stack.enter_context(bridge.spinning_node('mission_test'))


@pytest.fixture
def reader(node):
    """Return a GetTagReading service that the test commands."""
    return Commanded(node, GetTagReading, '/commanded/get_tag_reading')


@pytest.fixture
def confirmer(node):
    """Return a ConfirmTag service that the test commands; one at a time answers."""
    return Commanded(node, ConfirmTag, '/commanded/confirm_tag')
