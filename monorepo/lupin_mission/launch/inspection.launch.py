"""Inspect the greenhouse once: the bridge, the mission and, to confirm the tags, the camera's node."""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
    SetLaunchConfiguration,
    Shutdown,
)
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare
from lupin_greenhouse_bridge.node.launching import node_with_arguments
from lupin_mission.settings import WITHOUT_EFFECT, Settings

CAMERA = 'require_visual_confirmation'


def generate_launch_description():
    """Include the bridge and the camera with their own arguments; the end of the mission ends all nodes."""
    mission = node_with_arguments(
        Settings,
        has_sim_time=True,
        without_effect=WITHOUT_EFFECT,
        package='lupin_mission',
        executable='mission_orchestrator',
        name='mission_orchestrator',
        output='screen',
        on_exit=Shutdown(reason='the mission has ended'),
    )
    return LaunchDescription(
        [
            _included('lupin_greenhouse_bridge', 'greenhouse_bridge.launch.py'),
            DeclareLaunchArgument(CAMERA, default_value='false'),
            _included('lupin_perception', 'confirm_tag.launch.py', IfCondition(LaunchConfiguration(CAMERA))),
            OpaqueFunction(function=_hand_tag_file_on),
            SetLaunchConfiguration('wait_for_start', 'false'),
            *mission,
        ]
    )


def _included(package: str, launch_file: str, condition=None) -> GroupAction:
    """Return a launch file whose defaults are its own: they do not reach the nodes that follow."""
    path = PathJoinSubstitution([FindPackageShare(package), 'launch', launch_file])
    return GroupAction([IncludeLaunchDescription(PythonLaunchDescriptionSource(path))], condition=condition)


def _hand_tag_file_on(context) -> None:
    """Let the mission take the tags and their places from the bridge's tag_file."""
    tag_file = context.launch_configurations.pop('tag_file', '')
    if tag_file:
        context.launch_configurations.setdefault('tag_locations_file', tag_file)
