"""The picture of a route and its approach poses. Imports matplotlib only to draw, and never ROS."""

import itertools
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.simulator.layout import Layout

from lupin_planning.approach import Approaches
from lupin_planning.occupancy import OccupancyMap
from lupin_planning.route import Route
from lupin_planning.walls import Walls

os.environ['MPLBACKEND'] = 'Agg'  # only files are written, so no other backend is asked for
ROUTE, FAILED, INK = '#3d6fa8', '#b3261e', '#1f2328'
TABLE, OBSTACLE, UNKNOWN_PART = '#d3d9e1', '#e69f00', '0.7'
INCHES_PER_M, LARGEST_INCHES, DPI = 1.2, 40.0, 200
VIEW_MARGIN_M, ID_ASIDE_M = 0.2, 0.13
SHORTEST_LEG_M = 0.3  # that has an arrow
Style = dict[str, Any]  # of what matplotlib draws
CENTRED: Style = {'ha': 'center', 'va': 'center'}
SIGHT: Style = {'arrowstyle': '->', 'color': '0.35', 'linewidth': 0.8, 'shrinkA': 0, 'shrinkB': 3}
ARROW: Style = {'arrowstyle': '-|>', 'color': ROUTE, 'linewidth': 0, 'mutation_scale': 12}
KEY: dict[str, Style] = {
    'stop': {'marker': 'o', 'color': ROUTE},
    'tag': {'marker': 's', 'color': INK},
    'tag without a pose': {'marker': 'X', 'color': FAILED},
}
NUMBER: Style = {'boxstyle': 'circle,pad=0.2', 'facecolor': ROUTE, 'edgecolor': 'white'}


def check_ending(path: Path) -> None:
    """Raise StartUpError if matplotlib is missing, or cannot write pictures with the ending of this path."""
    try:
        from matplotlib import backend_bases
    except ImportError as error:
        raise StartUpError(f'{error}: sudo apt install python3-matplotlib') from error
    endings = sorted(backend_bases.FigureCanvasBase.get_supported_filetypes())
    if path.suffix[1:].lower() not in endings:
        raise StartUpError(f"--picture '{path}': the ending must be one of {', '.join(endings)}")


def draw_route(
    path: Path,
    layout: Layout,
    walls: Walls,
    approaches: Approaches,
    route: Route,
    occupancy: OccupancyMap | None = None,
) -> None:
    """
    Write a picture of the greenhouse, the route, the robot at its numbered stops, and the unreachable tags.

    A map of the room, in the frame of the layout, lies beneath: its obstacles orange, its unknown parts grey.
    Raises StartUpError if the file cannot be written.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Rectangle

    points = np.array([walls[:2], walls[2:], *(tag[:2] for tag in layout.tags.values())])
    low, high = points.min(axis=0) - VIEW_MARGIN_M, points.max(axis=0) + VIEW_MARGIN_M
    inches = INCHES_PER_M * (high - low)
    figure = Figure((inches * min(1.0, LARGEST_INCHES / inches.max())).tolist(), layout='constrained')
    axes = figure.add_subplot(xlabel='x (m)', ylabel='y (m)')
    axes.spines[:].set_visible(False)  # the walls are the frame
    axes.set_title(
        f'A route of {route.length_m:.1f} m past {len(approaches.poses)} of {len(layout.tags)} tags'
    )
    axes.add_patch(Rectangle(walls[:2], walls.x1 - walls.x0, walls.y1 - walls.y0, fill=False))
    for x0, y0, x1, y1 in layout.tables.values():
        axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=TABLE))
    if occupancy is not None:
        _draw_map(axes, occupancy)
    axes.plot(*np.reshape(route.points_m, (-1, 2)).T, color=ROUTE, linewidth=1.2, label='route')
    for start, end in itertools.pairwise(route.points_m):
        if math.dist(start, end) >= SHORTEST_LEG_M:
            tip = 0.4 * start[0] + 0.6 * end[0], 0.4 * start[1] + 0.6 * end[1]
            axes.annotate('', tip, start, arrowprops=ARROW)
    radius_m = approaches.grid.robot_radius_m
    for number, tag_id in enumerate(route.tag_ids, start=1):
        stop = approaches.poses[tag_id][:2]
        axes.add_patch(Circle(stop, radius_m, facecolor=f'{INK}10', edgecolor=f'{INK}80', linewidth=0.7))
        axes.annotate('', layout.tags[tag_id][:2], stop, arrowprops=SIGHT)
        axes.text(*stop, str(number), color='white', fontsize=8, bbox=NUMBER, **CENTRED)
    for tag_id, tag in layout.tags.items():
        is_lost = tag_id in approaches.unreachable
        colour = FAILED if is_lost else INK
        axes.plot(*tag[:2], 'X' if is_lost else 's', color=colour, markersize=8 if is_lost else 5)
        place = tag.x + ID_ASIDE_M, tag.y + ID_ASIDE_M
        axes.text(*place, tag_id, color=colour, parse_math=False, **CENTRED)
    for label, style in KEY.items():
        axes.plot([], [], label=label, linestyle='', **style)
    axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.1), frameon=False, ncol=2)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect='equal')
    try:
        figure.savefig(path, dpi=DPI, bbox_inches='tight', pad_inches=0.15)
    except OSError as error:
        raise StartUpError(f"--picture '{path}': {error.strerror}: name another file") from error


def _draw_map(axes: Any, occupancy: OccupancyMap) -> None:
    """Draw the obstacles and the unknown parts of a map, over the tables and below the rest."""
    from matplotlib.colors import to_rgba
    from matplotlib.transforms import Affine2D

    cells = np.zeros((*occupancy.is_occupied.shape, 4))
    cells[occupancy.is_occupied] = to_rgba(OBSTACLE, 0.8)
    cells[occupancy.is_unknown] = to_rgba(UNKNOWN_PART, 0.5)
    height, width = np.array(occupancy.is_occupied.shape) * occupancy.resolution_m
    x, y, yaw = occupancy.origin
    axes.imshow(
        cells,
        origin='lower',
        extent=(0.0, width, 0.0, height),
        interpolation='none',
        transform=Affine2D().rotate(yaw).translate(x, y) + axes.transData,
        zorder=1.1,
    )
