"""The mission's parameters: names, defaults, what is accepted, what they do. No ROS here."""

from collections.abc import Iterable
from dataclasses import dataclass, fields

from lupin_mission.errors import StartUpError, printable
from lupin_mission.life_cycle import check_parameters, parameter
from lupin_mission.mission import Limits

LONGEST_SECONDS = 86400.0


@dataclass(frozen=True)
class Settings:
    """The parameter values of one run, checked; raises StartUpError on what a description does not accept."""

    tag_ids: str = parameter(  # or an array
        '',
        'The tags in the order of the visit, as text ("6 21 29") or as an array; empty: all of world_file or'
        ' tag_file, or all that the bridge has loaded.',
    )
    tag_file: str = parameter('', "The bridge's tag_locations.json; empty: ask the bridge for its tags.")
    world_file: str = parameter(
        '', 'An SDF world: visit its models tag_<id>, in numeric order; the tags are where it has them.'
    )
    bridge_service_name: str = parameter('/greenhouse_bridge/get_tag_reading', 'The GetTagReading service.')
    confirm_service_name: str = parameter('/perception/confirm_tag', 'The ConfirmTag service.')
    require_visual_confirmation: bool = parameter(
        False,
        'Read a tag only when the camera has confirmed it (hardware); false: trust the ids (simulation).',
    )
    drive_seconds: float = parameter(
        0.0,
        'How long the drive to a tag takes, in seconds; 0.0: the robot is there at once.',
        smallest=0.0,
        largest=LONGEST_SECONDS,
    )
    dwell_seconds: float = parameter(
        Limits.dwell_seconds,
        'How long, at least, the robot stands at a tag, in seconds.',
        smallest=0.0,
        largest=LONGEST_SECONDS,
    )
    request_timeout_seconds: float = parameter(
        Limits.request_timeout_seconds,
        'How long to wait for one answer, in seconds.',
        smallest=0.001,
        largest=LONGEST_SECONDS,
    )
    max_attempts: int = parameter(
        Limits.max_attempts,
        'How often to ask each service at a tag before its scan has failed.',
        smallest=1,
        largest=1000,
    )
    retry_delay_seconds: float = parameter(
        Limits.retry_delay_seconds,
        'How long to wait before the second attempt, in seconds; doubles each time, up to 10.',
        smallest=0.0,
        largest=LONGEST_SECONDS,
    )
    report_file: str = parameter(
        '',
        'The JSON Lines file to write; one that exists is continued. Empty: mission-TIME.jsonl here.'
        ' With wait_for_start, each mission adds its id to the name.',
    )
    wait_for_start: bool = parameter(
        False,
        'Wait for ~/start, and after each mission for the next one; false: start at once.',
    )
    observations_topic: str = parameter(
        '/floranova/observations', 'Where each tag that is closed is published.'
    )
    tag_poses_in_map: str = parameter(  # or a bool
        '',
        'Publish the place of a tag in the tag file or world as its pose in the map: true where the map is'
        ' that of the layout (simulation); empty: the opposite of require_visual_confirmation.',
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
        """The ids that tag_ids names; none when it is empty."""
        if isinstance(self.tag_ids, str):
            return self.tag_ids.replace(',', ' ').split()
        is_array = isinstance(self.tag_ids, Iterable)
        return [str(tag_id) for tag_id in (self.tag_ids if is_array else [self.tag_ids])]

    @property
    def has_poses_in_map(self) -> bool:
        """Whether a tag's place in the tag file is its place in the map."""
        if self.tag_poses_in_map == '':
            return not self.require_visual_confirmation
        return self.tag_poses_in_map in (True, 'true')

    @property
    def limits(self) -> Limits:
        """The part of the settings that the mission itself goes by."""
        return Limits(**{each.name: getattr(self, each.name) for each in fields(Limits)})
