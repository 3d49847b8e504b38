"""
Draw the SDF world for the documents: from above, and what a robot's camera sees at the right and a wrong tag.

    make figure WORLD=1
"""

import sys
import tempfile
from collections.abc import Callable
from functools import partial
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
from lupin_tag_confirmation.confirmation import Confirmer, Frame, Moment, Sight
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import Settings
from matplotlib import pyplot
from matplotlib.figure import Figure
from PIL import Image, ImageOps

MONOREPO = Path(__file__).resolve().parents[2] / 'monorepo'
# Of the picture from above: its size and focal length in pixels, what is too near, and where the camera is.
WIDTH, HEIGHT, FOCAL_PIXELS, NEAREST_M = 2000, 1100, 2850.0, 2.0
FROM_MIDDLE_M, MARGIN_PIXELS = (-9.5, -8.5, 8.5), 18
INK, BORDER, POINTS = '#1f2328', '#8c959f', 20  # 11 px on a phone 328 px wide


def world_of(side_m: float, *camera: Any) -> RenderedWorld:
    """Return the world of the shipped layout with tags of a size."""
    layout = require_layout('')
    with tempfile.TemporaryDirectory() as folder:
        return RenderedWorld(make_world(Path(folder), layout, find_walls(layout), side_m), *camera)


def draw_above() -> Figure:
    """Return the figure of the whole world with large tags, its axes, and the names of what it shows."""
    walls = find_walls(require_layout(''))
    world = world_of(LARGEST_SIDE_M, WIDTH, HEIGHT, FOCAL_PIXELS, NEAREST_M)
    middle = np.array([(walls.x0 + walls.x1) / 2, (walls.y0 + walls.y1) / 2, -1.0])
    view = View(middle + FROM_MIDDLE_M, middle)

    def pixel(*point: float) -> Any:
        right, down, ahead = (point - view.eye) @ camera_axes(*view)
        return np.array([right, down]) * FOCAL_PIXELS / ahead + [WIDTH / 2, HEIGHT / 2]

    out, height = sdf.THICKNESS_M, sdf.WALL_HEIGHT_M
    x0, y0, x1, y1 = np.add(walls, (-out, -out, out, out))
    corners = [pixel(*at, z) for at in ((x0, y0), (x0, y1), (x1, y1), (x1, y0)) for z in (0.0, height)]
    left, top = np.min(corners, axis=0) - MARGIN_PIXELS
    right, bottom = np.add(np.max(corners, axis=0), (MARGIN_PIXELS, 5 * MARGIN_PIXELS))
    figure = pyplot.figure(figsize=(8.2, 8.2 * (bottom - top) / (right - left)), dpi=200)
    axes: Any = figure.add_axes((0, 0, 1, 1), xlim=(left, right), ylim=(bottom, top))
    picture = world.look(*view)
    axes.imshow(np.where((picture == picture[0, 0]).all(axis=-1, keepdims=True), 255, picture))  # a white sky
    axes.set_axis_off()
    style = {'fontsize': POINTS, 'color': INK, **drawings.CENTRED}
    line = {'color': INK, 'linewidth': 1.5, 'arrowstyle': '-', 'shrinkB': 8}
    # On top of the walls: those in front hide the floor at the origin.
    origin, *ends = (pixel(*at, height) for at in (walls[:2], (walls.x1, walls.y0), (walls.x0, walls.y1)))
    axes.text(origin[0], bottom - 2.2 * MARGIN_PIXELS, 'origin', **style)
    for end, name, metres, aside in zip(ends, 'xy', (walls.x1, walls.y1), (130, -130), strict=True):
        axes.text(*(origin + end) / 2 + (aside, 75), f'{name}, {metres:g} m', **style)
        arrow = {**line, 'arrowstyle': '-|>', 'mutation_scale': 18, 'shrinkA': 0, 'shrinkB': 0}
        axes.annotate('', end, origin, arrowprops=arrow)
    axes.plot(*origin, 'o', color=INK)
    for text, at, offset in (  # the offset in points
        ('tag 19', world.tags[19].centre, (-46, -42)),
        ('tag 2\nfrom behind', world.tags[2].centre, (14, 95)),
        ('table', (*world.tables[7][:2], sdf.TABLE_HEIGHT_M / 2), (-42, -30)),
        (f'wall, {height:g} m high', (x0, 2.6, height / 2), (-70, -66)),
    ):
        axes.annotate(text, pixel(*at), offset, textcoords='offset points', arrowprops=line, **style)
    return figure


def draw_seen(tag: int, expected_tag: int, distance_m: float, degrees: float) -> Image.Image:
    """Return what confirm_tag publishes about what the camera of a robot at a tag sees, with a border."""
    world = world_of(SIDE_M, 960, 600, 900.0)
    picture = world.look(viewpoint(world.tags[tag], distance_m, degrees), world.tags[tag].centre)
    sight = Sight(TagDetector().detect(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)), picture)
    settings, now = Settings(), Moment(0.0, 0.0)
    confirmer = Confirmer(settings)
    for _ in range(settings.min_frames):
        confirmer.add(Frame(lambda: sight, *now))
    while confirmer.choose(now, now):
        pass
    reason = confirmer.judge(expected_tag, now, now).reason
    seen = drawing.draw(picture, sight.detections, expected_tag, reason, settings)
    return ImageOps.expand(Image.fromarray(seen), 2, BORDER)


def main(arguments: list[str] | None = None) -> int:
    """Draw or check; exit code 0: done, 1: not up to date."""
    is_check = parser_of('world', __doc__).parse_args(arguments).check
    layout = shipped_file('tag_locations.json')
    files = (__file__, drawing.__file__, rendered_world.__file__, sdf.__file__, layout)
    fingerprint = hash_of(*(Path(str(file)).read_bytes() for file in files))
    draws: dict[str, Callable[[], Any]] = {
        'lupin_simulation/doc/above': draw_above,
        'lupin_simulation/doc/eye': partial(draw_seen, 7, 7, 0.4, 20.0),
        'lupin_tag_confirmation/doc/seen': partial(draw_seen, 16, 5, 0.3, -25.0),
    }
    pictures = {MONOREPO / f'{name}.png': (fingerprint, draw) for name, draw in draws.items()}
    return draw_or_check('make figure WORLD=1', pictures, is_check=is_check)


if __name__ == '__main__':
    sys.exit(main())
