# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Draw a MarkerArray from above, as RViz does: from the messages alone."""

from lupin_greenhouse_bridge.runtime.poses import pose_in_plane
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.textpath import TextPath
from matplotlib.transforms import Affine2D, Bbox
from visualization_msgs.msg import Marker

PIXELS_PER_M = 160
MARGIN_M = 0.2
ASCENT = 0.75  # of a letter, as a part of the line
BACKGROUND = '#14181c'


def turned(pose) -> Affine2D:
    """Return the transform of a pose that lies in the plane."""
    x, y, yaw = pose_in_plane(pose)
    return Affine2D().rotate(yaw).translate(x, y)


def rgba(colour) -> tuple[float, float, float, float]:
    return colour.r, colour.g, colour.b, colour.a


def render(path, markers) -> dict[tuple[str, int], Bbox]:
    """Write a picture, and return the box of each text in metres by its namespace and number."""
    axes = Figure(facecolor=BACKGROUND).add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    boxes = {}
    for marker in sorted(markers.markers, key=lambda each: each.pose.position.z):
        if marker.type == Marker.CUBE:
            draw_box(axes, marker, (0.0, 0.0), marker.color)
        elif marker.type == Marker.CUBE_LIST:
            for point, colour in zip(marker.points, marker.colors, strict=True):
                draw_box(axes, marker, (point.x, point.y), colour)
        else:
            assert marker.type == Marker.TEXT_VIEW_FACING
            boxes[marker.ns, marker.id] = draw_text(axes, marker)
    around = Bbox.union([*boxes.values(), Bbox(axes.dataLim)])
    axes.set_xlim(around.x0 - MARGIN_M, around.x1 + MARGIN_M)
    axes.set_ylim(around.y0 - MARGIN_M, around.y1 + MARGIN_M)
    axes.figure.set_size_inches((around.width + 2 * MARGIN_M), (around.height + 2 * MARGIN_M))
    FigureCanvasAgg(axes.figure).print_figure(path, dpi=PIXELS_PER_M, facecolor=BACKGROUND)
    return boxes


def draw_box(axes, marker, middle, colour) -> None:
    """Draw a rectangle of the marker's size around a point of its frame."""
    width, height = marker.scale.x, marker.scale.y
    corner = (middle[0] - width / 2, middle[1] - height / 2)
    style = {'facecolor': rgba(colour), 'linewidth': 0}
    axes.add_patch(Rectangle(corner, width, height, **style, transform=turned(marker.pose) + axes.transData))


def draw_text(axes, marker) -> Bbox:
    """Draw the lines of a text below each other, from the left, around the position."""
    size, position = marker.scale.z, marker.pose.position
    assert marker.text.isascii(), 'RViz draws nothing else'
    lines = [TextPath((0, 0), line, size=0.87 * size) for line in marker.text.split('\n')]
    width = max(line.get_extents().x1 for line in lines)
    height = len(lines) * size
    for number, line in enumerate(lines):
        base = position.y + height / 2 - (number + ASCENT) * size
        placed = line.transformed(Affine2D().translate(position.x - width / 2, base))
        axes.add_patch(PathPatch(placed, color=rgba(marker.color), linewidth=0))
    return Bbox.from_bounds(position.x - width / 2, position.y - height / 2, width, height)
