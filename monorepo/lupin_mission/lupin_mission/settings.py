"""The mission's parameters: names, defaults, limits and descriptions. Does not import ROS."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.runtime.parameters import check_parameters, invalid, parameter
from lupin_planning.viewpoints import ViewingLimits
from lupin_planning.walls import parse_pose, parse_walls, walls_parameter

from lupin_mission.visit import Service

LONGEST_SECONDS = 86400.0
CHOICES = {
    'drive': (('nav2', 'simulated'), 'nav2 or simulated'),
    'order': (('numeric', 'shortest'), 'numeric or shortest'),
    'tag_poses_in_map': (('', True, False, 'true', 'false'), 'true, false or empty'),
}
REPLY_SECONDS = 3.0  # A camera on a busy machine replies this long after its timeout.
LARGEST_CAMERA_OFFSET_M = 0.29  # Less than the smallest standoff.
# Arguments of the team's orchestrator that have no effect here: this mission does not explore, localize, or
# move an arm.
WITHOUT_EFFECT = (
    'approach_yaw',
    'arm_inspect_preset',
    'arm_patrol_enabled',
    'arm_preset_service',
    'arm_travel_preset',
    'arm_travel_settle_s',
    'base_frame',
    'battery_low_threshold',
    'battery_topic',
    'discovered_tags_topic',
    'discovery_goal',
    'dock_timeout_s',
    'exploration_timeout_s',
    'frontier_free_thresh',
    'frontier_min_cluster_cells',
    'frontier_occupied_thresh',
    'frontier_robot_radius_cells',
    'localization_covariance_threshold',
    'localization_timeout_s',
    'map_yaml_path',
    'monitoring_sweeps',
    'nav_localization_cov_threshold',
    'seed_climate_on_discovery',
)


def _seconds(default: float, description: str, smallest: float = 0.0) -> Any:
    return parameter(default, description, smallest=smallest, largest=LONGEST_SECONDS)


def _count(default: int, description: str, largest: int = 1000) -> Any:
    return parameter(default, description, smallest=1, largest=largest)


def _limit(name: str, smallest: float, largest: float, description: str) -> Any:
    """Return the field of a parameter with the default of ViewingLimits."""
    return parameter(getattr(ViewingLimits, name), description, smallest=smallest, largest=largest)


def _text_or_array(default: str, description: str) -> Any:
    """Return the field of a parameter that the dataclass splits into words itself."""
    return parameter(default, description, of_any_type=True)


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run; raises StartUpError for an invalid value."""

    tag_sequence: str = _text_or_array(
        '', 'The tags to visit, in this order: "6 21 29", or an array; empty: all tags in natural order.'
    )
    tag_locations_file: str = parameter(
        '', "The bridge's tag_locations.json; empty: ids from the bridge, positions from mdp-greenhouse."
    )
    world_file: str = parameter(
        '', 'An SDF world, without nav2: its models tag_<id> are the tags with their positions.'
    )
    bridge_service_name: str = parameter('/greenhouse_bridge/get_tag_reading', 'The GetTagReading service.')
    visual_confirmation_service: str = parameter('perception/confirm_tag', 'The ConfirmTag service.')
    require_visual_confirmation: bool = parameter(
        False, 'Read a tag only if the camera confirms it (hardware); false: no camera (simulation).'
    )
    order: str = parameter(
        'numeric', 'numeric (tag_sequence keeps its own order), or shortest: the shortest route, with nav2.'
    )
    drive: str = parameter('nav2', 'How the robot gets to a tag: nav2, or simulated (no robot moves).')
    drive_seconds: float = _seconds(0.0, 'With drive simulated: seconds for the drive to a tag.')
    nav_action_name: str = parameter('navigate_to_pose', 'The NavigateToPose action.')
    nav_timeout_s: float = _seconds(60.0, 'Seconds for one drive with Nav2; 0.0: no limit.')
    nav_max_attempts: int = _count(2, 'How often the robot tries to drive to one pose, or to the dock.')
    max_poses: int = _count(
        2, 'With nav2: the largest number of poses that the robot tries at a tag.', largest=10
    )
    robot_radius_m: float = parameter(
        0.2, 'Radius of the robot in metres, for its approach poses.', smallest=0.0, largest=0.75
    )
    approach_standoff_m: float = parameter(
        0.5, 'Preferred distance from the robot to a tag in metres.', smallest=0.2, largest=1.5
    )
    approach_clearance_m: float = _limit(
        'clearance_m',
        0.0,
        1.0,
        "Room at each pose beyond the robot's radius in metres, where there is as much.",
    )
    arrival_tolerance_m: float = _limit(
        'arrival_tolerance_m', 0.0, 1.0, 'How far from its pose the robot may stop, in metres.'
    )
    arrival_tolerance_rad: float = parameter(
        0.15,
        'How far the robot may be turned from its pose, in radians.',
        smallest=0.0,
        largest=math.pi,
    )
    camera_offset_m: float = _limit(
        'camera_offset_m',
        -LARGEST_CAMERA_OFFSET_M,
        LARGEST_CAMERA_OFFSET_M,
        "How far the camera is in front of the robot's centre, in metres.",
    )
    approach_overrides_file: str = parameter(
        '', 'A YAML file of poses that are set by hand: approach_overrides.yaml.'
    )
    sim_config_file: str = parameter(
        '', "The bridge's greenhouse_config.yaml, for the walls; empty: the one of mdp-greenhouse."
    )
    walls: str = walls_parameter()
    map_topic: str = parameter(
        'map', 'With nav2: a latched OccupancyGrid; the poses keep clear of its obstacles; empty: none.'
    )
    dock_pose: str = _text_or_array(
        '[0.0, 0.0, 0.0]',
        'Where the robot returns at the end: x and y in metres in the map, yaw in radians; empty: nowhere.',
    )
    flower_scan_dwell_s: float = _seconds(0.0, 'Minimum time at each tag in seconds.')
    scan_timeout_s: float = _seconds(5.0, 'Seconds to wait for each reply of the bridge.', smallest=0.001)
    visual_confirmation_timeout_s: float = _seconds(
        3.0,
        'Seconds for the camera to look, more than it needs; the mission waits 3 s longer for its reply.',
        smallest=0.001,
    )
    max_attempts: int = _count(3, 'How many requests the mission sends to each service from one pose.')
    report_file: str = parameter(
        '', 'The JSON Lines file to write or to continue; empty: mission-TIME.jsonl in the current folder.'
    )
    wait_for_start: bool = parameter(
        True, 'Start each mission when mission/start is called; false: start one immediately, then exit.'
    )
    wait_for_subscriber: bool = parameter(
        False, 'With wait_for_start false: wait for a subscriber of mission/readings, such as a recorder.'
    )
    dependency_timeout_s: float = _seconds(
        30.0, "Seconds to wait for Nav2; without wait_for_start, also for the bridge's tags and a subscriber."
    )
    mission_id_prefix: str = parameter('lupin', 'The first word of each mission id.')
    frame_id: str = parameter('map', 'The frame of the poses, and of the headers of all messages.')
    state_publish_rate_hz: float = parameter(
        5.0, 'How often mission/state is published, per second.', smallest=0.1, largest=100.0
    )
    estop_topic: str = parameter('/e_stop_state', 'A std_msgs/Bool topic: true stops the robot.')
    amcl_pose_topic: str = parameter(
        'amcl_pose', "The robot's pose, with which a plan begins and each drive is checked; empty: none."
    )
    layout_in_map: str = parameter(
        '', 'The file of register_layout: where the layout lies in the map; empty: at the origin of the map.'
    )
    tag_poses_in_map: str = _text_or_array(
        '', 'Of a tag that perception has not found: true publishes its place in the layout, false the robot.'
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        parse_walls(self.walls)
        for name, (choices, accepted) in CHOICES.items():
            if getattr(self, name) not in choices:
                raise invalid(name, getattr(self, name), accepted)
        self._check_names()
        if not abs(self.camera_offset_m) < self.approach_standoff_m:
            raise invalid('camera_offset_m', self.camera_offset_m, 'less than approach_standoff_m')
        if self.order == 'shortest' and self.drive != 'nav2':
            raise StartUpError('order:=shortest is for a robot that drives: set drive to nav2')
        if self.world_file and self.drive == 'nav2':
            raise StartUpError(
                'world_file does not name the tables that a robot drives around:'
                ' set tag_locations_file to the tag file of the world instead'
            )
        has_dock = self.dock_pose is not None and str(self.dock_pose).strip(' []') != ''
        if has_dock and not self.dock:
            accepted = 'empty, or x, y and yaw in radians: "1.0 0.5 3.14", or an array'
            raise invalid('dock_pose', self.dock_pose, accepted)
        if self.world_file and self.tag_locations_file:
            raise StartUpError('parameters world_file and tag_locations_file are both set: set one of them')
        ids = ids_in(self.tag_sequence)
        if twice := sorted({tag_id for tag_id in ids if ids.count(tag_id) > 1}):
            shown = escaped(twice[0], 40)
            raise StartUpError(f"parameter tag_sequence names '{shown}' twice: a mission visits a tag once")

    def _check_names(self) -> None:
        if not self.estop_topic:
            raise invalid('estop_topic', '', 'the name of a topic')
        if {'/', '\0'} & set(self.mission_id_prefix):  # it is a part of the report's name
            raise invalid('mission_id_prefix', self.mission_id_prefix, 'a word without /')
        if self.report_file and Path(self.report_file).name in ('', '..'):
            raise invalid('report_file', self.report_file, 'the path of a file, or empty')

    @property
    def chosen_tag_ids(self) -> list[str]:
        """The ids in tag_sequence; [] if it is empty."""
        return ids_in(self.tag_sequence)

    @property
    def dock(self) -> list[float]:
        """x, y and yaw of the dock in the map; [] if the robot does not return to one."""
        return parse_pose(self.dock_pose) if self.dock_pose is not None else []

    @property
    def has_poses_in_map(self) -> bool:
        """Whether the layout gives the position of a tag in the map."""
        if self.tag_poses_in_map == '':
            return bool(self.layout_in_map) or not self.require_visual_confirmation
        return self.tag_poses_in_map in (True, 'true')

    @property
    def viewing_limits(self) -> ViewingLimits:
        """The limits of the approach poses."""
        standoff_m = self.approach_standoff_m
        return ViewingLimits(
            robot_radius_m=self.robot_radius_m,
            smallest_standoff_m=min(ViewingLimits.smallest_standoff_m, standoff_m),
            preferred_standoff_m=standoff_m,
            largest_standoff_m=max(ViewingLimits.largest_standoff_m, standoff_m),
            clearance_m=self.approach_clearance_m,
            arrival_tolerance_m=self.arrival_tolerance_m,
            camera_offset_m=self.camera_offset_m,
        )

    def timeout_seconds(self, service: Service) -> float:
        """Return how long the mission waits for the reply to one request to a service."""
        if service is Service.CONFIRM:
            return self.visual_confirmation_timeout_s + REPLY_SECONDS
        return self.scan_timeout_s


def ids_in(tag_sequence: object) -> list[str]:
    """
    Return the tag ids in a text such as `6 21`, or in an array; raises StartUpError.

    An array can be a text, too, as in a launch argument: `["Tomate 7", 8]`.
    """
    accepted = 'ids such as "6 21 29", or an array of them'
    items = tag_sequence
    if isinstance(tag_sequence, str):
        if not tag_sequence.strip().startswith('['):
            return tag_sequence.replace(',', ' ').split()
        try:
            items = yaml.load(tag_sequence, yaml.BaseLoader)  # noqa: S506 - it makes texts of all values
        except yaml.YAMLError as error:
            raise invalid('tag_sequence', tag_sequence, accepted) from error
    if items is None:  # rclpy's value of an empty array
        return []
    ids = list(items) if isinstance(items, Iterable) else [items]
    if any(isinstance(tag_id, bool) or not isinstance(tag_id, str | int | float) for tag_id in ids):
        raise invalid('tag_sequence', tag_sequence, accepted)
    return [str(tag_id) for tag_id in ids]
