# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
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

SHARE = get_package_share_path('lupin_greenhouse_bridge')
LAUNCH_FILE = str(SHARE / 'launch/greenhouse_bridge.launch.py')


@pytest.mark.launch_test
def generate_test_description():
    """Launch with whole numbers, as people type them, and with a parameter file that says otherwise."""
    arguments = {
        'debug_time_of_day': '6',
        'speedup_factor': '3600',
        'debug_seed': '7',
        'params_file': str(SHARE / 'config/greenhouse_bridge.yaml'),
        'namespace': 'robot1',
        'log_level': 'debug',
    }
    bridge = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(LAUNCH_FILE), launch_arguments=arguments.items()
    )
    return launch.LaunchDescription([bridge, launch_testing.actions.ReadyToTest()])


class WhileTheBridgeRuns(unittest.TestCase):
    def test_an_argument_has_the_type_of_the_node_and_overrides_the_parameter_file(self, proc_output):
        proc_output.assertWaitFor('clock frozen at 6.0 h', timeout=30)
        proc_output.assertWaitFor('[robot1.greenhouse_bridge]', timeout=30)
        proc_output.assertWaitFor('[DEBUG]', timeout=30)

    def test_the_arguments_are_described_and_default_to_the_parameters(self):
        description = PythonLaunchDescriptionSource(LAUNCH_FILE).get_launch_description(
            launch.LaunchContext()
        )
        declared = {
            action.name: (action.default_value[0].text if action.default_value else '', action.description)
            for action in description.entities
            if isinstance(action, DeclareLaunchArgument)
        }
        for name, field in Settings.__dataclass_fields__.items():
            assert declared.pop(name) == (str(field.default), field.metadata['description'])
        assert list(declared) == ['namespace', 'log_level', 'params_file', 'respawn']

    def test_a_parameter_file_that_is_missing_is_named(self):
        context = launch.LaunchContext()
        context.launch_configurations['params_file'] = '/missing.yaml'
        description = PythonLaunchDescriptionSource(LAUNCH_FILE).get_launch_description(context)
        *declarations, start = description.entities
        for declaration in declarations:
            declaration.visit(context)
        with pytest.raises(FileNotFoundError, match=r"params_file '/missing.yaml' is not a file"):
            start.visit(context)


@launch_testing.post_shutdown_test()
class AfterTheBridgeEnded(unittest.TestCase):
    def test_it_ended_with_exit_code_0(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)
