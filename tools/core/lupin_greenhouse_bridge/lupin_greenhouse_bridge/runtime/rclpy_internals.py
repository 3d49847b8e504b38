"""The names of rclpy that are not public, or not the same in Humble, Jazzy, Kilted and Lyrical."""

from collections.abc import Callable, Collection
from typing import Any

from rclpy.client import Client
from rclpy.clock import Clock, ClockType  # type: ignore[attr-defined]  # Humble has no clock_type
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer

try:
    from rclpy.event_handler import SubscriptionEventCallbacks
except ImportError:  # Humble has no event_handler, and Kilted warns of qos_event
    from rclpy.qos_event import SubscriptionEventCallbacks

__all__ = [
    'RCLError',
    'RcutilsLogger',
    'SubscriptionEventCallbacks',
    'parameter_overrides',
    'pending_requests',
    'rclpy_implementation',
    'steady_timer',
    'take_message',
]

# The error of the C library, such as for a missing security key. No module of Humble exports it.
RCLError: type[Exception] = rclpy_implementation.RCLError


def parameter_overrides(node: Node) -> Collection[str]:
    """Return the names of the parameters that were set for a node. No distro has a public list of them."""
    return getattr(node, '_parameter_overrides', ())


def pending_requests(client: 'Client[Any, Any]') -> Collection[Any]:
    """Return the futures of the requests that wait for a reply. No distro has a public list; for tests."""
    return client._pending_requests.values()


def steady_timer(node: Node, seconds: float, callback: Callable[[], None]) -> Timer:
    """Return a timer that `use_sim_time` does not affect."""
    return node.create_timer(seconds, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def take_message(subscription: 'Subscription[Any]') -> Any:
    """
    Return the next message of a subscription without calling its callback; None if there is none.

    The only public way is to spin, which takes one message for each callback.
    """
    with subscription.handle:
        taken = subscription.handle.take_message(subscription.msg_type, False)
    return taken[0] if taken else None
