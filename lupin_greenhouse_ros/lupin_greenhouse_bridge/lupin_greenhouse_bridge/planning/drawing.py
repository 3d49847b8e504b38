# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Draw the greenhouse: footprint, tables and tags. Does not import ROS."""

from typing import Any

from matplotlib.patches import Rectangle

from lupin_greenhouse_bridge.planning.visualization import Footprint
from lupin_greenhouse_bridge.simulator.layout import Layout

COLOURS = 'viridis'  # readable in black and white, and for colour-blind people
MARGIN_M = 0.15


def draw_footprint(axes: Any, layout: Layout, footprint: Footprint) -> None:
    """Draw walls, tables and a scale in metres; the view includes tags outside the walls."""
    axes.add_patch(Rectangle((0, 0), *footprint, fill=False, linewidth=1.5))
    for x0, y0, x1, y1 in layout.tables.values():
        axes.add_patch(
            Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor='0.92', edgecolor='0.55', linewidth=0.8)
        )
    xs = [0.0, footprint.width_m, *(tag.x for tag in layout.tags.values())]
    ys = [0.0, footprint.length_m, *(tag.y for tag in layout.tags.values())]
    axes.set_xlim(min(xs) - MARGIN_M, max(xs) + MARGIN_M)
    axes.set_ylim(min(ys) - MARGIN_M, max(ys) + MARGIN_M)
    axes.set_aspect('equal')
    axes.set_xlabel('x (m)')
