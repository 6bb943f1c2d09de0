"""Curves between evenly spaced samples.

Not scipy.interpolate: importing it takes a third of the time that a refused log does.
"""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import FloatArray


def finer(values: FloatArray, times: int) -> FloatArray:
    """Return a cubic spline through evenly spaced samples, so many times finer.

    Parameters
    ----------
    values : ndarray, shape (..., n), n >= 4
    times : int
        Steps in each step of the samples.

    Returns
    -------
    ndarray, shape (..., times * (n - 1) + 1)
        Every `times`-th value is a sample.

    Notes
    -----
    The first two and the last two cubics are one: "not a knot" (C. de Boor, A Practical Guide to Splines,
    ch. IV).

    Examples
    --------
    >>> finer(np.array([0.0, 1.0, 8.0, 27.0]), 2).round(9).tolist()
    [0.0, 0.125, 1.0, 3.375, 8.0, 15.625, 27.0]
    """
    from scipy.linalg import solve_banded

    n = values.shape[-1]
    change = np.diff(values)
    # Slopes per step make the second derivatives of neighbours meet, the third ones at both ends.
    bands = np.tile([[1.0], [4.0], [1.0]], n)
    bands[0, 1] = bands[2, -2] = 2.0
    bands[1, [0, -1]] = 1.0
    between = np.empty((*values.shape[:-1], n))
    between[..., 1:-1] = 3.0 * (change[..., :-1] + change[..., 1:])
    between[..., 0] = 0.5 * (5.0 * change[..., 0] + change[..., 1])
    between[..., -1] = 0.5 * (5.0 * change[..., -1] + change[..., -2])
    slope = solve_banded((1, 1), bands, between.reshape(-1, n).T).T.reshape(between.shape)
    u = np.arange(times) / times
    start, rise = values[..., :-1, None], change[..., None]
    bend = (1.0 - u) * (slope[..., :-1, None] - rise) - u * (slope[..., 1:, None] - rise)
    curve = start + u * rise + u * (1.0 - u) * bend
    return np.concatenate([curve.reshape(*values.shape[:-1], -1), values[..., -1:]], axis=-1)
