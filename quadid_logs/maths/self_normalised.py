"""Means of correlated series, and changes of them, without an estimate of how far the correlation reaches.

The difference of two means is held against the partial sums of the parts themselves. Their ratio has one
distribution for every series whose correlation dies out (X. Shao and X. Zhang, *Testing for Change Points in
Time Series*, JASA 105, 2010; N. Kiefer and T. Vogelsang, Econometric Theory 21, 2005). Its quantiles below
are those of 200 000 random walks of 200 steps.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray

_P: Final = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001)
_OF_MEAN: Final = (3.5, 15.0, 28.3, 45.6, 75.0, 101.5, 130.1, 176.1, 212.2, 252.8, 315.3, 368.0)
_OF_ONE_CHANGE: Final = (3.1, 12.5, 22.4, 34.5, 54.0, 71.5, 91.6, 122.0, 147.1, 176.0, 207.3, 227.6)
_OF_ANY_CHANGE: Final = (18.4, 42.2, 63.5, 86.9, 121.8, 151.9, 184.5, 231.3, 268.2, 305.3, 349.1, 392.3)
#: Where the part before a change may end, and the part behind it begin: what is between them is a ramp.
_CUTS: Final = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
#: Found by simulated series (`_of_short_parts`).
_SHORT = 8.0
#: Fewer steps have no such limit.
FEWEST: Final = 40


class Mean(NamedTuple):
    """A mean with half of its 95 % interval, and the p-value that it lies beyond a dead zone by chance."""

    value: float
    half_width: float
    p_value: float


class Difference(NamedTuple):
    """Of the means of two parts, with half of its 95 % interval."""

    value: float
    half_width: float


class Change(NamedTuple):
    """A change of the mean.

    Attributes
    ----------
    before, after : slice
        The two parts that show it best.
    size : Difference
    p_value : float
        That a series without a change shows one as clear at any place.
    detectable : float
        The size that would have had a p-value of 0.002 there.
    """

    before: slice
    after: slice
    size: Difference
    p_value: float
    detectable: float


def mean_of(values: FloatArray, dead_zone: float = 0.0) -> Mean:
    """Return the mean of a series whose neighbours may be alike.

    Parameters
    ----------
    values : ndarray, shape (n_steps,)
    dead_zone : float
        The p-value is that of a true mean within plus or minus this.

    Returns
    -------
    Mean
    """
    value, square = _part(values)
    beyond = max(abs(value) - dead_zone, 0.0)
    half_width = float(np.sqrt(_quantile(_OF_MEAN, 0.05) * square))
    return Mean(value, half_width, _p_value(_OF_MEAN, _ratio(beyond, square)))


def change_of(values: FloatArray) -> Change | None:
    """Search for a change of the mean, sudden or slow.

    Parameters
    ----------
    values : ndarray, shape (n_steps,)

    Returns
    -------
    Change or None
        None where there are too few steps.
    """
    n_steps = len(values)
    if n_steps < FEWEST:
        return None
    places = [round(cut * n_steps) for cut in _CUTS]
    best, found = -1.0, None
    for place, end in enumerate(places):
        for begin in places[place:]:
            parts = slice(0, end), slice(begin, n_steps)
            value, square = _between(values, *parts)
            if (ratio := _ratio(value, square)) > best:
                best, found = ratio, (*parts, value, square)
    if found is None:
        return None
    before, after, value, square = found
    square *= _of_short_parts(values[before], values[after])
    return Change(
        before,
        after,
        Difference(value, float(np.sqrt(_quantile(_OF_ONE_CHANGE, 0.05) * square))),
        _p_value(_OF_ANY_CHANGE, _ratio(value, square)),
        float(np.sqrt(_quantile(_OF_ANY_CHANGE, 0.002) * square)),
    )


def between(values: FloatArray, before: slice, after: slice) -> Difference:
    """Return by how much the mean of a part lies above that of an earlier one.

    Parameters
    ----------
    values : ndarray, shape (n_steps,)
    before, after : slice

    Returns
    -------
    Difference
    """
    value, square = _between(values, before, after)
    return Difference(value, float(np.sqrt(_quantile(_OF_ONE_CHANGE, 0.05) * square)))


def _between(values: FloatArray, before: slice, after: slice) -> tuple[float, float]:
    (first, of_first), (last, of_last) = _part(values[before]), _part(values[after])
    return last - first, of_first + of_last


def _part(values: FloatArray) -> tuple[float, float]:
    """Return the mean, and the square of the partial sums by which it is judged."""
    mean = float(values.mean())
    return mean, float(np.sum(np.cumsum(values - mean) ** 2)) / float(len(values)) ** 3


def _of_short_parts(*parts: FloatArray) -> float:
    """Return how much too small partial sums are where parts are few times as long as their correlation.

    The limit is reached for endless parts. Of first-order autoregressive series of 100 to 600 steps with
    coefficients of up to 0.8, 0.2 to 0.6 % (1.2 % of a hundred steps at 0.8) pass for a change at 0.2 %, and
    up to 8 % at 5 %: without this up to 4.9 and 23 %.
    """
    rests = [part - part.mean() for part in parts]
    power = sum(float(rest @ rest) for rest in rests)
    alike = sum(float(rest[1:] @ rest[:-1]) for rest in rests)
    coefficient = min(max(alike / power, 0.0), 0.95) if power > 0.0 else 0.0
    correlated_steps = (1.0 + coefficient) / (1.0 - coefficient) - 1.0
    return 1.0 + _SHORT * correlated_steps / min(len(part) for part in parts)


def _ratio(difference: float, square: float) -> float:
    return difference**2 / square if square > 0.0 else 0.0


def _quantile(table: tuple[float, ...], p_value: float) -> float:
    return table[_P.index(p_value)]


def _p_value(table: tuple[float, ...], ratio: float) -> float:
    """Interpolate between the quantiles; the least that is told is that of the last."""
    return float(np.exp(np.interp(ratio, (0.0, *table), np.log((1.0, *_P)))))
