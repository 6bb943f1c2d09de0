"""From a logged signal to a clean series: sorted, one value per time, counted losses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quadid_logs.align.clock import Clock, is_wild
from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import Signal
from quadid_logs.data.settings import Settings
from quadid_logs.maths.resampling import median_period


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CleanSeries:
    """A signal on the common clock.

    ``time_s`` (n_samples,) strictly increasing [s]; ``values`` (n_samples,
    n_columns). The counts say what was dropped, merged or put in order.
    """

    signal: Signal
    time_s: FloatArray
    values: FloatArray
    n_duplicate: int
    n_out_of_order: int
    n_wild: int
    n_not_finite: int

    @property
    def period_s(self) -> float:
        """Median sample period [s]."""
        return median_period(self.time_s)

    @property
    def rate_hz(self) -> float:
        """Median sample rate [Hz], 0 for a single sample."""
        period = self.period_s
        return 1.0 / period if period > 0.0 else 0.0

    def within(self, start_s: float, end_s: float) -> slice:
        """Return the slice of samples with start_s <= time <= end_s."""
        first, last = np.searchsorted(self.time_s, [start_s, end_s + 1e-9])
        return slice(int(first), int(last))


def clean(signal: Signal, clock: Clock, settings: Settings) -> CleanSeries:
    """Put a signal onto the common clock; drop wild stamps and non-finite values, merge repeated stamps.

    Rows are ordered by time *within* an epoch only; a reboot is never sorted
    away. Of rows with the same stamp the last stands: it is what the
    autopilot knew last at that time.
    """
    wild = is_wild(signal.time_s, _tolerance_s(signal, settings))
    epoch = clock.epoch_of(signal.position)
    outside = (signal.time_s < clock.first_s[epoch]) | (signal.time_s > clock.last_s[epoch])
    wild |= outside & np.isfinite(signal.time_s)
    # A motor that does not turn is logged as NaN: a row counts as lost only if it says nothing.
    finite = (
        np.isfinite(signal.values).any(axis=1)
        if _may_be_nan(signal)
        else np.isfinite(signal.values).all(axis=1)
    )
    keep = np.flatnonzero(~wild & finite)
    time_s = signal.time_s[keep] + clock.shift_s[epoch[keep]]
    n_out_of_order = int(np.count_nonzero(np.diff(time_s) < 0.0))
    if n_out_of_order:
        order = np.argsort(time_s, kind="stable")
        keep, time_s = keep[order], time_s[order]
    last_of_stamp = np.append(np.diff(time_s) > 0.0, True) if time_s.size else np.zeros(0, bool)
    keep = keep[last_of_stamp]
    return CleanSeries(
        signal=signal,
        time_s=time_s[last_of_stamp],
        values=signal.values[keep],
        n_duplicate=int(np.count_nonzero(~last_of_stamp)),
        n_out_of_order=n_out_of_order,
        n_wild=int(np.count_nonzero(wild)),
        n_not_finite=int(np.count_nonzero(~wild & ~finite)),
    )


def _may_be_nan(signal: Signal) -> bool:
    return signal.name in {"motor_thrust", "rotor_speed", "output_pwm"}


def _tolerance_s(signal: Signal, settings: Settings) -> float:
    """Return how far a stamp may stray: out-of-order logging, or some periods of a slow signal."""
    steps = np.abs(np.diff(signal.time_s[np.isfinite(signal.time_s)]))
    typical = float(np.median(steps)) if steps.size else 0.0
    return max(settings.wild_stamp_s, 20.0 * typical)
