"""The files of readings: what is kept, what is refused, and what can be read again. Without ROS."""

import contextlib
import json
import math
import os
import resource
import sqlite3
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.reading.table import CSV_COLUMNS
from lupin_readings.reading_file import read_file
from lupin_readings.report_line import Observation, Outcome, Reading
from lupin_readings.rows import Row, utc_of
from lupin_readings.store import ReadingFileError, Store, StoreError, read_rows

STAMP_NS = 1_795_189_976_000_000_513


def row(number=0, tag_id='7', sensor='co2', value=468.63, place_m=(1.5, 7.25)) -> Row:
    at = STAMP_NS + number
    return Row(at, utc_of(at), tag_id, sensor, value, 'ppm', *place_m, 14400.0, '/mission/readings')


def rows(*numbers) -> list[Row]:
    return [row(number) for number in range(*numbers)]


@pytest.fixture
def database(tmp_path):
    return tmp_path / 'readings.sqlite'


@pytest.mark.parametrize('name', ['readings.sqlite', 'READINGS.DB', 'file:x?mode=ro.sqlite', ':memory:.db'])
def test_what_was_kept_is_read_again_with_the_positions_of_the_layout(
    tmp_path, shipped_tags, monkeypatch, name
):
    kept = [
        row(0, value=0.1 + 0.2),
        row(1, tag_id='a "b", c\r\nd\u2028e\x85', sensor='ünits'),
        row(2, place_m=(None, None), tag_id='nowhere'),
        row(2, place_m=(-1.0, 1e-300), sensor='light'),
        row(3, sensor='long' * 50_000),
    ]
    monkeypatch.chdir(tmp_path)
    assert Store(name).keep([*kept, row(4, place_m=(None, None))]) == 6
    place_m = shipped_tags['7']['x'], shipped_tags['7']['y']
    assert sorted(read_file(name).rows, key=str) == sorted([*kept, row(4, place_m=place_m)], key=str)
    assert list(tmp_path.iterdir()) == [tmp_path / name]


def test_read_tag_prints_the_columns_of_the_file():
    assert Row._fields == CSV_COLUMNS


def test_recorders_share_a_database_that_keeps_a_repeated_row_once_and_one_with_another_value_too(database):
    first, second = row(), row(value=468.64)
    store, other = Store(str(database)), Store(str(database))
    assert [store.keep([first, first]), store.keep([first]), other.keep([first, second])] == [1, 0, 1]
    assert read_rows(database) == [first, second]


def test_a_database_that_another_program_locks_is_written_after_it(database):
    store = Store(str(database))
    with contextlib.closing(sqlite3.connect(database, isolation_level=None)) as other:
        other.execute('BEGIN IMMEDIATE')
        with pytest.raises(StoreError, match='database is locked'):
            store.keep([row()], wait_seconds=0.0)
    assert store.keep([row()]) == 1


def change_database(path, *statements):
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for statement in statements:
            connection.execute(statement)


def test_on_a_full_disk_all_of_some_rows_are_kept_or_none(database):
    store, many = Store(str(database)), rows(2000)
    before = database.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)  # no file of this process grows beyond so many bytes
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 20_000, limits[1]))
    try:
        with pytest.raises(StoreError, match=r'disk|File too large'):
            store.keep(many)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert database.read_bytes() == before
    assert store.keep(many) == len(many)
    assert read_rows(database) == many


LOSSES = {
    'moved': lambda path: path.rename(path.with_name('moved')),
    'truncated': lambda path: os.truncate(path, 0),
}


@pytest.mark.parametrize('lose', LOSSES.values(), ids=LOSSES)
def test_after_a_file_that_was_lost_the_rows_go_on_in_a_new_one(database, lose):
    store = Store(str(database))
    store.keep([row()])
    lose(database)
    assert [store.keep(rows(1, 3)), store.keep([row(3)])] == [2, 1]
    assert read_rows(database) == rows(1, 4)
    if (moved := database.with_name('moved')).exists():
        assert read_rows(moved) == [row()]


