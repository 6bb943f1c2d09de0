"""From motor outputs to thrust: the propellers' curve, the rotors' lag, and the battery.

No header tells the thrust curve. Where the speeds of the rotors are logged they tell it, since thrust goes
with their square; elsewhere it is that of a common propeller, which the fit corrects as far as the flight
shows it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.align.series import CleanLog, CleanSeries
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.maths.moving_mean import moving_mean
from quadid_logs.maths.recurrence import lag

#: Middle of what thrust stands show (0.2 to 0.8, see docs/method.md).
COMMON_EXPO: Final = 0.5
#: By measured speeds the expo comes out within 0.01 of the truth in simulation; what thrust is beside the
#: square of speed, and an output beside a voltage, is known to a few hundredths (95 %).
MEASURED_HALF_WIDTH: Final = 0.05
#: Middle of published lags of rotors of this size [s].
COMMON_LAG_S: Final = 0.03
#: ``drivers/motor_types.h``: protocols of these numbers are digital.
_DIGITAL: Final = (5.0, 8.0)
#: Outputs of no and full throttle: below the first of 2000 digital steps (``drivers/dshot.h``), pulses [us].
_STEPS, _PULSES = (47.0, 2047.0), (1000.0, 2000.0)
#: Battery and air change over longer times, manoeuvres over shorter ones [s].
_DRIFT_S: Final = 2.0
#: Measured speeds that a curve and a lag explain less of belong to a battery at its end, or to other motors.
_EXPLAINED: Final = 0.8
#: Gauss-Newton's steps of expo and lag [s]; it needs four from anywhere in the range.
_STEPS_OF, _ROUNDS = (1e-3, 1e-4), 8
_RANGE: Final = ((-0.25, 0.001), (1.25, 0.25))
_FEWEST_ROWS: Final = 500
#: Beyond, a voltage is that of no battery in flight, or a speed that of a stopped motor.
_BELIEVED: Final = (0.5, 2.0)
#: Telemetry comes two loops of the PID controller late, 1 ms at 2 kHz [s].
_OLD_S: Final = 0.002


class Rotors(NamedTuple):
    """How outputs make thrust.

    Attributes
    ----------
    expo, lag_s : float
        Of the thrust curve, and of the speed behind the output [s].
    supply : ndarray, shape (n_samples, 1)
        Voltage over its mean in flight, which output counts with; 1 where it is not known.
    drift : ndarray, shape (n_samples, n_rotors) or (1, 1)
        Thrust over that of the curve, by measured speeds; 1 without.
    measured : bool
        By measured speeds.
    """

    expo: float
    lag_s: float
    supply: FloatArray
    drift: FloatArray
    measured: bool

    def lag_range_s(self, period_s: float) -> tuple[float, float]:
        """Return where the lag lies by measured speeds, up to 2 ms old, and outputs held for a period."""
        if not self.measured:
            return 0.0, math.inf
        return max(self.lag_s - _OLD_S - period_s, 0.0), self.lag_s + period_s

    def thrust(self, output: FloatArray, expo: float | None = None) -> FloatArray:
        """Return thrust as a fraction of that at full output, by this or another expo; shape of `output`."""
        e = self.expo if expo is None else expo
        supply, drift = (np.broadcast_to(each, output.shape) for each in (self.supply, self.drift))
        found = np.empty(output.shape)
        # Rotor by rotor: what is needed on the way is as long as the log.
        for result, *of_rotor in zip(found.T, output.T, supply.T, drift.T, strict=True):
            y = np.clip(of_rotor[0] * of_rotor[1], 0.0, None)
            result[:] = np.clip((1.0 - e) * y + e * y**2, 0.0, None) * of_rotor[2]
        return found


def full_output(fraction: FloatArray, settings: Mapping[str, float]) -> FloatArray:
    """Return outputs as a fraction of full throttle, idle included.

    Parameters
    ----------
    fraction : ndarray
        From idle, 0, to the highest output, 1.

    Returns
    -------
    ndarray
        Shape of `fraction`.
    """
    digital = _DIGITAL[0] <= settings.get("motor_pwm_protocol", _DIGITAL[0]) <= _DIGITAL[1]
    # Digital ones that begin at a pulse's length are logged in microseconds.
    digital = digital and settings.get("motorOutput[0]", _STEPS[0]) < _PULSES[0]
    zero, full = _STEPS if digital else _PULSES
    low, high = settings.get("motorOutput[0]", zero), settings.get("motorOutput[1]", full)
    return np.asarray(np.clip((low - zero + fraction * (high - low)) / (full - zero), 0.0, 1.0))


def find_rotors(log: CleanLog, motors: CleanSeries, output: FloatArray, flown: BoolArray) -> Rotors:
    """Find curve, lag and drift by measured speeds, or the drift by the battery's voltage.

    Parameters
    ----------
    output : ndarray, shape (n_samples, n_rotors)
        As a fraction of full throttle.
    flown : ndarray of bool, shape (n_samples,)
    """
    one = np.ones((1, 1))
    common = Rotors(COMMON_EXPO, COMMON_LAG_S, _supply(log, motors, flown), one, measured=False)
    logged = log.first("rotor_speed")
    if logged is None or logged.n_columns != output.shape[1]:
        return common
    speed = np.column_stack([logged.at(motors.time_s, number) for number in range(logged.n_columns)])
    if not np.isfinite(speed).all() or np.count_nonzero(flown) < _FEWEST_ROWS:
        return common
    width = max(round(_DRIFT_S / motors.period_s), 1)
    expo, lag_s, explained = _fitted(speed, output, flown, motors.period_s, width)
    if not explained >= _EXPLAINED:
        return common
    found = Rotors(expo, lag_s, one, one, measured=True)
    answered = behind_lag(found.thrust(output), motors.period_s, lag_s)
    # Measured over expected squares of the speeds, both means over some seconds, of mean 1.
    measured, expected = (moving_mean(each, width, beyond="edge") for each in (speed**2, answered))
    ratio = measured / np.maximum(expected, 1e-9)
    ratio /= ratio[flown].mean()
    return found._replace(drift=np.asarray(np.clip(ratio, *_BELIEVED, out=ratio)))


def behind_lag(thrust: FloatArray, period_s: float, lag_s: float) -> FloatArray:
    """Return the thrust of rotors whose speeds, its roots, follow with a lag; (n_samples, n_rotors).

    Parameters
    ----------
    thrust : ndarray, shape (n_samples, n_rotors)
        That the outputs ask for.

    Returns
    -------
    ndarray, shape (n_samples, n_rotors)
    """
    found = np.empty(thrust.shape)
    for result, column in zip(found.T, thrust.T, strict=True):
        result[:] = lag(np.sqrt(column), period_s, lag_s) ** 2
    return found


def _supply(log: CleanLog, motors: CleanSeries, flown: BoolArray) -> FloatArray:
    """Return the voltage over its mean in flight on the motors' rows, 1 where no battery is logged."""
    battery = log.first("battery_voltage")
    if battery is None or not flown.any():
        return np.ones((1, 1))
    voltage = battery.at(motors.time_s)
    mean = float(np.mean(voltage[flown]))
    relative = voltage / mean if mean > 0.0 else np.zeros_like(voltage)
    believed = (relative[flown] > _BELIEVED[0]) & (relative[flown] < _BELIEVED[1])
    if not believed.all():
        return np.ones((1, 1))
    return np.asarray(np.clip(relative, *_BELIEVED)[:, np.newaxis])


