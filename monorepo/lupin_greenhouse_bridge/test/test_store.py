# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The files of readings: what is kept, what is refused, and what can be read again. Without ROS."""

import contextlib
import csv
import io
import json
import math
import os
import re
import resource
import sqlite3
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lupin_greenhouse_bridge.display.reading_file import read_file
from lupin_greenhouse_bridge.display.report_line import Observation, Outcome, Reading
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.recording import store as store_module
from lupin_greenhouse_bridge.recording.reading_files import ReadingFileError, parse_csv, read_rows
from lupin_greenhouse_bridge.recording.rows import HEADER, Row, csv_text, utc_of
from lupin_greenhouse_bridge.recording.store import StoreError, open_store

STAMP_NS = 1_795_189_976_000_000_513


def row(number=0, tag_id='7', sensor='co2', value=468.63, place_m=(1.5, 7.25)) -> Row:
    at = STAMP_NS + number
    return Row(at, utc_of(at), tag_id, sensor, value, 'ppm', *place_m, 14400.0, '/mission/readings')


def rows(*numbers) -> list[Row]:
    return [row(number) for number in range(*numbers)]


@pytest.fixture(params=['readings.sqlite', 'readings.csv'])
def path(request, tmp_path):
    return tmp_path / request.param


@pytest.fixture
def csv_path(tmp_path):
    return tmp_path / 'readings.csv'


@pytest.fixture
def database(tmp_path):
    return tmp_path / 'readings.sqlite'


@pytest.mark.parametrize('name', ['readings.sqlite', 'readings.db', 'readings.csv', 'READINGS.CSV'])
def test_what_was_kept_is_read_again_with_the_positions_of_the_layout(tmp_path, shipped_tags, name):
    kept = [
        row(0, value=0.1 + 0.2),
        row(1, tag_id='a "b", c\r\nd\u2028e\x85', sensor='ünits'),
        row(2, place_m=(None, None), tag_id='nowhere'),
        row(2, place_m=(-1.0, 1e-300), sensor='light'),
        row(3, sensor='long' * 50_000),
    ]
    assert open_store(str(tmp_path / name)).keep([*kept, row(4, place_m=(None, None))]) == 6
    place_m = shipped_tags['7']['x'], shipped_tags['7']['y']
    assert read_rows(tmp_path / name) == [*kept, row(4, place_m=place_m)]
    assert list(tmp_path.iterdir()) == [tmp_path / name]


def test_recorders_share_a_database_that_keeps_a_repeated_row_once_and_one_with_another_value_too(database):
    first, second = row(), row(value=468.64)
    store, other = open_store(str(database)), open_store(str(database))
    assert [store.keep([first, first]), store.keep([first]), other.keep([first, second])] == [1, 0, 1]
    assert read_rows(database) == [first, second]


def test_an_older_database_counts_and_tells_the_rows_that_its_key_refuses(database):
    open_store(str(database))
    change_database(database, 'DROP TABLE readings', OLD_TABLE, 'PRAGMA user_version = 0')
    said = []
    store = open_store(str(database), said.append)
    assert store.keep([row(), row(value=1.0), row(1), row()]) == 2
    assert (read_rows(database), store.refused_rows) == (rows(2), 1)
    assert said == [
        f"file '{database}' of release 2.0 or older has another value with the same stamp, tag and sensor:"
        ' 1 row lost: record into a new file'
    ]


def test_a_database_that_another_program_locks_is_written_after_it(database, monkeypatch):
    monkeypatch.setattr(store_module, 'LOCKED_FOR_SECONDS', 0.0)
    store = open_store(str(database))
    with contextlib.closing(sqlite3.connect(database, isolation_level=None)) as other:
        other.execute('BEGIN IMMEDIATE')
        with pytest.raises(StoreError, match='database is locked'):
            store.keep([row()])
    assert store.keep([row()]) == 1
    assert list(database.parent.iterdir()) == [database]  # not set aside as damaged


def change_database(path, *statements):
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for statement in statements:
            connection.execute(statement)


COLUMNS = len(Row._fields)
OLD_TABLE = store_module._TABLE.replace('sensor, value)', 'sensor)')


