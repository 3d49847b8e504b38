"""The launch file under `ros2 launch` (collected only if launch is installed, see conftest.py)."""

import unittest

import launch
import launch_testing
import launch_testing.actions
import launch_testing.asserts
import pytest
from ament_index_python.packages import get_package_share_path
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from lupin_greenhouse_bridge.settings import Settings

LAUNCH_FILE = str(get_package_share_path('lupin_greenhouse_bridge') / 'launch/greenhouse_bridge.launch.py')


@pytest.mark.launch_test
def generate_test_description():
    """Launch with whole numbers, as people type them, for every numeric parameter."""
    arguments = {'debug_time_of_day': '6', 'speedup_factor': '3600', 'debug_seed': '7'}
    bridge = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(LAUNCH_FILE), launch_arguments=arguments.items()
    )
    return launch.LaunchDescription([bridge, launch_testing.actions.ReadyToTest()])


class WhileTheBridgeRuns(unittest.TestCase):
    def test_it_gets_the_arguments_in_the_types_of_the_node(self, proc_output):
        proc_output.assertWaitFor('clock frozen at 6.0 h', timeout=30)

    def test_the_arguments_are_described_and_default_to_the_parameters(self):
        description = PythonLaunchDescriptionSource(LAUNCH_FILE).get_launch_description(
            launch.LaunchContext()
        )
        declared = {
            each.name: (each.default_value[0].text if each.default_value else '', each.description)
            for each in description.entities
            if isinstance(each, DeclareLaunchArgument)
        }
        assert declared == {
            name: (str(field.default), field.metadata['description'])
            for name, field in Settings.__dataclass_fields__.items()
        }


@launch_testing.post_shutdown_test()
class AfterTheBridgeEnded(unittest.TestCase):
    def test_it_ended_with_exit_code_0(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)
