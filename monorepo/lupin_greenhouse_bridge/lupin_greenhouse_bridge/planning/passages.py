# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The widths of the passages that a route leads through. Does not import ROS."""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.planning.free_space import Flags, FreeSpace
from lupin_greenhouse_bridge.planning.route import Route
from lupin_greenhouse_bridge.planning.viewpoints import ApproachPose
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout

STEP_M = 0.05


class Passage(NamedTuple):
    """The narrowest passage of the leg that ends at a tag: its width in metres between the obstacles."""

    tag_id: str
    width_m: float


class Passages:
    """
    Tells where lines of a robot's path lead through passages narrower than it needs.

    The width is measured across a line, from the table or wall on its left to that on its right.
    """

    def __init__(self, layout: Layout, walls: Walls, needed_m: float):
        """Take the width in metres that the robot needs."""
        self._obstacles, self.needed_m = FreeSpace(layout, walls, 0.0), needed_m

    def are_narrow(self, starts: np.ndarray, ends: np.ndarray) -> Flags:
        """Return whether each line, from a free point (lines, 2) to another, has a passage too narrow."""
        widths_m = np.array([self._width_m(*line) for line in zip(starts, ends, strict=True)])
        return np.asarray(widths_m < self.needed_m - 1e-9)

    def narrow_on(self, route: Route, poses: Mapping[str, ApproachPose]) -> list[Passage]:
        """Return for each leg of a route that leads through a passage too narrow its narrowest one."""
        left_to_visit = list(route.tag_ids)
        narrowest: dict[str, float] = {}
        for here, there in itertools.pairwise(route.points_m):
            while left_to_visit and here == poses[left_to_visit[0]][:2]:
                del left_to_visit[0]
            if not left_to_visit:
                break
            width_m = self._width_m(np.array(here), np.array(there))
            narrowest[left_to_visit[0]] = min(width_m, narrowest.get(left_to_visit[0], width_m))
        return [Passage(*each) for each in narrowest.items() if each[1] < self.needed_m - 1e-9]

    def _width_m(self, start: np.ndarray, end: np.ndarray) -> float:
        """Return the width of the narrowest passage of a line; of a wider one, the width that is needed."""
        length_m = float(np.hypot(*(end - start)))
        if length_m == 0.0:
            return self.needed_m
        direction = (end - start) / length_m
        places = start + np.arange(0.0, length_m, STEP_M)[:, None] * direction
        across = self.needed_m * np.array([-direction[1], direction[0]])
        widths_m = sum(self._obstacles.reach_m(places, places + side * across) for side in (1, -1))
        return min(float(np.min(widths_m)), self.needed_m)
