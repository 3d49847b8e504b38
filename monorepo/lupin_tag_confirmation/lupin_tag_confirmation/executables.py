"""The entry points of `ros2 run`. Each handles signals first, because importing rclpy takes a moment."""

from typing import NoReturn

from lupin_greenhouse_bridge.runtime.process import start


def confirm_tag() -> NoReturn:
    """Serve until Ctrl-C or SIGTERM, then exit."""
    start('lupin_tag_confirmation.confirm_tag')
