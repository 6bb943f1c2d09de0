"""Torque from the motor outputs, in units of the PID sums; source: ``mixer.c``.

The outputs make thrust by the curve of the propellers. A unit of torque is what a unit of the PID sums
makes of it, by least squares over the flight: mixer, ``thrust_linear``, airmode, sag compensation and idle
are in it. The logged terms are whole thousandths, which is much of a small sum; outputs are finer, and the
mixer is known. So the sums are those that the mixer makes the outputs of, as far as the terms allow.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.actuation.motors import MotorSeries, Rebuilt, any_motor
from quadid_logs.align.series import CleanLog
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.autopilots.betaflight.mixer import highest_output, unmixed
from quadid_logs.autopilots.betaflight.rotors import (
    MEASURED_HALF_WIDTH,
    Rotors,
    behind_lag,
    find_rotors,
    full_output,
)
from quadid_logs.data.torque import AssumedExpo, HeldScale
from quadid_logs.maths.recurrence import lag
from quadid_logs.maths.thrust_curve import relative_by_expo

#: Outputs and PID terms are whole numbers: their rounding is a few thousandths of the range.
_LIMITED: Final = 0.02
#: The battery's voltage that the firmware stops the motors by is filtered otherwise than the logged one.
_NEAR_STOP: Final = 0.01
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
    """Take the outputs through the propellers' thrust curve."""
    motors, command = log.first("motor_thrust"), log.first("torque_command")
    throttle = log.first("throttle")
    if motors is None or command is None or throttle is None:
        return Rebuilt()
    if motors.n_columns != airframe.n_rotors:
        return Rebuilt(remarks=(f"The log has {motors.n_columns} motors, not {airframe.n_rotors}.",))
    commanded = np.column_stack([command.at(motors.time_s, axis) for axis in range(3)])
    output = full_output(motors.values, log.log.parameters)
    flown = log.flown(motors.time_s, motors.values.mean(axis=1))
    rotors = find_rotors(log, motors, output, flown)
    battery = log.first("battery_voltage")
    highest = (
        np.ones((1, 1))
        if battery is None
        else highest_output(battery.at(motors.time_s), log.log.parameters)[:, np.newaxis]
    )
    # Mark rows in which a motor is at a stop; shape (n_samples,).
    near = np.where(highest < 1.0, _NEAR_STOP, 0.0)
    at_stop = any_motor((motors.values <= 0.0) | (motors.values >= highest - near))
    # What is as long as the log is let go of as soon as it has served.
    mixed = unmixed(np.clip(motors.values / highest, 0.0, 1.0), throttle.at(motors.time_s), airframe, log.log)
    scale = _scale(rotors, output, (commanded, mixed), flown & ~at_stop, airframe, motors.period_s)
    if scale is None:
        return Rebuilt(
            remarks=("The outputs do not follow the PID sums, so the torque is taken as it was commanded.",)
        )
    thrust = rotors.thrust(output)
    per_thrust = airframe.command_per_thrust * scale.per_thrust[:, np.newaxis]
    series = MotorSeries(
        base=motors,
        thrust=thrust,
        command_thrust=thrust,
        actuator=output,
        command=thrust @ per_thrust.T,
        saturated=at_stop[:, np.newaxis] & (np.abs(mixed - commanded) > _LIMITED),
        flown=flown,
        source=f"{motors.source} through the thrust curve",
        reason="the motor commands in units of the PID sums, which include saturation",
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
    sums: tuple[FloatArray, FloatArray],
    free: BoolArray,
    airframe: Airframe,
    period_s: float,
) -> _Scale | None:
    """Compare thrust with PID sums behind the same lag, where no motor is at a stop.

    The sums, each (n_samples, 3), are as logged and as `unmixed`: a regressor that is rounded would take
    from the slopes what rounding adds to its variance.

    None where a slope is that of no mixer, or the rows are too few.
    """
    if np.count_nonzero(free) < _FEWEST_ROWS:
        return None
    commanded, mixed = sums
    of_sums = _logged_per_mixed(mixed[free], commanded[free])
    lagged = lag(mixed, period_s, rotors.lag_s)[free]

    def slopes(expo: float) -> FloatArray:
        thrust = behind_lag(rotors.thrust(output, expo), period_s, rotors.lag_s)[free]
        made = _slopes(lagged, thrust @ airframe.command_per_thrust.T)
        return np.clip(made / of_sums, 1e-9, None)

    found = slopes(rotors.expo)
    if not ((found > _SLOPES[0]) & (found < _SLOPES[1])).all():
        return None
    lower, upper = (np.log(slopes(rotors.expo + sign * _EXPO_STEP)) for sign in (-1.0, 1.0))
    roll, pitch, yaw = (float(change) for change in (upper - lower) / (2.0 * _EXPO_STEP))
    return _Scale(1.0 / found, (roll, pitch, yaw))


def _logged_per_mixed(mixed: FloatArray, commanded: FloatArray) -> FloatArray:
    """Return what the logged sums are of those that the mixer makes the outputs of; shape (3,).

    One where what is left between them, rounding for the most part, could be all of the difference
    (the inequality of Cauchy and Schwarz): small terms vanish in it. Sag compensation, for one, leaves less.
    """
    slopes = _slopes(mixed, commanded)
    allowed = (commanded - slopes * mixed).std(axis=0) / np.maximum(mixed.std(axis=0), 1e-12)
    return np.where(np.abs(slopes - 1.0) > allowed, np.clip(slopes, 1e-9, None), 1.0)


def _slopes(of: FloatArray, made: FloatArray) -> FloatArray:
    """Return each axis' slope on its own by least squares, the other axes and a constant beside; (3,)."""
    regressors = np.column_stack([of, np.ones(len(of))])
    return np.asarray(np.diag(np.linalg.lstsq(regressors, made, rcond=None)[0][:3]))
