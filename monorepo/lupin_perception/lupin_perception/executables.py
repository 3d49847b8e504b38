"""What `ros2 run` starts. Each takes its signals first: to import rclpy takes a moment."""

from typing import NoReturn

from lupin_perception.life_cycle import start


def confirm_tag() -> NoReturn:
    """Serve until Ctrl-C or SIGTERM; end with the exit code."""
    start('lupin_perception.confirm_tag')


def camera_stand_in() -> NoReturn:
    """Publish images until Ctrl-C or SIGTERM; end with the exit code."""
    start('lupin_perception.camera_stand_in')
