"""A ROS domain of the tests' own."""

pytest_plugins = ['lupin_greenhouse_bridge.testing']
