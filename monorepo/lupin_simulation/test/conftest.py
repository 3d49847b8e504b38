"""Fixtures: a ROS domain of the tests' own, and a machine without Drake."""

import os

import hypothesis
import pytest

pytest_plugins = ['lupin_greenhouse_bridge.testing']
# No test may depend on the speed of the machine.
hypothesis.settings.register_profile(
    'unhurried', deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile('unhurried')


@pytest.fixture
def without_drake(tmp_path, monkeypatch):
    """Hide Drake from the processes of a test."""
    hidden = tmp_path / 'hidden/pydrake'
    hidden.mkdir(parents=True)
    (hidden / '__init__.py').write_text("raise ImportError('No Drake in this test')\n", encoding='utf-8')
    monkeypatch.setenv('PYTHONPATH', f'{hidden.parent}:{os.environ.get("PYTHONPATH", "")}')
