"""The plug-ins of the tests."""

pytest_plugins = ['lupin_greenhouse_bridge.testing', 'confirmation_helpers']
