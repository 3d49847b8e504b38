"""Start the greenhouse bridge: one node, one service, `/greenhouse_bridge/get_tag_reading`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

# Name, default, type and description: the node's own (lupin_greenhouse_bridge/settings.py).
ARGUMENTS = (
    ('tag_file', '', str, 'Path of a tag_locations.json; empty: the shipped one.'),
    ('sim_config_file', '', str, 'Path of a greenhouse_config.yaml; empty: the shipped one.'),
    (
        'debug_time_of_day',
        '-1.0',
        float,
        'Hours in [0, 24) to freeze the simulated time at; -1.0: as the config says.',
    ),
    ('speedup_factor', '0.0', float, 'Simulated seconds per real second, above 0; 0.0: as the config says.'),
    ('debug_seed', '-1', int, 'Seed of the noise, from 0 up; turns debug mode on; -1: as the config says.'),
)


def generate_launch_description():
    """Declare each parameter of the node as an argument, and forward it in the node's own type."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, default, _, description in ARGUMENTS
            ),
            Node(
                package='lupin_greenhouse_bridge',
                executable='bridge_node',
                name='greenhouse_bridge',
                output='screen',
                parameters=[
                    {
                        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
                        for name, _, kind, _ in ARGUMENTS
                    }
                ],
            ),
        ]
    )
