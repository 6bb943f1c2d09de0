"""Signals on the log's one clock: sorted, one value per time, counted losses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from quadid_logs.align.clock import EVENTS, JUMP_S, OUTLIER_S, Clock
from quadid_logs.arrays import AnyArray, BoolArray, FloatArray, IntArray
from quadid_logs.data.log import NO_GYRO_FILTER, FlightLog, GyroFilter, Rows, Signal
from quadid_logs.data.torque import AssumedExpo
from quadid_logs.maths.intervals import inside
from quadid_logs.maths.resampling import typical_period

#: In SI units nothing that a multirotor logs comes near this: such a number is damage, and its
#: square would overflow later on.
_IMPOSSIBLE = 1e6
#: No log's clock is finer [s]: what is closer than this has the same time.
_SAME_TIME_S = 1e-9
#: A pause longer than this many periods is a gap.
GAP_PERIODS = 3.0
#: In flight the throttle stays above this much of its median: motors that idle on the ground are not flown.
_FLOWN_THROTTLE = 0.5
_ONE_COLUMN_PER_MOTOR = frozenset({"motor_thrust", "rotor_speed", "output_pwm"})
#: What the model is made of: a handful of absurd samples would outweigh all others in its squares.
_MEASURED = frozenset(
    {"body_rate", "torque_n_m", "torque_command", "thrust_n", "throttle", *_ONE_COLUMN_PER_MOTOR}
)
#: Their rows stand in the file seconds after the samples were taken.
WRITTEN_LATE = frozenset({"gyro_samples"})
#: Times the 99th percentile of a signal's distance from its median.
_ABSURD = 10.0
#: Within two periods of this length no vehicle turns away and back, and no rate loop takes back a torque that
#: it gave; a slower log shows a kick of the controller in one sample [s].
_LONGEST_SPIKE_S = 0.0105
#: Times the 99th percentile of the samples' distance from the mean of their neighbours: thirteen standard
#: deviations of noise.
_SPIKE = 5.0
#: The four samples around a spike differ by less than this fraction of it.
_AROUND_A_SPIKE = 0.25

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CleanSeries:
    """A signal on the common clock, as logged or rebuilt.

    Attributes
    ----------
    name : str
        Canonical name, a key of `vocabulary.SIGNALS`.
    rows : Rows
        Of the message that it was logged in or rebuilt from: the same object for all series of one message.
    time_s : ndarray, shape (n_samples,)
        Strictly increasing [s].
    stored : ndarray, shape (n_samples, n_columns)
        As they were made: whole numbers of few digits in single precision, marks as such.
    period_s : float
        Typical sample period [s], NaN for fewer than two samples.
    source, reason, gyro_filter, achieved, raw, normalised
        As of `Signal`.
    n_duplicate, n_out_of_order, n_outliers, n_not_finite : int
        Rows that were merged, put in order, or dropped.
    """

    name: str
    rows: Rows
    time_s: FloatArray
    stored: AnyArray
    period_s: float
    source: str
    reason: str = ""
    gyro_filter: GyroFilter = NO_GYRO_FILTER
    achieved: bool = False
    raw: bool = False
    normalised: bool = True
    n_duplicate: int = 0
    n_out_of_order: int = 0
    n_outliers: int = 0
    n_not_finite: int = 0

    @property
    def values(self) -> FloatArray:
        """In double precision, to work with; shape (n_samples, n_columns).

        What is stored in single precision is converted each time: ask once, or for a column or some rows.
        """
        return np.asarray(self.stored, dtype=np.float64)

    @property
    def n_columns(self) -> int:
        """Number of columns."""
        return int(self.stored.shape[1])

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return int(self.time_s.shape[0])

    @property
    def rate_hz(self) -> float:
        """Typical sample rate [Hz], 0 for a single sample."""
        return 1.0 / self.period_s if self.period_s > 0.0 else 0.0

    def within(self, start_s: float, end_s: float) -> slice:
        """Return the samples of an interval.

        Parameters
        ----------
        start_s, end_s : float
            Both belong to it [s].
        """
        first, last = np.searchsorted(self.time_s, [start_s, end_s + 1e-9])
        return slice(int(first), int(last))

    def of_rows(self, rows: slice | IntArray | BoolArray) -> FloatArray:
        """Return the values of some rows, in double precision.

        Parameters
        ----------
        rows : slice or ndarray of int or bool

        Returns
        -------
        ndarray, shape (n_rows, n_columns)
        """
        return np.asarray(self.stored[rows], dtype=np.float64)

    def at(self, time_s: FloatArray, column: int = 0) -> FloatArray:
        """Interpolate a column linearly to other times, held beyond the ends.

        Parameters
        ----------
        time_s : ndarray, shape (n,)
            On the common clock [s].
        column : int

        Returns
        -------
        ndarray, shape (n,)
            In the unit of the signal.
        """
        return np.asarray(np.interp(time_s, self.time_s, self.stored[:, column]), dtype=np.float64)

    def last_before(self, time_s: FloatArray) -> IntArray:
        """Return which sample was the last one at given times.

        Parameters
        ----------
        time_s : ndarray, shape (n,)
            On the common clock [s].

        Returns
        -------
        ndarray of int64, shape (n,)
            Index of the last sample at or before each time, -1 ahead of the first one.
        """
        return np.asarray(np.searchsorted(self.time_s, time_s + _SAME_TIME_S, side="right") - 1, np.int64)

    def take(self, samples: slice | IntArray | BoolArray) -> CleanSeries:
        """Return chosen samples; the rate stays that of the whole.

        Parameters
        ----------
        samples : slice or ndarray of int or bool
            In order of time.
        """
        return replace(self, time_s=self.time_s[samples], stored=self.stored[samples])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TorqueSeries:
    """A torque, and what is known beside it.

    Attributes
    ----------
    series : CleanSeries
        ``torque_command`` or ``torque_n_m``; ``achieved`` where the motors' limits are in it.
    saturated : CleanSeries or None
        ``torque_saturation``: where the axes got less than was commanded; None where that is not known.
    rotor_thrust : ndarray, shape (n_samples, n_rotors), or None
        Thrust of each rotor; the unit is that of ``torque_per_thrust``.
    torque_per_thrust : ndarray, shape (3, n_rotors), or None
        L, M, N per unit of each rotor's thrust; None where the rotors are not known.
    thrust_by_expo : ndarray, shape (n_samples, n_rotors), or None
        Derivative of ``rotor_thrust`` by the expo of the thrust curve; None where that is not assumed.
    expo : AssumedExpo or None
        That from which ``rotor_thrust`` was made.
    """

    series: CleanSeries
    saturated: CleanSeries | None = None
    rotor_thrust: FloatArray | None = None
    torque_per_thrust: FloatArray | None = None
    thrust_by_expo: FloatArray | None = None
    expo: AssumedExpo | None = None

    def possible(self) -> TorqueSeries:
        """Drop the samples that no multirotor can have, as cleaning does with what was logged."""
        good = np.ones(self.series.n_samples, dtype=np.bool_)
        for column in self.series.stored.T:
            good &= np.abs(column) < _IMPOSSIBLE
        if good.all():
            return self
        lost = int(np.count_nonzero(~good))
        series = replace(self.series.take(good), n_not_finite=self.series.n_not_finite + lost)
        thrust, by_expo = (
            None if each is None else each[good] for each in (self.rotor_thrust, self.thrust_by_expo)
        )
        return replace(self, series=series, rotor_thrust=thrust, thrust_by_expo=by_expo)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CleanLog:
    """A log whose signals are on one clock, and its flights.

    Attributes
    ----------
    log : FlightLog
    clock : Clock
    candidates : mapping of str to tuple of CleanSeries
        All sources of each signal, the preferred one first.
    flights : tuple of (start_s, end_s)
        From take-off to landing.
    on_ground_reason : str
        Why there is none.
    hops : tuple of (start_s, end_s)
        Flights with take-off and touch-down, where arming or a land detector tells them.
    """

    log: FlightLog
    clock: Clock
    candidates: Mapping[str, tuple[CleanSeries, ...]]
    flights: tuple[Interval, ...] = ()
    on_ground_reason: str = ""
    hops: tuple[Interval, ...] = ()

    def sources(self, name: str) -> tuple[CleanSeries, ...]:
        """Return the sources of a signal that hold any sample, the preferred one first.

        Parameters
        ----------
        name : str
            A key of `vocabulary.SIGNALS`.
        """
        return tuple(one for one in self.candidates.get(name, ()) if one.n_samples)

    def first(self, name: str) -> CleanSeries | None:
        """Return the preferred source of a signal, None where there is none."""
        return next(iter(self.sources(name)), None)

    def at(self, name: str, time_s: FloatArray, *, missing: float) -> FloatArray:
        """Interpolate the first column of a signal's preferred source.

        Parameters
        ----------
        name : str
            A key of `vocabulary.SIGNALS`.
        time_s : ndarray, shape (n,)
            On the common clock [s].
        missing : float
            The value where the log has no such signal.

        Returns
        -------
        ndarray, shape (n,)
        """
        found = self.first(name)
        return np.full(time_s.shape, missing) if found is None else found.at(time_s)

    def flown(self, time_s: FloatArray, throttle: FloatArray) -> BoolArray:
        """Mark the times at which the vehicle was certainly off the ground.

        Parameters
        ----------
        time_s : ndarray, shape (n,)
            On the common clock [s].
        throttle : ndarray, shape (n,)
            Or anything that goes with it, in any unit.

        Returns
        -------
        ndarray of bool, shape (n,)
            In a flight, and at more than half of the throttle that is typical there.
        """
        up = inside(time_s, self.flights) & np.isfinite(throttle)
        if up.any():
            up &= throttle > _FLOWN_THROTTLE * float(np.median(throttle[up]))
        return up


class _Order(NamedTuple):
    """What stamps tell: which rows stay, in which order (None: all, as they are), and how they follow."""

    chosen: BoolArray | IntArray | None
    n_out_of_order: int
    n_duplicate: int
    period_s: float


class _Stamps(NamedTuple):
    """The stamps of a message on the common clock, and which are damaged."""

    time_s: FloatArray
    outlier: BoolArray


class Cleaner:
    """Puts the signals of a log onto its common clock.

    Several signals come from one message: what their stamps tell is found out once.

    Parameters
    ----------
    clock : Clock
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._stamps: dict[tuple[Rows, float], _Stamps] = {}
        self._orders: dict[tuple[Rows, float], _Order] = {}

    def clean(self, signal: Signal) -> CleanSeries:
        """Drop damaged stamps, absurd values and spikes, put rows in order, merge repeated stamps.

        Rows are ordered by time *within* an epoch only; a reboot is never sorted
        away. Of rows with the same stamp the last stands: it is what the
        autopilot knew last at that time.
        """
        # An event may stand alone, minutes from the periodic rows around it in the file.
        apart = signal.name in EVENTS or signal.name in WRITTEN_LATE
        key = signal.rows, JUMP_S if apart else OUTLIER_S
        if key not in self._stamps:
            self._stamps[key] = _Stamps(
                self._clock.common_time(signal.rows.time_s, signal.rows.position),
                self._clock.is_outlier(signal.rows.time_s, signal.rows.position, key[1]),
            )
        stamps = self._stamps[key]
        known = _is_possible(signal.values)
        finite = _says_something(known, signal.name in _ONE_COLUMN_PER_MOTOR)
        if signal.name in _MEASURED and finite.all():
            finite = ~_is_absurd(signal.values)
        elif signal.name in _MEASURED and finite.any():
            finite = finite.copy()
            finite[finite] = ~_is_absurd(signal.values[finite])
        n_not_finite = int(np.count_nonzero(~stamps.outlier & ~finite))
        time_s, values = stamps.time_s, signal.values
        kept = ~stamps.outlier & finite
        if not kept.all():  # in most logs all are, and nothing is copied
            time_s, values, known = time_s[kept], values[kept], known[kept]
        order = _order_of(time_s) if n_not_finite else self._order(key, time_s)
        if order.chosen is not None:
            time_s, values, known = time_s[order.chosen], values[order.chosen], known[order.chosen]
        if signal.name in _MEASURED and order.period_s < _LONGEST_SPIKE_S:
            spike = _is_spike(values)
            if spike.any():
                n_not_finite += int(np.count_nonzero(spike))
                time_s, values, known = time_s[~spike], values[~spike], known[~spike]
        return CleanSeries(
            name=signal.name,
            rows=signal.rows,
            time_s=time_s,
            # `_is_possible` broadcasts where all values are known, which tells that at once.
            stored=values if not any(known.strides) or known.all() else np.where(known, values, np.nan),
            period_s=order.period_s,
            source=signal.source,
            reason=signal.reason,
            gyro_filter=signal.gyro_filter,
            achieved=signal.achieved,
            raw=signal.raw,
            normalised=signal.normalised,
            n_duplicate=order.n_duplicate,
            n_out_of_order=order.n_out_of_order,
            n_outliers=int(np.count_nonzero(stamps.outlier)),
            n_not_finite=n_not_finite,
        )

    def _order(self, key: tuple[Rows, float], time_s: FloatArray) -> _Order:
        """Return the order of a message's rows whose stamps are believed."""
        if key not in self._orders:
            self._orders[key] = _order_of(time_s)
        return self._orders[key]


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


