# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Start the greenhouse bridge: one node, one service, `/greenhouse_bridge/get_tag_reading`."""

from launch import LaunchDescription
from lupin_greenhouse_bridge.runtime.launching import node_with_arguments
from lupin_greenhouse_bridge.settings import Settings


def generate_launch_description():
    """Declare the parameters of the bridge, namespace, log_level, params_file and respawn as arguments."""
    bridge = node_with_arguments(
        Settings,
        package='lupin_greenhouse_bridge',
        executable='bridge_node',
        name='greenhouse_bridge',
        output='screen',
    )
    return LaunchDescription(bridge)
