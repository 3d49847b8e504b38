# PYTHON_ARGCOMPLETE_OK
"""What `ros2 run` starts. Each takes its signals first: to import rclpy takes a moment."""

from lupin_greenhouse_bridge.life_cycle import start


def bridge_node() -> int:
    """Serve until Ctrl-C or SIGTERM; return the exit code."""
    return start('lupin_greenhouse_bridge.bridge_node')


def read_tag() -> int:
    """Read tags from a running bridge; return the exit code."""
    return start('lupin_greenhouse_bridge.read_tag')
