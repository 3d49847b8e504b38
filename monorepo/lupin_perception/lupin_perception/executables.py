"""The entry points of `ros2 run`. Each handles signals first, because importing rclpy takes a moment."""

from typing import NoReturn

from lupin_greenhouse_bridge.node.process import start


def confirm_tag() -> NoReturn:
    """Serve until Ctrl-C or SIGTERM, then exit."""
    start('lupin_perception.confirm_tag')


def camera_stand_in() -> NoReturn:
    """Publish images until Ctrl-C or SIGTERM, then exit."""
    start('lupin_perception.camera_stand_in')


def passive_observer() -> NoReturn:
    """Publish observations until Ctrl-C or SIGTERM, then exit."""
    start('lupin_perception.passive_observer')
