"""Start the bridge, the mission and, if a camera must confirm the tags, the camera's node."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, Shutdown
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare
from lupin_greenhouse_bridge.node.parameters import launch_arguments
from lupin_mission.settings import Settings
from lupin_perception.settings import SOURCES
from lupin_perception.settings import Settings as CameraSettings


def generate_launch_description():
    """Include the bridge with its own arguments; the end of the mission ends all nodes."""
    bridge = PathJoinSubstitution(
        [FindPackageShare('lupin_greenhouse_bridge'), 'launch', 'greenhouse_bridge.launch.py']
    )
    arguments = launch_arguments(Settings)
    camera_arguments = [each for each in launch_arguments(CameraSettings) if each[0] in SOURCES]
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, default, _, description in [*arguments, *camera_arguments]
            ),
            IncludeLaunchDescription(PythonLaunchDescriptionSource(bridge)),
            Node(
                package='lupin_perception',
                executable='confirm_tag',
                output='screen',
                parameters=[_forwarded(camera_arguments)],
                condition=IfCondition(LaunchConfiguration('require_visual_confirmation')),
            ),
            Node(
                package='lupin_mission',
                executable='mission_node',
                name='mission',
                output='screen',
                parameters=[_forwarded(arguments)],
                on_exit=Shutdown(reason='the mission has ended'),
            ),
        ]
    )


def _forwarded(arguments) -> dict[str, ParameterValue]:
    return {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, _, kind, _ in arguments
    }
