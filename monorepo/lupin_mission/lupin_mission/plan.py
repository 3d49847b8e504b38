"""Plan a robot's drives: its goal in the map for each tag, and the order of visits. Does not import ROS."""

from lupin_greenhouse_bridge.simulator.layout import Layout
from lupin_planning.approach import find_approaches
from lupin_planning.occupancy import OccupancyMap
from lupin_planning.overrides import read_overrides
from lupin_planning.poses import PoseInPlane
from lupin_planning.registration import Transform
from lupin_planning.route import plan_route
from lupin_planning.walls import find_walls

from lupin_mission.settings import Settings

Place = tuple[float, float]  # x and y in metres


class Plan:
    """The approach poses of a layout in the map, and the paths between them."""

    def __init__(
        self,
        layout: Layout,
        settings: Settings,
        layout_in_map: Transform,
        occupancy: OccupancyMap | None = None,
        start_in_map_m: Place | None = None,
    ):
        """
        Find the poses that the robot can reach from a free start, with room in the map if there is one.

        Without a start, all poses are in the region from which most tags can be reached. Raises StartUpError.
        """
        self._map_in_layout = layout_in_map.inverse()
        overrides: dict[str, PoseInPlane] = {}
        self.warnings: list[str] = []
        if path := settings.approach_overrides_file:
            overrides, self.warnings = read_overrides(path, layout.tags, layout_in_map)
        found = find_approaches(
            layout,
            find_walls(layout, settings.sim_config_file, settings.walls),
            settings.viewing_limits,
            start_m=start_in_map_m and self._map_in_layout.point(*start_in_map_m),
            overrides=overrides,
            most_per_tag=settings.max_poses,
            occupancy=occupancy and occupancy.in_layout(layout_in_map),
        )
        self._grid, self._region, self._poses = found.grid, found.region, found.poses
        self.unreachable, self.room_warnings = found.unreachable, found.room_warnings
        self.warnings += found.warnings
        self.goals = {
            tag_id: [
                PoseInPlane(*layout_in_map.point(pose.x, pose.y), layout_in_map.heading(pose.yaw))
                for pose in (best, *found.alternatives[tag_id])
            ]
            for tag_id, best in found.poses.items()
        }

    def goal_in_layout_m(self, tag_id: str, pose: int) -> Place | None:
        """Return where the robot stands at a pose of a tag, in the layout; None without this pose."""
        goals = self.goals.get(tag_id, [])[pose - 1 : pose]  # a new plan can have fewer poses
        places = [self._map_in_layout.point(*goal[:2]) for goal in goals]
        return next(((round(x, 3), round(y, 3)) for x, y in places), None)

    def is_for(self, robot_in_map_m: Place | None) -> bool:
        """Return whether the robot can reach the poses, or its place is unknown, or not free."""
        robot_m = self._free_in_layout(robot_in_map_m)
        return robot_m is None or self._grid.region_of(robot_m) == self._region

    def shortest(
        self, tag_ids: list[str], robot_in_map_m: Place | None = None, dock_in_map_m: Place | None = None
    ) -> list[str]:
        """
        Return the tags in the order of the shortest path, and then those without a pose.

        The path starts at the robot, or else at the dock, or else at a tag. It ends at the dock, or else at a
        tag. A robot or dock that is not in the free space is ignored. Raises StartUpError if a tag cannot be
        reached.
        """
        robot_m, dock_m = map(self._free_in_layout, (robot_in_map_m, dock_in_map_m))
        with_pose = [tag_id for tag_id in tag_ids if tag_id in self._poses]
        route = plan_route(self._grid, self._poses, robot_m or dock_m, 'shortest', with_pose, end_m=dock_m)
        return [*route.tag_ids, *(tag_id for tag_id in tag_ids if tag_id not in self._poses)]

    def _free_in_layout(self, place_in_map_m: Place | None) -> Place | None:
        """Transform a position from the map into the layout; None if it is unknown, or not free."""
        if place_in_map_m is None:
            return None
        place_m = self._map_in_layout.point(*place_in_map_m)
        return place_m if self._grid.is_free(*place_m) else None
