"""The launch file in a bring-up (collected only if launch is installed, see conftest.py)."""

import unittest

import launch
import launch_testing
import launch_testing.actions
import launch_testing.asserts
import pytest
from ament_index_python.packages import get_package_share_path
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from lupin_greenhouse_bridge.simulator.layout import shipped_file

TAG_FILE = str(shipped_file('tag_locations.json'))


def included(package, launch_file, **arguments):
    path = get_package_share_path(package) / 'launch' / launch_file
    return IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(path)), launch_arguments=arguments.items()
    )


@pytest.mark.launch_test
def generate_test_description():
    """Include both launch files: the tag_file of the bridge stays in the scope of the mission."""
    return launch.LaunchDescription(
        [
            included('lupin_greenhouse_bridge', 'greenhouse_bridge.launch.py', tag_file=TAG_FILE),
            included(
                'lupin_mission',
                'mission.launch.py',
                drive='simulated',
                tag_locations_file=TAG_FILE,
                discovery_goal='5',
            ),
            launch_testing.actions.ReadyToTest(),
        ]
    )


class WhileTheMissionWaits(unittest.TestCase):
    def test_it_takes_its_own_arguments_and_not_the_bridge_s(self, proc_output):
        proc_output.assertWaitFor('without effect in this node: discovery_goal', timeout=30)


@launch_testing.post_shutdown_test()
class AfterTheLaunch(unittest.TestCase):
    def test_bridge_and_mission_ended_with_exit_code_0(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)
