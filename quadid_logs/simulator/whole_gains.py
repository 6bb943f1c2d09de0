"""Gains of Betaflight's rate loops: whole numbers in its header, per rad/s in the simulator."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.simulator.control import Gains, vector

#: ``pid.h``: PTERM_SCALE, ITERM_SCALE, DTERM_SCALE, from deg/s to thousandths of the mixer's range.
_SCALES: Final = np.array([0.032029, 0.244381, 0.000529])
#: ``pid_init.c``: the scale of yaw's I, since 4.0.
_YAW_INTEGRAL: Final = 2.5
#: ``pid.h``: PID_GAIN_MAX.
_HIGHEST: Final = 250.0
#: ``pid_init.c``: the limit of the integral, `iterm_limit` of 400 thousandths.
_INTEGRAL_LIMIT: Final = 0.4


class WholeGains(NamedTuple):
    """P, I and D of roll, pitch and yaw, shape (3, 3), and the angle gain in tenths of 1/s, shape (3,)."""

    rates: FloatArray
    angle: FloatArray

    @classmethod
    def near(cls, gains: Gains) -> WholeGains:
        """Return the numbers that come nearest to gains, as far as the firmware allows them.

        Roll and pitch share one angle gain.
        """
        rates = np.array([gains.proportional, gains.integral, gains.derivative]) / _units()
        angle = np.array(gains.attitude) / 0.1
        angle[:2] = angle[:2].mean()
        return cls(np.clip(np.rint(rates), 0.0, _HIGHEST), np.rint(angle))

    def put_into(self, gains: Gains) -> Gains:
        """Return gains that are these numbers."""
        P, I, D = self.rates * _units()  # noqa: E741
        return gains._replace(
            proportional=vector(P),
            integral=vector(I),
            derivative=vector(D),
            attitude=vector(0.1 * self.angle),
            integral_limit=_INTEGRAL_LIMIT,
        )


def _units() -> FloatArray:
    """Return P, I and D of one in the header, per rad/s of the full command; shape (3, 3)."""
    units = np.repeat(_SCALES[:, np.newaxis] * math.degrees(1.0) * 1e-3, 3, axis=1)
    units[1, 2] *= _YAW_INTEGRAL
    return units
