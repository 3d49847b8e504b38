"""The files of readings: what is kept, what is refused, and what can be read again. Without ROS."""

import contextlib
import csv
import errno
import itertools
import json
import math
import os
import resource
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lupin_greenhouse_bridge.display.input_file import read_file
from lupin_greenhouse_bridge.display.report_line import Observation, Outcome, Reading
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.recording import store as store_module
from lupin_greenhouse_bridge.recording.reading_files import ReadingFileError, read_rows
from lupin_greenhouse_bridge.recording.rows import HEADER, Row, csv_text, parse_csv, utc_of
from lupin_greenhouse_bridge.recording.store import StoreError, open_store

STAMP_NS = 1_795_189_976_000_000_513


def row(number=0, tag_id='7', sensor='co2', value=468.63, place_m=(1.5, 7.25)) -> Row:
    """Return a row whose stamp has this number."""
    stamp_ns = STAMP_NS + number
    return Row(
        stamp_ns, utc_of(stamp_ns), tag_id, sensor, value, 'ppm', *place_m, 14400.0, '/mission/readings'
    )


@pytest.fixture(params=['readings.sqlite', 'readings.csv'])
def path(request, tmp_path):
    """Return the path of a file in each of the two formats."""
    return tmp_path / request.param


@pytest.fixture
def csv_path(tmp_path):
    return tmp_path / 'readings.csv'


@pytest.fixture
def opened():
    """Return a function that opens a store; each one is closed at the end."""
    with contextlib.ExitStack() as stack:
        yield lambda path: stack.enter_context(contextlib.closing(open_store(str(path))))


@pytest.mark.parametrize('name', ['readings.sqlite', 'readings.db', 'readings.csv', 'READINGS.CSV'])
def test_what_was_kept_is_read_again_value_by_value_from_one_file(opened, tmp_path, name):
    rows = [
        row(0, value=0.1 + 0.2),
        row(1, tag_id='a "b", c\r\nd\u2028e\x85', sensor='ünits'),
        row(2, place_m=(None, None), tag_id='nowhere'),
        row(2, place_m=(-1.0, 1e-300), sensor='light'),
        row(3, sensor='long' * 50_000),
    ]
    assert opened(tmp_path / name).keep(rows) == 5
    assert read_rows(tmp_path / name) == rows
    assert list(tmp_path.iterdir()) == [tmp_path / name]


def test_a_repeated_row_is_not_kept_twice_also_after_a_restart(opened, path):
    first, second = row(), row(tag_id='8')
    store = opened(path)
    assert [store.keep([first, first]), store.keep([first])] == [1, 0]
    store.close()
    assert opened(path).keep([first, second]) == 1
    assert read_rows(path) == [first, second]


def test_two_recorders_share_a_database(opened, tmp_path):
    stores = [opened(tmp_path / 'readings.sqlite') for _ in range(2)]
    for number in range(4):
        assert stores[number % 2].keep([row(number), row(0)]) == 1
    assert [each.stamp_ns - STAMP_NS for each in read_rows(tmp_path / 'readings.sqlite')] == [0, 1, 2, 3]


def test_a_database_that_another_program_locks_is_written_after_it(opened, tmp_path, monkeypatch):
    monkeypatch.setattr(store_module, 'LOCKED_FOR_SECONDS', 0.0)
    store = opened(tmp_path / 'readings.sqlite')
    with contextlib.closing(sqlite3.connect(tmp_path / 'readings.sqlite', isolation_level=None)) as other:
        other.execute('BEGIN IMMEDIATE')
        with pytest.raises(StoreError, match='database is locked'):
            store.keep([row()])
    assert store.keep([row()]) == 1


