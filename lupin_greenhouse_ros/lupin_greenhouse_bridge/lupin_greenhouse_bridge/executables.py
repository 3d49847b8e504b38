# PYTHON_ARGCOMPLETE_OK
# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The entry points of `ros2 run`. A node handles signals first, because importing rclpy takes a moment."""

from typing import NoReturn

from lupin_greenhouse_bridge.runtime.process import start


def bridge_node() -> NoReturn:
    """Serve until Ctrl-C or SIGTERM, then exit."""
    start('lupin_greenhouse_bridge.bridge_node')


def read_tag() -> NoReturn:
    """Read tags from a running bridge, then exit."""
    start('lupin_greenhouse_bridge.reading.read_tag')


def register_layout() -> NoReturn:
    """Find where the layout lies in the map, or publish it until Ctrl-C or SIGTERM, then exit."""
    start('lupin_greenhouse_bridge.planning.register_layout')


def read_on_sight() -> NoReturn:
    """Publish the readings of the tags in view until Ctrl-C or SIGTERM, then exit."""
    start('lupin_greenhouse_bridge.reading.read_on_sight')


def record_readings() -> NoReturn:
    """Keep readings in a file until Ctrl-C or SIGTERM, then exit."""
    start('lupin_greenhouse_bridge.recording.record_readings')


def plot_report() -> NoReturn:
    """Draw the last readings of a file, then exit."""
    start('lupin_greenhouse_bridge.display.plot_report', has_node=False)


def readings_page() -> NoReturn:
    """Make a page of the readings in a file, then exit."""
    start('lupin_greenhouse_bridge.display.readings_page', has_node=False)


def show_readings() -> NoReturn:
    """Publish received readings as markers and as a field until Ctrl-C or SIGTERM, then exit."""
    start('lupin_greenhouse_bridge.display.show_readings')


def approach_poses() -> NoReturn:
    """Print the approach poses of the tags, then exit."""
    start(
        'lupin_greenhouse_bridge.planning.approach_poses', has_node=False
    )  # its --publish takes signals then