@pytest.mark.parametrize(
    ('table', 'problem'),
    [
        (OLD_TABLE.replace('unit TEXT', 'units TEXT'), 'table readings has no column named unit'),
        (OLD_TABLE.replace('x_m', 'note TEXT NOT NULL, x_m'), 'NOT NULL constraint failed: readings.note'),
        ('CREATE VIEW readings AS SELECT 1 AS value', 'readings'),
    ],
)
def test_a_database_that_cannot_take_our_columns_is_refused(database, table, problem):
    open_store(str(database))
    change_database(database, 'DROP TABLE readings', table, 'PRAGMA user_version = 7')
    before = database.read_bytes()
    with pytest.raises(StartUpError, match=problem) as raised:
        open_store(str(database))
    assert str(raised.value).endswith('(its user_version is 7, not 1): name another file, or a new one')
    assert database.read_bytes() == before


def test_a_copy_of_a_database_that_another_program_keeps_in_wal_mode_has_every_row(database):
    store, copy = open_store(str(database)), database.with_name('copy.sqlite')
    with contextlib.closing(sqlite3.connect(database)) as other:
        other.execute('PRAGMA journal_mode = WAL')
        other.execute('SELECT * FROM readings').fetchall()
        assert store.keep(rows(100)) == 100
        copy.write_bytes(database.read_bytes())
        assert read_rows(copy) == rows(100)
        other.execute('BEGIN')
        other.execute('SELECT * FROM readings').fetchall()  # nothing can be moved out of the WAL
        with pytest.raises(StoreError, match='another program reads it'):
            store.keep([row(100)])
    assert store.keep(rows(100, 102)) == 1


@pytest.mark.parametrize('fraction', [0.01, 0.1, 0.5, 0.99])
def test_a_damaged_database_is_set_aside_and_the_rows_go_on_in_a_new_one(database, fraction):
    said = []
    store = open_store(str(database), said.append)
    store.keep(rows(300))
    cut = database.read_bytes()[: int(database.stat().st_size * fraction)]
    database.write_bytes(cut)
    with pytest.raises(StoreError, match=r'cut off|database'):
        store.keep([row(1000)])  # the recorder repeats it
    assert [store.keep([row(1000)]), store.keep([row(1001)])] == [1, 1]
    assert read_rows(database) == rows(1000, 1002)
    (damaged,) = database.parent.glob('readings.sqlite.damaged-*')
    assert damaged.read_bytes() == cut
    (line,) = said
    assert line.endswith(f'is damaged: renamed it to {damaged.name}, and made a new one')


@pytest.mark.parametrize('torn', [csv_text([row(7)])[:30], csv_text([row(7, tag_id='a "b"')])[:65], 'x\n\n"'])
def test_an_unfinished_line_of_another_writer_does_not_swallow_the_next_row(csv_path, torn):
    store = open_store(str(csv_path))
    store.keep([row()])
    for number in (1, 2):
        with csv_path.open('a') as other:
            other.write(torn)
        store.keep([row(number)])
    assert read_rows(csv_path) == rows(3)


def test_on_a_full_disk_a_database_keeps_all_of_some_rows_or_none_and_a_csv_file_each_row_whole(path):
    store, many = open_store(str(path)), rows(2000)
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)  # no file of this process grows beyond so many bytes
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 20_000, limits[1]))
    try:
        with pytest.raises(StoreError, match=r'disk|File too large'):
            store.keep(many)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    written = read_rows(path)
    if path.suffix == '.csv':
        assert 0 < len(written) < len(many)
    else:
        assert path.read_bytes() == before
    assert store.keep(many) == len(many)
    assert sorted(read_rows(path)) == sorted(written + many)


LOSSES = {
    'moved': lambda path: path.rename(path.with_name('moved')),
    'truncated': lambda path: os.truncate(path, 0),
}


@pytest.mark.parametrize('lose', LOSSES.values(), ids=LOSSES)
def test_after_a_file_that_was_lost_the_rows_go_on_in_a_new_one(path, lose):
    said = []
    store = open_store(str(path), said.append)
    store.keep([row()])
    lose(path)
    assert [store.keep(rows(1, 3)), store.keep([row(3)])] == [2, 1]
    assert read_rows(path) == rows(1, 4)
    assert said == [f"file '{path}' was moved, deleted or emptied: made a new one"]
    if (moved := path.with_name('moved')).exists():
        assert read_rows(moved) == [row()]


def test_a_file_that_is_lost_in_the_middle_of_a_write_loses_none_of_its_rows(csv_path, monkeypatch):
    store, fsync = open_store(str(csv_path)), os.fsync
    store.keep([row()])

    def lose_and_fsync(file):
        monkeypatch.setattr(os, 'fsync', fsync)
        csv_path.unlink()
        fsync(file)

    monkeypatch.setattr(os, 'fsync', lose_and_fsync)
    assert store.keep([row(1)]) == 1
    assert read_rows(csv_path) == [row(1)]


