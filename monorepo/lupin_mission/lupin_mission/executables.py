"""The entry points of `ros2 run`. Each handles signals first, because importing rclpy takes a moment."""

from typing import NoReturn

from lupin_greenhouse_bridge.runtime.process import start


def mission_orchestrator() -> NoReturn:
    """Run one mission or wait for each start, until Ctrl-C or SIGTERM."""
    start('lupin_mission.mission_orchestrator')


def passive_observer() -> NoReturn:
    """Publish observations until Ctrl-C or SIGTERM, then exit."""
    start('lupin_mission.passive_observer')


def register_discovered_tags() -> NoReturn:
    """Find where the layout lies in the map, by the discovered tags, then exit."""
    start('lupin_mission.register_discovered_tags')
