"""What breaks: a motor that gives less, one that loses its thrust for a moment, a bent propeller."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.rotational_dynamics import Triple
from quadid_logs.simulator.control import higher, lower
from quadid_logs.simulator.effects import Effects
from quadid_logs.vocabulary import GRAVITY_M_S2

#: Of most flight controllers: 16 g [m/s^2].
ACCELEROMETER_RANGE_M_S2: Final = 16.0 * GRAVITY_M_S2
#: The force of an imbalance turns with the rotor in its plane, a quarter of a turn between the two axes; a
#: part of it is along the third. At the end of an arm it turns the frame about all three.
_FORCE_PARTS: Final = (1.0, 1.0, 0.3)
_PHASES_RAD: Final = (0.0, 0.5 * math.pi, 0.25 * math.pi)
#: From rotor to rotor, so that no two of them begin alike [rad].
_APART_RAD: Final = 2.4
#: Slower rotors shake nothing that a gyro would show [rad/s].
_SLOW_ROTOR_RAD_S: Final = 30.0


class MotorFaults:
    """What faults make of the speeds that the motors are sent to.

    Parameters
    ----------
    effects : Effects
    n_rotors : int
    begin_s, end_s : float
        Of the manoeuvre, which the faults' times are fractions of.
    """

    def __init__(self, effects: Effects, n_rotors: int, begin_s: float, end_s: float) -> None:
        #: Whether there is anything to do.
        self.present = bool(effects.motor_fault or effects.desync_rotor)
        length_s, rotors = end_s - begin_s, range(1, n_rotors + 1)
        self._lost = [
            (1.0 - effects.motor_effectiveness) * (effects.motor_fault == rotor) for rotor in rotors
        ]
        # One that is there from the beginning is there before take-off.
        self._from_s = begin_s + effects.motor_fault_at * length_s if effects.motor_fault_at else -1e9
        self._ramp_s = max(effects.motor_ramp_s, 1e-9)
        self._desync = [1.0 * (effects.desync_rotor == rotor) for rotor in rotors]
        self._desync_from_s = begin_s + effects.desync_at * length_s
        self._desync_s = effects.desync_s

    def speeds(self, wanted: tuple[float, ...], time_s: float) -> tuple[float, ...]:
        """Return the speeds that the motors go to; thrust goes with their square [rad/s]."""
        grown = higher(lower((time_s - self._from_s) / self._ramp_s, 1.0), 0.0)
        since_s = time_s - self._desync_from_s
        stalled = 1.0 * (since_s >= 0.0) * (since_s < self._desync_s)
        return tuple(
            speed * (1.0 - lost * grown) ** 0.5 * (1.0 - desync * stalled)
            for speed, lost, desync in zip(wanted, self._lost, self._desync, strict=True)
        )


class RotorVibration:
    """What rotors out of balance add to the gyro [rad/s]: each a sine that turns with its rotor.

    Parameters
    ----------
    effects : Effects
        A bent propeller shakes more than the others.
    line_rad_s : float
        Root mean square of all rotors together about each axis.
    n_rotors : int
    loop_hz : float
    """

    def __init__(self, effects: Effects, line_rad_s: float, n_rotors: int, loop_hz: float) -> None:
        alike = line_rad_s * math.sqrt(2.0 / n_rotors)
        self._sizes = [
            alike + effects.propeller_gyro_rad_s * (effects.bent_propeller == rotor)
            for rotor in range(1, n_rotors + 1)
        ]
        #: Whether there is anything to do.
        self.present = any(self._sizes)
        self._step_s = 1.0 / loop_hz
        self._turned = [_APART_RAD * place for place in range(n_rotors)]

    def rates(self, speeds: tuple[float, ...]) -> Triple:
        """Return what is added to roll, pitch and yaw, and turn the propellers by a period."""
        self._turned = [
            turned + self._step_s * speed for turned, speed in zip(self._turned, speeds, strict=True)
        ]
        sizes = [
            size * speed / (speed + _SLOW_ROTOR_RAD_S)
            for size, speed in zip(self._sizes, speeds, strict=True)
        ]
        roll, pitch, yaw = (
            sum(size * np.sin(turned + phase) for size, turned in zip(sizes, self._turned, strict=True))
            for phase in _PHASES_RAD
        )
        return roll, pitch, yaw


def shaken(effects: Effects, rotor_speed: FloatArray, hover_rad_s: float, step_s: float) -> FloatArray:
    """Return what a bent propeller adds to the accelerometer [m/s^2].

    Parameters
    ----------
    rotor_speed : ndarray, shape (n_steps, n_rotors)
        [rad/s]
    hover_rad_s, step_s : float

    Returns
    -------
    ndarray, shape (n_steps, 3)
    """
    if not effects.bent_propeller:
        return np.zeros((len(rotor_speed), 3))
    speed = rotor_speed[:, effects.bent_propeller - 1]
    angle = np.cumsum(speed) * step_s
    size = effects.propeller_acceleration_m_s2 * (speed / hover_rad_s) ** 2
    turned = zip(_FORCE_PARTS, _PHASES_RAD, strict=True)
    return np.column_stack([part * size * np.sin(angle + phase) for part, phase in turned])
