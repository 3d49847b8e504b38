"""
The file of recorded readings: SQLite or CSV, with the columns of Row. Does not import ROS.

SQLite uses its rollback journal, not WAL. When a commit returns, its rows are in this one file, so that a
copy of the file has all of them. With WAL, some rows could still be in a second file.
"""

import contextlib
import errno
import fcntl
import os
import sqlite3
import stat
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError
from lupin_greenhouse_bridge.recording.rows import HEADER, Row, csv_text, has_header, parse_csv

APPLICATION_ID = 0x4C755250  # marks our SQLite files, in big-endian order at byte 68
HEAD_BYTES = 72
LOCKED_FOR_SECONDS = 0.5  # how long a commit waits for another program; then its rows wait in memory
TAIL_BYTES = 2 * 2**20  # of a CSV file: at the start, one to two times as many are parsed
MOST_KEYS = 20_000  # of the last rows of a CSV file; a latched topic repeats at most 2,000 readings
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
_BEGIN = 'BEGIN IMMEDIATE'  # with a plain one, programs that read before they write wait for each other
_MARKS = ', '.join('?' * len(Row._fields))
_INSERT = f'INSERT OR IGNORE INTO readings ({HEADER}) VALUES ({_MARKS})'  # noqa: S608 (no text of a user)
_ERRORS = (OSError, ValueError, sqlite3.Error)


class StoreError(OneLineError):
    """Rows cannot be written now, and none of them is in the file."""


def key_of(row: Row) -> tuple[int, str, str]:
    """Return what identifies a row."""
    return row.stamp_ns, row.tag_id, row.sensor


def is_sqlite_of_readings(head: bytes) -> bool:
    """Return whether a file that starts with these HEAD_BYTES was made by SqliteStore."""
    return head.startswith(b'SQLite format 3\0') and head[68:72] == APPLICATION_ID.to_bytes(4, 'big')


def open_store(path: str) -> 'Store':
    """
    Open or create a file of readings, whose suffix selects the format.

    Raises StartUpError for another suffix, and for a file in another format, which stays unchanged.
    """
    kinds = {'.sqlite': SqliteStore, '.db': SqliteStore, '.csv': CsvStore}
    if not (kind := kinds.get(Path(path).suffix.lower())):
        raise StartUpError(
            f"file '{path}' ends in none of {', '.join(kinds)}: name it readings.sqlite or .csv"
        )
    try:
        return kind(path)
    except _ERRORS as error:
        raise StartUpError(
            f"file '{path}': {file_error_text(error)}: name another file, or a new one"
        ) from error


def file_error_text(error: Exception) -> str:
    """Return why a file cannot be read or written, without the number and the path of an OSError."""
    return getattr(error, 'strerror', None) or str(error)


class Store:
    """A file of readings. If it is moved, deleted or truncated, a new file with its name gets the rows."""

    _identity = None  # device and inode while the file is open
    _size = 0  # bytes that the file has at least

    def __init__(self, path: str):
        """Open or make the file; raises OSError, ValueError and sqlite3.Error."""
        self.notes: list[str] = []  # what happened to the file, for the log
        self.row_count = 0  # in the file when it was opened
        self._path = path
        self._open()

    def keep(self, rows: Sequence[Row]) -> int:
        """Write all rows that are not in the file yet, or none; return their number. Raises StoreError."""
        try:
            while True:
                if not self._is_in_place():
                    self._identity = None
                    self.close()
                    self._open()
                    self.notes.append(f"file '{self._path}' was moved, deleted or truncated: made a new one")
                kept = self._write(rows)
                if self._is_in_place():  # otherwise nobody may find these rows
                    return kept
        except _ERRORS as error:
            raise StoreError(f"file '{self._path}': {file_error_text(error)}") from error

    def _is_in_place(self) -> bool:
        try:
            there = os.stat(self._path)
        except FileNotFoundError:
            return False
        return (there.st_dev, there.st_ino) == self._identity and there.st_size >= self._size

    def _open_regular_file(self) -> tuple[int, tuple[int, int]]:
        """Open or make the file, and return it with its device and inode; raises OSError and ValueError."""
        file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NONBLOCK, 0o666)
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode):
            os.close(file)
            raise ValueError('not a regular file')
        return file, (status.st_dev, status.st_ino)


