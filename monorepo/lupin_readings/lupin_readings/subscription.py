"""Subscribe to topics of readings with any durability: latched (transient local) or volatile."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.interfaces import TagReading
from lupin_greenhouse_bridge.runtime.graph import domain_id
from lupin_greenhouse_bridge.runtime.parameters import invalid, parameter
from lupin_greenhouse_bridge.runtime.rclpy_internals import (
    SubscriptionEventCallbacks,
    steady_timer,
    take_message,
)
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.validate_topic_name import validate_topic_name

NO_PUBLISHER_SECONDS, LOOK_EVERY_SECONDS = 5.0, 1.0
DEPTH = 2000  # waiting readings: 1000 per second while a file is written for two seconds
VOLATILE, LATCHED = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL


def topics_parameter() -> Any:
    """Return a settings field for the parameter readings_topics, which takes a text or an array."""
    return parameter(
        '/read_on_sight/readings /mission/readings',
        'The TagReading topics, as text with spaces between them, or as an array.',
        of_any_type=True,
    )


def topics_of(readings_topics: object) -> list[str]:
    """Return the topics in the value of readings_topics; raises StartUpError."""
    topics = readings_topics
    if isinstance(topics, str):
        topics = topics.replace(',', ' ').split()
    if not (isinstance(topics, Sequence) and topics and all(isinstance(topic, str) for topic in topics)):
        raise invalid('readings_topics', readings_topics, 'the name of a topic, or an array of names')
    return list(dict.fromkeys(topics))


def subscribe_to_readings(
    node: Node, topics: list[str], on_reading: Callable[[TagReading, str], None]
) -> list[str]:
    """
    Call on_reading(reading, topic) once for each reading of these topics; return their full names.

    A latched topic delivers its readings again to each new subscriber, and therefore also after a restart. If
    no topic has a publisher for NO_PUBLISHER_SECONDS, the node logs one line, and another when the first
    publisher appears. Raises StartUpError for an invalid name.
    """
    last: dict[tuple[object, ...], None] = {}  # the keys of the last readings, oldest first

    def once(topic: str, reading: TagReading) -> None:
        values = ((sensor.name, repr(sensor.value)) for sensor in reading.readings)  # nan != nan
        key = reading.stamp.sec, reading.stamp.nanosec, reading.tag_id, *values
        if key not in last:
            last[key] = None
            if len(last) > 2 * DEPTH:
                del last[next(iter(last))]
            on_reading(reading, topic)

    names = []
    for topic in topics:
        try:
            validate_topic_name(topic)
            names.append(node.resolve_topic_name(topic))
            # The latched subscription receives what was published before it, and nothing of a volatile
            # publisher, of which rclpy would warn. The other one receives both.
            for durability in (LATCHED, VOLATILE):
                node.create_subscription(
                    TagReading,
                    topic,
                    partial(once, names[-1]),
                    QoSProfile(depth=DEPTH, durability=durability),
                    event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=durability is VOLATILE),
                )
        except InvalidTopicNameException as error:
            raise StartUpError(f'parameter readings_topics: {error}') from error
    watch_publishers(node, names, 'a mission or read_on_sight that starts')
    return names


def watch_publishers(node: Node, topics: list[str], awaited: str) -> None:
    """Log once if there is no publisher for a while, and again when the first publisher appears."""
    has_logged, deadline = False, time.monotonic() + NO_PUBLISHER_SECONDS

    def look() -> None:
        nonlocal has_logged
        if found := [topic for topic in topics if node.count_publishers(topic)]:
            timer.cancel()
            if has_logged:
                node.get_logger().info(f'{found[0]} has a publisher now')
        elif not has_logged and time.monotonic() >= deadline:
            has_logged = True
            node.get_logger().info(
                f'no publisher of {" or ".join(topics)} is found yet on domain {domain_id()}:'
                f' wait for {awaited}, or set ROS_DOMAIN_ID to its domain'
            )

    timer = steady_timer(node, LOOK_EVERY_SECONDS, look)


def take_what_has_arrived(node: Node) -> None:
    """Call on_reading for the readings that still wait in the subscriptions, after the node has stopped."""
    for subscription in node.subscriptions:
        for _ in range(DEPTH if subscription.msg_type is TagReading else 0):
            if (reading := take_message(subscription)) is None:
                break
            subscription.callback(reading)  # type: ignore[call-arg]  # none of ours takes a MessageInfo
