"""The parameters of the nodes, and the file that has them all."""

import dataclasses

import pytest
import yaml
from ament_index_python.packages import get_package_share_path
from lupin_greenhouse_bridge.testing.helpers import check_settings
from lupin_readings import read_on_sight, record_readings, show_readings

NODES = (read_on_sight, record_readings, show_readings)


@pytest.mark.parametrize('node', NODES)
def test_each_parameter_has_its_type_and_its_limits(node):
    check_settings(node.Settings)


def test_the_shipped_parameter_file_has_every_parameter_and_its_default():
    path = get_package_share_path('lupin_readings') / 'config/readings.yaml'
    nodes = yaml.safe_load(path.read_text(encoding='utf-8'))
    assert {node: parameters['ros__parameters'] for node, parameters in nodes.items()} == {
        f'/**/{node.__name__.partition(".")[2]}': dataclasses.asdict(node.Settings()) for node in NODES
    }
