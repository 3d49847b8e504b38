"""The entry points of `ros2 run`. Each handles signals first, because importing rclpy takes a moment."""

from typing import NoReturn

from lupin_greenhouse_bridge.node.process import start


def mission_orchestrator() -> NoReturn:
    """Run one mission or wait for each start, until Ctrl-C or SIGTERM."""
    start('lupin_mission.mission_node')
