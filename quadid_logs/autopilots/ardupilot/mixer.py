"""ArduPilot's mixer and thrust curve, forwards and backwards.

Sources: libraries/AP_Motors/AP_MotorsMatrix.cpp (`output_armed_stabilizing`),
AP_Motors_Thrust_Linearization.cpp (`thrust_to_actuator`, `get_compensation_gain`,
`update_lift_max_from_batt_voltage`), AP_MotorsMulticopter.cpp (`output_to_pwm`,
`get_pwm_output_min`). Thrust boost, which only a lost motor switches on, is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray

#: Throttle that leaves most room for torque on both sides (AP_MotorsMatrix.cpp).
_MIDDLE = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorSettings:
    """The parameters between a thrust and a pulse width.

    ``expo`` is MOT_THST_EXPO, ``spin_min`` and ``spin_max`` MOT_SPIN_MIN and
    MOT_SPIN_MAX, ``pwm_min_us`` and ``pwm_max_us`` MOT_PWM_MIN and MOT_PWM_MAX
    [us], ``yaw_headroom`` MOT_YAW_HEADROOM / 1000.
    """

    expo: float
    spin_min: float
    spin_max: float
    pwm_min_us: float
    pwm_max_us: float
    yaw_headroom: float

    def output_range_us(self, n_rotors: int) -> tuple[FloatArray, FloatArray]:
        """Return the pulse widths of no and full thrust, each of shape (n_rotors,)."""
        width_us = self.pwm_max_us - self.pwm_min_us
        low, high = (self.pwm_min_us + width_us * spin for spin in (self.spin_min, self.spin_max))
        return np.full(n_rotors, low), np.full(n_rotors, high)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Supply:
    """What the mixer knows about battery and air, one value per row; each of shape (n_samples,).

    ``lift_max`` and ``voltage_ratio`` of the battery, the compensation
    ``gain``, the ``throttle_limit``, and ``throttle_average_max``.
    """

    lift_max: FloatArray
    voltage_ratio: FloatArray
    gain: FloatArray
    throttle_limit: FloatArray
    throttle_average_max: FloatArray

    def rows(self, rows: slice) -> Supply:
        """Return those of some rows."""
        return Supply(**{each.name: getattr(self, each.name)[rows] for each in fields(self)})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MixerOutput:
    """What the mixer made of a command.

    ``thrust`` (n_samples, n_rotors) is the fraction of the available thrust per
    motor; ``limited`` (n_samples, 3) marks the axes that got less than was commanded.
    """

    thrust: FloatArray
    limited: BoolArray


def compensation_gain(lift_max: FloatArray, density_ratio: FloatArray) -> FloatArray:
    """Return the factor on all commands against a weak battery and thin air [-]; shape (n_samples,).

    Parameters
    ----------
    lift_max : ndarray, shape (n_samples,)
        MOTB.LiftMax: available lift over that of a full battery [1].
    density_ratio : ndarray, shape (n_samples,)
        Air density over that at sea level; believed between 0.3 and 1.5, limited to 0.5 to 1.25.
    """
    believed = (density_ratio > 0.3) & (density_ratio < 1.5)
    density = np.where(believed, np.clip(density_ratio, 0.5, 1.25), 1.0)
    return np.where(lift_max > 0.0, 1.0 / (np.where(lift_max > 0.0, lift_max, 1.0) * density), 1.0)


def mix(
    command: FloatArray, throttle: FloatArray, factors: FloatArray, supply: Supply, yaw_headroom: float
) -> MixerOutput:
    """Mix torque commands and throttle into motor thrusts, as `output_armed_stabilizing` does.

    Roll and pitch come first, yaw gets the room that they leave but at least
    the headroom, then all three are scaled to fit, and throttle comes last.

    Parameters
    ----------
    command : ndarray, shape (n_samples, 3)
        RATE.ROut, POut, YOut [1].
    throttle : ndarray, shape (n_samples,)
        RATE.AOut [1].
    factors : ndarray, shape (n_rotors, 4)
        Roll, pitch, yaw and throttle factor of each motor; the last is 1 in every frame of the table.
    """
    roll, pitch, yaw = (command * supply.gain[:, None]).T
    highest = supply.throttle_limit * supply.gain
    wanted = np.clip(throttle * supply.gain, 0.0, np.maximum(highest, 0.0))
    average_max = np.clip(supply.throttle_average_max * supply.gain, wanted, np.maximum(highest, wanted))
    tilt = np.column_stack([roll, pitch]) @ factors[:, :2].T
    allowed = np.maximum(_yaw_room(tilt, yaw, factors[:, 2], np.minimum(_MIDDLE, average_max)), yaw_headroom)
    given = np.clip(yaw, -allowed, allowed)
    torque = tilt + given[:, None] * factors[:, 2]
    low, high = torque.min(axis=1), torque.max(axis=1)
    scale = np.ones_like(low)
    np.divide(1.0, high - low, out=scale, where=high - low > 1.0)
    below = average_max + low < 0.0
    scale = np.minimum(scale, np.divide(-average_max, low, out=np.ones_like(low), where=below))
    collective = np.where(scale < 1.0, -low * scale, np.clip(wanted, -low, np.maximum(-low, 1.0 - high)))
    limited = np.repeat((scale < 1.0)[:, None], 3, axis=1)
    limited[:, 2] |= np.abs(yaw) > allowed
    return MixerOutput(thrust=collective[:, None] + scale[:, None] * torque, limited=limited)


def _yaw_room(tilt: FloatArray, yaw: FloatArray, factor: FloatArray, middle: FloatArray) -> FloatArray:
    """Return the largest yaw command that no motor clips; shape (n_samples,)."""
    steering = factor != 0.0
    if not steering.any():
        return np.ones_like(yaw)
    level = middle[:, None] + tilt[:, steering]
    room = np.where(yaw[:, None] * factor[steering] > 0.0, 1.0 - level, level)
    per_motor = np.maximum(room, 0.0) / np.abs(factor[steering])
    return np.asarray(np.minimum(per_motor.min(axis=1), 1.0), dtype=np.float64)


def actuator_of_thrust(thrust: FloatArray, supply: Supply, settings: MotorSettings) -> FloatArray:
    """Return the motor command between MOT_SPIN_MIN (0) and MOT_SPIN_MAX (1) for a thrust; same shape.

    Parameters
    ----------
    thrust : ndarray, shape (n_samples, n_rotors)
        Fraction of the available thrust [1].
    """
    lifted = supply.lift_max[:, None] * np.clip(thrust, 0.0, 1.0)
    return np.clip(throttle_of_thrust(lifted, settings) / _voltage(supply), 0.0, 1.0)


def throttle_of_thrust(thrust: FloatArray, settings: MotorSettings) -> FloatArray:
    """Return the voltage-effective throttle y for which (1 - e) y + e y^2 is a thrust [1]; same shape.

    Parameters
    ----------
    thrust : ndarray
        Over that at full command and full battery [1].
    settings : MotorSettings
        With e, MOT_THST_EXPO.
    """
    e = float(np.clip(settings.expo, -1.0, 1.0))
    if e == 0.0:
        return thrust
    root = np.sqrt(np.maximum((1.0 - e) ** 2 + 4.0 * e * thrust, 0.0))
    return np.asarray(((e - 1.0) + root) / (2.0 * e), dtype=np.float64)


def full_battery_thrust(actuator: FloatArray, supply: Supply, settings: MotorSettings) -> FloatArray:
    """Return thrust over that at full command and full battery [1]; same shape as `actuator`.

    The curve (1 - e) y + e y^2 of the voltage-effective throttle y.

    Parameters
    ----------
    actuator : ndarray, shape (n_samples, n_rotors)
        Motor command, 0 at MOT_SPIN_MIN to 1 at MOT_SPIN_MAX.
    """
    y = voltage_effective(actuator, supply)
    e = float(np.clip(settings.expo, -1.0, 1.0))
    return (1.0 - e) * y + e * y**2


def voltage_effective(actuator: FloatArray, supply: Supply) -> FloatArray:
    """Return the throttle that the battery leaves of a motor command (n_samples, n_rotors) [1]; same shape.

    Parameters
    ----------
    actuator : ndarray, shape (n_samples, n_rotors)
        Motor command, 0 at MOT_SPIN_MIN to 1 at MOT_SPIN_MAX.
    """
    return np.asarray(actuator * _voltage(supply), dtype=np.float64)


def _voltage(supply: Supply) -> FloatArray:
    """Return the voltage ratio as a column, 1 where it is not positive."""
    return np.where(supply.voltage_ratio > 0.0, supply.voltage_ratio, 1.0)[:, None]


def pulse_width(actuator: FloatArray, settings: MotorSettings) -> FloatArray:
    """Return the pulse width [us] of a motor command, cut to whole microseconds as the firmware does.

    Parameters
    ----------
    actuator : ndarray, shape (n_samples, n_rotors)
        Motor command, 0 at MOT_SPIN_MIN to 1 at MOT_SPIN_MAX.
    """
    spin = settings.spin_min + (settings.spin_max - settings.spin_min) * actuator
    # A hair of slack: what single precision rounds up, double precision leaves just below.
    return np.floor(settings.pwm_min_us + (settings.pwm_max_us - settings.pwm_min_us) * spin + 1e-4)


def actuator_of_pulse(pulse_us: FloatArray, settings: MotorSettings) -> FloatArray:
    """Return the motor command between spin minimum and maximum of a logged pulse width; same shape.

    Parameters
    ----------
    pulse_us : ndarray, shape (n_samples, n_rotors)
    """
    # Half a microsecond for what the firmware cut off.
    spin = (pulse_us + 0.5 - settings.pwm_min_us) / (settings.pwm_max_us - settings.pwm_min_us)
    return np.clip((spin - settings.spin_min) / (settings.spin_max - settings.spin_min), 0.0, 1.0)
