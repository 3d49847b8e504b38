"""Draw the greenhouse: footprint, tables and tags. Does not import ROS."""

from typing import Any, NamedTuple

from matplotlib.patches import Rectangle

from lupin_greenhouse_bridge.greenhouse.layout import Layout
from lupin_greenhouse_bridge.greenhouse.visualization import Footprint

COLOURS = 'viridis'  # readable in black and white, and for colour-blind people
MARGIN_M = 0.15


class Box(NamedTuple):
    """A rectangle in metres: its centre and its size."""

    x: float
    y: float
    width: float
    height: float

    def overlap(self, other: 'Box') -> float:
        """Return the common area of two rectangles."""
        wide = _shared(self.x, self.width, other.x, other.width)
        return wide * _shared(self.y, self.height, other.y, other.height)


def _shared(middle: float, length: float, other_middle: float, other_length: float) -> float:
    """Return the common length of two intervals."""
    end = min(middle + length / 2, other_middle + other_length / 2)
    return max(end - max(middle - length / 2, other_middle - other_length / 2), 0.0)


def place_labels(
    dots: list[Box], labels: list[tuple[Box, float, float]], room: Box | None = None
) -> list[tuple[float, float]]:
    """
    Return a place for each label beside its dot, where it covers no dot, no earlier label and no wall.

    Each label is given as its dot, its width and its height.
    """
    taken = list(dots)
    places = []
    for dot, width, height in labels:
        aside, above = (dot.width + width) / 2, (dot.height + height) / 2
        tries = [(aside, 0), (-aside, 0), (0, above), (0, -above)]
        tries += [(x * aside, y * above) for y in (0.7, -0.7, 1.0, -1.0) for x in (1, -1)]
        tries += [(2 * x, 2 * y) for x, y in tries]
        boxes = [Box(dot.x + dx, dot.y + dy, width, height) for dx, dy in tries]

        def cost(box: Box) -> float:
            outside = box.width * box.height - box.overlap(room) if room else 0.0
            return round(outside + sum(box.overlap(each) for each in taken), 4)  # the nearest of equals

        best = min(boxes, key=cost)
        taken.append(best)
        places.append((best.x, best.y))
    return places


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
