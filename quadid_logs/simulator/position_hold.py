"""Fly a path: position and velocity controllers around the attitude loop, as the autopilots have them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import POSITION_VALUES
from quadid_logs.maths.rotational_dynamics import Quadruple, Triple
from quadid_logs.maths.rotations import quaternion_from_euler
from quadid_logs.vocabulary import GRAVITY_M_S2

#: No steeper tilt is wanted [rad].
_STEEPEST: Final = 0.6
DIRECTIONS: Final = ("north", "east")


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionHold:
    """How positions are held, and the path.

    Attributes
    ----------
    position_per_s, proportional_per_s, integral_per_s2, derivative, error_hz, derivative_hz, slope_of_error
        As of `data.outer_loops.CascadeController`.
    lag_s : float
        Of the attitude's target behind the wanted attitude, whose rate is then fed forward; 0 for neither.
    period_s : float
        Of the controllers [s].
    moves_m : float
        How far the path goes along each direction, to both sides.
    path_hz : tuple of float
        Frequencies of the path, north and east.
    """

    position_per_s: float = 1.0
    proportional_per_s: float = 2.0
    integral_per_s2: float = 1.0
    derivative: float = 0.25
    error_hz: float = 5.0
    derivative_hz: float = 5.0
    slope_of_error: bool = True
    lag_s: float = 0.15
    period_s: float = 1.0 / 400.0
    moves_m: float = 2.0
    path_hz: tuple[float, float] = (0.06, 0.09)


def path(hold: PositionHold, time_s: FloatArray, begin_s: float) -> FloatArray:
    """Return where the path is, shape (n, 2) [m]: it swings ever further in the first five seconds."""
    since_s = np.maximum(time_s - begin_s, 0.0)[:, np.newaxis]
    begun = np.minimum(since_s / 5.0, 1.0)
    swing = np.sin(2.0 * np.pi * np.array(hold.path_hz) * since_s)
    return np.asarray(hold.moves_m * begun**2 * (3.0 - 2.0 * begun) * swing, dtype=np.float64)


class Navigated(NamedTuple):
    """What the position controllers want of the attitude loop, and what they were given."""

    attitude: Quadruple
    forward: Triple
    row: tuple[float, ...]


class Navigator:
    """Holds positions of one flight, loop by loop.

    Parameters
    ----------
    hold : PositionHold
    loop_hz : float
    time_s : ndarray, shape (n_steps,)
    begin_s : float
        When the path begins.
    """

    def __init__(self, hold: PositionHold, loop_hz: float, time_s: FloatArray, begin_s: float) -> None:
        self._hold, self._step_s = hold, 1.0 / loop_hz
        where = path(hold, time_s, begin_s)
        speed = np.gradient(where, self._step_s, axis=0)
        self._path = np.stack([where, speed, np.gradient(speed, self._step_s, axis=0)], axis=2).tolist()
        self._every = max(round(hold.period_s * loop_hz), 1)
        self._place, self._target = [0.0, 0.0], [0.0, 0.0]
        self._axes = [_Velocity(hold, self._every * self._step_s) for _ in DIRECTIONS]
        self._row: tuple[float, ...] = (0.0,) * (len(POSITION_VALUES) * len(DIRECTIONS))
        self._wanted = (0.0, 0.0)

    def fly(self, step: int, velocity: Sequence[float]) -> Navigated:
        """Return what is wanted in one control period, of a vehicle that heads north."""
        if step % self._every == 0:
            rows = [
                axis.update(wanted, place, speed)
                for axis, wanted, place, speed in zip(
                    self._axes, self._path[step], self._place, velocity[:2], strict=True
                )
            ]
            self._row = (*rows[0], *rows[1])
            pitch = math.atan2(-rows[0][-1], GRAVITY_M_S2)
            roll = math.atan2(rows[1][-1] * math.cos(pitch), GRAVITY_M_S2)
            self._wanted = (_tilt(roll), _tilt(pitch))
        self._place = [
            place + self._step_s * speed for place, speed in zip(self._place, velocity[:2], strict=True)
        ]
        # The target behind the shaper's lag, and its rate.
        lag_s = self._hold.lag_s
        if not lag_s:
            self._target = list(self._wanted)
        roll, pitch = self._target
        rates = [
            (wanted - target) / lag_s if lag_s else 0.0
            for wanted, target in zip(self._wanted, self._target, strict=True)
        ]
        euler = np.array([[roll, pitch, 0.0]])
        w, x, y, z = quaternion_from_euler(euler)[0].tolist()
        # Body rates of an attitude that does not turn about the vertical.
        forward = (rates[0], rates[1] * math.cos(roll), -rates[1] * math.sin(roll))
        self._target = [roll + self._step_s * rates[0], pitch + self._step_s * rates[1]]
        return Navigated((w, x, y, z), forward, (*self._row, roll, pitch, 0.0))


def _tilt(angle_rad: float) -> float:
    """Return an angle no steeper than tilts may be."""
    return min(max(angle_rad, -_STEEPEST), _STEEPEST)


class _Velocity:
    """Position and velocity controller along one direction."""

    def __init__(self, hold: PositionHold, step_s: float) -> None:
        self._hold, self._step_s = hold, step_s
        self._error, self._slope, self._integral = 0.0, 0.0, 0.0
        self._before: float | None = None

    def update(self, wanted: Sequence[float], place: float, speed: float) -> tuple[float, ...]:
        """Return what went in and came out, by `POSITION_VALUES`."""
        hold, (position, forward, acceleration) = self._hold, wanted
        target = forward + hold.position_per_s * (position - place)
        error_before = self._error
        self._error += self._weight(hold.error_hz) * (target - speed - self._error)
        moved = self._error - error_before
        if not hold.slope_of_error:
            moved = 0.0 if self._before is None else self._before - speed
        self._before = speed
        self._slope += self._weight(hold.derivative_hz) * (moved / self._step_s - self._slope)
        self._integral += hold.integral_per_s2 * self._error * self._step_s
        asked = (
            acceleration
            + hold.proportional_per_s * self._error
            + self._integral
            + hold.derivative * self._slope
        )
        return position, place, forward, target, speed, acceleration, asked

    def _weight(self, cutoff_hz: float) -> float:
        """Return the weight of a new value in a first-order filter, 1 without one."""
        return 1.0 / (1.0 + 1.0 / (2.0 * math.pi * cutoff_hz * self._step_s)) if cutoff_hz > 0.0 else 1.0
