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
#: Firmware that logged no time wrote these at 10 Hz, and PM every ten seconds, which says so itself with 1000
#: loops of 10 ms (ArduCopter 3.0, ten_hz_logging_loop and perf_update).
_TEN_HERTZ: Final = ("CTUN", "ATT")
_STEP_S, _MONITOR, _MONITOR_S = 0.1, "PM", 10.0
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
        every = list(tables)
        timed = [table for table in every if _time_label(table) is not None]
        if timed:
            self._reference = self.rows(max(timed, key=lambda table: table.n_rows))
        else:
            # While nothing was logged at 10 Hz, as on the ground, the monitor's rows keep the time.
            named = {table.name: table for table in every if table.n_rows}
            regular = next((named[name] for name in _TEN_HERTZ if name in named), None)
            self._reference = None
            if regular is not None:
                marks = named[_MONITOR].position if _MONITOR in named else np.zeros(0, np.int64)
                span = np.searchsorted(marks, regular.position)
                first = np.searchsorted(span, span)
                n_rows = np.searchsorted(span, span, side="right") - first
                step_s = np.minimum(_STEP_S, _MONITOR_S / n_rows)
                if not len(marks):
                    step_s = np.full(regular.n_rows, _STEP_S)
                # What lies before the first of the monitor's rows was logged just before it.
                before_s = np.where(span == 0, _MONITOR_S - n_rows * step_s, 0.0)
                times = _MONITOR_S * span + before_s + step_s * (np.arange(regular.n_rows) - first)
                self._reference = Rows(np.asarray(times, dtype=np.float64), regular.position)
        self.has_time = bool(timed)
        """False where no row of the log carries a time."""

    @property
    def is_nominal(self) -> bool:
        """Whether times are those at which the firmware should have logged."""
        return self._reference is not None and not self.has_time

    def rows(self, table: MessageTable) -> Rows:
        """Return the rows of a table: the same object each time.

        With their own time [s], else that of the row before them in the file, else that at which the firmware
        should have logged; NaN where nothing tells.
        """
        if table not in self._rows:
            known, own = self._reference, own_time(table)
            if own is None and known is not None:
                own = time_before(table.position, known.position, known.time_s)
            self._rows[table] = Rows(np.full(table.n_rows, np.nan) if own is None else own, table.position)
        return self._rows[table]
