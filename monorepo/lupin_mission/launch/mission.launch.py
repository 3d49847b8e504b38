"""Start the mission alone: it waits in READY until `mission/start` is called."""

from launch import LaunchDescription
from lupin_greenhouse_bridge.runtime.launching import node_with_arguments
from lupin_mission.settings import WITHOUT_EFFECT, Settings


def generate_launch_description():
    """Start the node. Each of its parameters is an argument of the launch file."""
    mission = node_with_arguments(
        Settings,
        has_sim_time=True,
        without_effect=WITHOUT_EFFECT,
        package='lupin_mission',
        executable='mission_orchestrator',
        name='mission_orchestrator',
        output='screen',
    )
    return LaunchDescription(mission)
