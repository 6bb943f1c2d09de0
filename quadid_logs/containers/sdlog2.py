"""PX4's legacy sdlog2 log (.px4log, .bin): DataFlash's framing with other messages and its own clock."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.containers.content import time_before
from quadid_logs.containers.dataflash_index import MessageDefinition, looks_like_dataflash
from quadid_logs.containers.message_table import MessageTable
from quadid_logs.data.log import Rows


def is_mine(head: bytes) -> bool:
    """Say whether a file that begins with these (up to 64 kB) bytes is an sdlog2 log."""
    return looks_like_dataflash(head, is_sdlog2)


def is_sdlog2(definitions: Collection[MessageDefinition]) -> bool:
    """Say whether definitions are those of sdlog2, which has DataFlash's framing.

    Its rows carry no time; a TIME message with the field StartTime precedes
    them (PX4 v1.0 src/modules/sdlog2/sdlog2_messages.h).
    """
    return any(
        (definition.name == "TIME" and definition.columns[:1] == ("StartTime",))
        or (definition.name == "ATT" and "RollRate" in definition.columns)
        for definition in definitions
    )


class TimeRecords:
    """The TIME records of a file: each holds for the rows that follow it.

    Parameters
    ----------
    table : MessageTable or None
        The rows of TIME.
    """

    def __init__(self, table: MessageTable | None) -> None:
        time_us = None if table is None else table.column("StartTime")
        self._position = np.zeros(0, np.int64) if table is None or time_us is None else table.position
        self._time_s = np.zeros(0) if time_us is None else time_us.astype(np.float64) / 1e6

    @property
    def has_time(self) -> bool:
        """False where there is no such record."""
        return len(self._position) > 0

    def times(self, table: MessageTable) -> FloatArray:
        """Return the time of each row [s], NaN for rows before the first TIME."""
        time_s = time_before(table.position, self._position, self._time_s)
        return np.where(table.position < self._position[0], np.nan, time_s) if self.has_time else time_s

    def rows(self, table: MessageTable) -> Rows:
        """Return times and positions of a table."""
        return Rows(self.times(table), table.position)
