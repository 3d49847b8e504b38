"""The plug-ins of the tests."""

pytest_plugins = ['clones']
