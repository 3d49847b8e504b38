"""The entry points of `ros2 run`. Each handles signals first, because importing rclpy takes a moment."""

from functools import partial

from lupin_greenhouse_bridge.runtime.process import start

mission_orchestrator = partial(start, 'lupin_mission.mission_orchestrator')
passive_observer = partial(start, 'lupin_mission.passive_observer')
register_discovered_tags = partial(start, 'lupin_mission.register_discovered_tags')
