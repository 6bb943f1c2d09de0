"""Regression of a quantity of which only the interval that it lies in is known."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray

#: Of expectation and maximisation, which is slow where few values leave their interval.
_MOST_ROUNDS, _SETTLED = 300, 1e-4
#: Samples that tell a factor and a scatter: more of them tell no more, and take longer.
_ENOUGH: Final = 5000
#: Of a normal distribution inside of an interval, below which rounding is all that is left.
_FAR: Final = 1e-12
_TINY = float(np.finfo(np.float64).tiny)


class _Expected(NamedTuple):
    """Mean and variance inside of each interval; both of shape (n,)."""

    mean: FloatArray
    variance: FloatArray


def expected_within(low: FloatArray, high: FloatArray, told: FloatArray) -> FloatArray:
    """Return what a quantity is expected to be that goes with another and is known to an interval.

    Parameters
    ----------
    low, high : ndarray, shape (n,)
        Ends of each interval.
    told : ndarray, shape (n,)
        What the quantity goes with, but for a factor and normal scatter, both of which are estimated.

    Returns
    -------
    ndarray, shape (n,)
        Between the ends.

    Notes
    -----
    Expectation and maximisation for a normal regression with interval-censored values (Stewart, J. R.
    Statist. Soc. B 45, 1983).

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> told = rng.normal(size=20_000)
    >>> value = 0.5 * told + 0.1 * rng.normal(size=20_000)
    >>> steps = np.trunc(value)
    >>> found = expected_within(steps - (steps <= 0.0), steps + (steps >= 0.0), told)
    >>> round(float(found @ told / (told @ told)), 2)
    0.5
    """
    factor, scatter = _regression(*(each[:: max(1, told.size // _ENOUGH)] for each in (low, high, told)))
    return _inside(low, high, factor * told, scatter).mean


def _regression(low: FloatArray, high: FloatArray, told: FloatArray) -> tuple[float, float]:
    """Return the factor and the scatter that are likeliest."""
    power = max(float(told @ told), _TINY)
    least = max(1e-3 * float(np.max(high - low, initial=0.0)), _TINY)
    value = 0.5 * (low + high)
    factor, scatter = float(value @ told) / power, max(float(np.std(value)), least)
    for _ in range(_MOST_ROUNDS):
        before = np.array([factor, scatter])
        value, variance = _inside(low, high, factor * told, scatter)
        factor = float(value @ told) / power
        scatter = max(float(np.sqrt(np.mean((value - factor * told) ** 2 + variance))), least)
        if np.all(np.abs(np.array([factor, scatter]) - before) < _SETTLED * np.abs(before)):
            break
    return factor, scatter


def _inside(low: FloatArray, high: FloatArray, mean: FloatArray, scatter: float) -> _Expected:
    """Return mean and variance of normal distributions that are cut off at both ends."""
    from scipy.special import ndtr

    first, last = (low - mean) / scatter, (high - mean) / scatter
    # Above the mean, differences of what is below would be rounding.
    inside = np.where(first > 0.0, ndtr(-first) - ndtr(-last), ndtr(last) - ndtr(first))
    near = inside > _FAR
    inside = np.where(near, inside, 1.0)
    before, after = (np.exp(-0.5 * end**2) / np.sqrt(2.0 * np.pi) for end in (first, last))
    shift = np.where(near, (before - after) / inside, 0.0)
    wide = np.where(near, 1.0 + (first * before - last * after) / inside - shift**2, 0.0)
    return _Expected(np.clip(mean + scatter * shift, low, high), scatter**2 * np.maximum(wide, 0.0))
