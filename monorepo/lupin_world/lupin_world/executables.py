"""The nodes of `ros2 run`. Each handles signals first, because importing rclpy takes a moment."""

from typing import NoReturn

from lupin_greenhouse_bridge.node.process import start


def world_camera() -> NoReturn:
    """Publish images until Ctrl-C or SIGTERM, then exit."""
    start('lupin_world.world_camera')
