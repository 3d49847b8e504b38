"""The plug-ins of the tests."""

import importlib.util

pytest_plugins = ['lupin_greenhouse_bridge.testing', 'mission_helpers']
# Without launch, the test of the launch file cannot run.
collect_ignore = [] if importlib.util.find_spec('launch_testing') else ['test_bring_up.py']