def test_a_file_that_something_else_replaces_stays_unchanged_and_the_rows_wait(path):
    store = open_store(str(path))
    moved = path.rename(path.with_name('moved'))
    path.write_text('dear diary\n' * 1000)
    for _ in range(2):
        with pytest.raises(StoreError, match=r'the first line is not|not a file of record_readings'):
            store.keep([row()])
    assert path.read_text() == 'dear diary\n' * 1000
    moved.replace(path)
    assert store.keep([row()]) == 1
    assert read_rows(path) == [row()]


FORMULAS = ['=1+1', '+1', '-1', '@SUM(A1)', '\t=1', '\r=1', "'=1", "'", "'x"]


def test_a_spreadsheet_takes_no_text_of_a_csv_file_for_a_formula(csv_path):
    kept = [row(n, tag_id=text, sensor=text, value=-1.5) for n, text in enumerate(FORMULAS)]
    open_store(str(csv_path)).keep(kept)
    with csv_path.open(newline='') as file:
        cells = [(each['tag_id'], each['sensor'], each['value']) for each in csv.DictReader(file)]
    assert cells == [(f"'{text}", f"'{text}", '-1.5') for text in FORMULAS]
    assert read_rows(csv_path) == kept
    csv_path.write_text(f'{HEADER}\n{csv_text([row(tag_id="x")])}'.replace(',x,', ",'x,"))
    assert [each.tag_id for each in read_rows(csv_path)] == ["'x"]  # of an older file


def test_a_database_killed_in_a_commit_is_restored_by_its_reader(database):
    """The file and its journal are those of a commit that has written some of its pages."""
    open_store(str(database)).keep(rows(1000))
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


def test_a_csv_file_that_is_torn_at_any_byte_is_continued_after_its_whole_rows(csv_path):
    first, last = row(), row(1, tag_id='ä\n"b"')
    whole, end = f'{HEADER}\n{csv_text([first])}'.encode(), len(HEADER)
    for size in (*range(end + 2), *range(len(whole) - 1, len(whole) + 78)):
        csv_path.write_bytes((whole + csv_text([last]).encode())[:size])
        kept = [first] if size > end + 1 else []
        assert size < end or read_rows(csv_path) == kept
        assert open_store(str(csv_path)).keep([last, row(2)]) == 2
        assert read_rows(csv_path) == [*kept, last, row(2)]


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
        lambda path: path.write_text(f'{HEADER},note\n'),
    ],
)
def test_a_file_that_is_something_else_is_refused_and_unchanged(path, make):
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(StartUpError, match=f"file '{path}': .*: name another file"):
        open_store(str(path))
    assert (path.read_bytes() if path.is_file() else None) == before
    assert list(path.parent.iterdir()) == [path]


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
NO_UTF_8 = "must be text in UTF-8 (save a spreadsheet as 'CSV UTF-8')"


@pytest.mark.parametrize(
    ('name', 'column', 'value', 'fault'),
    [
        ('a.csv', 'stamp_ns', -1, f'line 3: stamp_ns of co2 is -1: {LATEST}'),
        ('a.csv', 'stamp_ns', 'noon', f"line 3: stamp_ns of co2 is 'noon': {LATEST}"),
        ('a.csv', 'value', math.nan, 'line 3: value of co2 is nan: must be a finite number'),
        ('a.sqlite', 'stamp_ns', 1e26, f'row 2: stamp_ns of co2 is 1e+26: {LATEST}'),
        ('a.sqlite', 'x_m', 'here', "row 2: x_m of co2 is 'here': must be a finite number"),
        ('a.sqlite', 'tag_id', b'7', f"row 2: tag_id of co2 is b'7': {NO_UTF_8}"),
    ],
)
def test_a_wrong_value_is_named_with_its_place_and_what_would_be_right(tmp_path, name, column, value, fault):
    path = tmp_path / name
    open_store(str(path)).keep([row(), row(1)._replace(**{column: value})])
    with pytest.raises(ReadingFileError) as raised:
        read_file(path)
    assert str(raised.value) == f"'{path}': {fault}"


READINGS = [
    row(0, value=0.1 + 0.2),
    row(1, tag_id='a "b", c;d\te|f\ng', sensor='ünits', place_m=(None, None)),
]


