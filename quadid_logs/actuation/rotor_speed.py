"""Thrust from measured rotor speeds: battery, thrust curve, motor lag and saturation are in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.actuation.motors import MotorSeries
from quadid_logs.align.series import CleanLog, CleanSeries
from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.maths.recurrence import lag
from quadid_logs.maths.thrust_curve import mean_while_moved, slope_at
from quadid_logs.numerals import number

#: Speeds that a rotor in flight cannot fall below or exceed [rad/s]; 100 and 100 000 rpm.
_SPEEDS: Final = (10.0, 10_500.0)
#: Speeds of a multirotor in flight vary; what does not is no measurement.
_LEAST_SPREAD: Final = 1e-3
#: A measurement has lag, noise and rounding; what follows the command closer than this is computed from it.
_COMPUTED: Final = 0.9995
#: Below this the speeds belong to other rotors, or their clock is off.
_UNLIKE: Final = 0.5
#: What of a slow command fell between its rows is missing in a slope on it: 1 - 0.99^2, 2 % of it here.
_TOLD: Final = 0.99
#: Telemetry is this much older than its stamp, or less, the rotor's dead time included [s].
_AGES_S: Final = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08)
#: Steps of age and of lag about the best of these [s].
_FINER_S: Final = (-0.0075, -0.005, -0.0025, 0.0, 0.0025, 0.005, 0.0075)
#: Lags of rotor speeds on commands, as published [s].
_LAGS_S: Final = (0.0, 0.005, 0.01, 0.015, 0.02, 0.03, 0.04, 0.055, 0.075, 0.1)
_FEW_ROWS: Final = 20
#: Ages and lags differ by what this many rows tell well enough.
_ENOUGH_ROWS: Final = 4000
#: A little slower than the commands is as good, and no rate loop needs more than this [Hz]; below the
#: last, the torque between two samples is a guess.
_MOST_LOST, _FAST_HZ, _LEAST_HZ = 0.8, 400.0, 40.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RotorSpeed:
    """What the ESCs' speeds are, in words, and the thrust series if they are measurements.

    ``fast``: as dense as the commands, so that they are the better input.
    """

    verdict: str = ""
    series: MotorSeries | None = None
    fast: bool = False


class _Match(NamedTuple):
    """By how much telemetry is late, with which lag it follows the commands [s], and how well."""

    age_s: float
    lag_s: float
    likeness: float


def from_rotor_speed(log: CleanLog, airframe: Airframe, reference: MotorSeries | None) -> RotorSpeed:
    """Judge the rotor speeds and turn them into thrust, which goes with their square.

    Parameters
    ----------
    log : CleanLog
    airframe : Airframe
    reference : MotorSeries or None
        Thrust from commands: fixes the scale, and tells measured from computed speeds.

    Returns
    -------
    RotorSpeed
        Its stamps are those of the commands that the speeds answer: a rotor's dead time is found again
        as a delay of the torque, the age of telemetry is not.
    """
    signal = log.first("rotor_speed")
    if signal is None:
        return RotorSpeed()
    columns = [channel - 1 for channel in airframe.channels] or list(range(airframe.n_rotors))
    if reference is None or max(columns) >= signal.n_columns:
        return RotorSpeed(
            verdict=(
                f"{signal.source}: not used, {signal.n_columns} speeds do not match the number of motors"
            )
        )
    speed = signal.values[:, columns]
    believable = np.asarray(((speed > _SPEEDS[0]) & (speed < _SPEEDS[1])).all(axis=1), dtype=np.bool_)
    up = np.asarray(log.flown(signal.time_s, np.nan_to_num(speed).mean(axis=1)) & believable, np.bool_)
    if np.count_nonzero(up) < _FEW_ROWS or np.ptp(speed[up]) < _LEAST_SPREAD * speed[up].mean():
        return RotorSpeed(verdict=f"{signal.source}: not used, zero or constant in flight")
    some = np.flatnonzero(up)
    # Choose as many rows as tell an age and a lag.
    some = some[slice(None, None, max(1, len(some) // _ENOUGH_ROWS))]
    match = _match(speed[some], _commanded_speed, signal.time_s[some], reference)
    if _is_computed(speed[some], signal.time_s[some], reference, match.likeness):
        return RotorSpeed(verdict=f"{signal.source}: not used, computed from the command instead of measured")
    if match.likeness < _UNLIKE:
        return RotorSpeed(
            verdict=f"{signal.source}: not used, it does not follow the commanded thrust "
            f"(correlation {match.likeness:.2f})"
        )
    if match.likeness < _TOLD and reference.base.rate_hz < _LEAST_HZ:
        return RotorSpeed(
            verdict=(
                f"{signal.source}: not used, commands at {number(reference.base.rate_hz, 3)} Hz are too "
                f"slow to show their scale (correlation {match.likeness:.2f})"
            )
        )
    rates_hz = (reference.base.rate_hz, *(each.rate_hz for each in log.sources("torque_command")))
    needed_hz = max(_MOST_LOST * min(max(rates_hz), _FAST_HZ), _LEAST_HZ)
    fast = signal.rate_hz >= needed_hz
    flown, needed = (number(each, 3) for each in (signal.rate_hz, needed_hz))
    use = "" if fast else f"; logged at {flown} Hz, too slowly for the model's input, which needs {needed} Hz"
    return RotorSpeed(
        verdict=f"{signal.source}: follows the commanded thrust (correlation {match.likeness:.3f}){use}",
        series=_of_speed(signal, speed, up, airframe, _Commanded.of(reference, match)),
        fast=fast,
    )


class _Commanded(NamedTuple):
    """The series that was commanded, its thrust behind the rotors' lag, and the age of telemetry [s]."""

    series: MotorSeries
    thrust: FloatArray
    age_s: float

    @classmethod
    def of(cls, series: MotorSeries, match: _Match) -> _Commanded:
        """Let the speeds that are commanded lag as they were found to."""
        thrust = np.empty(series.thrust.shape)
        for result, column in zip(thrust.T, series.thrust.T, strict=True):
            result[:] = _lagged(_commanded_speed(column), series.base.period_s, match.lag_s) ** 2
        return cls(series, thrust, match.age_s)


