"""What each rotor gives of what it is sent, where the rotors moved independently of each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import FloatArray
from quadid_logs.data.health import Quantity
from quadid_logs.health.records import records
from quadid_logs.maths.recurrence import band_both_ways, linear_filter
from quadid_logs.maths.student import student_95

#: Where the torque of single rotors moves the vehicle: above the trim, below the rotors' own lag [Hz].
_BAND_HZ: Final = (0.5, 8.0)
#: Of common rotors and gyro filters [s]. All rotors have it, and their differences do not depend on it.
LAG_S: Final = 0.03
_SLOWEST_HZ: Final = 40.0
#: Before the flight: all rotors are equal, and 95 % of them give half to one and a half times the mean.
_PRIOR: Final = 0.25
#: Wider intervals than this say no more than what is known of any rotor before the flight.
_KNOWN: Final = 0.2
_BLOCK_S: Final = 2.0
_FEWEST_BLOCKS: Final = 8
_STEPS: Final = 6


class Motion(NamedTuple):
    """Accelerations [rad/s^2] and what the rotors were sent, in parts without gaps.

    ``rate`` and ``acceleration`` (n, 3), ``sent`` (n, n_rotors) behind the lag, ``time_s`` (n,), each for
    every part.
    """

    time_s: list[FloatArray]
    rate: list[FloatArray]
    acceleration: list[FloatArray]
    sent: list[FloatArray]
    period_s: float


def motion(
    sent: CleanSeries, rate: CleanSeries, intervals: Sequence[Interval], slowest_hz: float
) -> Motion | None:
    """Put accelerations beside what the rotors were sent.

    Parameters
    ----------
    sent, rate : CleanSeries
        A column for each rotor, and the body rates [rad/s].
    slowest_hz : float
        Slower logs show too little.
    """
    found, period_s = records([rate, sent], intervals)
    if not found or not period_s * slowest_hz < 1.01:
        return None
    weight = period_s / (LAG_S + period_s)
    parts = [one for one in found if one.time_s.size * period_s >= _BLOCK_S and np.isfinite(one.values).all()]
    if not parts:
        return None
    return Motion(
        [one.time_s for one in parts],
        [one.values[:, :3] for one in parts],
        [np.asarray(np.gradient(one.values[:, :3], period_s, axis=0)) for one in parts],
        [
            one.values[0, 3:]
            + linear_filter((weight,), (1.0, weight - 1.0), one.values[:, 3:] - one.values[0, 3:])
            for one in parts
        ],
        period_s,
    )


def directions(place: FloatArray) -> FloatArray:
    """Return in which sense each rotor's thrust turns the vehicle about roll, pitch, yaw; (3, n_rotors)."""
    return np.asarray(np.column_stack([-place[:, 1], place[:, 0], place[:, 2]]).T, dtype=np.float64)


def find_effectiveness(
    sent: CleanSeries, place: FloatArray, rate: CleanSeries, intervals: Sequence[Interval]
) -> tuple[Quantity | None, ...]:
    """Fit one effectiveness for each rotor and one scale for each axis.

    What the controller answers to gusts moves rotors of a symmetric frame alike, and is in the scales: they
    are not reported.

    Parameters
    ----------
    place : ndarray, shape (n_rotors, 3)
        As of `Commanded`.

    Returns
    -------
    tuple of Quantity or None
        Over the mean of all rotors [1]; None where the flight tells no more than that rotors are alike.
    """
    nothing: tuple[Quantity | None, ...] = tuple(None for _ in place)
    moved = motion(sent, rate, intervals, _SLOWEST_HZ)
    if moved is None:
        return nothing
    step = max(1, int(1.0 / (4.0 * _BAND_HZ[1] * moved.period_s)))
    parts = [
        tuple(band_both_ways(one, _BAND_HZ, moved.period_s)[::step] for one in (y, x))
        for y, x in zip(moved.acceleration, moved.sent, strict=True)
    ]
    block = round(_BLOCK_S / (moved.period_s * step))
    blocks = [
        (y[begin : begin + block], x[begin : begin + block])
        for y, x in parts
        for begin in range(0, len(y) - block + 1, block)
    ]
    if len(blocks) < _FEWEST_BLOCKS:
        return nothing
    # Solve for scales and effectiveness in turn; errors by what the blocks differ.
    signs = directions(place)
    n_rotors = signs.shape[1]
    y = np.concatenate([one for one, _ in blocks])
    x = np.concatenate([one for _, one in blocks])
    gives = np.ones(n_rotors)
    scale, left = np.zeros(3), np.ones(3)
    for _ in range(_STEPS):
        torque = x @ (signs * gives).T
        power = np.sum(torque**2, axis=0)
        if not (power > 0.0).all():
            return tuple(None for _ in range(n_rotors))
        scale = np.sum(torque * y, axis=0) / power
        left = np.mean((y - scale * torque) ** 2, axis=0)
        # The normal equations of each block for the rotors' effectiveness, axes by their noise.
        squares, products = [], []
        for block_y, block_x in blocks:
            regressors = [scale[axis] * signs[axis] * block_x for axis in range(3)]
            squares.append(sum(one.T @ one / left[axis] for axis, one in enumerate(regressors)))
            products.append(sum(one.T @ block_y[:, axis] / left[axis] for axis, one in enumerate(regressors)))
        information, moment = np.array(squares), np.array(products)
        prior = np.eye(n_rotors) / _PRIOR**2
        gives = np.linalg.solve(
            information.sum(axis=0) + prior, moment.sum(axis=0) + prior @ np.ones(n_rotors)
        )
        gives = gives / gives.mean()
    inverse = np.linalg.inv(information.sum(axis=0) + prior)
    scores = moment - information @ gives
    spread = inverse @ (scores.T @ scores + prior) @ inverse
    # The mean of all is one by definition.
    centre = np.eye(n_rotors) - 1.0 / n_rotors
    sigma = np.sqrt(np.diagonal(centre @ spread @ centre.T))
    half = student_95(len(blocks) - 1) * sigma
    return tuple(
        Quantity(float(one), "1", (float(one - wide), float(one + wide))) if wide < _KNOWN else None
        for one, wide in zip(gives, half, strict=True)
    )
