# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The widths of the passages that a route leads through. Does not import ROS."""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.planning.free_space import FreeSpace
from lupin_greenhouse_bridge.planning.route import Route
from lupin_greenhouse_bridge.planning.viewpoints import ApproachPose
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

STEP_M = 0.05


class Passage(NamedTuple):
    """The narrowest passage of the leg that ends at a tag: its width in metres between the obstacles."""

    tag_id: str
    width_m: float


def passages_below(
    width_m: float, route: Route, poses: Mapping[str, ApproachPose], layout: Layout, walls: Walls
) -> list[Passage]:
    """
    Return for each leg of a route that leads through a passage narrower than this its narrowest passage.

    The width is measured across the path, from the table or wall on its left to that on its right.
    """
    obstacles = FreeSpace(layout, walls, 0.0)
    left_to_visit = list(route.tag_ids)
    narrowest: dict[str, float] = {}
    for here, there in itertools.pairwise(np.array(route.points_m)):
        while left_to_visit and tuple(here) == poses[left_to_visit[0]][:2]:
            del left_to_visit[0]
        length_m = float(np.hypot(*(there - here)))
        if not left_to_visit or length_m == 0.0:
            continue
        direction = (there - here) / length_m
        places = here + np.arange(0.0, length_m, STEP_M)[:, None] * direction
        across = width_m * np.array([-direction[1], direction[0]])
        widths_m = obstacles.reach_m(places, places + across) + obstacles.reach_m(places, places - across)
        tag_id = left_to_visit[0]
        narrowest[tag_id] = min(float(widths_m.min()), narrowest.get(tag_id, width_m))
    return [Passage(tag_id, each) for tag_id, each in narrowest.items() if each < width_m - 1e-9]
