"""The SQLite file of recorded readings: written by the recorder, and read again. Does not import ROS."""

import contextlib
import sqlite3
import stat
from collections.abc import Sequence
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, reason_of

from lupin_readings.rows import HEADER, NUMBERS, TEXTS, Row, fault_of

ENDINGS = ('.sqlite', '.db')
SQLITE_HEAD = b'SQLite format 3\0'
APPLICATION_ID = 0x4C755250  # marks our files
USER_VERSION = 1  # of the table
LOCKED_FOR_SECONDS = 0.1  # how long a write waits for another program; after that, the rows stay in memory
WANTED = "name a file of record_readings, or a mission's report"
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
_INSERT = f'INSERT OR IGNORE INTO readings ({HEADER}) VALUES ({_MARKS})'  # noqa: S608 (no user text)
_SELECT = f'SELECT {HEADER} FROM readings ORDER BY stamp_ns, rowid'  # noqa: S608 (no user text)
# SQLite accepts values of any type, so another program can have written wrong ones.
_IS_WRONG = ' OR '.join(
    [
        "typeof(stamp_ns) <> 'integer' OR stamp_ns < 0",
        *(f"typeof({name}) <> 'text'" for name in TEXTS),
        *(f"typeof({name}) NOT IN ('real', 'null') OR abs({name}) = 9e999" for name in NUMBERS),
    ]
)
_SELECT_WRONG = f'SELECT {HEADER} FROM readings WHERE {_IS_WRONG} LIMIT 1'  # noqa: S608 (no user text)
Identity = tuple[int, int]  # device and inode


class StoreError(OneLineError):
    """Rows cannot be written now."""


class ReadingFileError(OneLineError):
    """A file holds no readings, or cannot be read."""

    def __init__(self, path: Path | str, error: Exception) -> None:
        """Make a message of the error and the fix."""
        super().__init__(f"'{path}': {reason_of(error)}: {WANTED}")


class Store:
    """
    A file with the table `readings`, which has each row once. Several programs can write it.

    If it is moved, deleted or emptied, a new file with its name gets the rows.
    """

    def __init__(self, path: str) -> None:
        """Make the file, or check that it can be continued; raises StartUpError."""
        self._path = Path(path).absolute()  # SQLite would take a name such as `file:x` for an address
        self._connection: sqlite3.Connection | None = None
        self._identity: Identity | None = None  # of the file that is open
        if self._path.suffix.lower() not in ENDINGS:
            raise StartUpError(
                f"file '{path}' does not end in {' or '.join(ENDINGS)}: name it readings.sqlite"
            )
        try:
            self.keep([])
        except StoreError as error:
            folder = self._path.parent
            remedy = 'name another file' if folder.is_dir() else f"make the folder '{folder}'"
            raise StartUpError(f'{error}: {remedy}') from error

    def keep(self, rows: Sequence[Row], wait_seconds: float = LOCKED_FOR_SECONDS) -> int:
        """Add rows to the file, and return how many of them are new. Raises StoreError."""
        try:
            while True:
                connection = self._connected()
                connection.execute(f'PRAGMA busy_timeout = {round(1000 * wait_seconds)}')
                before = connection.total_changes
                with connection:  # commits, or rolls back
                    connection.executemany(_INSERT, rows)
                # Otherwise the rows went to a deleted or moved file.
                if self._identity == _identity_of(self._path):
                    return connection.total_changes - before
        except (OSError, ValueError, sqlite3.Error) as error:
            self.close()
            raise StoreError(f"file '{self._path}': {reason_of(error)}") from error

    def close(self) -> None:
        """Close the file; keep() opens it again."""
        if self._connection:
            self._connection.close()
        self._connection = None

    def _connected(self) -> sqlite3.Connection:
        """Return the open file, or open it; raises OSError, ValueError and sqlite3.Error."""
        identity = _identity_of(self._path)  # raises ValueError before SQLite would wait for a pipe
        if self._connection and identity == self._identity:
            return self._connection
        self.close()
        # Several threads can use the connection, but only one at a time.
        connection = sqlite3.connect(self._path, timeout=LOCKED_FOR_SECONDS, check_same_thread=False)
        self._connection = connection
        with connection:
            connection.execute('BEGIN IMMEDIATE')
            if not connection.execute('SELECT count(*) FROM sqlite_master').fetchone()[0]:
                connection.execute(f'PRAGMA application_id = {APPLICATION_ID}')
                connection.execute(f'PRAGMA user_version = {USER_VERSION}')
                connection.execute(_TABLE)
            (application_id,) = connection.execute('PRAGMA application_id').fetchone()
            (user_version,) = connection.execute('PRAGMA user_version').fetchone()
            if (application_id, user_version) != (APPLICATION_ID, USER_VERSION):
                raise ValueError('not a file that this release of record_readings has made')
        self._identity = _identity_of(self._path)
        return connection


def _identity_of(path: Path) -> Identity | None:
    """Return the device and inode of a file; None if it is missing or empty. Raises ValueError."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(status.st_mode):
        raise ValueError('not a regular file')
    return (status.st_dev, status.st_ino) if status.st_size else None


def read_rows(path: Path | str) -> list[Row]:
    """Return the rows of a file, sorted by stamp; raises ReadingFileError if it is not a valid file."""
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            raise ValueError('not a regular file')
        # Writable, because SQLite first repairs the file if a recorder was killed during a commit.
        address = f'{path.resolve(strict=True).as_uri()}?mode=rw'
        with contextlib.closing(sqlite3.connect(address, uri=True)) as connection:
            if wrong := connection.execute(_SELECT_WRONG).fetchone():
                raise ValueError(fault_of(Row(*wrong)))
            return [Row(*values) for values in connection.execute(_SELECT)]
    except (OSError, sqlite3.Error, ValueError) as error:
        raise ReadingFileError(path, error) from error
