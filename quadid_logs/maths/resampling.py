"""From irregular samples to a uniform grid, without aliasing and without inventing data."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from quadid_logs.arrays import FloatArray

#: Half length of the anti-alias filter, in periods of the output grid: the
#: transition from pass to stop band then fits between 0.35 and 0.5 of its rate.
_FILTER_PERIODS = 8
#: A step of more than so many medians is a pause, unless more than one in ten is as long.
_PAUSE_MEDIANS, _RARE = 5.0, 0.1


def typical_period(time_s: FloatArray) -> float:
    """Return the mean of the steps [s] that are no pauses; NaN for fewer than two times.

    The median alone misleads where stamps lie on a coarse grid or come in
    bunches; the mean alone where there are gaps. A pause is a step of more
    than five medians, far above any jitter, and rare: where many steps are that
    long, they are the rhythm of bunches, and count.

    Parameters
    ----------
    time_s : ndarray, shape (n_samples,)
        Increasing [s].

    Returns
    -------
    float
    """
    steps = np.diff(time_s)
    if steps.size and not steps.min() > 0.0:
        steps = steps[steps > 0.0]
    if steps.size == 0:
        return float("nan")
    longest = _PAUSE_MEDIANS * np.median(steps)
    # Most series hold neither repeated stamps nor pauses: nothing is copied.
    while steps.max() > longest:
        long = steps > longest
        if np.count_nonzero(long) <= _RARE * steps.size:
            return float(np.mean(steps[~long]))
        longest = _PAUSE_MEDIANS * np.median(steps[long])
    return float(np.mean(steps))


def resample(
    time_s: FloatArray, values: FloatArray, grid_s: FloatArray, period_s: float | None = None
) -> FloatArray:
    """Interpolate linearly onto a uniform grid, low-passing first where the grid is coarser.

    Parameters
    ----------
    time_s : ndarray, shape (n_in,)
        Strictly increasing [s].
    values : ndarray, shape (n_in, n_columns)
    grid_s : ndarray, shape (n_out,)
        Uniform [s].
    period_s : float, optional
        Typical period of the samples [s], if it is known: then only those near the grid are looked at.

    Returns
    -------
    ndarray, shape (n_out, n_columns)
        Held constant beyond the first and the last sample.
    """
    return _resample(time_s, values, grid_s, period_s, _interpolate)


def resample_held(
    time_s: FloatArray, values: FloatArray, grid_s: FloatArray, period_s: float | None = None
) -> FloatArray:
    """Average what held during each period of a uniform grid, low-passing first where it is coarser.

    For a quantity that is set and then holds until it is set again. Averages
    over a period do not care whether a sample falls just before or just after
    a grid point; on evenly spaced samples they are the samples.

    Parameters
    ----------
    time_s : ndarray, shape (n_in,)
        Strictly increasing [s].
    values : ndarray, shape (n_in, n_columns)
    grid_s : ndarray, shape (n_out,)
        Uniform [s].
    period_s : float, optional
        Typical period of the samples [s], if it is known: then only those near the grid are looked at.

    Returns
    -------
    ndarray, shape (n_out, n_columns)

    Examples
    --------
    >>> resample_held(np.array([0.0, 1.5]), np.array([[1.0], [2.0]]), np.array([0.0, 1.0, 2.0]))[:, 0]
    array([1. , 1.5, 2. ])
    """
    return _resample(time_s, values, grid_s, period_s, _hold)


def fill_gaps(
    time_s: FloatArray, values: FloatArray, period_s: float, longest_s: float
) -> tuple[FloatArray, FloatArray]:
    """Put in what is missing in gaps on a straight line: an output is not held for as long as a gap lasts.

    Parameters
    ----------
    time_s : ndarray, shape (n_in,)
        Strictly increasing [s].
    values : ndarray, shape (n_in, n_columns)
    period_s : float
        Of the samples [s].
    longest_s : float
        A longer step is a gap [s].

    Returns
    -------
    time_s : ndarray, shape (n_out,)
    values : ndarray, shape (n_out, n_columns)
        The same arrays where there is no gap.
    """
    steps = np.diff(time_s)
    gaps = np.flatnonzero(steps > longest_s)
    if not gaps.size:
        return time_s, values
    missing = [time_s[gap] + np.arange(1, round(steps[gap] / period_s)) * period_s for gap in gaps.tolist()]
    every_s = np.sort(np.concatenate([time_s, *missing]))
    return every_s, _interpolate(time_s, values, every_s)


def _resample(
    time_s: FloatArray,
    values: FloatArray,
    grid_s: FloatArray,
    period_s: float | None,
    between: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
) -> FloatArray:
    """Evaluate between the samples; on a coarser grid, densely first and then low-passed."""
    factor = _decimation_factor(typical_period(time_s) if period_s is None else period_s, grid_s)
    if factor == 1:
        return between(*_near(time_s, values, grid_s), grid_s)
    period = (grid_s[-1] - grid_s[0]) / (len(grid_s) - 1)
    margin = _FILTER_PERIODS * factor
    fine = grid_s[0] + (np.arange(-margin, (len(grid_s) - 1) * factor + margin + 1)) * (period / factor)
    # A windowed-sinc low-pass at 0.42 of the output rate.
    n = np.arange(-_FILTER_PERIODS * factor, _FILTER_PERIODS * factor + 1)
    kernel = np.sinc(0.84 * n / factor) * np.blackman(len(n))
    kernel = kernel / kernel.sum()
    dense = between(*_near(time_s, values, fine), fine)
    smooth = np.stack([np.convolve(column, kernel, mode="valid") for column in dense.T], axis=1)
    return np.ascontiguousarray(smooth[::factor])


def _near(time_s: FloatArray, values: FloatArray, grid_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the samples that a grid needs: a log of many short segments would be copied once for each."""
    step = grid_s[-1] - grid_s[-2] if len(grid_s) > 1 else 0.0
    first, after = np.searchsorted(time_s, [grid_s[0], grid_s[-1] + step])
    near = slice(max(int(first) - 1, 0), int(after) + 1)
    return time_s[near], values[near]


def _decimation_factor(period_s: float, grid_s: FloatArray) -> int:
    """Return how many input samples fall into one grid period (1 if about as many or fewer)."""
    if len(grid_s) < 2 or not period_s > 0.0:
        return 1
    ratio = (grid_s[-1] - grid_s[0]) / (len(grid_s) - 1) / period_s
    return int(np.ceil(ratio)) if ratio > 1.25 else 1


def _interpolate(time_s: FloatArray, values: FloatArray, grid_s: FloatArray) -> FloatArray:
    """Interpolate each column linearly."""
    found = np.empty((grid_s.size, values.shape[1]))
    for number, column in enumerate(values.T):
        found[:, number] = np.interp(grid_s, time_s, column)
    return found


def _hold(time_s: FloatArray, values: FloatArray, grid_s: FloatArray) -> FloatArray:
    """Return the mean of the held values from each grid point to the next."""
    if len(grid_s) < 2:
        return _interpolate(time_s, values, grid_s)
    edges = np.append(grid_s, 2.0 * grid_s[-1] - grid_s[-2])
    # Each value holds to the next time; the first one from ever, the last one for ever.
    since = np.concatenate([[min(edges[0], time_s[0])], time_s[1:], [max(edges[-1], time_s[-1])]])
    area = np.concatenate(
        [np.zeros((1, values.shape[1])), np.cumsum(np.diff(since)[:, np.newaxis] * values, axis=0)]
    )
    return np.diff(_interpolate(since, area, edges), axis=0) / np.diff(edges)[:, np.newaxis]
