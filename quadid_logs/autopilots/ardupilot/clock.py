"""Times of DataFlash rows: their own time column, or that of the rows around them in the file."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.containers.message_table import MessageTable

#: Seconds per count. `SampleUS` is when a raw sensor was read, `TimeUS` when it was logged.
_SAMPLE_COLUMN: Final = "SampleUS"
_TIME_COLUMNS: Final = {"TimeUS": 1e-6, "TimeMS": 1e-3}
TIME_LABELS: Final = frozenset({*_TIME_COLUMNS, _SAMPLE_COLUMN})
#: Their TimeMS is not this clock: it is the time of week of the GPS receiver.
_FOREIGN_CLOCK: Final = frozenset({"GPS", "GPS2"})


def own_time(table: MessageTable) -> FloatArray | None:
    """Return the rows' own time [s], None where the message type has no time column.

    A time column is the first column: the same labels mean other things
    elsewhere. Values pass untouched, however wild.
    """
    first = next(iter(table.columns), "")
    if first == "TimeMS" and table.name in _FOREIGN_CLOCK:
        first = ""
    label = _SAMPLE_COLUMN if _SAMPLE_COLUMN in table.columns else first
    factor = _TIME_COLUMNS.get(first)
    if factor is None or not table.has_numbers(label):
        return None
    factor = 1e-6 if label == _SAMPLE_COLUMN else factor
    # Division keeps whole microseconds at the double nearest to their decimal value.
    times: FloatArray = np.divide(table.columns[label], round(1.0 / factor), dtype=np.float64)
    return times


class LogClock:
    """Gives every row of a log a time.

    Parameters
    ----------
    tables : iterable of MessageTable
        The rows with the most times serve as reference for rows without one.
    """

    def __init__(self, tables: Iterable[MessageTable]) -> None:
        self._position: IntArray = np.zeros(0, np.int64)
        self._time: FloatArray = np.zeros(0)
        # Several signals come from one table: they share its times. The positions kept beside hold the key.
        self._known: dict[int, tuple[IntArray, FloatArray | None]] = {}
        for table in tables:
            time = self._own_time(table)
            if time is not None and len(time) > len(self._time):
                self._position, self._time = table.position, time

    @property
    def has_time(self) -> bool:
        """False where no row of the log carries a time."""
        return len(self._time) > 0

    @property
    def start_s(self) -> float:
        """Time of the reference's first row, NaN without any."""
        return float(self._time[0]) if self.has_time else float("nan")

    def times(self, table: MessageTable) -> FloatArray:
        """Return the time of each row [s]: its own, or that of the last reference row before it."""
        own = self._own_time(table)
        return self.times_at(table.position) if own is None else own

    def _own_time(self, table: MessageTable) -> FloatArray | None:
        """Return `own_time` of a table, computed once for all tables of these rows."""
        position = table.position
        if id(position) not in self._known:
            self._known[id(position)] = position, own_time(table)
        return self._known[id(position)][1]

    def times_at(self, position: IntArray) -> FloatArray:
        """Return the time of the last reference row before each position [s], NaN without any."""
        if not self.has_time:
            return np.full(len(position), np.nan)
        before = np.searchsorted(self._position, position, side="right") - 1
        return self._time[np.maximum(before, 0)]