@contextlib.contextmanager
def full_disk(size):
    """Let no file of this process grow beyond so many bytes, until the block ends."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_keeps_all_of_some_rows_or_none_and_can_be_written_afterwards(opened, path):
    store = opened(path)
    store.keep([row()])
    many = [row(number) for number in range(1, 2000)]
    before = path.read_bytes()
    with full_disk(len(before) + 20_000), pytest.raises(StoreError, match=path.name):
        store.keep(many)
    assert path.read_bytes() == before
    assert store.keep(many) == len(many)
    assert read_rows(path) == [row(), *many]


def test_a_torn_row_that_cannot_be_removed_at_once_is_removed_before_the_next_one(
    opened, csv_path, monkeypatch
):
    store = opened(csv_path)
    store.keep([row()])
    before = csv_path.read_bytes()

    def fail(_file, _size):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as patch:
        patch.setattr(os, 'ftruncate', fail)
        with full_disk(len(before) + 30), pytest.raises(StoreError, match='No space left'):
            store.keep([row(1)])
        assert len(csv_path.read_bytes()) == len(before) + 30
        with pytest.raises(StoreError, match='Input/output error'):  # none of its rows is written
            store.keep([row(1)])
        assert len(csv_path.read_bytes()) == len(before) + 30
    assert read_rows(csv_path) == [row()]
    assert store.keep([row(1), row(2)]) == 2
    assert csv_path.read_bytes() == before + csv_text([row(1), row(2)]).encode()


LOSSES = {
    'deleted': Path.unlink,
    'moved': lambda path: path.rename(path.with_name('moved')),
    'truncated': lambda path: os.truncate(path, 0),
}


@pytest.mark.parametrize('lose', LOSSES.values(), ids=LOSSES)
def test_after_a_file_that_was_lost_the_rows_go_on_in_a_new_one(opened, path, lose):
    store = opened(path)
    store.keep([row()])
    lose(path)
    assert store.keep([row(1), row(2)]) == 2
    assert store.keep([row(2), row(3)]) == 1
    assert read_rows(path) == [row(1), row(2), row(3)]
    assert store.notes == [f"file '{path}' was moved, deleted or truncated: made a new one"]
    if (moved := path.with_name('moved')).exists():
        assert read_rows(moved) == [row()]


@pytest.mark.parametrize('lose', LOSSES.values(), ids=LOSSES)
@pytest.mark.parametrize('step', ['write', 'fsync'])
def test_a_file_that_is_lost_in_the_middle_of_a_write_loses_none_of_its_rows(
    opened, csv_path, monkeypatch, lose, step
):
    store = opened(csv_path)
    store.keep([row()])
    real, is_lost = getattr(os, step), []

    def lose_and_do(*arguments):
        if not is_lost:
            is_lost.append(lose(csv_path))
        return real(*arguments)

    monkeypatch.setattr(os, step, lose_and_do)
    assert store.keep([row(1)]) == 1
    assert read_rows(csv_path) == [row(1)]


def test_a_file_that_something_else_replaces_stays_unchanged_and_the_rows_wait(opened, path):
    store = opened(path)
    moved = path.rename(path.with_name('moved'))
    path.write_text('dear diary\n' * 1000)
    for _ in range(2):
        with pytest.raises(StoreError, match=r'the first line is not|not a file of record_readings'):
            store.keep([row()])
    assert path.read_text() == 'dear diary\n' * 1000
    moved.replace(path)
    assert store.keep([row()]) == 1
    assert read_rows(path) == [row()]


def test_without_its_folder_a_file_takes_no_rows_and_goes_on_when_it_is_back(opened, path):
    store = opened(path)
    path.parent.rename(f'{path.parent} moved')
    for _ in range(2):
        with pytest.raises(StoreError, match='No such file or directory'):
            store.keep([row()])
    path.parent.mkdir()
    assert store.keep([row()]) == 1
    assert read_rows(path) == [row()]


def test_a_csv_file_to_which_another_program_adds_a_header_and_rows_keeps_them(opened, csv_path):
    store = opened(csv_path)
    with csv_path.open('a') as other:
        other.write(f'{HEADER}\n{csv_text([row(5)])}')
    store.keep([row()])
    with full_disk(csv_path.stat().st_size + 30), pytest.raises(StoreError, match='No space left'):
        store.keep([row(1)])
    assert read_rows(csv_path) == [row(), row(5)]
    store.close()
    assert opened(csv_path).keep([row(5), row(2)]) == 1


@pytest.mark.parametrize('tail_bytes', range(60, 700, 80))
def test_of_a_long_csv_file_the_last_rows_are_known_again(opened, csv_path, monkeypatch, tail_bytes):
    monkeypatch.setattr(store_module, 'TAIL_BYTES', tail_bytes)
    ids = ['7', 'a\n"b"\n', '"', ',\n', f'\n{csv_text([row()])}', 'ä']
    rows = [row(number, tag_id=ids[number % len(ids)]) for number in range(60)]
    store = opened(csv_path)
    store.keep(rows)
    store.close()
    before = csv_path.read_bytes()
    with csv_path.open('ab') as end:
        end.write(b'1795"')
    store = opened(csv_path)
    assert 'removed an incomplete last row' in store.notes[0]
    assert csv_path.read_bytes() == before
    assert store.keep([rows[0], rows[-1], row(99)]) == 2  # the first one is forgotten
    store.close()
    with csv_path.open('a') as end:
        end.write('dear diary\n')
    lines = before.count(b'\n') + 3
    with pytest.raises(StartUpError, match=f'line {lines}: 1 values in place of 10'):
        opened(csv_path)


def test_a_csv_file_knows_so_many_of_its_last_rows(opened, csv_path, monkeypatch):
    monkeypatch.setattr(store_module, 'MOST_KEYS', 2)
    store = opened(csv_path)
    assert store.keep([row(1), row(2), row(3)]) == 3
    assert store.keep([row(2), row(3)]) == 0
    assert store.keep([row(1)]) == 1


FORMULAS = ['=1+1', '+1', '-1', '@SUM(A1)', '\t=1', '\r=1', "'=1", "'", "'x"]


def test_a_spreadsheet_takes_no_text_of_a_csv_file_for_a_formula(opened, csv_path):
    rows = [row(n, tag_id=text, sensor=text, value=-1.5) for n, text in enumerate(FORMULAS)]
    opened(csv_path).keep(rows)
    with csv_path.open(newline='') as file:
        cells = [(each['tag_id'], each['sensor'], each['value']) for each in csv.DictReader(file)]
    assert cells == [(f"'{text}", f"'{text}", '-1.5') for text in FORMULAS]
    assert read_rows(csv_path) == rows


def test_an_apostrophe_of_an_older_file_stays(csv_path):
    csv_path.write_text(f'{HEADER}\n{csv_text([row(tag_id="x")])}'.replace(',x,', ",'x,"))
    assert [each.tag_id for each in read_rows(csv_path)] == ["'x"]


WRITER = """
import sys
from lupin_greenhouse_bridge.recording.rows import Row
from lupin_greenhouse_bridge.recording.store import open_store
store, first = open_store(sys.argv[1]), Row(*eval(sys.argv[2]))
for number in range(0, 10**9, 50):
    store.keep([first._replace(stamp_ns=first.stamp_ns + each) for each in range(number, number + 50)])
    print(number + 50, flush=True)
