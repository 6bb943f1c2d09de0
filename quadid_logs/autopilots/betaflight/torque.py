"""Torque from the motor outputs, in units of the PID sums; source: ``mixer.c``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.actuation.motors import MotorSeries, Rebuilt, any_motor
from quadid_logs.align.series import CleanLog
from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import whole_number

#: Outputs and PID terms are whole numbers: their rounding is a few thousandths of the range.
_LIMITED: Final = 0.02
#: ``config/feature.h``: FEATURE_AIRMODE.
_AIRMODE: Final = 1 << 22
#: Points of the inverse of a smooth curve: interpolated to 1e-6.
_CURVE_POINTS: Final = 1001


def rebuild(log: CleanLog, airframe: Airframe) -> Rebuilt:
    """Take the outputs back through thrust linearisation and airmode.

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
    settings = log.log.parameters
    thrust = before_linearisation(motors.values, settings.get("thrust_linear", 0.0) / 100.0)
    scaled = np.linalg.pinv(airframe.factors) @ thrust.T
    # Without airmode the mixer makes the sums smaller at low throttle; here they are as before.
    factor = mix_factor(throttle.at(motors.time_s), settings)
    mixed = (airframe.factors[:, :3] @ scaled[:3]).T
    command_thrust = thrust + mixed * (1.0 / factor - 1.0)[:, np.newaxis]
    made = command_thrust @ airframe.command_per_thrust.T
    commanded = np.column_stack([command.at(motors.time_s, axis) for axis in range(3)])
    at_stop = any_motor((motors.values <= 0.0) | (motors.values >= 1.0))
    series = MotorSeries(
        base=motors,
        thrust=thrust,
        command_thrust=command_thrust,
        actuator=motors.values,
        command=made,
        saturated=at_stop[:, np.newaxis] & (np.abs(made - commanded) > _LIMITED),
        flown=log.flown(motors.time_s, thrust.mean(axis=1)),
        source=f"{motors.source} back through the mixer",
        reason="what the motors were sent, in units of the PID sums: saturation is in it",
        achieved=True,
    )
    return Rebuilt(series=(series,))


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
