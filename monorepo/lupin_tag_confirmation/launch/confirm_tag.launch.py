"""Start the camera's node, which serves `/perception/confirm_tag`."""

from launch import LaunchDescription
from lupin_greenhouse_bridge.runtime.launching import node_with_arguments
from lupin_tag_confirmation.settings import Settings


def generate_launch_description() -> LaunchDescription:
    """Start the node. Each of its parameters is an argument of the launch file."""
    camera = node_with_arguments(
        Settings,
        has_sim_time=True,
        package='lupin_tag_confirmation',
        executable='confirm_tag',
        name='confirm_tag',
        output='screen',
    )
    return LaunchDescription(camera)
