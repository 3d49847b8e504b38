"""What `ros2 run` starts. It takes its signals first: to import rclpy takes a moment."""

from lupin_mission.life_cycle import start


def mission_node() -> int:
    """Run one mission; return the exit code."""
    return start('lupin_mission.mission_node')
