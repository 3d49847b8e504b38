"""Start the bridge, the mission and, where a camera has to confirm the tags, the camera's node."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, Shutdown
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

# Name, default, type and description: the node's own (lupin_mission/settings.py).
ARGUMENTS = (
    (
        'tag_ids',
        '',
        str,
        'The tags in the order of the visit, as text ("6 21 29") or as an array; empty: all of tag_file.',
    ),
    ('tag_file', '', str, "The bridge's tag_locations.json; empty: the shipped one."),
    ('bridge_service_name', '/greenhouse_bridge/get_tag_reading', str, 'The GetTagReading service.'),
    ('confirm_service_name', '/perception/confirm_tag', str, 'The ConfirmTag service.'),
    (
        'require_visual_confirmation',
        'false',
        bool,
        'Read a tag only when the camera has confirmed it (hardware); false: trust the ids (simulation).',
    ),
    ('drive_seconds', '0.0', float, 'How long the drive to a tag takes; 0.0: the robot is there at once.'),
    ('dwell_seconds', '1.0', float, 'How long, at least, the robot stands at a tag, in seconds.'),
    ('request_timeout_seconds', '2.0', float, 'How long to wait for one answer, in seconds, above 0.'),
    (
        'max_attempts',
        '3',
        int,
        'How often to ask each service at a tag before its scan has failed, at least 1.',
    ),
    (
        'retry_delay_seconds',
        '0.5',
        float,
        'How long to wait before the second attempt, in seconds; doubles each time, up to 10.',
    ),
    (
        'report_file',
        '',
        str,
        'The JSON Lines file to write; one that exists is continued. Empty: mission-TIME.jsonl here.',
    ),
)
IMAGE_TOPIC = ('image_topic', '/camera/image_raw', "The camera's images, with require_visual_confirmation.")


def generate_launch_description():
    """Include the bridge, which takes its own arguments too; when the mission ends, everything does."""
    bridge = PathJoinSubstitution(
        [FindPackageShare('lupin_greenhouse_bridge'), 'launch', 'greenhouse_bridge.launch.py']
    )
    image_topic, default_topic, topic_description = IMAGE_TOPIC
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, default, _, description in ARGUMENTS
            ),
            DeclareLaunchArgument(image_topic, default_value=default_topic, description=topic_description),
            IncludeLaunchDescription(PythonLaunchDescriptionSource(bridge)),
            Node(
                package='lupin_perception',
                executable='confirm_tag',
                output='screen',
                parameters=[{image_topic: ParameterValue(LaunchConfiguration(image_topic), value_type=str)}],
                condition=IfCondition(LaunchConfiguration('require_visual_confirmation')),
            ),
            Node(
                package='lupin_mission',
                executable='mission_node',
                name='mission',
                output='screen',
                parameters=[
                    {
                        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
                        for name, _, kind, _ in ARGUMENTS
                    }
                ],
                on_exit=Shutdown(reason='the mission has ended'),
            ),
        ]
    )
