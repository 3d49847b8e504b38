"""
The file of recorded readings: SQLite or CSV, with the columns of Row. Does not import ROS.

SQLite uses its rollback journal, not WAL. When a commit returns, its rows are in this one file, so that a
copy of the file has all of them. With WAL, some rows could still be in a second file.
"""

import contextlib
import os
import sqlite3
import stat
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError
from lupin_greenhouse_bridge.recording.rows import HEADER, Row, csv_text, has_header

HEAD_BYTES = 128  # of a file: enough to tell its format
APPLICATION_ID = 0x4C755250  # marks our SQLite files, in big-endian order at byte 68
LOCKED_FOR_SECONDS = 0.5  # how long a commit waits for another program; then its rows wait in memory
_TABLE = """
CREATE TABLE IF NOT EXISTS readings (
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
    PRIMARY KEY (stamp_ns, tag_id, sensor)
)"""
_MARKS = ', '.join('?' * len(Row._fields))
_INSERT = f'INSERT OR IGNORE INTO readings ({HEADER}) VALUES ({_MARKS})'  # noqa: S608 (no text of a user)


class StoreError(OneLineError):
    """Rows cannot be written now."""


def is_sqlite_of_readings(head: bytes) -> bool:
    """Return whether a file that starts with these HEAD_BYTES was made by SqliteStore."""
    return head.startswith(b'SQLite format 3\0') and head[68:72] == APPLICATION_ID.to_bytes(4, 'big')


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
        raise StartUpError(f'{error}: name another file, or a new one') from error


def file_error_text(error: Exception) -> str:
    """Return why a file cannot be read or written, without the number and the path of an OSError."""
    return getattr(error, 'strerror', None) or str(error)


class Store(ABC):
    """
    A file of readings, which is open only while rows are added.

    If it is moved, deleted or emptied, a new file with its name gets the rows.
    """

    def __init__(self, path: str, warn: Callable[[str], object]) -> None:
        """Make the file, or check that it can be continued; raises StoreError."""
        self._path, self._warn = Path(path), warn
        self._identity: tuple[int, int] | None = None  # of the file that got the last rows
        self.keep([])

    def keep(self, rows: Sequence[Row]) -> int:
        """Add rows to the file, and return how many of them are new. Raises StoreError."""
        try:
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
            raise StoreError(f"file '{self._path}': {file_error_text(error)}") from error

    def _find(self) -> tuple[int, int] | None:
        """Return the device and inode of the file; None if it is missing or empty."""
        try:
            status = self._path.stat()
        except FileNotFoundError:
            return None
        if not stat.S_ISREG(status.st_mode):
            raise ValueError('not a regular file')
        return (status.st_dev, status.st_ino) if status.st_size else None

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
        if head and not is_sqlite_of_readings(head):
            raise ValueError('not a file of record_readings')
        with self._transaction() as connection:
            connection.execute(f'PRAGMA application_id = {APPLICATION_ID}')
            connection.execute(_TABLE)

    def _add(self, rows: Sequence[Row]) -> int:
        with self._transaction() as connection:
            connection.executemany(_INSERT, rows)
            return connection.total_changes

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """Yield a connection; commit at the end, or roll back after an error."""
        connection = sqlite3.connect(self._path, timeout=LOCKED_FOR_SECONDS, isolation_level=None)
        with contextlib.closing(connection), connection:
            # With a plain BEGIN, programs that read before they write wait for each other.
            connection.execute('BEGIN IMMEDIATE')
            yield connection


class CsvStore(Store):
    """A CSV file. Lines are only added: a row that is kept again is there again."""

    def _prepare(self) -> None:
        """Write the header, or end a line that a killed writer has torn: the next row needs its own line."""
        header = f'{HEADER}\n'.encode()
        with self._path.open('a+b') as file:
            file.seek(0)
            content = file.read(HEAD_BYTES)
            if header.startswith(content):  # new, or torn when it was new
                file.write(header[len(content) :])
                return
            if not has_header(content):
                raise ValueError(f'the first line is not {HEADER}')
            quotes = content.count(b'"')
            while part := file.read(2**20):
                content, quotes = part, quotes + part.count(b'"')
            if quotes % 2:  # torn within a cell
                file.write(b'"\n')
            elif not content.endswith(b'\n'):
                file.write(b'\n')

    def _add(self, rows: Sequence[Row]) -> int:
        file_number = os.open(self._path, os.O_WRONLY | os.O_APPEND)  # open() would make a missing file
        with open(file_number, 'wb') as file:
            file.write(csv_text(rows).encode())
            file.flush()
            os.fsync(file_number)
        return len(rows)
