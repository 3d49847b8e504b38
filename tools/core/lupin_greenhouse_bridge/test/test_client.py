"""The blocking client: one call at a time, each with a timeout."""

import threading
from types import SimpleNamespace

import pytest
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.reading import client
from lupin_greenhouse_bridge.reading.client import Client, NoAnswer
from lupin_greenhouse_bridge.runtime.rclpy_internals import pending_requests
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS, greet
from lupin_greenhouse_bridge.testing.slow_bridge import SlowBridge

MINE = GetTagReading.Request(tag_id='mine')
# The thread of `robot` spins the node.
PAUSE = SimpleNamespace(spin_once=lambda timeout_sec: threading.Event().wait(min(timeout_sec, 0.01)))


@pytest.fixture
def found(robot):
    """Return a client of the service, which the service has found."""
    found = Client(PAUSE, robot, PATIENCE_SECONDS).connect(GetTagReading, SlowBridge.name)
    greet(found, GetTagReading.Request())
    return found


@pytest.fixture
def times(monkeypatch):
    """Return the times that the clock shows, one after the other; it fails when it is asked more often."""
    times = []
    monkeypatch.setattr(client, 'time', SimpleNamespace(monotonic=lambda: times.pop(0)))
    return times


def test_the_wait_for_a_service_ends_at_its_timeout_and_not_before(robot, times):
    times += [100.0, 101.4, 102.0]
    with pytest.raises(NoAnswer, match=r'offers /nobody: '):
        Client(PAUSE, robot, 2.0).connect(GetTagReading, '/nobody')
    assert times == []


def test_a_call_ends_at_its_timeout_and_is_forgotten(slow_bridge, found, robot, times):
    spins = []

    def spin_once(timeout_sec):
        spins.append((timeout_sec, len(pending_requests(found))))

    times += [100.0, 101.9, 102.0]
    with pytest.raises(NoAnswer, match=f'^{slow_bridge.name} did not answer within 2 s$'):
        Client(SimpleNamespace(spin_once=spin_once), robot, 2.0).call(found, MINE)
    assert spins == [(pytest.approx(0.1), 1)]
    assert not pending_requests(found)
    assert found.qos_profile == SERVICE_QOS  # keeps as many replies to other clients as the bridge sends


def test_a_request_is_sent_once_however_late_its_reply_is(slow_bridge, found, robot):
    """Each request takes the next noise of a bridge with a seed."""
    late = threading.Timer(1.5, slow_bridge.reply, [1000])
    late.start()
    assert Client(PAUSE, robot, PATIENCE_SECONDS).call(found, MINE).reading.tag_id == 'mine'
    late.join()
    assert slow_bridge.requests == ['mine']
