# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The rows in which readings are kept: one value each. Does not import ROS."""

import datetime
import math
from collections.abc import Iterable
from typing import NamedTuple

from lupin_greenhouse_bridge.units import unit_of

LATEST_STAMP_NS = 2**63 - 1  # the year 2262


class Row(NamedTuple):
    """One value of one reading. The wall clock's stamp, the tag and the sensor identify it."""

    stamp_ns: int  # wall clock of the bridge, since 1970
    stamp_utc: str  # the same, as ISO 8601
    tag_id: str
    sensor: str
    value: float
    unit: str  # '' for a sensor that is not one of the simulator's
    x_m: float | None  # position of the tag in the layout; None if it is unknown
    y_m: float | None
    sim_time_of_day_seconds: float  # in [0, 86400); it repeats, so it identifies nothing
    source: str  # the topic or the command that the reading came from


def rows_of(reading, source: str, place_m: tuple[float, float] | None = None) -> list[Row]:
    """Return the rows of a TagReading, in the order of its sensors."""
    stamp_ns = reading.stamp.sec * 1_000_000_000 + reading.stamp.nanosec
    x_m, y_m = place_m or (None, None)
    return [
        Row(
            stamp_ns,
            utc_of(stamp_ns),
            reading.tag_id,
            each.name,
            each.value,
            unit_of(each.name),
            x_m,
            y_m,
            reading.sim_time_of_day_seconds,
            source,
        )
        for each in reading.readings
    ]


def fault_of(row: Row) -> str:
    """Return which number of a row from a file cannot be right; '' if all can."""
    if not 0 <= row.stamp_ns <= LATEST_STAMP_NS:
        return f'stamp_ns is {row.stamp_ns}'
    for name in ('value', 'x_m', 'y_m', 'sim_time_of_day_seconds'):
        number = getattr(row, name)
        if number is not None and not math.isfinite(number):
            return f'{name} of {row.sensor} is {number}'
    return ''


def utc_of(stamp_ns: int) -> str:
    """Return a stamp as ISO 8601 in UTC with nanoseconds, such as 2026-05-04T09:30:00.000000000Z."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    moment = datetime.datetime.fromtimestamp(seconds, tz=datetime.timezone.utc)
    return f'{moment:%Y-%m-%dT%H:%M:%S}.{nanoseconds:09}Z'


def last_of_each_tag(rows: Iterable[Row]) -> dict[str, dict[str, Row]]:
    """Return the last reading of each tag as its rows by sensor; rows come in the order of their stamps."""
    last: dict[str, dict[str, Row]] = {}
    for row in rows:
        reading = last.setdefault(row.tag_id, {})
        if any(each.stamp_ns != row.stamp_ns for each in reading.values()):
            reading.clear()
        reading[row.sensor] = row
    return last