def _commanded_speed(thrust: FloatArray) -> FloatArray:
    """Return the speeds that go with thrust."""
    return np.asarray(np.sqrt(np.clip(np.nan_to_num(thrust), 0.0, None)))


def _of_speed(
    signal: CleanSeries, speed: FloatArray, flown: BoolArray, airframe: Airframe, commanded: _Commanded
) -> MotorSeries:
    """Return the series of the squares of speeds (n_samples, n_rotors), on the scale of the commands."""
    reference, thrust = commanded.series, speed**2
    expected = commanded.thrust[_row(signal.time_s[flown] - commanded.age_s, reference)]
    thrust *= float(expected.mean() / thrust[flown].mean())
    per_thrust = airframe.command_per_thrust
    # By how much the reference's thrust was raised against battery and air.
    # How much larger `other` is than `one`, by least squares; 1 where `one` is zero.
    one = reference.command[reference.flown]
    other = reference.thrust[reference.flown] @ per_thrust.T
    known = np.isfinite(one) & np.isfinite(other)
    size = float(one[known] @ one[known])
    gain = float(one[known] @ other[known]) / size if size > 0.0 else 1.0
    # A unit of command is a change of thrust, which need not be in proportion to thrust.
    moved = reference.thrust[reference.flown].mean(axis=1), reference.command[reference.flown]
    where = mean_while_moved(*moved, reference.base.period_s)
    slope = slope_at(expected.ravel(), thrust[flown].ravel(), where)
    gain *= slope if slope > 0.0 else 1.0
    del expected
    actuator = np.clip(thrust, 0.0, 1.0)
    return MotorSeries(
        base=replace(signal, time_s=signal.time_s - commanded.age_s),
        thrust=thrust,
        command_thrust=thrust / gain,
        actuator=np.sqrt(actuator, out=actuator),
        command=thrust @ per_thrust.T / gain,
        saturated=None,
        flown=flown,
        source=f"{signal.source} squared",
        reason="measured rotor speeds, which include lag, battery, thrust curve and saturation",
        achieved=True,
    )


