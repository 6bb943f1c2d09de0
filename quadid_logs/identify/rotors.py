"""The lag where it acts: on the speed of each rotor, not on the torque.

Thrust goes with speed squared. If w follows its target w* with the lag T, then
F = w^2 lags too, but not as a linear filter would make it. The thrust that a
linear lag T would have to be given for the same result is F + T dF/dt =
w^2 + 2 w (w* - w), which is F* - (w* - w)^2. With the torque of such thrusts,
the search for a linear lag finds the lag of the rotors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, InputDescription, Segment
from quadid_logs.identify.design import Design
from quadid_logs.identify.torque import RowTorque

#: After so many time constants a wrong start is below a thousandth.
_FORGOTTEN = 7.0
#: Least samples of an interval of the recursion, and least times its warming up: few steps, each for
#: many intervals at once, are quicker than many steps for few.
_INTERVAL, _INTERVAL_OVER_WARM = 200, 2
#: Most of spin-down over spin-up. Motors that brake slow down about as fast as they speed up, others by drag
#: alone, which takes some times as long; at 3 simulated ones of 5 came out 6 % low.
MOST_ASYMMETRIC = 6.0
#: Relative step of the central differences, by the lag and by its spin-up/spin-down asymmetry.
_STEP = 0.02


class Rotors(NamedTuple):
    """Time constants of a rotor's speed, rising and falling [s]."""

    up_s: float
    down_s: float

    @classmethod
    def of(cls, lag_s: float, log_asymmetry: float) -> Rotors:
        """Return those with a given mean and logarithm of up over down."""
        ratio = float(np.exp(log_asymmetry))
        return cls(2.0 * lag_s * ratio / (1.0 + ratio), 2.0 * lag_s / (1.0 + ratio))

    @property
    def mean_s(self) -> float:
        """Time constant of the linear lag that is nearest."""
        return 0.5 * (self.up_s + self.down_s)

    @property
    def log_asymmetry(self) -> float:
        """Logarithm of up over down."""
        return float(np.log(self.up_s / self.down_s))


class RotorSlopes(NamedTuple):
    """Derivatives of the torque by the mean lag [unit/s], and by the log_asymmetry."""

    by_lag: RowTorque
    by_asymmetry: RowTorque


def rotors_known(data: FlightData) -> bool:
    """Say whether the thrust of each rotor follows from the torque.

    Parameters
    ----------
    data : FlightData

    Returns
    -------
    bool
    """
    described = data.input
    return (
        described is not None
        and described.torque_per_thrust is not None
        and all(segment.rotor_thrust is not None for segment in data.segments)
    )


def per_rotor(segments: Sequence[Segment]) -> tuple[FloatArray, FloatArray]:
    """Return thrust and its derivative by the expo, of all rotors and samples in a row.

    Parameters
    ----------
    segments : sequence of Segment
        Some of which know both.

    Returns
    -------
    thrust, by_expo : ndarray, each of shape (n,)
    """
    pairs = [
        (each.rotor_thrust.ravel(), each.thrust_by_expo.ravel())
        for each in segments
        if each.rotor_thrust is not None and each.thrust_by_expo is not None
    ]
    thrust, by_expo = (np.concatenate(columns) for columns in zip(*pairs, strict=True))
    return thrust, by_expo


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
    period_s = design.sample_period_s
    return design.with_torque(
        [equivalent_torque(chunk, described, period_s, rotors) for chunk in design.chunks]
    )


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
    mean_s, asymmetry = rotors.mean_s, rotors.log_asymmetry
    period_s = design.sample_period_s

    def slope(ahead: Rotors, behind: Rotors, step: float) -> RowTorque:
        differences = (
            equivalent_torque(chunk, described, period_s, ahead)
            - equivalent_torque(chunk, described, period_s, behind)
            for chunk in design.chunks
        )
        return design.torque.replaced([difference / (2.0 * step) for difference in differences])

    return RotorSlopes(
        by_lag=slope(
            Rotors.of(mean_s * (1.0 + _STEP), asymmetry),
            Rotors.of(mean_s * (1.0 - _STEP), asymmetry),
            mean_s * _STEP,
        ),
        by_asymmetry=slope(Rotors.of(mean_s, asymmetry + _STEP), Rotors.of(mean_s, asymmetry - _STEP), _STEP),
    )


