"""From a logged signal to a clean series: sorted, one value per time, counted losses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from quadid_logs.align.clock import EVENTS, Clock
from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.log import Signal
from quadid_logs.data.settings import AlignSettings
from quadid_logs.maths.resampling import typical_period

#: In SI units nothing that a multirotor logs comes near this: such a number is damage, and its
#: square would overflow later on.
_IMPOSSIBLE = 1e6
#: No log's clock is finer [s]: what is closer than this has the same time.
_SAME_TIME_S = 1e-9
#: Address, number of elements, strides.
_Place = tuple[int, int, tuple[int, ...]]
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
    n_outliers: int
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


class _Order(NamedTuple):
    """What stamps tell: which rows stay, in which order (None: all, as they are), and how they follow."""

    chosen: BoolArray | IntArray | None
    n_out_of_order: int
    n_duplicate: int
    period_s: float


class Cleaner:
    """Puts the signals of a log onto its common clock.

    Several signals come from one message: what their stamps tell is found out once.

    Parameters
    ----------
    clock : Clock
    settings : AlignSettings
        The thresholds on stamps.
    """

    def __init__(self, clock: Clock, settings: AlignSettings) -> None:
        self._clock = clock
        self._settings = settings
        # The signals kept beside hold the memory that the keys name.
        self._wild: dict[tuple[_Place, _Place, float], tuple[Signal, BoolArray]] = {}
        self._orders: dict[_Place, tuple[Signal, _Order]] = {}

    def clean(self, signal: Signal) -> CleanSeries:
        """Drop wild stamps and impossible values, put rows in order, merge repeated stamps.

        Rows are ordered by time *within* an epoch only; a reboot is never sorted
        away. Of rows with the same stamp the last stands: it is what the
        autopilot knew last at that time.
        """
        wild = self._wild_stamps(signal)
        known = _is_possible(signal.values)
        finite = _says_something(known, signal.name in _ONE_COLUMN_PER_MOTOR)
        rows = _Rows(self._clock.common_time(signal.time_s, signal.position), signal.values, known)
        rows = rows.where(~wild & finite)
        order = self._order(rows.time_s, signal)
        if order.chosen is not None:
            rows = rows.at(order.chosen)
        return CleanSeries(
            signal=signal,
            time_s=rows.time_s,
            values=rows.values if _all(rows.known) else np.where(rows.known, rows.values, np.nan),
            period_s=order.period_s,
            n_duplicate=order.n_duplicate,
            n_out_of_order=order.n_out_of_order,
            n_outliers=int(np.count_nonzero(wild)),
            n_not_finite=int(np.count_nonzero(~wild & ~finite)),
        )

    def _wild_stamps(self, signal: Signal) -> BoolArray:
        """Mark the stamps that are far from what the clock showed."""
        # An event may stand alone, minutes from the periodic rows around it in the file.
        is_event = signal.name in EVENTS
        tolerance_s = self._settings.clock_jump_s if is_event else self._settings.outlier_stamp_s
        key = (_place(signal.time_s), _place(signal.position), tolerance_s)
        if key not in self._wild:
            wild = self._clock.is_outlier(signal.time_s, signal.position, tolerance_s)
            self._wild[key] = signal, wild
        return self._wild[key][1]

    def _order(self, time_s: FloatArray, signal: Signal) -> _Order:
        """Return the order of the rows of a signal that have stayed; kept where all have."""
        if time_s is not signal.time_s:
            return _order_of(time_s)
        place = _place(time_s)
        if place not in self._orders:
            self._orders[place] = signal, _order_of(time_s)
        return self._orders[place][1]


def _place(series: FloatArray | IntArray) -> _Place:
    """Return where a series lies in memory: every signal has views of its own of its message's stamps."""
    return series.__array_interface__["data"][0], series.size, series.strides


def _order_of(time_s: FloatArray) -> _Order:
    """Sort stamps where they are not in order, and choose the last of those that are the same."""
    chosen: BoolArray | IntArray | None = None
    steps = np.diff(time_s)
    n_out_of_order = int(np.count_nonzero(steps < 0.0))
    if n_out_of_order:
        chosen = np.argsort(time_s, kind="stable")
        time_s = time_s[chosen]
        steps = np.diff(time_s)
    n_duplicate = int(np.count_nonzero(~(steps > _SAME_TIME_S)))
    if n_duplicate:
        last_of_stamp = np.append(steps > _SAME_TIME_S, True)
        time_s = time_s[last_of_stamp]
        chosen = last_of_stamp if chosen is None else chosen[last_of_stamp]
    return _Order(chosen, n_out_of_order, n_duplicate, typical_period(time_s))


def _is_possible(values: FloatArray) -> BoolArray:
    """Mark the numbers that a multirotor can log; without memory where all are."""
    if values.size and values.min() > -_IMPOSSIBLE and values.max() < _IMPOSSIBLE:
        return np.broadcast_to(np.True_, values.shape)
    return np.asarray(np.abs(values) < _IMPOSSIBLE, dtype=np.bool_)  # false for NaN


def _all(known: BoolArray) -> bool:
    """Tell whether all values are known, at once where `_is_possible` has found that."""
    return not any(known.strides) or bool(known.all())


def _says_something(known: BoolArray, one_is_enough: bool) -> BoolArray:
    """Mark the rows with known values; a motor that does not turn is logged as NaN, beside others."""
    if not any(known.strides):
        return np.broadcast_to(np.True_, known.shape[:1])
    return np.asarray(known.any(axis=1) if one_is_enough else known.all(axis=1), dtype=np.bool_)
