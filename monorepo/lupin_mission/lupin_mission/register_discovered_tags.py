"""`ros2 run lupin_mission register_discovered_tags`: fit the layout to the discovered tags."""

import argparse

from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import UsageError, escaped
from lupin_greenhouse_bridge.runtime.arguments import Parser, number_type
from lupin_msgs.msg import DiscoveredTags
from lupin_planning.register_layout import (
    EPILOG,
    add_arguments,
    layout_of,
    node_in,
    register,
    run_registration,
    spin_until,
)
from lupin_readings.subscription import watch_publishers
from rclpy.executors import Executor

from lupin_mission.tag_positions import discovered_positions

NAME = 'register_discovered_tags'
FEWEST_TAGS = 4  # With fewer, no outlier can be left out.


def main(args: list[str] | None = None) -> int:
    """Wait for the tags, fit and write; return the exit code of register_layout."""
    parser = Parser(
        prog=NAME,
        description='Find where the layout lies in the map, from the tags that perception discovered.',
        epilog=EPILOG,
    )
    add_arguments(parser)
    parser.add_argument(
        '--tags',
        type=number_type('a whole number, such as 4', int),
        default=FEWEST_TAGS,
        metavar='N',
        help='wait until perception has discovered this many tags of the layout; default: %(default)s',
    )
    return run_registration(parser, _register, args)


def _register(executor: Executor, options: argparse.Namespace) -> None:
    layout = layout_of(options)
    if not 2 <= options.tags <= len(layout.tags):
        raise UsageError(
            f'--tags is {options.tags}: must be from 2 to {len(layout.tags)}, the tags of the layout'
        )
    node = node_in(executor, NAME)
    messages, logged = [DiscoveredTags()], ['']

    def places() -> dict[str, tuple[float, float]]:
        positions = discovered_positions(messages[-1]).items()
        return {tag_id: (at.x, at.y) for tag_id, at in positions if tag_id in layout.tags}

    def on_tags(message: DiscoveredTags) -> None:
        messages[:] = [message]
        frame = '' if message.header.frame_id else ' (without header.frame_id)'
        text = f'{len(places())} of {options.tags} tags{frame}: {escaped(", ".join(places()), 200)}'
        if text != logged[-1]:
            logged[:] = [text]
            node.get_logger().info(text)

    tags = node.create_subscription(DiscoveredTags, 'perception/discovered_tags', on_tags, latched())
    node.get_logger().info(
        f'waiting for {options.tags} tags of the layout on {tags.topic_name} (--tags N takes fewer or more)'
    )
    watch_publishers(node, [tags.topic_name], 'perception')
    spin_until(executor, lambda: messages[-1].header.frame_id and len(places()) >= options.tags)
    register(layout, places(), messages[-1].header.frame_id, options)
