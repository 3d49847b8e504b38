# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The messages of AprilTag detectors: apriltag_msgs/AprilTagDetectionArray. Can be imported without ROS."""

import importlib

from lupin_greenhouse_bridge.errors import StartUpError

# One family under two names: apriltag_ros uses the first, apriltag_detector the second.
FAMILIES = ('tag36h11', 'tf36h11')


def detection_messages():
    """Return the module apriltag_msgs.msg; raises StartUpError if that package is missing."""
    try:
        return importlib.import_module('apriltag_msgs.msg')
    except ImportError as error:
        raise StartUpError(
            f'detections need the package apriltag_msgs ({error}):'
            ' sudo apt install ros-$ROS_DISTRO-apriltag-msgs'
        ) from error
