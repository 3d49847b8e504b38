# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Draw the approach poses of a greenhouse and the route along them. Does not import ROS."""

import math
from collections.abc import Collection, Mapping
from typing import Any

from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from lupin_greenhouse_bridge.planning.approach import ApproachPose
from lupin_greenhouse_bridge.planning.drawing import draw_footprint
from lupin_greenhouse_bridge.planning.free_space import room_of
from lupin_greenhouse_bridge.planning.labelling import Box, place_labels
from lupin_greenhouse_bridge.planning.route import Route
from lupin_greenhouse_bridge.planning.visualization import Footprint
from lupin_greenhouse_bridge.simulator.layout import Layout

ROUTE_COLOUR, POSE_COLOUR, BAD_COLOUR = '#56b4e9', '#0072b2', '#d00000'
ARROW_M, TAG_M, BAD_TAG_M = 0.22, 0.14, 0.24
CHARACTER_M, LINE_M = 0.1, 0.18  # of a label in the picture
VIEW_M = 0.4  # around all that is drawn


def draw_route(
    layout: Layout, poses: Mapping[str, ApproachPose], unreachable: Collection[str], route: Route
) -> Figure:
    """Return a figure of tables and tags, poses as arrows, the route, and unreachable tags in red."""
    figure = Figure(figsize=(6.2, 8.8), layout='constrained')
    axes = figure.add_subplot()
    room = room_of(layout)
    draw_footprint(axes, layout, Footprint(room.x1 - room.x0, room.y1 - room.y0))
    axes.patches[0].set_xy((room.x0, room.y0))
    draw_poses(axes, layout, poses, unreachable, route.points_m)
    corners = [corner for x0, y0, x1, y1 in layout.tables.values() for corner in ((x0, y0), (x1, y1))]
    xs, ys = zip(*corners, *(tag[:2] for tag in layout.tags.values()), *route.points_m, strict=True)
    axes.set_xlim(min(xs) - VIEW_M, max(xs) + VIEW_M)
    axes.set_ylim(min(ys) - VIEW_M, max(ys) + VIEW_M)
    axes.set_ylabel('y (m)')
    axes.set_title(
        f'{len(poses)} of {len(layout.tags)} tags have a pose; route {route.length_m:.1f} m', fontsize=10
    )
    axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.06), ncol=5, frameon=False, fontsize=9)
    return figure


def draw_poses(
    axes: Any,
    layout: Layout,
    poses: Mapping[str, ApproachPose],
    unreachable: Collection[str],
    points_m: list[tuple[float, float]],
) -> None:
    """Draw the way of the robot, its poses, and the tags with their ids, into axes that have the tables."""
    if points_m:
        axes.plot(*zip(*points_m, strict=True), color=ROUTE_COLOUR, linewidth=1.8, zorder=2, label='route')
        axes.plot(*points_m[0], 'o', markersize=9, markerfacecolor='white', color=POSE_COLOUR, label='start')
    arrows = [
        (each.x, each.y, math.cos(each.yaw) * ARROW_M, math.sin(each.yaw) * ARROW_M)
        for each in poses.values()
    ]
    if arrows:
        axes.quiver(
            *zip(*arrows, strict=True),
            angles='xy',
            scale_units='xy',
            scale=1,
            width=0.008,
            color=POSE_COLOUR,
            zorder=4,
        )
        axes.plot(
            [], [], linestyle='', marker=r'$\rightarrow$', markersize=12, color=POSE_COLOUR, label='pose'
        )
    for is_bad, style in (
        (False, {'marker': 's', 'markersize': 4.5, 'color': 'black', 'label': 'tag'}),
        (True, {'marker': 'X', 'markersize': 8, 'color': BAD_COLOUR, 'label': 'tag without a pose'}),
    ):
        some = [tag for tag_id, tag in layout.tags.items() if (tag_id in unreachable) is is_bad]
        if some:
            axes.plot([tag.x for tag in some], [tag.y for tag in some], linestyle='', zorder=3, **style)
    sizes_m = [BAD_TAG_M if tag_id in unreachable else TAG_M for tag_id in layout.tags]
    dots = [Box(tag.x, tag.y, side, side) for tag, side in zip(layout.tags.values(), sizes_m, strict=True)]
    taken = [Box(x + dx / 2, y + dy / 2, 0.2, 0.2) for x, y, dx, dy in arrows]
    labels = [(dot, CHARACTER_M * len(tag_id), LINE_M) for tag_id, dot in zip(layout.tags, dots, strict=True)]
    for place, tag_id in zip(place_labels([*dots, *taken], labels), layout.tags, strict=True):
        colour = BAD_COLOUR if tag_id in unreachable else 'black'
        text = axes.text(
            *place, tag_id, ha='center', va='center', fontsize=8, fontweight='bold', color=colour
        )
        text.set(zorder=6, path_effects=[withStroke(linewidth=2, foreground='white')])
