"""A motor that does not push for a moment: the vehicle turns as if one rotor were not there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.health.effectiveness import directions, motion
from quadid_logs.maths.recurrence import band_both_ways

#: The shortest loss that is searched for: a rotor needs about its lag to slow down, and as long to be back
#: [s].
_WINDOW_S: Final = 0.1
#: Four samples in a window.
_SLOWEST_HZ: Final = 40.0
#: What is called a loss: every axis by itself says that so much of the rotor's thrust was missing.
_LOST: Final = 0.5
#: Nothing loses more than all of it. What the controller answers to gusts halves the scale at most that is
#: found in a hover: a loop with 6 dB of gain margin answers with no more than twice what a gust needs.
_MOST: Final = 2.0
#: A rotor this near to an axis, in lengths of the arm, does not turn the vehicle about it.
_ON_AXIS: Final = 0.2
#: Band in which the scale of torque is found: what a slow command does [Hz].
_BAND_HZ: Final = (0.3, 5.0)
#: The tail of the windows is that beyond this quantile; above it, it is taken for exponential.
_TAIL: Final = 0.95
_FEWEST: Final = 100
#: What follows a loss is the controller's answer to it [s].
_ANSWER_S: Final = 1.0


class Desync(NamedTuple):
    """The clearest moment at which a rotor may have lost its thrust; ``rotor`` is -1 where there is none."""

    rotor: int
    time_s: float
    p_value: float


def find_desync(
    sent: CleanSeries,
    place: FloatArray,
    rate: CleanSeries,
    force: CleanSeries | None,
    intervals: Sequence[Interval],
) -> Desync | None:
    """Search for a moment at which one rotor's thrust was missing.

    Parameters
    ----------
    place : ndarray, shape (n_rotors, 3)
        As of `Commanded`.
    force : CleanSeries or None
        Specific force [m/s^2]: what touches the ground or hits something turns as suddenly, but is pushed.

    Returns
    -------
    Desync or None
        None where the log is too slow or too short to tell.
    """
    moved = motion(sent, rate, intervals, _SLOWEST_HZ)
    if moved is None:
        return None
    signs = directions(place)
    # Acceleration per torque of each axis; no answer where the two do not go together.
    y = np.concatenate([band_both_ways(one, _BAND_HZ, moved.period_s) for one in moved.acceleration])
    x = np.concatenate([band_both_ways(one @ signs.T, _BAND_HZ, moved.period_s) for one in moved.sent])
    power = np.sum(x**2, axis=0)
    if not (power > 0.0).all():
        return None
    scale = np.asarray(np.sum(x * y, axis=0) / power, dtype=np.float64)
    if not (scale > 0.0).all():
        return None
    width = max(2, round(_WINDOW_S / moved.period_s))
    hop = max(1, width // 4)
    parts = []
    columns = moved.time_s, moved.rate, moved.acceleration, moved.sent
    for time_s, rates, y, x in zip(*columns, strict=True):
        if len(y) < 4 * width:
            continue
        torque = scale * (x @ signs.T)
        means = _means(y - torque, width, hop)
        # The trim is no loss: against the median of the part.
        left = means - np.median(means, axis=0)
        # The acceleration that inertia and another lag than is assumed may make, (n, 3).
        lately = np.abs(torque - torque[np.maximum(np.arange(len(torque)) - width, 0)])
        values = _means(
            np.asarray(np.abs(rates[:, [1, 2, 0]] * rates[:, [2, 0, 1]]) + lately, dtype=np.float64),
            width,
            hop,
        )
        parts.append(
            _Windows(
                _means(time_s[:, np.newaxis], width, hop)[:, 0],
                left,
                _spread_before(left, hop * moved.period_s),
                _means(x, width, hop),
                np.asarray(
                    values[np.maximum(np.arange(len(values)) - (2 * width // hop), 0)], dtype=np.float64
                ),
            )
        )
    if sum(len(one.time_s) for one in parts) < _FEWEST:
        return None
    windows = _Windows(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    # Where the vehicle felt more than it was sent: where thrust is missing, it feels less.
    pushed = np.zeros(len(windows.time_s), dtype=np.bool_)
    if force is not None:
        rows = np.searchsorted(
            force.time_s, windows.time_s[:, np.newaxis] + _WINDOW_S * np.array([-0.5, 0.5])
        )
        felt = np.nan_to_num(np.linalg.norm(force.values[:, :3], axis=1))
        sums = np.concatenate([[0.0], np.cumsum(felt)])
        mean = (sums[rows[:, 1]] - sums[rows[:, 0]]) / np.maximum(rows[:, 1] - rows[:, 0], 1)
        total = windows.thrust.sum(axis=1)
        pushed = np.asarray(mean > np.median(mean) / np.median(total) * total, dtype=np.bool_)
    return _clearest(windows, scale[:, np.newaxis] * signs, pushed)


class _Windows(NamedTuple):
    """Means over windows.

    ``left`` (n, 3) is the acceleration that is not explained, ``spread`` its typical size, ``thrust``
    (n, n_rotors) what was sent, ``unmodelled`` (n, 3) as of `_unmodelled` just before: a
    loss turns the vehicle itself.
    """

    time_s: FloatArray
    left: FloatArray
    spread: FloatArray
    thrust: FloatArray
    unmodelled: FloatArray


def _spread_before(left: FloatArray, step_s: float) -> FloatArray:
    """Return the standard deviation of the second before each window, at least that of the whole part.

    In a manoeuvre much is left over; what comes after a loss is the controller's answer to it.
    """
    typical = np.median(np.abs(left), axis=0) / 0.6745
    n_before, apart = max(1, round(_ANSWER_S / step_s)), max(1, round(_WINDOW_S / step_s))
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(left**2, axis=0)])
    last = np.maximum(np.arange(len(left)) - apart, 0)
    first = np.maximum(last - n_before, 0)
    count = np.maximum(last - first, 1)[:, np.newaxis]
    return np.asarray(np.maximum(np.sqrt((sums[last] - sums[first]) / count), typical), dtype=np.float64)


def _means(values: FloatArray, width: int, hop: int) -> FloatArray:
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray((sums[width:] - sums[:-width])[::hop] / width, dtype=np.float64)


def _clearest(windows: _Windows, per_thrust: FloatArray, pushed: BoolArray) -> Desync:
    """Hold the clearest loss against what the same rotors seem to gain, which no fault makes."""
    nothing = Desync(-1, float("nan"), 1.0)
    if not (windows.spread > 0.0).all():
        return nothing
    best, rotor, place = 0.0, -1, 0
    gains = []
    typical = np.median(windows.thrust, axis=0)
    for number in range(per_thrust.shape[1]):
        sent = windows.thrust[:, number]
        missing = -per_thrust[:, number] * typical[number] / windows.spread
        weighted = np.sum(windows.left / windows.spread * missing, axis=1) / np.linalg.norm(missing, axis=1)
        gains.append(np.maximum(-weighted, 0.0))
        # What is missing is missing of what was sent at that moment, and of a rotor that was to push.
        # Each axis by itself says so: half of the thrust or more, not more than all of it.
        whole = -per_thrust[:, number] * sent[:, np.newaxis]
        arm = np.abs(np.median(whole, axis=0))
        said = ~pushed & (sent > _LOST * typical[number])
        for axis in np.flatnonzero(arm > _ON_AXIS * arm.max() * np.array([1.0, 1.0, 0.0])):
            towards, most = windows.left[:, axis] * np.sign(whole[:, axis]), np.abs(whole[:, axis])
            said &= (towards - windows.unmodelled[:, axis] >= _LOST * most) & (towards <= _MOST * most)
        clear = np.where(said, weighted, 0.0)
        if float(clear.max()) > best:
            best, rotor, place = float(clear.max()), number, int(np.argmax(clear))
    if rotor < 0:
        return nothing
    far = np.abs(windows.time_s - windows.time_s[place]) > _ANSWER_S
    return Desync(rotor, float(windows.time_s[place]), _chance(np.array(gains)[:, far], best))


def _chance(gains: FloatArray, size: float) -> float:
    """Return the chance of so large a window anywhere in the flight, for any rotor: an exponential tail."""
    if gains.size < _FEWEST:
        return 1.0
    limit = float(np.quantile(gains, _TAIL))
    beyond = gains[gains > limit] - limit
    if not beyond.size or not size > limit:
        return 1.0
    return float(min(1.0, beyond.size * np.exp(-(size - limit) / float(beyond.mean()))))
