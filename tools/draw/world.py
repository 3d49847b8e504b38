"""
Draw the SDF world for the page of lupin_simulation: from above, and as a robot's camera sees a tag.

    make figure WORLD=1
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from figure import draw_or_check, hash_of, parser_of
from lupin_greenhouse_bridge.display import drawings
from lupin_greenhouse_bridge.planning.walls import find_walls
from lupin_greenhouse_bridge.simulator.layout import require_layout, shipped_file
from lupin_simulation import rendered_world, sdf
from lupin_simulation.generate_world import LARGEST_SIDE_M, SIDE_M, make_world
from lupin_simulation.rendered_world import RenderedWorld, View, camera_axes, viewpoint
from lupin_tag_confirmation import drawing
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import Settings
from matplotlib import pyplot
from matplotlib.figure import Figure
from PIL import Image

COMMITTED = Path(__file__).resolve().parents[2] / 'monorepo/lupin_simulation/doc'
TAG, ROBOT_M, ROBOT_DEGREES = 7, 0.4, 20.0
# Of the picture from above: its size and its focal length in pixels, and where the camera is.
WIDTH, HEIGHT, FOCAL_PIXELS = 2000, 1100, 2850.0
FROM_MIDDLE_M = (9.5, -8.5, 8.5)
NAMES = {
    2: ('tag 2', (90, 0)),
    19: ('tag 19 from behind', (10, 105)),
}  # with the offset of the text in points
INK, POINTS = '#1f2328', 20  # 11 px on a phone 328 px wide


def world_of(side_m: float, **camera: Any) -> RenderedWorld:
    """Return the world of the shipped layout with tags of a size."""
    layout = require_layout('')
    with tempfile.TemporaryDirectory() as folder:
        return RenderedWorld(make_world(Path(folder), layout, find_walls(layout), side_m), **camera)


def draw_above() -> Figure:
    """Return the figure of the whole world with large tags, and the names of what it shows."""
    walls = find_walls(require_layout(''))
    world = world_of(
        LARGEST_SIDE_M, width=WIDTH, height=HEIGHT, focal_length_pixels=FOCAL_PIXELS, nearest_m=2.0
    )
    middle = np.array([(walls.x0 + walls.x1) / 2, (walls.y0 + walls.y1) / 2, -1.0])
    view = View(middle + FROM_MIDDLE_M, middle)

    def pixel(*point: float) -> Any:
        right, down, ahead = (point - view.eye) @ camera_axes(*view)
        return np.array([right, down]) * FOCAL_PIXELS / ahead + [WIDTH / 2, HEIGHT / 2]

    figure = pyplot.figure(figsize=(8.2, 8.2 * HEIGHT / WIDTH))
    axes: Any = figure.add_axes((0, 0, 1, 1))
    axes.imshow(world.look(*view))
    axes.set_axis_off()
    style = {'fontsize': POINTS, 'color': INK, **drawings.CENTRED}
    x, y = walls.x1 + 0.35, walls.y0 - 0.35
    for text, start, end, aside in (
        (f'x, {walls.x1 - walls.x0:g} m', (walls.x0, y, 0.0), (walls.x1, y, 0.0), -110),
        (f'y, {walls.y1 - walls.y0:g} m', (x, walls.y0, 0.0), (x, walls.y1, 0.0), 150),
    ):
        arrow = {'arrowstyle': '-|>', 'color': INK, 'linewidth': 1.5, 'mutation_scale': 18}
        axes.annotate('', pixel(*end), pixel(*start), arrowprops=arrow)
        axes.text(*(pixel(*start) + pixel(*end)) / 2 + [aside, 60], text, **style)
    for number, (text, offset) in NAMES.items():
        line = {'arrowstyle': '-', 'color': INK, 'linewidth': 1.5, 'shrinkB': 8}
        at = pixel(*world.tags[number].centre)
        axes.annotate(text, at, offset, textcoords='offset points', arrowprops=line, **style)
    return figure


def draw_eye() -> Image.Image:
    """Return what the camera of a robot in front of a tag sees, with what the detector reads in it."""
    world = world_of(SIDE_M, width=480, height=300, focal_length_pixels=450.0)
    picture = world.look(viewpoint(world.tags[TAG], ROBOT_M, ROBOT_DEGREES), world.tags[TAG].centre)
    found = TagDetector().detect(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
    return Image.fromarray(drawing.draw(picture, found, TAG, '', Settings()))


def main(arguments: list[str] | None = None) -> int:
    """Draw or check; exit code 0: done, 1: not up to date."""
    is_check = parser_of('world', __doc__).parse_args(arguments).check
    code = (__file__, drawing.__file__, rendered_world.__file__, sdf.__file__)
    files = [*code, shipped_file('tag_locations.json')]
    fingerprint = hash_of(*(Path(str(file)).read_bytes() for file in files))
    draws = {'above': draw_above, 'eye': draw_eye}
    pictures = {COMMITTED / f'{name}.png': (fingerprint, draw) for name, draw in draws.items()}
    return draw_or_check('make figure WORLD=1', pictures, is_check=is_check)


if __name__ == '__main__':
    sys.exit(main())
