"""The entry points of `ros2 run`. Each handles signals first, because importing rclpy takes a moment."""

from typing import NoReturn

from lupin_mission.life_cycle import start


def mission_node() -> NoReturn:
    """Run one mission, then exit."""
    start('lupin_mission.mission_node')
