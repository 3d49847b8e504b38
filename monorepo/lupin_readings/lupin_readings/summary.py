"""The summary of a file of readings in words, for the head of the page. Does not import ROS."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from lupin_greenhouse_bridge.errors import escaped, names_text
from lupin_greenhouse_bridge.simulator.layout import Layout, natural_order
from lupin_greenhouse_bridge.units import clock_time, unit_of, value_text
from lupin_planning.walls import Walls

from lupin_readings.report_line import Observation
from lupin_readings.rows import Row

LONGEST_REASON = 300  # characters
MOST_EXTREME = 4  # tags that a text about the lowest or the highest value names


class Failures(NamedTuple):
    """The tags that were not read, all for the same reason."""

    word: str  # the outcome, such as `not confirmed`
    reason: str
    tag_ids: list[str]


def failures_of(visits: Iterable[Observation]) -> list[Failures]:
    """Return the tags whose last visit failed, by reason: the largest group first."""
    groups: dict[tuple[str, str], list[str]] = {}
    for visit in {visit.tag_id: visit for visit in visits}.values():
        if visit.outcome != 'OK':
            key = outcome_text(visit.outcome), failure_reason(visit.detail)
            groups.setdefault(key, []).append(visit.tag_id)
    largest_first = sorted(groups.items(), key=lambda item: -len(item[1]))
    return [Failures(*key, sorted(tag_ids, key=natural_order)) for key, tag_ids in largest_first]


def goals_of(visits: Iterable[Observation], walls: Walls) -> dict[str, tuple[float, float]]:
    """Return the goal that the last visit of each tag did not reach, if it is within the walls."""
    last = {visit.tag_id: None if visit.outcome == 'OK' else visit.goal for visit in visits}
    return {tag_id: goal for tag_id, goal in last.items() if goal and walls.has_inside(*goal)}


def is_complete(sensors_of: Mapping[str, Iterable[str]], sensors: Iterable[str], layout: Layout) -> bool:
    """Return whether these tags have values of all their sensors."""
    return all(
        tag_id in layout.tags and {*sensors}.difference(found).isdisjoint(layout.tags[tag_id].sensors)
        for tag_id, found in sensors_of.items()
    )


def failure_counts(failures: Iterable[Failures]) -> dict[str, int]:
    """Return how many tags failed with each word, the most frequent first."""
    counts = Counter[str]()
    for failure in failures:
        counts[failure.word] += len(failure.tag_ids)
    return dict(counts.most_common())


def outcome_text(outcome: str) -> str:
    """Return the outcome of a visit in words, such as `not confirmed`."""
    return 'read' if outcome == 'OK' else escaped(outcome.lower().replace('_', ' '), 64)


def failure_reason(detail: str) -> str:
    """
    Return why a visit failed: what happened, then Nav2's code, without the name of the action.

    Positions in the text stay on one line.
    """
    reason = re.sub(r'[^\s:;][^:;]*\b(code \d+): ([^;]+)', r'\2 (Nav2 \1)', escaped(detail, LONGEST_REASON))
    return re.sub(r'(\d), (-?[\d.]+) m\b', '\\1,\u00a0\\2\u00a0m', reason)


def extremes_of(sensor: str, values: Mapping[str, float]) -> list[tuple[str, list[str]]]:
    """Return the lowest and the highest value as texts, with all their tags; one text if all are equal."""
    tags_by_text: dict[str, list[str]] = {}
    for tag_id, value in values.items():
        tags_by_text.setdefault(value_text(sensor, value), []).append(tag_id)
    found = []
    for word, extreme in (('lowest ', min), ('highest ', max)) if values else ():
        text = value_text(sensor, extreme(values.values()))
        shown = f'{text} {unit_of(sensor)}'.rstrip()
        prefix = word if len(tags_by_text) > 1 else ''
        found.append(
            (f'{prefix}{shown} at {names_text("tag", tags_by_text[text], MOST_EXTREME)}', tags_by_text[text])
        )
    return found[: len(tags_by_text)]


def duration_text(first_ns: int, last_ns: int) -> str:
    """Return the time between two stamps, both cut to whole seconds, such as `7 s`."""
    seconds = last_ns // 10**9 - first_ns // 10**9
    if seconds < 120:
        return f'{seconds} s'
    return f'{seconds / 60:.0f} min' if seconds < 7200 else f'{seconds / 3600:.1f} h'


def greenhouse_times(rows: list[Row]) -> str:
    """Return the first and last time of day in the greenhouse, and the number of days if more than one."""
    times = [row.sim_time_of_day_seconds for row in rows]
    span = ' to '.join(dict.fromkeys(map(clock_time, (times[0], times[-1]))))
    midnights = int((np.diff(times) < 0.0).sum())  # at least: a pause can hide one
    has_more_days = midnights > (times[-1] < times[0])
    return f'greenhouse {span}' + (f' over at least {midnights + 1:,} days' if has_more_days else '')
