# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Write rows in a separate thread. Does not import ROS."""

import math
import sys
import threading
import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.recording.rows import Row
from lupin_greenhouse_bridge.recording.store import Store, StoreError

if TYPE_CHECKING:
    from lupin_greenhouse_bridge.runtime.rclpy_internals import RcutilsLogger

MOST_ROWS = 50_000
MOST_BYTES = 64 * 2**20  # of memory
WRITE_EVERY_SECONDS = 0.5
ERROR_EVERY_SECONDS = 10.0
LAST_TRIES = 6  # at the end: three seconds for a file that another program locks


class BufferedWriter:
    """
    Writes the waiting rows twice a second after start(). A file that cannot be written blocks nobody else.

    Up to MOST_ROWS rows and MOST_BYTES wait in memory, and rows that do not fit are counted as lost. The line
    "N rows kept" acknowledges that the first N new rows are on the disk.
    """

    def __init__(
        self, store: Store, logger: 'RcutilsLogger', clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Write to an open store. The clock is monotonic, in seconds."""
        self._store, self._logger, self._clock = store, logger, clock
        self._lock = threading.Lock()
        self._waiting: list[Row] = []
        self._bytes = self._kept = self._lost = self._lost_said = 0
        self._next_error_at = -math.inf
        self._is_ended = threading.Event()
        self._thread = threading.Thread(target=self._write_all, name='writer', daemon=True)

    def start(self) -> None:
        """Start to write."""
        self._thread.start()

    def add(self, rows: Iterable[Row]) -> None:
        """Take rows, without waiting for the file."""
        with self._lock:
            for row in rows:
                size = _bytes_of(row)
                if len(self._waiting) < MOST_ROWS and self._bytes + size <= MOST_BYTES:
                    self._waiting.append(row)
                    self._bytes += size
                else:
                    self._lost += 1

    def _write_all(self) -> None:
        while not self._is_ended.wait(WRITE_EVERY_SECONDS):
            self.write()

    def write(self) -> bool:
        """Write the waiting rows, and log the result; return whether all of them are written."""
        with self._lock:
            rows = list(self._waiting)
        try:
            new_count = self._store.keep(rows) if rows else 0
        except StoreError as error:
            if self._clock() >= self._next_error_at:
                self._next_error_at = self._clock() + ERROR_EVERY_SECONDS
                waiting = pluralized(len(rows), 'row')
                self._logger.error(f'{error}: {waiting} waiting in memory, {self._lost} dropped')
            return False
        with self._lock:
            del self._waiting[: len(rows)]
            self._bytes -= sum(map(_bytes_of, rows))
        self._kept += new_count
        if new_count:
            self._logger.info(f'{pluralized(self._kept, "row")} kept')
        if self._lost > self._lost_said:
            self._lost_said = self._lost
            dropped = pluralized(self._lost, 'row')
            self._logger.warning(f'{dropped} dropped so far: the file could not be written for too long')
        return True

    def end(self) -> int:
        """Write the waiting rows, and return how many rows were lost since the start."""
        self._is_ended.set()
        if self._thread.is_alive():
            self._thread.join()
        self._next_error_at = -math.inf
        any(self.write() for _ in range(LAST_TRIES))
        self._lost += len(self._waiting)
        self._waiting.clear()
        return self._lost + self._store.refused_rows


def _bytes_of(row: Row) -> int:
    return sys.getsizeof(row) + sum(map(sys.getsizeof, row))
