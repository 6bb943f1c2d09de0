"""Torque from the motor outputs, in units of the PID sums; source: ``mixer.c``.

The outputs make thrust by the curve of the propellers. A unit of torque is what a unit of the PID sums
makes of it, by least squares over the flight: mixer, ``thrust_linear``, airmode, sag compensation and idle
are in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.actuation.motors import MotorSeries, Rebuilt, any_motor
from quadid_logs.align.series import CleanLog, CleanSeries
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.autopilots.betaflight.rotors import (
    MEASURED_HALF_WIDTH,
    Rotors,
    behind_lag,
    find_rotors,
    full_output,
    lagged,
)
from quadid_logs.data.log import whole_number
from quadid_logs.data.torque import AssumedExpo, HeldScale
from quadid_logs.maths.thrust_curve import relative_by_expo

#: Outputs and PID terms are whole numbers: their rounding is a few thousandths of the range.
_LIMITED: Final = 0.02
#: ``config/feature.h``: FEATURE_AIRMODE.
_AIRMODE: Final = 1 << 22
#: Points of the inverse of a smooth curve: interpolated to 1e-6.
_CURVE_POINTS: Final = 1001
#: Rows that tell a slope of PID sums.
_FEWEST_ROWS: Final = 500
#: Thrust by curves of these changes of the expo tells how the slope goes with it.
_EXPO_STEP: Final = 0.05
#: A unit of the PID sums is half of full thrust to all of it; ten times less or more is no mixer.
_SLOPES: Final = (0.05, 10.0)


class _Scale(NamedTuple):
    """Units of the PID sums per unit of thrust on each axis, and the slopes' relative change by the expo."""

    per_thrust: FloatArray
    by_expo: tuple[float, float, float]


def rebuild(log: CleanLog, airframe: Airframe) -> Rebuilt:
    """Take the outputs through the propellers' thrust curve.

    Parameters
    ----------
    log : CleanLog
    airframe : Airframe

    Returns
    -------
    Rebuilt
    """
    motors, command = log.first("motor_thrust"), log.first("torque_command")
    throttle = log.first("throttle")
    if motors is None or command is None or throttle is None:
        return Rebuilt()
    if motors.values.shape[1] != airframe.n_rotors:
        return Rebuilt(remarks=(f"The log has {motors.values.shape[1]} motors, not {airframe.n_rotors}.",))
    commanded = np.column_stack([command.at(motors.time_s, axis) for axis in range(3)])
    output = full_output(motors.values, log.log.parameters)
    flown = log.flown(motors.time_s, motors.values.mean(axis=1))
    rotors = find_rotors(log, motors, output, flown)
    free = flown & ((motors.values > 0.0) & (motors.values < 1.0)).all(axis=1)
    scale = _scale(rotors, output, commanded, free, airframe, motors.period_s)
    if scale is None:
        return Rebuilt(remarks=("The outputs do not follow the PID sums, so the torque is as commanded.",))
    thrust = rotors.thrust(output)
    per_thrust = airframe.command_per_thrust * scale.per_thrust[:, np.newaxis]
    series = MotorSeries(
        base=motors,
        thrust=thrust,
        command_thrust=thrust,
        actuator=output,
        command=thrust @ per_thrust.T,
        saturated=_saturated(motors, commanded, throttle.at(motors.time_s), airframe, log.log.parameters),
        flown=flown,
        source=f"{motors.source} through the thrust curve",
        reason="what the motors were sent, in units of the PID sums: saturation is in it",
        achieved=True,
        by_expo=relative_by_expo(output * rotors.supply, rotors.expo),
        per_thrust=per_thrust,
    )
    expo = AssumedExpo(
        value=rotors.expo,
        parameter="",
        held=HeldScale.COMMAND,
        half_width=MEASURED_HALF_WIDTH if rotors.measured else 0.0,
        slope_by_expo=scale.by_expo,
        rotor_lag_s=rotors.lag_range_s(motors.period_s),
    )
    return Rebuilt(series=(series,), expo=expo, told_by_speed=rotors.measured)


def _scale(
    rotors: Rotors,
    output: FloatArray,
    commanded: FloatArray,
    free: BoolArray,
    airframe: Airframe,
    period_s: float,
) -> _Scale | None:
    """Compare thrust with PID sums (n_samples, 3) behind the same lag, where no motor is at a stop.

    None where a slope is that of no mixer, or the rows are too few.
    """
    if np.count_nonzero(free) < _FEWEST_ROWS:
        return None
    sums = lagged(commanded, period_s, rotors.lag_s)[free]
    regressors = np.column_stack([sums, np.ones(len(sums))])

    def slopes(expo: float) -> FloatArray:
        thrust = behind_lag(rotors.thrust(output, expo), period_s, rotors.lag_s)[free]
        made = np.linalg.lstsq(regressors, thrust @ airframe.command_per_thrust.T, rcond=None)[0]
        return np.clip(np.diag(made[:3]), 1e-9, None)

    found = slopes(rotors.expo)
    if not ((found > _SLOPES[0]) & (found < _SLOPES[1])).all():
        return None
    lower, upper = (np.log(slopes(rotors.expo + sign * _EXPO_STEP)) for sign in (-1.0, 1.0))
    roll, pitch, yaw = (float(change) for change in (upper - lower) / (2.0 * _EXPO_STEP))
    return _Scale(1.0 / found, (roll, pitch, yaw))


def _saturated(
    motors: CleanSeries,
    commanded: FloatArray,
    throttle: FloatArray,
    airframe: Airframe,
    settings: Mapping[str, float],
) -> BoolArray:
    """Mark axes that got less than was commanded, because a motor was at a stop; shape (n_samples, 3)."""
    linear = before_linearisation(motors.values, settings.get("thrust_linear", 0.0) / 100.0)
    made = linear @ airframe.command_per_thrust.T / mix_factor(throttle, settings)[:, np.newaxis]
    at_stop = any_motor((motors.values <= 0.0) | (motors.values >= 1.0))
    return np.asarray(at_stop[:, np.newaxis] & (np.abs(made - commanded) > _LIMITED))


def mix_factor(throttle: FloatArray, settings: Mapping[str, float]) -> FloatArray:
    """Return what the mixer multiplies the PID sums with, for each throttle.

    Parameters
    ----------
    throttle : ndarray, shape (n,)
    settings : mapping of str to float

    Returns
    -------
    ndarray, shape (n,)
        1 with airmode; without, 0.5 to 1.
    """
    if whole_number(settings.get("features"), _AIRMODE) & _AIRMODE:
        return np.ones_like(throttle)
    return np.clip(0.5 + throttle, 0.5, 1.0)


def before_linearisation(output: FloatArray, amount: float) -> FloatArray:
    """Return the outputs as they were before ``thrust_linear``, which raises low ones.

    Parameters
    ----------
    output : ndarray
        From 0 to 1.
    amount : float
        ``thrust_linear`` as a fraction.

    Returns
    -------
    ndarray
        The x of output = x (1 + e (1 - x) (1 + e (1 - 2 x))), `pidApplyThrustLinearization`.
    """
    if not 0.0 < amount <= 1.0:
        return output
    x = np.linspace(0.0, 1.0, _CURVE_POINTS)
    linear = 1.0 - x
    curve = x * (1.0 + amount * linear * (1.0 + amount * (linear - x)))
    return np.asarray(np.interp(output, np.maximum.accumulate(curve), x), dtype=np.float64)
