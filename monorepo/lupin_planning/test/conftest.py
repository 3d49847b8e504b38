"""Fixtures and settings of the tests."""

import os

# Set before the messages are imported: a wrong type in a field raises.
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'

import hypothesis

pytest_plugins = ['lupin_greenhouse_bridge.testing']
# No test may depend on the speed of the machine.
hypothesis.settings.register_profile(
    'unhurried',
    deadline=None,
    suppress_health_check=[hypothesis.HealthCheck.too_slow, hypothesis.HealthCheck.filter_too_much],
)
hypothesis.settings.load_profile('unhurried')
