"""The lag where it acts: on the speed of each rotor, not on the torque.

Thrust goes with speed squared. If w follows its target w* with the lag T, then
F = w^2 lags too, but not as a linear filter would make it. The thrust that a
linear lag T would have to be given for the same result is F + T dF/dt =
w^2 + 2 w (w* - w), which is F* - (w* - w)^2. With the torque of such thrusts,
the search for a linear lag finds the lag of the rotors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, InputDescription, Segment
from quadid_logs.identify.design import Design

#: After so many time constants a wrong start is below a thousandth.
_FORGOTTEN = 7.0
#: Least samples of a stretch of the recursion, and least times its warming up: few steps, each for
#: many stretches at once, are quicker than many steps for few.
_STRETCH, _STRETCH_OVER_WARM = 200, 2
#: Motors that brake or that do not differ by less than this factor from those that push.
MOST_UNEVEN = 3.0
#: Relative step of the central differences, by the lag and by its unevenness.
_STEP = 0.02


class Rotors(NamedTuple):
    """Time constants of a rotor's speed, rising and falling [s]."""

    up_s: float
    down_s: float

    @classmethod
    def of(cls, lag_s: float, log_unevenness: float) -> Rotors:
        """Return those with a given mean and logarithm of up over down."""
        ratio = float(np.exp(log_unevenness))
        return cls(2.0 * lag_s * ratio / (1.0 + ratio), 2.0 * lag_s / (1.0 + ratio))

    @property
    def mean_s(self) -> float:
        """Time constant of the linear lag that is nearest."""
        return 0.5 * (self.up_s + self.down_s)

    @property
    def log_unevenness(self) -> float:
        """Logarithm of up over down."""
        return float(np.log(self.up_s / self.down_s))


class RotorSlopes(NamedTuple):
    """Designs whose torque is the derivative by the mean lag [unit/s], and by its log_unevenness."""

    by_lag: Design
    by_unevenness: Design


def rotors_known(data: FlightData) -> bool:
    """Say whether the thrust of each rotor follows from the torque."""
    described = data.input
    return (
        described is not None
        and described.torque_per_thrust is not None
        and all(segment.rotor_thrust is not None for segment in data.segments)
    )


def with_lag_on_rotors(design: Design, described: InputDescription, rotors: Rotors) -> Design:
    """Return the design with the torque that, behind a linear lag, acts as rotors with their own lag do.

    Parameters
    ----------
    design : Design
    described : InputDescription
        With the ``torque_per_thrust`` of the rotors.
    rotors : Rotors

    Returns
    -------
    Design
    """
    torques = [_torque(piece, described, design.sample_period_s, rotors) for piece in design.pieces]
    return design.with_torque(torques)


def rotor_slopes(design: Design, described: InputDescription, rotors: Rotors) -> RotorSlopes:
    """Return the derivatives of the torque that `with_lag_on_rotors` makes.

    Parameters
    ----------
    design : Design
    described : InputDescription
    rotors : Rotors

    Returns
    -------
    RotorSlopes
    """
    mean_s, uneven = rotors.mean_s, rotors.log_unevenness

    def slope(ahead: Rotors, behind: Rotors, step: float) -> Design:
        return design.with_torque(
            [
                (
                    _torque(piece, described, design.sample_period_s, ahead)
                    - _torque(piece, described, design.sample_period_s, behind)
                )
                / (2.0 * step)
                for piece in design.pieces
            ]
        )

    return RotorSlopes(
        by_lag=slope(
            Rotors.of(mean_s * (1.0 + _STEP), uneven),
            Rotors.of(mean_s * (1.0 - _STEP), uneven),
            mean_s * _STEP,
        ),
        by_unevenness=slope(Rotors.of(mean_s, uneven + _STEP), Rotors.of(mean_s, uneven - _STEP), _STEP),
    )


def _torque(segment: Segment, described: InputDescription, period_s: float, rotors: Rotors) -> FloatArray:
    """Return the torque of one piece for a linear lag; shape (n_samples, 3)."""
    thrust, torque_per_thrust = segment.rotor_thrust, described.torque_per_thrust
    if thrust is None or torque_per_thrust is None:
        return segment.torque
    target = np.sqrt(thrust)
    speed = _lagged(target, period_s, rotors)
    gap = target - speed
    # F + T dF/dt, with the T of the direction in dw/dt and the mean of both before dF/dt.
    share = np.where(gap > 0.0, rotors.mean_s / rotors.up_s, rotors.mean_s / rotors.down_s)
    change = speed**2 + 2.0 * speed * gap * share - thrust
    return np.asarray(segment.torque + change @ torque_per_thrust.T)


def _lagged(target: FloatArray, period_s: float, rotors: Rotors) -> FloatArray:
    """Return speeds that approach held targets exponentially, up and down with their own time constant.

    The recursion runs through stretches of the flight side by side: each
    begins early enough for its own start to be forgotten.
    """
    up, down = (1.0 - np.exp(-period_s / lag_s) for lag_s in rotors)
    n_samples, n_rotors = target.shape
    warm = int(np.ceil(_FORGOTTEN * max(rotors) / period_s))
    length = max(_STRETCH, _STRETCH_OVER_WARM * warm)
    n_stretches = int(np.ceil(n_samples / length))
    before, after = (
        np.repeat(row, count, axis=0)
        for row, count in ((target[:1], warm), (target[-1:], n_stretches * length - n_samples))
    )
    padded = np.concatenate([before, target, after])
    stretches = np.lib.stride_tricks.sliding_window_view(padded, warm + length, axis=0)[::length]
    speed = stretches[:, :, 0].copy()
    lagged = np.empty((length, n_stretches, n_rotors))
    for step in range(warm + length):
        gap = stretches[:, :, step] - speed
        speed = speed + gap * np.where(gap > 0.0, up, down)
        if step >= warm:
            lagged[step - warm] = speed
    return np.asarray(lagged.transpose(1, 0, 2).reshape(-1, n_rotors)[:n_samples])
