# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Rows on their way into the file. Does not import ROS."""

import math
from collections.abc import Iterable

from lupin_greenhouse_bridge.errors import escaped, pluralized
from lupin_greenhouse_bridge.recording.rows import Row, fault_of
from lupin_greenhouse_bridge.recording.store import StoreError, key_of

MOST_WAITING = 10_000
ERROR_EVERY_SECONDS = 10.0


class BufferedWriter:
    """
    Writes rows together. While the file cannot be written, up to MOST_WAITING rows wait in memory.

    All times are seconds of one steady clock. The line "N rows kept" acknowledges the first N rows that were
    not in the file before: they are on the disk.
    """

    def __init__(self, store, logger):
        """Keep rows in an open store, and close it at the end."""
        self._store, self._logger = store, logger
        self._waiting: dict[tuple, Row] = {}
        self._kept = self._dropped = 0
        self._is_failing = False
        self._next_error = -math.inf  # when to log an ERROR again

    def add(self, rows: Iterable[Row], now: float) -> None:
        """Take rows. They are in the file after the next write()."""
        for row in rows:
            if fault := fault_of([row]):  # it would make the file unreadable
                self._logger.warning(
                    f"tag '{escaped(row.tag_id, 64)}': {escaped(fault, 200)}: not kept",
                    throttle_duration_sec=ERROR_EVERY_SECONDS,
                )
                continue
            if len(self._waiting) >= MOST_WAITING and not self._is_failing:
                self.write(now)
            if len(self._waiting) < MOST_WAITING or key_of(row) in self._waiting:
                self._waiting.setdefault(key_of(row), row)
            else:
                self._dropped += 1

    def write(self, now: float) -> None:
        """Write what waits, and log it."""
        if not self._waiting:
            return
        try:
            kept = self._store.keep(list(self._waiting.values()))
        except StoreError as error:
            self._is_failing = True
            if now >= self._next_error:
                self._next_error = now + ERROR_EVERY_SECONDS
                waiting = pluralized(len(self._waiting), 'row')
                self._logger.error(f'{error}: {waiting} waiting in memory, {self._dropped} dropped')
            return
        self._waiting.clear()
        self._is_failing = False
        self._kept += kept
        if kept:
            self._logger.info(f'{self._kept} rows kept')
        if self._dropped:
            self._logger.warning(
                f'{pluralized(self._dropped, "row")} dropped: the file could not be written for too long'
            )
            self._dropped = 0

    def end(self) -> int:
        """Write what waits, close the file, and return how many rows are lost."""
        self.write(math.inf)
        self._store.close()
        return len(self._waiting) + self._dropped
