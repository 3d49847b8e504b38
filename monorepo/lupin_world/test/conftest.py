"""Fixtures: a ROS domain of the tests' own, and a machine without Drake."""

import os

import pytest

pytest_plugins = ['lupin_greenhouse_bridge.testing']


@pytest.fixture
def without_drake(tmp_path, monkeypatch):
    """Hide Drake from the processes of a test."""
    hidden = tmp_path / 'hidden/pydrake'
    hidden.mkdir(parents=True)
    (hidden / '__init__.py').write_text("raise ImportError('No Drake in this test')\n", encoding='utf-8')
    monkeypatch.setenv('PYTHONPATH', f'{hidden.parent}:{os.environ.get("PYTHONPATH", "")}')
