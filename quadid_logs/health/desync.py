"""A motor that does not push for a moment: the vehicle turns as if one rotor were not there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.health.effectiveness import directions, motion

#: The shortest loss that is searched for: the rotor needs about its lag to slow down, and as long to be back [s].
_WINDOW_S: Final = 0.1
#: Four samples in a window.
_SLOWEST_HZ: Final = 40.0
#: What is called a loss: every axis by itself says that so much of the rotor's thrust was missing.
_LOST: Final = 0.5
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
    sent: CleanSeries, place: FloatArray, rate: CleanSeries, intervals: Sequence[Interval]
) -> Desync | None:
    """Search for a moment at which one rotor's thrust was missing.

    Parameters
    ----------
    sent : CleanSeries
    place : ndarray, shape (n_rotors, 3)
        As of `Commanded`.
    rate : CleanSeries
    intervals : sequence of (start_s, end_s)

    Returns
    -------
    Desync or None
        None where the log is too slow or too short to tell.
    """
    moved = motion(sent, rate, intervals, _SLOWEST_HZ)
    if moved is None:
        return None
    signs = directions(place)
    scale = _scale(moved.acceleration, moved.sent, signs, moved.period_s)
    if scale is None:
        return None
    width = max(2, round(_WINDOW_S / moved.period_s))
    hop = max(1, width // 4)
    times, left, thrust = [], [], []
    for time_s, y, x in zip(moved.time_s, moved.acceleration, moved.sent, strict=True):
        if len(y) < 4 * width:
            continue
        rest = y - scale * (x @ signs.T)
        times.append(_means(time_s[:, np.newaxis], width, hop)[:, 0])
        # The trim is no loss: against the median of the part.
        windows = _means(rest, width, hop)
        left.append(windows - np.median(windows, axis=0))
        thrust.append(_means(x, width, hop))
    if not times or sum(len(one) for one in times) < _FEWEST:
        return None
    return _clearest(np.concatenate(times), np.concatenate(left), np.concatenate(thrust), scale[:, np.newaxis] * signs)


def _scale(
    accelerations: Sequence[FloatArray], sent: Sequence[FloatArray], signs: FloatArray, period_s: float
) -> FloatArray | None:
    """Return acceleration per torque of each axis; None where torque and acceleration do not go together."""
    from scipy.signal import butter, sosfiltfilt

    band = butter(2, _BAND_HZ, "bandpass", fs=1.0 / period_s, output="sos")
    y = np.concatenate([sosfiltfilt(band, one, axis=0) for one in accelerations])
    x = np.concatenate([sosfiltfilt(band, one @ signs.T, axis=0) for one in sent])
    power = np.sum(x**2, axis=0)
    if not (power > 0.0).all():
        return None
    scale = np.sum(x * y, axis=0) / power
    return np.asarray(scale, dtype=np.float64) if (scale > 0.0).all() else None


def _means(values: FloatArray, width: int, hop: int) -> FloatArray:
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray((sums[width:] - sums[:-width])[::hop] / width, dtype=np.float64)


def _clearest(time_s: FloatArray, left: FloatArray, thrust: FloatArray, per_thrust: FloatArray) -> Desync:
    """Hold the clearest loss against what the same rotors seem to gain, which no fault makes."""
    spread = np.median(np.abs(left), axis=0) / 0.6745
    nothing = Desync(-1, float("nan"), 1.0)
    if not (spread > 0.0).all():
        return nothing
    best, rotor, place = 0.0, -1, 0
    gains = []
    usual = np.median(thrust, axis=0)
    for number in range(per_thrust.shape[1]):
        missing = -per_thrust[:, number] * usual[number]
        weighted = left / spread @ (missing / spread) / float(np.linalg.norm(missing / spread))
        gains.append(np.maximum(-weighted, 0.0))
        # What is missing is missing of what was sent at that moment.
        lost = _says(left, -per_thrust[:, number] * thrust[:, number, np.newaxis])
        clear = np.where(lost, weighted, 0.0)
        if float(clear.max()) > best:
            best, rotor, place = float(clear.max()), number, int(np.argmax(clear))
    if rotor < 0:
        return nothing
    far = np.abs(time_s - time_s[place]) > _ANSWER_S
    p_value = _chance(np.array(gains)[:, far], best)
    return Desync(rotor, float(time_s[place]), p_value)


def _says(left: FloatArray, missing: FloatArray) -> BoolArray:
    """Return where each axis by itself says that half of the thrust or more is missing."""
    arm = np.abs(np.median(missing, axis=0))
    turns = arm > _ON_AXIS * arm.max() * np.array([1.0, 1.0, 0.0])
    said: BoolArray = np.ones(len(left), dtype=np.bool_)
    for axis in np.flatnonzero(turns):
        said &= left[:, axis] * np.sign(missing[:, axis]) >= _LOST * np.abs(missing[:, axis])
    return said


def _chance(gains: FloatArray, size: float) -> float:
    """Return the chance of so large a window anywhere in the flight, for any rotor: an exponential tail."""
    if gains.size < _FEWEST:
        return 1.0
    limit = float(np.quantile(gains, _TAIL))
    beyond = gains[gains > limit] - limit
    if not beyond.size or not size > limit:
        return 1.0
    return float(min(1.0, beyond.size * np.exp(-(size - limit) / float(beyond.mean()))))
