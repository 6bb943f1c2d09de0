"""Times of DataFlash rows: their own time column, or that of the rows around them in the file."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.containers.content import time_before
from quadid_logs.containers.message_table import MessageTable
from quadid_logs.data.log import Rows

#: Counts per second. `SampleUS` is when a raw sensor was read, `TimeUS` when it was logged.
_SAMPLE_COLUMN: Final = "SampleUS"
_TIME_COLUMNS: Final = {"TimeUS": 1_000_000, "TimeMS": 1000, _SAMPLE_COLUMN: 1_000_000}
TIME_LABELS: Final = frozenset(_TIME_COLUMNS)
#: Their TimeMS is not this clock: it is the time of week of the GPS receiver.
_FOREIGN_CLOCK: Final = frozenset({"GPS", "GPS2"})


def _time_label(table: MessageTable) -> str | None:
    """Return the column that holds the rows' own time; None where the message type has none.

    A time column is the first column: the same labels mean other things elsewhere.
    """
    first = next(iter(table.columns), "")
    if first not in ("TimeUS", "TimeMS") or (first == "TimeMS" and table.name in _FOREIGN_CLOCK):
        return None
    label = _SAMPLE_COLUMN if _SAMPLE_COLUMN in table.columns else first
    return label if table.has_numbers(label) else None


def own_time(table: MessageTable) -> FloatArray | None:
    """Return the rows' own time [s] as logged, however implausible; None where the message type has none.

    Parameters
    ----------
    table : MessageTable

    Returns
    -------
    ndarray, shape (n_rows,), or None
    """
    label = _time_label(table)
    if label is None:
        return None
    # Division keeps whole microseconds at the double nearest to their decimal value.
    times: FloatArray = np.divide(table.columns[label], _TIME_COLUMNS[label], dtype=np.float64)
    return times


class LogClock:
    """Gives every row of a log a time.

    Parameters
    ----------
    tables : iterable of MessageTable
        The longest with a time column serves as reference for rows without one.
    """

    def __init__(self, tables: Iterable[MessageTable]) -> None:
        self._rows: dict[MessageTable, Rows] = {}
        self._reference: Rows | None = None
        timed = [table for table in tables if _time_label(table) is not None]
        if timed:
            self._reference = self.rows(max(timed, key=lambda table: table.n_rows))

    @property
    def has_time(self) -> bool:
        """False where no row of the log carries a time."""
        return self._reference is not None

    def rows(self, table: MessageTable) -> Rows:
        """Return the rows of a table: the same object each time.

        Parameters
        ----------
        table : MessageTable

        Returns
        -------
        Rows
            With their own time [s], else that of the row before them in the file; NaN where no row has any.
        """
        if table not in self._rows:
            known, own = self._reference, own_time(table)
            if own is None and known is not None:
                own = time_before(table.position, known.position, known.time_s)
            self._rows[table] = Rows(np.full(table.n_rows, np.nan) if own is None else own, table.position)
        return self._rows[table]