class SqliteStore(Store):
    """A database with the table `readings`. Several programs can write it at a time."""

    _size = 1  # an empty file has no table

    def _open(self) -> None:
        file, identity = self._open_regular_file()
        head = os.pread(file, HEAD_BYTES, 0)
        os.close(file)
        if head and not is_sqlite_of_readings(head):
            raise ValueError('not a file of record_readings')
        self._connection = sqlite3.connect(
            self._path, timeout=LOCKED_FOR_SECONDS, isolation_level=None, check_same_thread=False
        )
        with self._connection:  # commits, or rolls back
            self._connection.execute(_BEGIN)
            self._connection.execute(f'PRAGMA application_id = {APPLICATION_ID}')
            self._connection.execute(_TABLE)
        (self.row_count,) = self._connection.execute('SELECT count(*) FROM readings').fetchone()
        self._identity = identity

    def _write(self, rows: Sequence[Row]) -> int:
        before = self._connection.total_changes
        with self._connection:
            self._connection.execute(_BEGIN)
            self._connection.executemany(_INSERT, rows)
        return self._connection.total_changes - before

    def close(self) -> None:
        """Close the file."""
        self._connection.close()


class CsvStore(Store):
    """A CSV file. Only one recorder can write it at a time, and it knows the last MOST_KEYS rows."""

    _file = -1
    _is_torn = False

    def _open(self) -> None:
        """Open or make the file, and remove a row that was torn by a kill."""
        self._file, identity = self._open_regular_file()
        try:
            self._lock()
            size, header = os.fstat(self._file).st_size, f'{HEADER}\n'.encode()
            start, lines_before = _start_of_tail(self._file, size)
            content = os.pread(self._file, size - start, start)
            if not start and header.startswith(content):  # new, or torn when it was new
                os.ftruncate(self._file, 0)
                _append(self._file, content := header)
            rows, complete = parse_csv(content, lines_before)
            self._size = start + complete
            self._mend()
        except BaseException:
            self.close()
            raise
        self._identity = identity
        self._keys = OrderedDict.fromkeys(map(key_of, rows[-MOST_KEYS:]))
        self.row_count = len(rows) + max(lines_before - 1, 0)  # without the header
        if complete < len(content):
            self.notes.append(f"file '{self._path}': removed an incomplete last row")

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

    def _write(self, rows: Sequence[Row]) -> int:
        new = {key: row for row in rows if (key := key_of(row)) not in self._keys}
        lines = csv_text(new.values()).encode()
        try:
            if self._is_torn:
                self._mend()
            self._size = os.fstat(self._file).st_size  # another program may have added rows
            self._is_torn = True  # until all is written
            _append(self._file, lines)
            os.fsync(self._file)
            self._is_torn = False
        except OSError:
            with contextlib.suppress(OSError):  # the next write, or the next recorder, mends it
                self._mend()
            raise
        if os.fstat(self._file).st_size == len(lines):  # truncated just before: these rows have no header
            os.ftruncate(self._file, 0)
        self._size += len(lines)
        self._keys.update(dict.fromkeys(new))
        while len(self._keys) > MOST_KEYS:
            self._keys.popitem(last=False)
        return len(new)

    def close(self) -> None:
        """Close the file, so that another recorder can write it."""
        if self._file >= 0:
            os.close(self._file)
        self._file = -1


def _append(file: int, data: bytes) -> None:
    if os.write(file, data) != len(data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _start_of_tail(file: int, size: int) -> tuple[int, int]:
    """Return where a row starts in the last bytes of a CSV file, and how many lines come before it."""
    if not has_header(os.pread(file, 4 * len(HEADER), 0)):
        return 0, 0
    start = lines_before = lines = quotes = 0
    with open(file, 'rb', closefd=False) as parts:
        while (part := parts.readlines(TAIL_BYTES)) and parts.tell() + TAIL_BYTES < size:
            lines, quotes = lines + len(part), quotes + b''.join(part).count(b'"')
            if quotes % 2 == 0:  # not within a quoted cell: this line end ends a row
                start, lines_before = parts.tell(), lines
    return start, lines_before
