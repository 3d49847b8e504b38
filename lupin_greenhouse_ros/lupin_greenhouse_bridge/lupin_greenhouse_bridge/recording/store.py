# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The file of recorded readings: SQLite or CSV, with the columns of Row. Does not import ROS."""

import codecs
import contextlib
import os
import sqlite3
import stat
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, pluralized, reason_of
from lupin_greenhouse_bridge.recording.rows import HEADER, Row, csv_text, key_of

HEAD_BYTES = 128  # of a file: enough to tell its format
SQLITE_HEAD = b'SQLite format 3\0'
APPLICATION_ID = 0x4C755250  # marks our SQLite files, in big-endian order at byte 68
USER_VERSION = 1  # of our SQLite files; 0 stands for release 2.0 and older, whose key lacks the value
LOCKED_FOR_SECONDS = 0.5  # how long a commit waits for another program; then its rows wait in memory
_TABLE = """
CREATE TABLE readings (
    stamp_ns INTEGER NOT NULL,
    stamp_utc TEXT NOT NULL,
    tag_id TEXT NOT NULL,
    sensor TEXT NOT NULL,
    value REAL NOT NULL,
    unit TEXT NOT NULL,
    x_m REAL,
    y_m REAL,
    sim_time_of_day_seconds REAL NOT NULL,
    source TEXT NOT NULL,
    PRIMARY KEY (stamp_ns, tag_id, sensor, value)
)"""
_MARKS = ', '.join('?' * len(Row._fields))
# Ignores only a row that is there already: OR IGNORE would also ignore one that breaks a rule of the table.
_INSERT = f'INSERT INTO readings ({HEADER}) VALUES ({_MARKS}) ON CONFLICT DO NOTHING'  # noqa: S608 (no user text)
_FIND = 'SELECT 1 FROM readings WHERE (stamp_ns, tag_id, sensor, value) = (?, ?, ?, ?)'
_EXAMPLE = Row(0, '', '', '', 0.0, '', None, None, 0.0, '')


class StoreError(OneLineError):
    """Rows cannot be written now."""


def open_store(path: str, warn: Callable[[str], object] = lambda _text: None) -> 'Store':
    """
    Make a file of readings, or check that it can be continued. Its suffix selects the format.

    Later, `warn` receives a line if the file was lost. Raises StartUpError for another suffix, and for a file
    in another format, which stays unchanged.
    """
    kinds: dict[str, type[Store]] = {'.sqlite': SqliteStore, '.db': SqliteStore, '.csv': CsvStore}
    if not (kind := kinds.get(Path(path).suffix.lower())):
        raise StartUpError(
            f"file '{path}' ends in none of {', '.join(kinds)}: name it readings.sqlite or .csv"
        )
    try:
        return kind(path, warn)
    except StoreError as error:
        folder = Path(path).parent
        remedy = 'name another file, or a new one' if folder.is_dir() else f"make the folder '{folder}'"
        raise StartUpError(f'{error}: {remedy}') from error


class Store(ABC):
    """
    A file of readings, which is open only while rows are added.

    If it is moved, deleted, emptied or damaged, a new file with its name gets the rows.
    """

    def __init__(self, path: str, warn: Callable[[str], object]) -> None:
        """Make the file, or check that it can be continued; raises StoreError."""
        self._path, self._warn = Path(path), warn
        self._identity: tuple[int, int] | None = None  # of the file that got the last rows
        self._damaged: tuple[int, int] | None = None  # the identity of a file that SQLite cannot write
        self.refused_rows = 0  # how many rows the file can never keep
        self.keep([])

    def keep(self, rows: Sequence[Row]) -> int:
        """Add rows to the file, and return how many of them are new. Raises StoreError."""
        found = None
        try:
            if self._damaged and self._damaged == self._find():
                self._set_aside()
            while True:
                found = self._find()
                if found is None or found != self._identity:
                    self._prepare()
                    if self._identity:
                        self._warn(f"file '{self._path}' was moved, deleted or emptied: made a new one")
                    self._identity = self._find()
                new_count = self._add(rows)
                if self._find() == self._identity:  # otherwise nobody may find these rows
                    return new_count
        except (OSError, ValueError, sqlite3.Error) as error:
            self._identity = None  # a part of a row may be in the file
            # SQLite raises subclasses of DatabaseError for all but a damaged file.
            self._damaged = found if type(error) is sqlite3.DatabaseError else None
            raise StoreError(f"file '{self._path}': {reason_of(error)}") from error

    def _find(self) -> tuple[int, int] | None:
        """Return the device and inode of the file; None if it is missing or empty."""
        try:
            status = self._path.stat()
        except FileNotFoundError:
            return None
        if not stat.S_ISREG(status.st_mode):
            raise ValueError('not a regular file')
        return (status.st_dev, status.st_ino) if status.st_size else None

    def _set_aside(self) -> None:
        """Rename a damaged file, and the files in which SQLite keeps parts of it; raises OSError."""
        damaged = f'{self._path.name}.damaged-{time.time_ns()}'
        for end in ('', '-journal', '-wal', '-shm'):
            with contextlib.suppress(FileNotFoundError):
                self._path.with_name(self._path.name + end).rename(self._path.with_name(damaged + end))
        self._warn(f"file '{self._path}' is damaged: renamed it to {damaged}, and made a new one")

    @abstractmethod
    def _prepare(self) -> None:
        """Make the file, or check that it is one of ours; raises ValueError, OSError and sqlite3.Error."""

    @abstractmethod
    def _add(self, rows: Sequence[Row]) -> int:
        """Add rows to the file; return how many are new. Raises OSError and sqlite3.Error."""