def equivalent_torque(
    segment: Segment, described: InputDescription, period_s: float, rotors: Rotors
) -> FloatArray:
    """Return the torque that, behind a linear lag, acts as rotors with their own lag do.

    Parameters
    ----------
    segment : Segment
    described : InputDescription
        With the ``torque_per_thrust`` of the rotors, in the torque's unit.
    period_s : float
        Between samples [s].
    rotors : Rotors

    Returns
    -------
    ndarray, shape (n_samples, 4)
        L, M, N, and what the rotors' reaction goes with: N to first order in their speeds. Where the thrust
        of each rotor is not known, the three of the segment as they are.
    """
    thrust, torque_per_thrust = segment.rotor_thrust, described.torque_per_thrust
    if thrust is None or torque_per_thrust is None:
        return segment.torque
    target = np.sqrt(thrust)
    change, reacting = beside_linear_lag(thrust, target, period_s, rotors, rotors.mean_s)
    reacting *= 2.0 * target.mean()
    found = np.empty((len(target), 4))
    np.add(segment.torque, change @ torque_per_thrust.T, out=found[:, :3])
    np.matmul(reacting, torque_per_thrust[2], out=found[:, 3])
    return found


def beside_linear_lag(
    thrust: FloatArray, target: FloatArray, period_s: float, rotors: Rotors, lag_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return what thrusts and speeds a linear lag would have to be given to act as rotors with their own do.

    Parameters
    ----------
    thrust, target : ndarray, shape (n_samples, n_rotors)
        What was commanded, and its square root: the speeds.
    period_s : float
        Between samples [s].
    rotors : Rotors
    lag_s : float
        The linear lag [s].

    Returns
    -------
    change : ndarray, shape (n_samples, n_rotors)
        To be added to the thrusts: F + T dF/dt = w^2 + 2 w (w* - w) T / T_w less F*, with the T_w of the
        direction.
    speed : ndarray, shape (n_samples, n_rotors)
        w + (w* - w) T / T_w.
    """
    speed = lagged_speeds(target, period_s, rotors)
    gap = target - speed
    # In place: a search makes this torque hundreds of times, and new memory takes longer than the sums.
    fraction = np.where(gap > 0.0, lag_s / rotors.up_s, lag_s / rotors.down_s)
    change, step = speed**2, 2.0 * speed
    step *= gap
    step *= fraction
    change += step
    change -= thrust
    fraction *= gap
    fraction += speed
    return change, fraction


def lagged_speeds(target: FloatArray, period_s: float, rotors: Rotors) -> FloatArray:
    """Return speeds that approach held targets exponentially, up and down with their own time constant.

    Parameters
    ----------
    target : ndarray, shape (n_samples, n_rotors)
    period_s : float
        Between samples [s].
    rotors : Rotors

    Returns
    -------
    ndarray, shape (n_samples, n_rotors)

    Notes
    -----
    The recursion runs through intervals of the flight side by side: each
    begins early enough for its own start to be forgotten.
    """
    up, down = (1.0 - np.exp(-period_s / lag_s) for lag_s in rotors)
    n_samples, n_rotors = target.shape
    warm = int(np.ceil(_FORGOTTEN * max(rotors) / period_s))
    length = max(_INTERVAL, _INTERVAL_OVER_WARM * warm)
    n_intervals = int(np.ceil(n_samples / length))
    before, after = (
        np.repeat(row, count, axis=0)
        for row, count in ((target[:1], warm), (target[-1:], n_intervals * length - n_samples))
    )
    padded = np.concatenate([before, target, after])
    intervals = np.lib.stride_tricks.sliding_window_view(padded, warm + length, axis=0)[::length]
    targets = np.ascontiguousarray(np.moveaxis(intervals, 2, 0))
    # Each goes a fraction of the way to its target in each step, another one up than down. Steps on axis 0;
    # each takes a microsecond or two, so nothing is allocated there.
    # Of both steps the larger one is that of its direction where `up` is the larger fraction.
    choose = np.maximum if up >= down else np.minimum
    found = np.empty_like(targets)
    gap, rise, fall = (np.empty_like(targets[0]) for _ in range(3))
    before = targets[0]
    for wanted, now in zip(targets, found, strict=True):
        np.subtract(wanted, before, out=gap)
        np.multiply(gap, up, out=rise)
        if up != down:
            np.multiply(gap, down, out=fall)
            choose(rise, fall, out=rise)
        np.add(before, rise, out=now)
        before = now
    return np.asarray(found[warm:].transpose(1, 0, 2).reshape(-1, n_rotors)[:n_samples])
