"""What the greenhouse config says about drawings."""

from lupin_greenhouse_bridge.greenhouse.files import shipped_file
from lupin_greenhouse_bridge.greenhouse.layout import Layout, Tag
from lupin_greenhouse_bridge.greenhouse.visualization import read_visualization


def test_the_walls_are_those_of_the_config_or_go_around_everything(monkeypatch):
    layout = Layout({'7': Tag(1.0, 2.5, ['co2'])}, {'bench': (0.0, 0.0, 2.0, 1.0)})
    assert read_visualization(layout, shipped_file('greenhouse_config.yaml')).footprint.width_m > 2.0
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert read_visualization(layout) == ((2.0, 2.5), {})
