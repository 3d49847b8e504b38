"""The mission's parameters: names, defaults, what is accepted, what they do. No ROS here."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields

from lupin_greenhouse_bridge.errors import StartUpError

from lupin_mission.mission import Limits


def _parameter(default, description: str):
    return field(default=default, metadata={'description': description})


@dataclass(frozen=True)
class Settings:
    """The parameter values of one run, checked; raises StartUpError on what a description does not accept."""

    tag_ids: str = _parameter(  # or an array
        '', 'The tags in the order of the visit, as text ("6 21 29") or as an array; empty: all of tag_file.'
    )
    tag_file: str = _parameter('', "The bridge's tag_locations.json; empty: the shipped one.")
    bridge_service_name: str = _parameter('/greenhouse_bridge/get_tag_reading', 'The GetTagReading service.')
    confirm_service_name: str = _parameter('/perception/confirm_tag', 'The ConfirmTag service.')
    require_visual_confirmation: bool = _parameter(
        False,
        'Read a tag only when the camera has confirmed it (hardware); false: trust the ids (simulation).',
    )
    drive_seconds: float = _parameter(
        0.0, 'How long the drive to a tag takes; 0.0: the robot is there at once.'
    )
    dwell_seconds: float = _parameter(
        Limits.dwell_seconds, 'How long, at least, the robot stands at a tag, in seconds.'
    )
    request_timeout_seconds: float = _parameter(
        Limits.request_timeout_seconds, 'How long to wait for one answer, in seconds, above 0.'
    )
    max_attempts: int = _parameter(
        Limits.max_attempts, 'How often to ask each service at a tag before its scan has failed, at least 1.'
    )
    retry_delay_seconds: float = _parameter(
        Limits.retry_delay_seconds,
        'How long to wait before the second attempt, in seconds; doubles each time, up to 10.',
    )
    report_file: str = _parameter(
        '', 'The JSON Lines file to write; one that exists is continued. Empty: mission-TIME.jsonl here.'
    )

    def __post_init__(self):
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name == 'tag_ids':
                continue
            kind, accepted = _KINDS[each.type]
            if isinstance(value, bool) != (kind is bool) or not isinstance(value, kind):
                raise StartUpError(f'parameter {each.name} is {value!r}, not {accepted}')
        for name in ('drive_seconds', 'dwell_seconds', 'retry_delay_seconds'):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise StartUpError(f'parameter {name} is {getattr(self, name)}: give seconds, 0 or more')
        if not 0.0 < self.request_timeout_seconds < math.inf:
            raise StartUpError(
                f'parameter request_timeout_seconds is {self.request_timeout_seconds}: give seconds above 0'
            )
        if self.max_attempts < 1:
            raise StartUpError(
                f'parameter max_attempts is {self.max_attempts}: give a whole number from 1 up'
            )
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
    def limits(self) -> Limits:
        """The part of the settings that the mission itself goes by."""
        return Limits(**{each.name: getattr(self, each.name) for each in fields(Limits)})


_KINDS = {
    str: (str, 'text (a number as a file name needs quotes)'),
    bool: (bool, 'true or false'),
    float: ((int, float), 'a number'),
    int: (int, 'a whole number'),
}
