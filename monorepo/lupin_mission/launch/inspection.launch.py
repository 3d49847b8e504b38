"""
Inspect the greenhouse once: the bridge, the mission and, to confirm the tags, the camera's node.

The package lupin_tag_confirmation is needed only with require_visual_confirmation:=true.
"""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
)
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

CAMERA = 'require_visual_confirmation'


def generate_launch_description():
    """Include each node with its own arguments. When one node ends, such as the mission, all end."""
    return LaunchDescription(
        [
            RegisterEventHandler(
                OnProcessExit(on_exit=Shutdown(reason='a node of the inspection has ended'))
            ),
            _included('lupin_greenhouse_bridge', 'greenhouse_bridge.launch.py'),
            DeclareLaunchArgument(CAMERA, default_value='false', choices=['true', 'false', 'True', 'False']),
            _included(
                'lupin_tag_confirmation', 'confirm_tag.launch.py', IfCondition(LaunchConfiguration(CAMERA))
            ),
            OpaqueFunction(function=_hand_tag_file_on),
            _included('lupin_mission', 'mission.launch.py', wait_for_start='false'),
        ]
    )


def _included(package: str, launch_file: str, condition=None, **arguments: str) -> GroupAction:
    """Return a launch file in its own scope, so that its defaults do not reach the later nodes."""
    path = PathJoinSubstitution([FindPackageShare(package), 'launch', launch_file])
    source = PythonLaunchDescriptionSource(path)
    included = IncludeLaunchDescription(source, launch_arguments=arguments.items())
    return GroupAction([included], condition=condition)


def _hand_tag_file_on(context) -> None:
    """Let the mission take the tags and their places from the bridge's tag_file."""
    tag_file = context.launch_configurations.pop('tag_file', '')
    if tag_file:
        context.launch_configurations.setdefault('tag_locations_file', tag_file)