def _match(
    measured: FloatArray,
    target: Callable[[FloatArray], FloatArray],
    time_s: FloatArray,
    reference: MotorSeries,
) -> _Match:
    """Find the age of telemetry and the lag with which targets, made of the reference's thrust, fit best."""
    best, told = _Match(0.0, 0.0, -1.0), _Deviations.of(measured)
    targets = [target(column) for column in reference.thrust.T]
    for lags_s, ages_s in ((_LAGS_S, _AGES_S), ((0.0,), _FINER_S), (_FINER_S, _FINER_S)):
        tried_s = sorted({max(best.lag_s + lag_s, 0.0) for lag_s in lags_s})
        around_s = sorted({max(best.age_s + age_s, 0.0) for age_s in ages_s})
        rows = np.stack([_row(time_s - age_s, reference) for age_s in around_s])
        for lag_s in tried_s:
            # One rotor after the other: each is as long as the log, and few of its rows are looked at.
            lagged = np.stack(
                [_lagged(column, reference.base.period_s, lag_s)[rows] for column in targets],
                axis=-1,
            )
            found = (
                _Match(age_s, lag_s, told.correlation(of_age))
                for age_s, of_age in zip(around_s, lagged, strict=True)
            )
            best = max((best, *found), key=lambda one: one.likeness)
    return best


def _lagged(target: FloatArray, period_s: float, lag_s: float) -> FloatArray:
    """Return speeds that approach held targets exponentially; shape of `target`."""
    return lag(target, period_s, lag_s) if lag_s else target


def _row(time_s: FloatArray, reference: MotorSeries) -> IntArray:
    """Return the rows of the reference at some times."""
    return np.maximum(reference.base.last_before(time_s), 0)


def _is_computed(speed: FloatArray, time_s: FloatArray, reference: MotorSeries, likeness: float) -> bool:
    """Say whether speeds follow command or thrust as no rotor does: at once, or as a thrust that lags.

    A rotor's speed lags; the root of a thrust that lags by itself is some simulator's.
    """
    rows = [_row(time_s - age_s, reference) for age_s in (*_AGES_S, *_FINER_S[-3:])]
    told, of_squares = _Deviations.of(speed), _Deviations.of(speed**2)
    at_once = any(
        told.correlation(reference.actuator[row]) > _COMPUTED
        or of_squares.correlation(reference.thrust[row]) > _COMPUTED
        for row in rows
    )
    lagging = _match(speed**2, np.nan_to_num, time_s, reference).likeness
    return at_once or lagging > max(_COMPUTED, likeness)


class _Deviations(NamedTuple):
    """Values (n_rows, n_rotors) that are compared with many others, and how far each is from its mean."""

    values: FloatArray
    finite: BoolArray
    known: FloatArray
    """Deviations of the values that are finite, one after the other, from the mean of their rotor."""
    squares: float

    @classmethod
    def of(cls, values: FloatArray, among: BoolArray | None = None) -> _Deviations:
        """Look at all values that are finite, or at some of them."""
        finite = np.isfinite(values) if among is None else among
        known = _from_mean(values, finite)
        # Sums, not products of vectors: BLAS would start threads for each of many short ones.
        return cls(values, finite, known, float(np.sum(known * known)))

    def correlation(self, other: FloatArray) -> float:
        """Return the correlation with an array of the same shape, 0 where one does not vary."""
        both = self.finite & np.isfinite(other)
        if not np.array_equal(both, self.finite):
            return _Deviations.of(self.values, both).correlation(np.where(both, other, np.nan))
        deviations = _from_mean(other, both)
        size = float(np.sqrt(self.squares * np.sum(deviations * deviations)))
        return float(np.sum(self.known * deviations)) / size if size > 0.0 else 0.0


def _from_mean(values: FloatArray, among: BoolArray) -> FloatArray:
    """Return how far some values are from the mean of these in their column, one after the other."""
    if among.all():
        return np.asarray((values - values.sum(axis=0) / max(len(values), 1)).ravel())
    mean = np.where(among, values, 0.0).sum(axis=0) / np.maximum(among.sum(axis=0), 1)
    return np.asarray((values - mean)[among])
