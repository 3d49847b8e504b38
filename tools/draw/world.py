"""
Draw the SDF world for the page of lupin_simulation: from above, and from a robot in front of a tag.

    make figure WORLD=1
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from lupin_greenhouse_bridge.planning.walls import find_walls
from lupin_greenhouse_bridge.simulator.layout import require_layout
from lupin_simulation.generate_world import LARGEST_SIDE_M, make_world
from lupin_simulation.rendered_world import RenderedWorld, viewpoint
from PIL import Image

COMMITTED = Path(__file__).resolve().parents[2] / 'monorepo/lupin_simulation/doc'
TAG = 7


def without_margin(picture: np.ndarray) -> np.ndarray:
    """Return the part of a picture that is not of the colour of its corner."""
    rows, columns = np.nonzero((picture != picture[0, 0]).any(axis=2))
    return picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]


def main() -> int:
    """Write both pictures."""
    COMMITTED.mkdir(exist_ok=True)
    layout = require_layout('')
    walls = find_walls(layout)
    with tempfile.TemporaryDirectory() as folder:
        large = make_world(Path(folder, 'large'), layout, walls, LARGEST_SIDE_M)
        sdf_file = make_world(Path(folder, 'usual'), layout, walls)
        above = RenderedWorld(large, width=1600, height=900, focal_length_pixels=1250.0, nearest_m=2.0)
        eye = RenderedWorld(sdf_file, width=640, height=360)
        centres = np.array([tag.centre for tag in above.tags.values()])
        middle = (centres.min(axis=0) + centres.max(axis=0)) / 2
        pictures = {
            'above': without_margin(above.look(middle + np.array([7.5, -5.0, 3.8]), middle)),
            'eye': eye.look(viewpoint(eye.tags[TAG], 0.4, 25.0), eye.tags[TAG].centre),
        }
    for name, picture in pictures.items():
        Image.fromarray(picture).save(COMMITTED / f'{name}.png', optimize=True)
        print(COMMITTED / f'{name}.png')
    return 0


if __name__ == '__main__':
    sys.exit(main())