class SqliteStore(Store):
    """A database with the table `readings`, which has each row once. Several programs can write it."""

    def _prepare(self) -> None:
        with self._path.open('a+b') as file:
            file.seek(0)
            head = file.read(HEAD_BYTES)
        # A file that was cut off before its application id is damaged, but ours.
        is_ours = head.startswith(SQLITE_HEAD) and head[68:72] in (b'', APPLICATION_ID.to_bytes(4, 'big'))
        if head and not is_ours:
            raise ValueError('not a file of record_readings')
        with self._transaction() as connection:
            if not connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'readings'").fetchone():
                connection.execute(f'PRAGMA application_id = {APPLICATION_ID}')
                connection.execute(f'PRAGMA user_version = {USER_VERSION}')
                connection.execute(_TABLE)
            connection.execute('SAVEPOINT trial')
            try:
                connection.execute(_INSERT, _EXAMPLE)
            except (sqlite3.IntegrityError, sqlite3.OperationalError) as error:  # names the column
                (version,) = connection.execute('PRAGMA user_version').fetchone()
                raise ValueError(f'{error} (its user_version is {version}, not {USER_VERSION})') from error
            connection.execute('ROLLBACK TO trial')

    def _add(self, rows: Sequence[Row]) -> int:
        with self._transaction() as connection:
            connection.executemany(_INSERT, rows)
            new_count, refused = connection.total_changes, 0
            if new_count < len(rows):
                refused = sum(not connection.execute(_FIND, key_of(row)).fetchone() for row in rows)
        if refused:
            self.refused_rows += refused
            self._warn(
                f"file '{self._path}' of release 2.0 or older has another value with the same stamp, tag and"
                f' sensor: {pluralized(refused, "row")} lost: record into a new file'
            )
        return new_count

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """Yield a connection; commit at the end, or roll back after an error."""
        connection = sqlite3.connect(self._path, timeout=LOCKED_FOR_SECONDS, isolation_level=None)
        with contextlib.closing(connection):
            with connection:
                # With a plain BEGIN, programs that read before they write wait for each other.
                connection.execute('BEGIN IMMEDIATE')
                (page_bytes,) = connection.execute('PRAGMA page_size').fetchone()
                if self._path.stat().st_size % page_bytes:  # SQLite would take the rest of the page for zeros
                    raise sqlite3.DatabaseError('its last page is cut off')
                yield connection
            # In WAL mode, which another program can set, the rows are in a second file until a checkpoint.
            if connection.execute('PRAGMA wal_checkpoint(FULL)').fetchone()[0]:
                raise OSError('another program reads it, so that the rows stay in its WAL')


class CsvStore(Store):
    """A CSV file. Lines are only added: a row that is kept again is there again."""

    _checked_bytes = 0  # up to here, the file has whole lines

    def _prepare(self) -> None:
        header = f'{HEADER}\n'.encode()
        self._checked_bytes = 0
        with self._path.open('a+b') as file:
            file.seek(0)
            head = file.read(HEAD_BYTES)
            if header.startswith(head):  # new, or torn when it was new
                file.write(header[len(head) :])
            # A spreadsheet can put a byte order mark before the header.
            elif head.removeprefix(codecs.BOM_UTF8).splitlines()[0] != HEADER.encode():
                raise ValueError(f'the first line is not {HEADER}')

    def _add(self, rows: Sequence[Row]) -> int:
        file_number = os.open(self._path, os.O_RDWR | os.O_APPEND)  # open() would make a missing file
        with open(file_number, 'a+b') as file:
            file.write(self._end_of_line(file) + csv_text(rows).encode())
            file.flush()
            os.fsync(file_number)
            self._checked_bytes = file.tell()
        return len(rows)

    def _end_of_line(self, file: BinaryIO) -> bytes:
        """Return what ends a line that a killed or another writer has left: a row needs its own line."""
        if file.seek(0, os.SEEK_END) < self._checked_bytes:
            self._checked_bytes = 0  # another program has cut the file
        file.seek(self._checked_bytes)
        last, quotes = b'\n', 0
        while part := file.read(2**20):
            last, quotes = part[-1:], quotes + part.count(b'"')
        return b'"\n' if quotes % 2 else b'' if last == b'\n' else b'\n'