"""


@pytest.mark.parametrize('acknowledgements', [1, 7])
def test_a_kill_at_any_moment_loses_no_row_that_was_acknowledged(opened, path, acknowledgements):
    """
    The moment is wherever the writer is when the test has read so many acknowledgements.

    Of the rows that it was keeping then, a table has all or none, and a CSV file the first ones: a signal can
    end a write to a file early.
    """
    command = [sys.executable, '-c', WRITER, path, repr(tuple(row()))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        acknowledged = list(itertools.islice(writer.stdout, acknowledgements))
        writer.kill()
        acknowledged += writer.stdout
    count = int(acknowledged[-1])
    kept = read_rows(path)
    assert [each.stamp_ns for each in kept] == [STAMP_NS + number for number in range(len(kept))]
    may_be_kept = range(count, count + 51) if path.suffix == '.csv' else (count, count + 50)
    assert len(kept) in may_be_kept
    assert opened(path).keep(kept) == 0


def test_a_database_killed_in_a_commit_is_restored_by_its_reader(opened, tmp_path):
    """The file and its journal are those of a commit that has written some of its pages."""
    store = opened(tmp_path / 'readings.sqlite')
    store.keep([row(number) for number in range(1000)])
    store._connection.execute('PRAGMA cache_size = 2')  # too small for a transaction: pages go to the file
    store._connection.execute('BEGIN IMMEDIATE')
    store._connection.execute('UPDATE readings SET value = 0.0')
    killed = tmp_path / 'killed'
    killed.mkdir()
    for name in ('readings.sqlite', 'readings.sqlite-journal'):
        (killed / name).write_bytes((tmp_path / name).read_bytes())
    without_its_journal = f'file:{killed}/readings.sqlite?immutable=1'
    with contextlib.closing(sqlite3.connect(without_its_journal, uri=True)) as connection:
        assert connection.execute('SELECT min(value) FROM readings').fetchone() == (0.0,)
    assert read_rows(killed / 'readings.sqlite') == [row(number) for number in range(1000)]


@pytest.mark.parametrize('torn', range(1, 96, 7))
def test_the_torn_last_row_of_a_csv_file_is_removed(opened, csv_path, torn):
    kept, last = row(0), row(1, tag_id='ä\n"b"')
    whole = f'{HEADER}\n{csv_text([kept])}'.encode()
    csv_path.write_bytes(whole + csv_text([last]).encode()[:torn])
    assert read_rows(csv_path) == [kept]
    store = opened(csv_path)
    assert 'removed an incomplete last row' in store.notes[0]
    assert csv_path.read_bytes() == whole
    assert store.keep([kept, last]) == 1
    assert read_rows(csv_path) == [kept, last]


@pytest.mark.parametrize('size', [0, 1, len(HEADER), len(HEADER) + 1])
def test_a_csv_file_torn_in_its_header_is_a_new_one(opened, csv_path, size):
    csv_path.write_text(f'{HEADER}\n'[:size])
    assert opened(csv_path).keep([row()]) == 1
    assert read_rows(csv_path) == [row()]


def other_database(path):
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute('CREATE TABLE readings (stamp, value)')


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
        lambda path: path.write_text('dear diary\n'),
        lambda path: path.write_text('x' * 5000),
        lambda path: path.write_text(REPORT),
        other_database,
        Path.mkdir,
        os.mkfifo,
        lambda path: path.write_text(f'{HEADER}\n1,2,3\n{csv_text([row()])}'),
        lambda path: path.write_text(f'{HEADER}\n{csv_text([row()]).replace("468.63", "nan")}'),
    ],
)
def test_a_file_that_is_something_else_is_refused_and_unchanged(path, make):
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(StartUpError, match=f"file '{path}': .*: name another file"):
        open_store(str(path))
    assert (path.read_bytes() if path.is_file() else None) == before
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize('name', ['readings', 'readings.txt', '', '.csv', 'no folder/readings.csv'])
def test_a_name_that_cannot_be_a_file_of_readings_is_refused(tmp_path, name, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StartUpError, match=f"file '{name}'"):
        open_store(name)
    assert list(tmp_path.iterdir()) == []


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
)
def test_an_observation_comes_back_as_it_was(tag_id, stamp, time_of_day, values):
    reading = Reading(tag_id, stamp, time_of_day, values)
    for drive in ('', 'simulated'):
        observation = Observation(tag_id, Outcome.OK, '', 1, reading, drive=drive)
        line = observation.to_line()
        assert '\n' not in line
        assert ('"drive": "simulated"}' in line[-22:]) == bool(drive)  # older reports have none
        assert Observation.from_line(line.encode()) == observation


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_a_number_that_json_does_not_have_is_never_written(value):
    with pytest.raises(ValueError, match='JSON'):
        Observation('7', Outcome.OK, '', 1, Reading('7', (1, 2), 0.0, {'co2': value})).to_line()


def test_a_row_without_a_position_gets_that_of_the_layout(opened, csv_path, shipped_tags):
    opened(csv_path).keep([row(place_m=(None, None)), row(1, tag_id='nowhere', place_m=(None, None))])
    known, unknown = read_rows(csv_path)
    assert (known.x_m, known.y_m) == (shipped_tags['7']['x'], shipped_tags['7']['y'])
    assert (unknown.x_m, unknown.y_m) == (None, None)


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (None, 'No such file'),
        (b'', 'empty'),
        (b'dear diary\n', 'not a file of readings'),
        (f'{HEADER}\n1,2,3\n{HEADER}\n'.encode(), 'line 2: 3 values in place of 10'),
        (f'{HEADER}\n'.encode() + b'\xff\n', "can't decode byte"),
        (REPORT.replace('"OK"', '"OK').encode(), 'line 1 is not an observation'),
        (b'{"tag_id": "7"}\n', "line 1 is not an observation (KeyError: 'outcome')"),
        (b'{"tag_id": 7, ' + b'[' * 100_000 + b'\n', 'line 1 is not an observation'),
        (REPORT.replace('468.63', 'NaN').encode(), 'value of co2 is nan'),
        (REPORT.replace('14400.0', 'Infinity').encode(), 'sim_time_of_day_seconds of co2 is inf'),
        (REPORT.replace('1795189976', '9' * 20).encode(), 'line 1 is not an observation (OverflowError'),
        (REPORT.replace('"attempts": 2', '"attempts": 1e999').encode(), 'observation (OverflowError'),
        (
            REPORT.replace('{"co2": 468.63, "radon": 2}', '{}').encode(),
            'line 1 is not an observation (ValueE',
        ),
        (f'{HEADER}\n{csv_text([row(place_m=(math.nan, 1.0))])}'.encode(), 'x_m of co2 is nan'),
        (f'{HEADER}\n{csv_text([row()._replace(stamp_ns=-1)])}'.encode(), 'stamp_ns is -1'),
        (b'SQLite format 3\0' + bytes(5000), 'not a file of readings'),
        (b'SQLite format 3\0' + bytes(52) + b'LuRP' + bytes(5000), 'file is not a database'),
    ],
)
def test_any_other_file_is_one_line_of_error(csv_path, content, reason):
    if content is not None:
        csv_path.write_bytes(content)
    with pytest.raises(ReadingFileError) as raised:
        read_file(csv_path)
    assert str(raised.value).startswith(f"'{csv_path}': ")
    assert reason in str(raised.value)


@pytest.mark.parametrize(
    ('column', 'value', 'shown'),
    [
        ('value', 'warm', "value is 'warm'"),
        ('stamp_ns', 'noon', "stamp_ns is 'noon'"),
        ('tag_id', b'7', "tag_id is b'7'"),
        ('x_m', 'here', "x_m is 'here'"),
    ],
)
def test_a_value_of_another_type_in_a_database_is_one_line_of_error(opened, tmp_path, column, value, shown):
    opened(tmp_path / 'a.sqlite').keep([row()._replace(**{column: value})])
    with pytest.raises(ReadingFileError, match=f"a.sqlite': {shown}: name a file of record_readings"):
        read_file(tmp_path / 'a.sqlite')


def test_a_csv_file_that_a_spreadsheet_saved_is_read():
    text = f'{HEADER}\n{csv_text([row()])}'.replace('\n', '\r\n')
    assert parse_csv(b'\xef\xbb\xbf' + text.encode())[0] == [row()]
