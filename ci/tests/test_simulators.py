"""The bridge with other releases of the simulator, installed from PyPI."""

import os
import sys

import pytest
from conftest import succeed

pytest_plugins = ['lupin_greenhouse_bridge.testing']


@pytest.fixture
def simulator(tmp_path):
    """Return a function that installs a release of the simulator and returns its environment."""

    def install(version: str) -> dict[str, str]:
        pip = [sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps', '--target', tmp_path]
        succeed(*pip, f'mdp-greenhouse=={version}')
        return {'PYTHONPATH': os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')])}

    return install


@pytest.mark.parametrize('version', ['1.0.5', '1.0.6'])
def test_a_simulator_before_1_0_7_is_refused(start_bridge, simulator, version):
    fatal = start_bridge(environment=simulator(version)).refusal()
    assert f'mdp-greenhouse {version} is installed' in fatal
    assert "pip install --upgrade 'mdp-greenhouse>=1.0.7'" in fatal


@pytest.mark.parametrize(('version', 'tag_count'), [('1.0.7', 22), ('1.0.8', 29)])
def test_a_simulator_from_1_0_7_on_is_served(start_bridge, simulator, version, tag_count):
    bridge = start_bridge(environment=simulator(version))
    assert f'ready: {tag_count} tags' in bridge.wait_for_log(f'mdp-greenhouse {version}')
