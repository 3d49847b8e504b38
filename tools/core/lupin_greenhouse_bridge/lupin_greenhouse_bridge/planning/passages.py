"""The widths of the passages that a route leads through. Does not import ROS."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from lupin_greenhouse_bridge.planning.free_space import Flags, FreeSpace
from lupin_greenhouse_bridge.planning.octagons import number_within
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
        return np.asarray(self._widths_m(starts, ends) < self.needed_m - 1e-9)

    def narrow_on(self, route: Route, poses: Mapping[str, ApproachPose]) -> list[Passage]:
        """Return for each leg of a route that leads through a passage too narrow its narrowest one."""
        points_m = np.array(route.points_m).reshape(-1, 2)
        widths_m = self._widths_m(points_m[:-1], points_m[1:]).tolist()
        left_to_visit = list(route.tag_ids)
        narrowest: dict[str, float] = {}
        for here, width_m in zip(route.points_m, widths_m, strict=False):
            while left_to_visit and here == poses[left_to_visit[0]][:2]:
                del left_to_visit[0]
            if not left_to_visit:
                break
            narrowest[left_to_visit[0]] = min(width_m, narrowest.get(left_to_visit[0], width_m))
        return [Passage(*each) for each in narrowest.items() if each[1] < self.needed_m - 1e-9]

    def _widths_m(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return the width of the narrowest passage of each line, and at most the width that is needed."""
        lengths_m = np.hypot(*(ends - starts).T)
        directions = (ends - starts) / np.maximum(lengths_m, 1e-9)[:, None]
        lines, number = number_within(np.ceil(lengths_m / STEP_M).astype(int))
        places = starts[lines] + STEP_M * number[:, None] * directions[lines]
        across = self.needed_m * np.column_stack([-directions[:, 1], directions[:, 0]])[lines]
        narrowest_m = np.full(len(lengths_m), self.needed_m)
        widths_m = sum(self._obstacles.reach_m(places, places + side * across) for side in (1, -1))
        np.minimum.at(narrowest_m, lines, widths_m)
        return narrowest_m
