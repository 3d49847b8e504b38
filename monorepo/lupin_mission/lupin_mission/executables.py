"""What `ros2 run` starts. It takes its signals first: to import rclpy takes a moment."""

from typing import NoReturn

from lupin_mission.life_cycle import start


def mission_node() -> NoReturn:
    """Run one mission; end with the exit code."""
    start('lupin_mission.mission_node')
