# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The blocking client: one call at a time, each with a timeout."""

import threading
from types import SimpleNamespace

import pytest
import rclpy
from conftest import HeldService
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.reading import client
from lupin_greenhouse_bridge.reading.client import Client, NoAnswer
from lupin_greenhouse_bridge.runtime.rclpy_internals import pending_requests
from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS, greet
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

GREETING, MINE = GetTagReading.Request(), GetTagReading.Request(tag_id='mine')


@pytest.fixture
def caller():
    """Return an executor that only the test spins, and its node."""
    context = Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node('caller', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield executor, node
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


def connected(executor, node):
    """Return a client of the service, which the service has found."""
    found = Client(executor, node, PATIENCE_SECONDS).connect(GetTagReading, HeldService.name)
    greeting = threading.Thread(target=greet, args=(found, GREETING))
    greeting.start()
    while greeting.is_alive():
        executor.spin_once(timeout_sec=0.01)
    return found


@pytest.fixture
def times(monkeypatch):
    """Return the times that the clock shows, one after the other; it fails when it is asked more often."""
    times = []
    monkeypatch.setattr(client, 'time', SimpleNamespace(monotonic=lambda: times.pop(0)))
    return times


def test_the_wait_for_a_service_ends_at_its_timeout_and_not_before(caller, times):
    times += [100.0, 101.4, 102.0]
    shown = []
    with pytest.raises(NoAnswer, match=r'^no service /nobody within 2 s$'):
        Client(*caller, 2.0).connect(GetTagReading, '/nobody', shown.append)
    assert (shown, times) == (['waiting for /nobody, 1 s more'], [])


@pytest.mark.usefixtures('held_service')
def test_a_call_ends_at_its_timeout_and_is_forgotten(caller, times):
    spins = []

    def spin_once(timeout_sec):
        spins.append((timeout_sec, len(pending_requests(found))))

    times += [100.0] * 1000  # for its connection
    found = connected(*caller)
    times[:] = [100.0, 101.9, 102.0]
    with pytest.raises(NoAnswer, match=f'^{HeldService.name} did not answer within 2 s$'):
        Client(SimpleNamespace(spin_once=spin_once), caller[1], 2.0).call(found, MINE)
    assert spins == [(pytest.approx(0.1), 1)]
    assert not pending_requests(found)
    assert found.qos_profile == SERVICE_QOS  # keeps as many replies to other clients as the bridge sends


def test_a_request_whose_reply_is_lost_is_sent_again(held_service, caller, monkeypatch):
    held_service.reply(1000)
    found = connected(*caller)
    call_async, asked = found.call_async, []

    def lose_the_first(request):
        asked.append(call_async(request))
        if len(asked) == 1:
            found.remove_pending_request(asked[0])  # its reply is then ignored
        return asked[-1]

    monkeypatch.setattr(found, 'call_async', lose_the_first)
    response = Client(*caller, PATIENCE_SECONDS).call(found, MINE)
    assert response.reading.tag_id == 'mine'
    assert held_service.requests.count('mine') > 1
    assert len(asked) > 1  # a slow reply may cost one more
