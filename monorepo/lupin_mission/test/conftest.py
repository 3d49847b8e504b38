"""The plug-ins of the tests, and how hypothesis runs."""

import importlib.util

import hypothesis

pytest_plugins = ['lupin_greenhouse_bridge.testing', 'mission_helpers']
# No test may depend on the speed of the machine.
hypothesis.settings.register_profile(
    'unhurried', deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile('unhurried')
# Without launch, the test of the launch file cannot run.
collect_ignore = [] if importlib.util.find_spec('launch_testing') else ['test_bring_up.py']
