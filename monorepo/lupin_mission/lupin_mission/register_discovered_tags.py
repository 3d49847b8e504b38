"""`ros2 run lupin_mission register_discovered_tags`: fit the layout to the discovered tags."""

import argparse
import math
import sys

from lupin_greenhouse_bridge.contract import latched
from lupin_greenhouse_bridge.errors import UsageError
from lupin_greenhouse_bridge.planning.register_layout import (
    EPILOG,
    add_arguments,
    layout_of,
    node_in,
    register,
    run,
    spin,
)
from lupin_msgs.msg import DiscoveredTags

NAME = 'register_discovered_tags'
FEWEST_TAGS = 4  # with fewer, none can be left out


def main(args=None) -> int:
    """Wait for the tags, fit and write; return the exit code of register_layout."""
    parser = argparse.ArgumentParser(
        prog=NAME,
        description='Find where the layout lies in the map, from the tags that perception discovered.',
        epilog=EPILOG,
    )
    add_arguments(parser)
    parser.add_argument(
        '--tags',
        type=int,
        default=FEWEST_TAGS,
        metavar='N',
        help='wait until perception has discovered this many tags of the layout; default: %(default)s',
    )
    return run(parser, _register, args)


def _register(executor, options) -> None:
    layout = layout_of(options)
    if not 2 <= options.tags <= len(layout.tags):
        raise UsageError(
            f'--tags is {options.tags}: must be from 2 to {len(layout.tags)}, the tags of the layout'
        )
    node = node_in(executor, NAME)
    places: dict[str, tuple[float, float]] = {}  # in the last message, of tags of the layout
    frame_id = ''

    def on_tags(message) -> None:
        nonlocal places, frame_id
        frame_id = message.header.frame_id
        positions = {
            tag.tag_id: tag.pose_in_map.position
            for tag in message.tags
            if tag.pose_in_map.orientation.w != 0.0  # 0: never populated
        }
        places = {
            tag_id: (at.x, at.y)
            for tag_id, at in positions.items()
            if tag_id in layout.tags and math.isfinite(at.x) and math.isfinite(at.y)
        }

    tags = node.create_subscription(DiscoveredTags, 'perception/discovered_tags', on_tags, latched())
    node.get_logger().info(f'waiting for {options.tags} tags of the layout on {tags.topic_name}')
    spin(executor, lambda: frame_id and len(places) >= options.tags)
    register(layout, places, frame_id, options)


if __name__ == '__main__':
    sys.exit(main())
