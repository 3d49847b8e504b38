"""The entry points of `ros2 run`. Each handles signals first, because importing rclpy takes a moment."""

from typing import NoReturn

from lupin_greenhouse_bridge.runtime.process import start


def fake_camera() -> NoReturn:
    """Publish images until Ctrl-C or SIGTERM, then exit."""
    start('lupin_simulation.fake_camera')


def fake_navigator() -> NoReturn:
    """Navigate until Ctrl-C or SIGTERM, then exit."""
    start('lupin_simulation.fake_navigator')


def world_camera() -> NoReturn:
    """Publish images until Ctrl-C or SIGTERM, then exit."""
    start('lupin_simulation.world_camera')