def test_a_file_that_something_else_replaces_stays_unchanged_and_the_rows_wait(database):
    store = Store(str(database))
    moved = database.rename(database.with_name('moved'))
    database.write_text('dear diary\n' * 1000)
    for _ in range(2):
        with pytest.raises(StoreError, match='file is not a database'):
            store.keep([row()])
    assert database.read_text() == 'dear diary\n' * 1000
    moved.replace(database)
    assert store.keep([row()]) == 1
    assert read_rows(database) == [row()]


def test_a_database_killed_in_a_commit_is_restored_by_its_reader(database):
    """The file and its journal are those of a commit that has written some of its pages."""
    Store(str(database)).keep(rows(1000))
    killed = database.with_name('killed.sqlite')
    with contextlib.closing(sqlite3.connect(database)) as writer:
        writer.execute('PRAGMA cache_size = 2')  # too small for a transaction: pages go to the file
        writer.execute('UPDATE readings SET value = 0.0')
        for ending in ('', '-journal'):
            Path(f'{killed}{ending}').write_bytes(Path(f'{database}{ending}').read_bytes())
    without_its_journal = f'file:{killed}?immutable=1'
    with contextlib.closing(sqlite3.connect(without_its_journal, uri=True)) as connection:
        assert connection.execute('SELECT min(value) FROM readings').fetchone() == (0.0,)
    assert read_rows(killed) == rows(1000)


REPORT = (
    '{"tag_id": "7", "outcome": "OK", "detail": "", "attempts": 2,'
    ' "stamp": {"sec": 1795189976, "nanosec": 513}, "sim_time_of_day_seconds": 14400.0,'
    ' "readings": {"co2": 468.63, "radon": 2}}\n'
    '{"tag_id": "99", "outcome": "UNKNOWN_TAG", "detail": "Tag \'99\' is not", "attempts": 1, "stamp": null,'
    ' "sim_time_of_day_seconds": null, "readings": null}\n'
)


@pytest.mark.parametrize(
    'make',
    [
        lambda path: path.write_text('x' * 5000),
        lambda path: change_database(path, 'CREATE TABLE readings (stamp, value)'),
        os.mkfifo,
        lambda path: (Store(str(path)).close(), change_database(path, 'PRAGMA user_version = 0')),
    ],
)
def test_a_file_that_is_something_else_is_refused_and_unchanged(database, make):
    make(database)
    before = database.read_bytes() if database.is_file() else None
    with pytest.raises(StartUpError, match=f"file '{database}': .*: name another file"):
        Store(str(database))
    assert (database.read_bytes() if database.is_file() else None) == before
    assert list(database.parent.iterdir()) == [database]


def test_a_report_gives_its_rows_with_positions_and_its_visits(tmp_path):
    report, tag_file = tmp_path / 'mission.jsonl', tmp_path / 'tags.json'
    report.write_text(REPORT + REPORT[:30])
    tag_file.write_text(json.dumps({'7': {'x': 1.5, 'y': 7.25, 'sensors': ['co2']}}))
    rows, visits = read_file(report, str(tag_file))
    assert rows == [
        row()._replace(source='mission report'),
        row(sensor='radon', value=2.0)._replace(source='mission report', unit=''),
    ]
    reading = Reading('7', divmod(STAMP_NS, 10**9), 14400.0, {'co2': 468.63, 'radon': 2.0})
    assert visits == [
        Observation('7', Outcome.OK, '', 2, reading),
        Observation('99', Outcome.UNKNOWN_TAG, "Tag '99' is not", 1),
    ]
    written = ''.join(f'{each.to_line()}\n' for each in visits)
    assert written.replace(', "seen": null, "pose": 1', '') == REPORT.replace('2}', '2.0}')


NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@given(
    tag_id=st.text(),
    stamp=st.tuples(st.integers(0, 2**31 - 1), st.integers(0, 10**9 - 1)),
    time_of_day=NUMBERS,
    values=st.dictionaries(st.text(), NUMBERS, min_size=1),
    seen=st.sampled_from([None, True, False]),
    pose=st.integers(1, 9),
    drive=st.sampled_from(['', 'simulated']),
    goal=st.none() | st.tuples(NUMBERS, NUMBERS),
)
def test_an_observation_comes_back_as_it_was(tag_id, stamp, time_of_day, values, seen, pose, drive, goal):
    reading = Reading(tag_id, stamp, time_of_day, values)
    observation = Observation(tag_id, Outcome.OK, '', 1, reading, seen, pose, drive, goal)
    line = observation.to_line()
    assert '\n' not in line
    assert ('"drive": "simulated"}' in line[-22:]) == bool(drive)  # older reports have none
    assert Observation.from_line(line.encode()) == observation


def test_a_number_that_json_does_not_have_is_never_written():
    with pytest.raises(ValueError, match='JSON'):
        Observation('7', Outcome.OK, '', 1, Reading('7', (1, 2), 0.0, {'co2': math.inf})).to_line()


LATEST = 'must be from 0 to 9223372036854775807, in nanoseconds since 1970'


@pytest.mark.parametrize(
    ('column', 'value', 'fault'),
    [
        ('stamp_ns', 1e26, f'stamp_ns of co2 is 1e+26: {LATEST}'),
        ('x_m', 'here', "x_m of co2 is 'here': must be a finite number"),
        ('value', math.inf, 'value of co2 is inf: must be a finite number'),
        ('tag_id', b'7', "tag_id of co2 is b'7': must be text in UTF-8"),
    ],
)
def test_a_wrong_value_is_named_with_what_would_be_right(database, column, value, fault):
    Store(str(database)).keep([row(), row(1)._replace(**{column: value})])
    with pytest.raises(ReadingFileError) as raised:
        read_file(database)
    assert str(raised.value).startswith(f"'{database}': {fault}: name")


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (None, 'No such file'),
        ('dear diary\n', 'line 1 is not an observation (it is not JSON): name a file of record_readings'),
        (REPORT.replace('"OK"', '"OK'), 'line 1 is not an observation (it is not JSON)'),
        ('{"tag_id": "7"}\n', "line 1 is not an observation ('outcome' is missing)"),
        ('{"tag_id": ' + '[' * 100_000 + '\n', 'line 1 is not an observation'),
        (REPORT.replace('"attempts": 2', '"attempts": 1e999'), 'observation (cannot convert float inf'),
        (REPORT.replace('"att', '"seen": "yes", "att'), "seen is 'yes': must be true, false or null"),
        (REPORT.replace('"att', '"goal": [NaN, 1], "att'), 'goal is [nan, 1.0]: must be x and y in metres'),
        (REPORT.replace('{"co2": 468.63, "radon": 2}', '{}'), 'not an observation (it has no value)'),
        (
            REPORT + REPORT.partition('\n')[0].replace('1795189976', f'{10**17}'),
            f'line 3 has a wrong value: stamp_ns of co2 is {10**26 + 513}: {LATEST}',
        ),
        (b'SQLite format 3\0' + bytes(5000), 'file is not a database'),
    ],
)
def test_any_other_file_is_one_line_of_error(tmp_path, content, reason):
    path = tmp_path / 'readings'
    if content is not None:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(ReadingFileError) as raised:
        read_file(path)
    assert str(raised.value).startswith(f"'{path}': ")
    assert reason in str(raised.value)


def test_a_report_that_was_saved_again_in_another_style_is_read(tmp_path):
    compact = [json.dumps(json.loads(line), separators=(',', ':')) for line in REPORT.splitlines()]
    (tmp_path / 'compact.jsonl').write_text('\n'.join(compact), encoding='utf-8')
    (tmp_path / 'written.jsonl').write_text(REPORT, encoding='utf-8')
    assert read_file(tmp_path / 'compact.jsonl') == read_file(tmp_path / 'written.jsonl')
    turned = [json.dumps(dict(reversed(json.loads(line).items()))) for line in REPORT.splitlines()]
    (tmp_path / 'turned.jsonl').write_text('\n'.join(turned), encoding='utf-8')
    assert read_file(tmp_path / 'turned.jsonl').visits == read_file(tmp_path / 'written.jsonl').visits