def _is_absurd(values: FloatArray) -> BoolArray:
    """Mark rows far outside what a signal does and far from what it does just before and after.

    One sample in a hundred of a flight lies beyond the 99th percentile; ten times that, for less than half a
    window of seven samples, is a decoder or a sensor that failed and no motion of a mass.
    """
    away = np.abs(values - np.median(values, axis=0))
    limit = _ABSURD * np.quantile(away, 0.99, axis=0)
    absurd = np.zeros(len(values), dtype=np.bool_)
    rows, columns = np.nonzero((away > limit) & (limit > 0.0))
    near = np.clip(rows[:, np.newaxis] + np.arange(-3, 4), 0, len(values) - 1)
    far = np.abs(values[rows, columns] - np.median(values[near, columns[:, np.newaxis]], axis=1))
    absurd[rows[far > limit[columns]]] = True
    return absurd


def _is_spike(values: FloatArray) -> BoolArray:
    """Mark single samples that jump away from four around them that agree with each other.

    A gyro that failed for one sample, or a bit that was read wrong: less than absurd, and yet a few of them
    outweigh the motion that a model is made of.
    """
    spike = np.zeros(len(values), dtype=np.bool_)
    if len(values) < 5:
        return spike
    for stored in values.T:
        column = np.asarray(stored, dtype=np.float64)
        away = np.abs(column[2:-2] - 0.5 * (column[1:-3] + column[3:-1]))
        limit = _SPIKE * np.quantile(away, 0.99)
        if not limit > 0.0:  # a motor that is not there, or never changes
            continue
        rows = np.flatnonzero(away > limit)
        around = np.ptp(column[rows[:, np.newaxis] + [0, 1, 3, 4]], axis=1)
        spike[rows[around < _AROUND_A_SPIKE * away[rows]] + 2] = True
    return spike


def _is_possible(values: FloatArray) -> BoolArray:
    """Mark the numbers that a multirotor can log; without memory where all are."""
    if values.size and values.min() > -_IMPOSSIBLE and values.max() < _IMPOSSIBLE:
        return np.broadcast_to(np.True_, values.shape)
    return np.asarray(np.abs(values) < _IMPOSSIBLE, dtype=np.bool_)  # false for NaN


def _says_something(known: BoolArray, one_is_enough: bool) -> BoolArray:
    """Mark the rows with known values; a motor that does not turn is logged as NaN, beside others."""
    if not any(known.strides):
        return np.broadcast_to(np.True_, known.shape[:1])
    return np.asarray(known.any(axis=1) if one_is_enough else known.all(axis=1), dtype=np.bool_)
