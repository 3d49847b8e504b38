"""The real node confirm_tag, and a camera that the test controls."""

pytest_plugins = ['lupin_greenhouse_bridge.testing']
