"""Recurrences without a loop over the samples.

Not scipy.signal: it takes longer to import than everything else that an analysis needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray

#: Three times the coefficients of a filter of fourth order.
_REFLECTED: Final = 15


def linear_filter(
    numerator: Sequence[float] | FloatArray, denominator: Sequence[float] | FloatArray, values: FloatArray
) -> FloatArray:
    """Return values behind a digital filter that starts from zero.

    Parameters
    ----------
    numerator, denominator : sequence of float
        Coefficients b of the present value and those before it, a of the result; a[0] is 1.
    values : ndarray, shape (n,) or (n, n_columns)
        x, filtered along the first axis.

    Returns
    -------
    ndarray, shape of `values`
        y[k] = b[0] x[k] + b[1] x[k-1] + ... - a[1] y[k-1] - a[2] y[k-2] - ...
    """
    bands = np.tile(np.asarray(denominator, dtype=np.float64), (len(values), 1)).T
    found = np.empty(values.shape)
    # Column by column: what is needed on the way is as large as one of them.
    by_column = (found, values) if values.ndim > 1 else (found[:, np.newaxis], values[:, np.newaxis])
    for result, column in zip(*(each.T for each in by_column), strict=True):
        driven = numerator[0] * np.asarray(column, dtype=np.float64)
        for late, coefficient in enumerate(numerator[1:], start=1):
            driven[late:] += coefficient * column[:-late]
        result[:] = _substituted(bands, driven)
    return found


def lag(values: FloatArray, period_s: float, lag_s: float) -> FloatArray:
    """Return held values behind a first-order lag, from rest at their first.

    Parameters
    ----------
    values : ndarray, shape (n,) or (n, n_columns)
    period_s, lag_s : float
        Between the values; time constant, positive.

    Returns
    -------
    ndarray, shape of `values`
    """
    decay = float(np.exp(-period_s / lag_s))
    found = linear_filter((1.0 - decay,), (1.0, -decay), values - values[:1])
    found += values[:1]
    return found


def band_both_ways(values: FloatArray, band_hz: tuple[float, float], period_s: float) -> FloatArray:
    """Return values behind a Butterworth band-pass of second order, run forwards and backwards: no phase.

    Parameters
    ----------
    values : ndarray, shape (n,) or (n, n_columns)
        More of them than are reflected at either end.
    band_hz : (low, high)
        Where one run leaves half of the power; below half the sample rate.
    period_s : float
        Between the values [s].

    Returns
    -------
    ndarray, shape of `values`

    Notes
    -----
    The ends are reflected about their last values, and each run begins as if its first value had always stood
    there, as in `scipy.signal.sosfiltfilt`.
    """
    before = 2.0 * values[:1] - values[_REFLECTED:0:-1]
    after = 2.0 * values[-1:] - values[-2 : -_REFLECTED - 2 : -1]
    found = np.concatenate([before, values, after])
    sections = _butterworth_band(*band_hz, period_s)
    for _ in range(2):
        found = found - found[:1]
        for numerator, denominator in sections:
            found = linear_filter(numerator, denominator, found)
        found = found[::-1]
    return found[_REFLECTED : _REFLECTED + len(values)]


def _butterworth_band(low_hz: float, high_hz: float, period_s: float) -> list[tuple[FloatArray, FloatArray]]:
    """Return both sections of a band-pass of second order, by the bilinear transform."""
    low, high = (2.0 / period_s * np.tan(np.pi * each * period_s) for each in (low_hz, high_hz))
    width, centre = high - low, low * high
    # Each pole of the low-pass, at 135 degrees and its mirror, becomes two of the band-pass.
    half = 0.5 * width * np.exp(0.75j * np.pi)
    aside = np.sqrt(half**2 - centre + 0j)
    sections = []
    for pole in (half + aside, half - aside):
        at = (2.0 / period_s + pole) / (2.0 / period_s - pole)
        gain = 2.0 / period_s * width / np.abs(2.0 / period_s - pole) ** 2
        sections.append((gain * np.array([1.0, 0.0, -1.0]), np.array([1.0, -2.0 * at.real, np.abs(at) ** 2])))
    return sections


def _substituted(bands: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a lower triangular system with few diagonals, (n_bands, n); the first one counts as ones."""
    from scipy.linalg.lapack import dtbtrs

    if not len(right):
        return right
    found, _ = dtbtrs(bands, right, uplo="L", diag="U", overwrite_b=True)
    return np.asarray(found, dtype=np.float64).reshape(right.shape)


def low_pass(values: FloatArray, cutoff_hz: float, step_s: FloatArray, *, first: float) -> FloatArray:
    """Return y[k] = y[k-1] + alpha[k] (x[k] - y[k-1]) with alpha = h / (h + 1 / (2 pi f)).

    Parameters
    ----------
    values : ndarray, shape (n,)
        x.
    cutoff_hz : float
        f; what is not positive switches the filter off.
    step_s : ndarray, shape (n,)
        The step h that led to each value [s].
    first : float
        y[0].

    Returns
    -------
    ndarray, shape (n,)
    """
    if not cutoff_hz > 0.0:
        return values
    alpha = step_s / (step_s + 1.0 / (2.0 * np.pi * cutoff_hz))
    bands = np.ones((2, values.size))
    bands[1, :-1] = alpha[1:] - 1.0
    right = alpha * values
    right[0] = first
    return _substituted(bands, right)


def anti_windup_sum(
    increments: FloatArray,
    limited: BoolArray,
    bound: float,
    *,
    first: float,
    told: FloatArray | None = None,
) -> FloatArray:
    """Sum increments up, but not away from zero where `limited`, and within +-`bound`.

    Parameters
    ----------
    increments : ndarray, shape (n,)
        The first one is not used.
    limited : ndarray of bool, shape (n,)
    bound : float
    first : float
        The sum at the first sample.
    told : ndarray, shape (n,), optional
        The sum as another tells it. Where that is on the other side of zero, and nearer than an increment, it
        says which way is away from zero: by a rounding alone a whole increment would be taken or left out,
        and that for good.

    Returns
    -------
    ndarray, shape (n,)
    """
    free = first + np.cumsum(np.where(np.arange(increments.size) > 0, increments, 0.0))
    if not limited.any() and np.abs(free).max(initial=0.0) <= bound:
        return free
    total, found = first, [first]
    sides = np.zeros(increments.size) if told is None else told
    for step, stopped, side in zip(
        increments[1:].tolist(), limited[1:].tolist(), sides[:-1].tolist(), strict=True
    ):
        rounded = total * side < 0.0 and abs(total - side) < abs(step)
        if not (stopped and (side if rounded else total) * step > 0.0):
            total += step
            # Not by min and max, which take as long as all else.
            if total > bound:
                total = bound
            elif total < -bound:
                total = -bound
        found.append(total)
    return np.array(found)