def in_columns(columns, delimiter=',', quoting=csv.QUOTE_MINIMAL, end='\n', **changed):
    file = io.StringIO(newline='')
    writer = csv.writer(file, delimiter=delimiter, quoting=quoting, lineterminator=end)
    writer.writerow(columns)
    for number, each in enumerate(READINGS):
        cells = {'': number, 'note': 'x', **each._asdict()}
        writer.writerow([changed[name](cells[name]) if name in changed else cells[name] for name in columns])
    return file.getvalue()


ROUNDED = '{:.5E}'.format
FOREIGN = {
    'spreadsheet': b'\xef\xbb\xbf' + in_columns(Row._fields, end='\r\n').encode(),
    'quoted, with an index (R, pandas)': in_columns(['', *Row._fields], quoting=csv.QUOTE_ALL).encode(),
    'other order and columns (DuckDB)': in_columns(['note', *reversed(Row._fields)]).encode(),
    'NA (R)': in_columns(Row._fields, x_m=lambda x: 'NA' if x is None else x).encode(),
    'decimal commas': re.sub(r'\.(?=\d+[E;])', ',', in_columns(Row._fields, ';', stamp_ns=ROUNDED)).encode(),
    'tabs in UTF-16 (Excel)': in_columns(Row._fields, '\t').encode('utf-16'),
    'bars (sqlite3)': in_columns(Row._fields, '|').encode(),
    'stamps as floats': in_columns(Row._fields, stamp_ns=ROUNDED).encode(),
    'stamps of 15 digits': in_columns(Row._fields, stamp_ns=lambda stamp: stamp // 10**4 * 10**4).encode(),
}


@pytest.mark.parametrize('content', FOREIGN.values(), ids=FOREIGN)
def test_a_csv_file_that_another_program_has_saved_again_is_read(content):
    assert parse_csv(content) == READINGS


def test_short_lines_are_told_of_unless_a_killed_writer_can_have_left_them(csv_path, capsys):
    whole, torn = csv_text([row()]), csv_text([row()])[:30]
    csv_path.write_text(f'{HEADER}\n{whole}{torn}\n{HEADER}\n{whole}{torn}', encoding='utf-8')
    assert (len(read_rows(csv_path)), capsys.readouterr().err) == (2, '')
    csv_path.write_text(f'{HEADER}\n{whole}{torn}\n{torn}\n{whole}{torn}', encoding='utf-8')
    assert len(read_rows(csv_path)) == 2
    told = f'left out 2 lines with fewer values than the {COLUMNS} of the header, first line 3'
    assert capsys.readouterr().err == f'{csv_path}: {told}\n'


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (None, 'No such file'),
        ('', 'empty'),
        ('dear diary\n', f'not a file of readings, which is SQLite or CSV with the header {HEADER}'),
        (f'{HEADER}\n{HEADER},more\n', f'line 2: {COLUMNS + 1} values in place of {COLUMNS}'),
        (in_columns(Row._fields).encode('latin-1'), rf"is '\udcfcnits': {NO_UTF_8}"),
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
        (in_columns(Row._fields[1:]), 'its header lacks stamp_ns: name a file'),
        (in_columns(Row._fields, stamp_ns=ROUNDED, stamp_utc=str.lower), "to '1.79519E+18': "),
        (in_columns(Row._fields).replace('source', 'source,', 1), f'no line has {COLUMNS + 1} values, as'),
    ],
)
def test_any_other_file_is_one_line_of_error(csv_path, content, reason):
    if content is not None:
        csv_path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(ReadingFileError) as raised:
        read_file(csv_path)
    assert str(raised.value).startswith(f"'{csv_path}': ")
    assert reason in str(raised.value)


@pytest.mark.parametrize('kind', [str, int])
def test_a_database_that_pandas_or_sqlite3_has_made_is_read(database, kind):
    """Without our application_id, with another column, and with integers or text for our types."""
    numbers = {'stamp_ns': STAMP_NS, 'tag_id': 7, 'value': 2, 'x_m': 1}
    values = tuple(row()._replace(**{name: kind(number) for name, number in numbers.items()}))
    change_database(
        database,
        f'CREATE TABLE readings ("index", {HEADER})',
        f'INSERT INTO readings VALUES {(0, *values)}',  # noqa: S608
    )
    assert read_rows(database) == [row(value=2.0)._replace(tag_id='7', x_m=1.0)]
    change_database(database, 'ALTER TABLE readings DROP COLUMN unit')
    with pytest.raises(ReadingFileError, match='no such column: unit'):
        read_rows(database)
