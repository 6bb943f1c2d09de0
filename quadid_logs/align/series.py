"""From a logged signal to a clean series: sorted, one value per time, counted losses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from quadid_logs.align.clock import EVENTS, Clock
from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.log import Signal
from quadid_logs.data.settings import Settings
from quadid_logs.maths.resampling import typical_period

#: In SI units nothing that a multirotor logs comes near this: such a number is damage, and its
#: square would overflow later on.
_IMPOSSIBLE = 1e6
#: No log's clock is finer [s]: what is closer than this has the same time.
_SAME_TIME_S = 1e-9
_ONE_COLUMN_PER_MOTOR = frozenset({"motor_thrust", "rotor_speed", "output_pwm"})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CleanSeries:
    """A signal on the common clock.

    ``time_s`` (n_samples,) strictly increasing [s]; ``values`` (n_samples,
    n_columns). ``period_s`` is the typical sample period [s], NaN for fewer than
    two samples. The counts say what was dropped, merged or put in order.
    """

    signal: Signal
    time_s: FloatArray
    values: FloatArray
    period_s: float
    n_duplicate: int
    n_out_of_order: int
    n_wild: int
    n_not_finite: int

    @property
    def rate_hz(self) -> float:
        """Typical sample rate [Hz], 0 for a single sample."""
        return 1.0 / self.period_s if self.period_s > 0.0 else 0.0

    def within(self, start_s: float, end_s: float) -> slice:
        """Return the slice of samples with start_s <= time <= end_s."""
        first, last = np.searchsorted(self.time_s, [start_s, end_s + 1e-9])
        return slice(int(first), int(last))


class _Rows(NamedTuple):
    """Times (n_samples,), values (n_samples, n_columns), and which values are known."""

    time_s: FloatArray
    values: FloatArray
    known: BoolArray

    def at(self, chosen: BoolArray | IntArray) -> _Rows:
        """Return the chosen rows."""
        return _Rows(self.time_s[chosen], self.values[chosen], self.known[chosen])

    def where(self, chosen: BoolArray) -> _Rows:
        """Return the marked rows; where all are, as in most logs, nothing is copied."""
        return self if chosen.all() else self.at(chosen)


def _is_possible(values: FloatArray) -> BoolArray:
    """Mark the numbers that a multirotor can log; without memory where all are."""
    if values.size and values.min() > -_IMPOSSIBLE and values.max() < _IMPOSSIBLE:
        return np.broadcast_to(np.True_, values.shape)
    return np.asarray(np.abs(values) < _IMPOSSIBLE, dtype=np.bool_)  # false for NaN


def clean(signal: Signal, clock: Clock, settings: Settings) -> CleanSeries:
    """Put a signal onto the common clock; drop wild stamps and impossible values, merge repeated stamps.

    Rows are ordered by time *within* an epoch only; a reboot is never sorted
    away. Of rows with the same stamp the last stands: it is what the
    autopilot knew last at that time.
    """
    # An event may stand alone, minutes from the periodic rows around it in the file.
    tolerance_s = settings.clock_jump_s if signal.name in EVENTS else settings.wild_stamp_s
    wild = clock.is_wild(signal.time_s, signal.position, tolerance_s)
    # A motor that does not turn is logged as NaN: such a row is lost only if it says nothing.
    known = _is_possible(signal.values)
    finite = known.any(axis=1) if signal.name in _ONE_COLUMN_PER_MOTOR else known.all(axis=1)
    rows = _Rows(clock.common_time(signal.time_s, signal.position), signal.values, known)
    rows = rows.where(~wild & finite)
    n_out_of_order = int(np.count_nonzero(np.diff(rows.time_s) < 0.0))
    if n_out_of_order:
        rows = rows.at(np.argsort(rows.time_s, kind="stable"))
    last_of_stamp = np.append(np.diff(rows.time_s) > _SAME_TIME_S, True)[: rows.time_s.size]
    rows = rows.where(last_of_stamp)
    return CleanSeries(
        signal=signal,
        time_s=rows.time_s,
        values=rows.values if rows.known.all() else np.where(rows.known, rows.values, np.nan),
        period_s=typical_period(rows.time_s),
        n_duplicate=int(np.count_nonzero(~last_of_stamp)),
        n_out_of_order=n_out_of_order,
        n_wild=int(np.count_nonzero(wild)),
        n_not_finite=int(np.count_nonzero(~wild & ~finite)),
    )
