"""First-order recurrences with a step that varies, without a loop over the samples."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_banded

from quadid_logs.arrays import BoolArray, FloatArray


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
    return np.asarray(solve_banded((1, 0), bands, right, overwrite_b=True, check_finite=False), np.float64)


def anti_windup_sum(increments: FloatArray, limited: BoolArray, bound: float, *, first: float) -> FloatArray:
    """Sum increments up, but not away from zero where `limited`, and within +-`bound`.

    Parameters
    ----------
    increments : ndarray, shape (n,)
        The first one is not used.
    limited : ndarray of bool, shape (n,)
    bound : float
    first : float
        The sum at the first sample.

    Returns
    -------
    ndarray, shape (n,)
    """
    free = first + np.cumsum(np.where(np.arange(increments.size) > 0, increments, 0.0))
    if not limited.any() and np.abs(free).max(initial=0.0) <= bound:
        return free
    total, found = first, [first]
    for step, stopped in zip(increments[1:].tolist(), limited[1:].tolist(), strict=True):
        if not (stopped and total * step > 0.0):
            total = min(max(total + step, -bound), bound)
        found.append(total)
    return np.array(found)
