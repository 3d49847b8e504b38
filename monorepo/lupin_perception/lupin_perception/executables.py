"""What `ros2 run` starts. Each takes its signals first: to import rclpy takes a moment."""

from lupin_perception.life_cycle import start


def confirm_tag() -> int:
    """Serve until Ctrl-C or SIGTERM; return the exit code."""
    return start('lupin_perception.confirm_tag')


def camera_stand_in() -> int:
    """Publish images until Ctrl-C or SIGTERM; return the exit code."""
    return start('lupin_perception.camera_stand_in')