def _fitted(
    speed: FloatArray, output: FloatArray, flown: BoolArray, period_s: float, width: int
) -> tuple[float, float, float]:
    """Return expo, lag [s], and which fraction of the speeds' variance they explain (Gauss-Newton).

    Both sides are relative to their mean over some seconds: battery and air are in neither.
    """
    target = np.column_stack([_relative(column, width)[flown] for column in speed.T])

    def left(x: FloatArray) -> FloatArray:
        found = target.copy()
        for result, column in zip(found.T, output.T, strict=True):
            curve = np.clip((1.0 - x[0]) * column + x[0] * column**2, 0.0, None)
            result -= _relative(lag(np.sqrt(curve), period_s, x[1]), width)[flown]
        return found.ravel()

    x = np.array([COMMON_EXPO, COMMON_LAG_S])
    for _ in range(_ROUNDS):
        now = left(x)
        slopes = np.empty((now.size, x.size))
        for number, step in enumerate(_STEPS_OF):
            slopes[:, number] = (left(x + step * np.eye(2)[number]) - now) / step
        change = np.linalg.lstsq(slopes, -now, rcond=None)[0]
        x, last = np.clip(x + change, *_RANGE), x
        del now, slopes
        if (np.abs(x - last) < _STEPS_OF).all():
            break
    whole = float(np.sum((target - target.mean(axis=0)) ** 2))
    return float(x[0]), float(x[1]), 1.0 - float(np.sum(left(x) ** 2)) / max(whole, 1e-300)


def _relative(columns: FloatArray, width: int) -> FloatArray:
    """Return columns over their running mean."""
    return np.asarray(columns / np.maximum(moving_mean(columns, width, beyond="edge"), 1e-9))
