"""The mission's parameters: names, defaults, limits and descriptions. Does not import ROS."""

from collections.abc import Iterable
from dataclasses import dataclass, fields

from lupin_greenhouse_bridge.errors import StartUpError, printable
from lupin_greenhouse_bridge.node.parameters import check_parameters, parameter

from lupin_mission.mission import Limits

LONGEST_SECONDS = 86400.0


@dataclass(frozen=True)
class Settings:
    """The validated parameters of one run. Raises StartUpError for an invalid value."""

    tag_ids: str = parameter(  # or an array
        '',
        'The tags to visit, in this order, as text ("6 21 29") or as an array; empty: all tags of world_file,'
        ' of tag_file, or else of the bridge.',
    )
    tag_file: str = parameter('', "The bridge's tag_locations.json; empty: ask the bridge for its tags.")
    world_file: str = parameter(
        '', 'An SDF world: visit its models tag_<id> in numeric order, and take their positions from it.'
    )
    bridge_service_name: str = parameter('/greenhouse_bridge/get_tag_reading', 'The GetTagReading service.')
    confirm_service_name: str = parameter('/perception/confirm_tag', 'The ConfirmTag service.')
    require_visual_confirmation: bool = parameter(
        False,
        'Read a tag only if the camera confirms it (hardware); false: trust the ids (simulation).',
    )
    drive_seconds: float = parameter(
        0.0,
        'Seconds for the drive to a tag; 0.0: the robot arrives at once.',
        smallest=0.0,
        largest=LONGEST_SECONDS,
    )
    dwell_seconds: float = parameter(
        Limits.dwell_seconds,
        'Seconds that the robot stays at a tag, at least.',
        smallest=0.0,
        largest=LONGEST_SECONDS,
    )
    request_timeout_seconds: float = parameter(
        Limits.request_timeout_seconds,
        'Seconds to wait for each reply.',
        smallest=0.001,
        largest=LONGEST_SECONDS,
    )
    max_attempts: int = parameter(
        Limits.max_attempts,
        'Requests to each service at a tag before its scan fails.',
        smallest=1,
        largest=1000,
    )
    retry_delay_seconds: float = parameter(
        Limits.retry_delay_seconds,
        'Seconds before the second attempt; doubles with each further attempt, up to 10.',
        smallest=0.0,
        largest=LONGEST_SECONDS,
    )
    report_file: str = parameter(
        '',
        'The JSON Lines file to write or to continue; empty: mission-TIME.jsonl in this folder.'
        ' With wait_for_start, each mission adds its id to the name.',
    )
    wait_for_start: bool = parameter(
        False,
        'Start each mission when ~/start is called; false: start one mission at once.',
    )
    observations_topic: str = parameter(
        '/floranova/observations', 'The topic for the observation of each tag.'
    )
    tag_poses_in_map: str = parameter(  # or a bool
        '',
        'Publish the position of a tag in the tag file or world as its pose in the map: true if the map has'
        ' the frame of the layout (simulation); empty: the opposite of require_visual_confirmation.',
    )

    def __post_init__(self):
        check_parameters(self, of_any_type=('tag_ids', 'tag_poses_in_map'))
        if self.tag_poses_in_map not in ('', True, False, 'true', 'false'):
            shown = printable(repr(self.tag_poses_in_map), 100)
            raise StartUpError(f'parameter tag_poses_in_map is {shown}: must be true, false or empty')
        if self.world_file and self.tag_file:
            raise StartUpError('parameters world_file and tag_file are both set: set one of them')
        ids = self.chosen_tag_ids
        if twice := sorted({tag_id for tag_id in ids if ids.count(tag_id) > 1}):
            raise StartUpError(f'parameter tag_ids names {twice[0]!r} twice: a mission visits a tag once')

    @property
    def chosen_tag_ids(self) -> list[str]:
        """The ids in tag_ids; () if it is empty."""
        if isinstance(self.tag_ids, str):
            return self.tag_ids.replace(',', ' ').split()
        is_array = isinstance(self.tag_ids, Iterable)
        return [str(tag_id) for tag_id in (self.tag_ids if is_array else [self.tag_ids])]

    @property
    def has_poses_in_map(self) -> bool:
        """Whether a tag's position in the tag file is its position in the map."""
        if self.tag_poses_in_map == '':
            return not self.require_visual_confirmation
        return self.tag_poses_in_map in (True, 'true')

    @property
    def limits(self) -> Limits:
        """The settings of the state machine."""
        return Limits(**{each.name: getattr(self, each.name) for each in fields(Limits)})
