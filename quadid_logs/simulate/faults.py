"""What breaks: a motor that gives less, one that loses its thrust for a moment, a bent propeller."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.rotations import Component
from quadid_logs.simulate.components import stacked
from quadid_logs.simulate.control import Arithmetic
from quadid_logs.simulate.effects import Effects

#: Of most flight controllers: 16 g [m/s^2].
ACCELEROMETER_RANGE_M_S2: Final = 16.0 * 9.80665
#: The force of an imbalance turns with the rotor in its plane. What of it tilts the frame is largest about
#: the axes in that plane, a quarter of a turn apart; about the third a part remains.
_ABOUT: Final = ((1.0, 0.0), (1.0, -0.5 * math.pi), (0.3, 0.25 * math.pi))


class MotorFaults:
    """What faults make of the speeds that the motors are sent to.

    Parameters
    ----------
    effects : sequence of Effects
        Of each flight.
    n_rotors : int
    begin_s, end_s : float
        Of the manoeuvre, which the faults' times are fractions of.
    """

    def __init__(self, effects: Sequence[Effects], n_rotors: int, begin_s: float, end_s: float) -> None:
        #: Whether there is anything to do.
        self.present = any(one.motor_fault or one.desync_rotor for one in effects)
        length_s = end_s - begin_s
        self._n_rotors = n_rotors
        self._lost = [
            stacked([(1.0 - one.motor_effectiveness) * (one.motor_fault == rotor + 1) for one in effects])
            for rotor in range(n_rotors)
        ]
        # One that is there from the beginning is there before take-off.
        self._from_s = stacked(
            [begin_s + one.motor_fault_at * length_s if one.motor_fault_at else -1e9 for one in effects]
        )
        self._ramp_s = stacked([max(one.motor_ramp_s, 1e-9) for one in effects])
        self._desync = [
            stacked([1.0 * (one.desync_rotor == rotor + 1) for one in effects]) for rotor in range(n_rotors)
        ]
        self._desync_from_s = stacked([begin_s + one.desync_at * length_s for one in effects])
        self._desync_s = stacked([one.desync_s for one in effects])

    def speeds(self, wanted: tuple[Component, ...], time_s: float, ops: Arithmetic) -> tuple[Component, ...]:
        """Return the speeds that the motors go to; thrust goes with their square [rad/s]."""
        grown = ops.higher(ops.lower((time_s - self._from_s) / self._ramp_s, 1.0), 0.0)
        since_s = time_s - self._desync_from_s
        stalled = 1.0 * (since_s >= 0.0) * (since_s < self._desync_s)
        return tuple(
            speed * (1.0 - lost * grown) ** 0.5 * (1.0 - desync * stalled)
            for speed, lost, desync in zip(wanted, self._lost, self._desync, strict=True)
        )


class Shaking:
    """What a bent propeller adds to the gyro [rad/s]; with the square of its speed.

    Parameters
    ----------
    effects : sequence of Effects
    hover_rad_s : float or ndarray
        Speed at which the stated size holds.
    step_s : float
    """

    def __init__(self, effects: Sequence[Effects], hover_rad_s: Component, step_s: float) -> None:
        self.present = any(one.bent_propeller for one in effects)
        self._rotor = next((one.bent_propeller - 1 for one in effects if one.bent_propeller), 0)
        size = [one.propeller_gyro_rad_s * bool(one.bent_propeller) for one in effects]
        self._size, self._hover, self._step_s = stacked(size), hover_rad_s, step_s
        self._angle = 0.0 * self._size

    def rates(self, speeds: tuple[Component, ...]) -> tuple[Component, Component, Component]:
        """Return what is added to roll, pitch and yaw, and turn the propeller by a period."""
        speed = speeds[self._rotor]
        size = self._size * (speed / self._hover) ** 2
        self._angle = self._angle + speed * self._step_s
        roll, pitch, yaw = (factor * size * np.sin(self._angle + phase) for factor, phase in _ABOUT)
        return roll, pitch, yaw


def shaken(effects: Effects, rotor_speed: FloatArray, hover_rad_s: float, step_s: float) -> FloatArray:
    """Return what a bent propeller adds to the accelerometer [m/s^2].

    Parameters
    ----------
    effects : Effects
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
    return np.column_stack([factor * size * np.sin(angle + phase) for factor, phase in _ABOUT])
