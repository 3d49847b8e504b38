"""Start the greenhouse bridge: one node, one service, `/greenhouse_bridge/get_tag_reading`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from lupin_greenhouse_bridge.node.parameters import launch_arguments
from lupin_greenhouse_bridge.settings import Settings


def generate_launch_description():
    """Declare each parameter of the node as an argument, and forward it in the node's own type."""
    arguments = launch_arguments(Settings)
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, default, _, description in arguments
            ),
            Node(
                package='lupin_greenhouse_bridge',
                executable='bridge_node',
                name='greenhouse_bridge',
                output='screen',
                parameters=[
                    {
                        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
                        for name, _, kind, _ in arguments
                    }
                ],
            ),
        ]
    )
