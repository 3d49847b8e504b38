# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
The file that readings are kept in: SQLite or CSV, with the columns of Row. Does not import ROS.

SQLite keeps its rollback journal and does not use WAL. When a commit returns, its rows are in this one file,
so that a copy of the file has all of them. With WAL, rows could still lie in a second file beside it.
"""

import contextlib
import errno
import fcntl
import os
import sqlite3
import stat
from collections.abc import Sequence
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError
from lupin_greenhouse_bridge.recording.rows import HEADER, Row, csv_text, parse_csv

APPLICATION_ID = 0x4C755250  # marks our SQLite files, in big-endian order at byte 68
HEAD_BYTES = 72
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
    """Rows cannot be written now. None of them is in the file."""


def key_of(row: Row) -> tuple[int, str, str]:
    """Return what identifies a row."""
    return row.stamp_ns, row.tag_id, row.sensor


def is_sqlite_of_readings(head: bytes) -> bool:
    """Return whether a file that starts with these HEAD_BYTES was made by SqliteStore."""
    return head.startswith(b'SQLite format 3\0') and head[68:72] == APPLICATION_ID.to_bytes(4, 'big')


def open_store(path: str) -> 'SqliteStore | CsvStore':
    """
    Open or make the file that a name stands for, by its suffix.

    Raises StartUpError for another suffix, and for a file that is something else, which stays unchanged.
    """
    kinds = {'.sqlite': SqliteStore, '.db': SqliteStore, '.csv': CsvStore}
    if not (kind := kinds.get(Path(path).suffix.lower())):
        raise StartUpError(
            f"file '{path}' ends in none of {', '.join(kinds)}: name it readings.sqlite or .csv"
        )
    try:
        return kind(path)
    except (OSError, ValueError, sqlite3.Error) as error:
        reason = getattr(error, 'strerror', None) or error
        raise StartUpError(f"file '{path}': {reason}: name another file, or a new one") from error


def _open(path: str) -> int:
    """Open or make a regular file; raises OSError, and ValueError for anything else."""
    file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NONBLOCK, 0o666)
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise ValueError('not a regular file')
    return file


class SqliteStore:
    """A database with the table `readings`. Several programs can write it at a time."""

    mended = ''

    def __init__(self, path: str):
        """Open or make the database; raises OSError, ValueError and sqlite3.Error."""
        file = _open(path)
        head = os.pread(file, HEAD_BYTES, 0)
        os.close(file)
        if head and not is_sqlite_of_readings(head):
            raise ValueError('not a file of record_readings')
        self._path = path
        self._connection = sqlite3.connect(
            path, timeout=LOCKED_FOR_SECONDS, isolation_level=None, check_same_thread=False
        )
        with self._transaction():
            self._connection.execute(f'PRAGMA application_id = {APPLICATION_ID}')
            self._connection.execute(_TABLE)

    @contextlib.contextmanager
    def _transaction(self):
        # Not a plain BEGIN: two programs that read before they write can wait for each other.
        self._connection.execute('BEGIN IMMEDIATE')
        try:
            yield
            self._connection.execute('COMMIT')
        finally:
            if self._connection.in_transaction:
                self._connection.execute('ROLLBACK')

    def keep(self, rows: Sequence[Row]) -> int:
        """Write the rows that are not in the file yet, all or none; return how many. Raises StoreError."""
        before = self._connection.total_changes
        try:
            with self._transaction():
                self._connection.executemany(_INSERT, rows)
        except sqlite3.Error as error:
            raise StoreError(f"file '{self._path}': {error}") from error
        return self._connection.total_changes - before

    def close(self) -> None:
        """Close the file."""
        self._connection.close()


class CsvStore:
    """A CSV file. Only one program can write it at a time, and it keeps the keys of all rows in memory."""

    def __init__(self, path: str):
        """Open or make the file, and remove a row that was torn by a kill; raises OSError and ValueError."""
        self._path, self._file = path, _open(path)
        try:
            self._lock()
            content, header = Path(path).read_bytes(), f'{HEADER}\n'.encode()
            if header.startswith(content):  # new, or torn when it was new
                os.ftruncate(self._file, 0)
                content = header[: os.write(self._file, header)]
            rows, self._size = parse_csv(content)
            self._keys = {key_of(row) for row in rows}
            self._mend()
        except BaseException:
            os.close(self._file)
            raise
        self.mended = f"file '{path}': removed an incomplete last row" if self._size < len(content) else ''

    def _mend(self) -> None:
        """Remove what follows the last row that was kept; raises OSError."""
        os.ftruncate(self._file, self._size)
        self._is_torn = False

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            reason = 'another recorder is writing it (a SQLite file takes more than one)'
            raise ValueError(reason) from error

    def keep(self, rows: Sequence[Row]) -> int:
        """Write the rows that are not in the file yet, all or none; return how many. Raises StoreError."""
        new = {key: row for row in rows if (key := key_of(row)) not in self._keys}
        lines = csv_text(new.values()).encode()
        try:
            if os.fstat(self._file).st_nlink == 0:
                raise FileNotFoundError(errno.ENOENT, 'it was deleted')
            if self._is_torn:
                self._mend()
            self._is_torn = True  # until all is written
            if os.write(self._file, lines) != len(lines):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file)
            self._is_torn = False
        except OSError as error:
            with contextlib.suppress(OSError):  # the next write, or the next recorder, mends it
                self._mend()
            raise StoreError(f"file '{self._path}': {error.strerror}") from error
        self._size += len(lines)
        self._keys |= new.keys()
        return len(new)

    def close(self) -> None:
        """Close the file, so that another recorder can write it."""
        os.close(self._file)
