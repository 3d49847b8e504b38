# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What the greenhouse config says about drawings."""

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.visualization import read_visualization
from lupin_greenhouse_bridge.simulator.files import shipped_file
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag

LAYOUT = Layout({'7': Tag(1.0, 2.5, ['co2'])}, {'bench': (0.0, 0.0, 2.0, 1.0)})
WALLS = 'greenhouse_width_m: 4, greenhouse_height_m: 8'


def test_the_walls_are_those_of_the_config_or_go_around_everything(monkeypatch):
    assert read_visualization(LAYOUT, shipped_file('greenhouse_config.yaml')).footprint.width_m > 2.0
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert read_visualization(LAYOUT) == ((2.0, 2.5), {})


@pytest.mark.parametrize(
    ('section', 'fault'),
    [
        ('5', 'visualization is 5, not a mapping'),
        ('{greenhouse_height_m: 8}', 'greenhouse_width_m is missing'),
        ('{greenhouse_width_m: .nan, greenhouse_height_m: 8}', 'greenhouse_width_m is nan'),
        (f'{{{WALLS}, colorbar_ranges: [co2]}}', 'colorbar_ranges is a list, not a mapping'),
        (f'{{{WALLS}, colorbar_ranges: {{co2: 5}}}}', 'co2 is 5, not a mapping'),
        (f'{{{WALLS}, colorbar_ranges: {{1: {{min: 0}}}}}}', 'max is missing'),
        (f'{{{WALLS}, colorbar_ranges: {{co2: {{min: .inf}}}}}}', 'min is inf'),
    ],
)
def test_walls_and_colours_that_no_drawing_can_use_are_refused(tmp_path, section, fault):
    config = tmp_path / 'config.yaml'
    config.write_text(f'visualization: {section}')
    with pytest.raises(StartUpError) as raised:
        read_visualization(LAYOUT, str(config))
    assert f"sim_config_file '{config}': visualization" in str(raised.value)
    assert fault in str(raised.value)
