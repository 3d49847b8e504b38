"""The rows of recorded readings, with one value each, and how they are written. Does not import ROS."""

import datetime
import math
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.units import unit_of

if TYPE_CHECKING:
    from lupin_greenhouse_bridge.interfaces import TagReading

LATEST_STAMP_NS = 2**63 - 1  # the largest integer of SQLite: the year 2262
SURROGATES = re.compile('[\ud800-\udfff]')  # stand for bytes that are not UTF-8


class Row(NamedTuple):
    """One value of one reading."""

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


HEADER = ','.join(Row._fields)
PLACE = ('x_m', 'y_m')
NUMBERS = ('value', *PLACE, 'sim_time_of_day_seconds')  # the columns of type float
TEXTS = tuple(name for name in Row._fields if name not in ('stamp_ns', *NUMBERS))


def key_of(row: Row) -> tuple[int, str, str, float]:
    """Return the key of a row. It includes the value."""
    return row.stamp_ns, row.tag_id, row.sensor, row.value


def rows_of(reading: 'TagReading', source: str, place_m: tuple[float, float] | None = None) -> list[Row]:
    """Return the rows of a TagReading, in the order of its sensors."""
    stamp_ns = reading.stamp.sec * 1_000_000_000 + reading.stamp.nanosec
    values = ((sensor.name, sensor.value) for sensor in reading.readings)
    return make_rows(stamp_ns, reading.tag_id, values, reading.sim_time_of_day_seconds, source, place_m)


def make_rows(
    stamp_ns: int,
    tag_id: str,
    values: Iterable[tuple[str, float]],
    sim_time_of_day_seconds: float,
    source: str,
    place_m: tuple[float, float] | None = None,
) -> list[Row]:
    """Return one row per name and value. The other arguments are columns; place_m is x and y, or None."""
    head = stamp_ns, utc_of(stamp_ns), tag_id
    tail = *(place_m or (None, None)), sim_time_of_day_seconds, source
    return [Row(*head, sensor, value, unit_of(sensor), *tail) for sensor, value in values]


def utc_of(stamp_ns: int) -> str:
    """
    Return a stamp as ISO 8601 in UTC with nanoseconds, such as 2026-05-04T09:30:00.000000000Z.

    Returns '' for a stamp that fault_of() refuses.
    """
    if not 0 <= stamp_ns <= LATEST_STAMP_NS:
        return ''
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    moment = datetime.datetime.fromtimestamp(seconds, tz=datetime.timezone.utc)
    return f'{moment:%Y-%m-%dT%H:%M:%S}.{nanoseconds:09}Z'


def last_reading_of_each_tag(rows: Sequence[Row]) -> dict[str, dict[str, Row]]:
    """Return the last reading of each tag as its rows by sensor; rows come in the order of their stamps."""
    last_stamps_ns = {row.tag_id: row.stamp_ns for row in rows}
    last: dict[str, dict[str, Row]] = {tag_id: {} for tag_id in last_stamps_ns}
    for row in rows:
        if row.stamp_ns == last_stamps_ns[row.tag_id]:
            last[row.tag_id][row.sensor] = row
    return last


def fault_of(row: Row) -> str:
    """Return which value of a row from outside is wrong, and what would be right; '' if the row is good."""
    if not (isinstance(row.stamp_ns, int) and 0 <= row.stamp_ns <= LATEST_STAMP_NS):
        return _fault(row, 'stamp_ns', f'from 0 to {LATEST_STAMP_NS}, in nanoseconds since 1970')
    for name in NUMBERS:
        number = getattr(row, name)
        is_finite = isinstance(number, float) and math.isfinite(number)
        if not (is_finite or (number is None and name in PLACE)):
            return _fault(row, name, 'a finite number')
    for name in TEXTS:
        text = getattr(row, name)
        if not isinstance(text, str) or SURROGATES.search(text):
            return _fault(row, name, 'text in UTF-8')
    return ''


def _fault(row: Row, name: str, wanted: str) -> str:
    return f'{name} of {row.sensor} is {escaped(repr(getattr(row, name)), 60)}: must be {wanted}'
