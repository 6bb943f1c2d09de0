"""Thrust of every motor over time, whatever it was rebuilt from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.log import Rows, Signal


def any_motor(limited: BoolArray) -> BoolArray:
    """Return whether any motor of a row is marked; (n_samples, n_rotors) to (n_samples,)."""
    return np.asarray(np.any(limited, axis=1), dtype=np.bool_)


def on_all_axes(limited: BoolArray) -> BoolArray:
    """Return a mark per row as a mark per row and axis, shape (n_samples, 3)."""
    return np.repeat(limited[:, None], 3, axis=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotorSeries:
    """What the motors did, or were asked to do.

    Attributes
    ----------
    time_s, position : ndarray, shape (n_samples,)
        As of the `Signal` that it was rebuilt from.
    thrust : ndarray, shape (n_samples, n_rotors)
        Share of one rotor's thrust at full command and full battery in air of sea level [1].
    actuator : ndarray, shape (n_samples, n_rotors)
        Motor command, 0 to 1 over the range that makes thrust.
    command : ndarray, shape (n_samples, 3)
        Torque on the scale of the autopilot's own command [1].
    saturated : ndarray of bool, shape (n_samples, 3), or None
        Axes that got less than they asked for; None where that is not known.
    flown : ndarray of bool, shape (n_samples,)
        Certainly off the ground.
    source, reason : str
    achieved : bool
        Saturation is contained.
    """

    time_s: FloatArray
    position: IntArray
    thrust: FloatArray
    actuator: FloatArray
    command: FloatArray
    saturated: BoolArray | None
    flown: BoolArray
    source: str
    reason: str
    achieved: bool

    def as_command(self) -> Signal:
        """Return the normalised torque as a source of ``torque_command``."""
        return self.signal("torque_command", self.command)

    def signal(self, name: str, values: FloatArray, reason: str = "") -> Signal:
        """Return values on these rows as a source of a signal."""
        return Signal(
            name=name,
            rows=Rows(self.time_s, self.position),
            values=np.asarray(values, dtype=np.float64),
            source=self.source,
            reason=reason or self.reason,
            achieved=self.achieved,
        )
