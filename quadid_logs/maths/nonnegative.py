"""Least squares without negative coefficients.

Not scipy.optimize: importing it takes longer than the whole fit of a short flight.
"""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import FloatArray

#: An exchange of columns lowers the residual each time, so that none comes back; rounding could undo that.
_ROUNDS_PER_COLUMN = 10


def nonnegative_least_squares(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Return the coefficients >= 0 of least squared residual.

    Parameters
    ----------
    columns : ndarray, shape (n, n_columns)
    target : ndarray, shape (n,)

    Returns
    -------
    ndarray, shape (n_columns,)

    Notes
    -----
    The active-set method of C. L. Lawson and R. J. Hanson, Solving Least Squares Problems (1974), ch. 23.

    Examples
    --------
    >>> nonnegative_least_squares(np.eye(3), np.array([2.0, -1.0, 0.5])).tolist()
    [2.0, 0.0, 0.5]
    """
    n_columns = columns.shape[1]
    found = np.zeros(n_columns)
    used = np.zeros(n_columns, dtype=bool)
    rounding = 10.0 * max(columns.shape) * np.finfo(float).eps
    small = rounding * np.linalg.norm(columns, axis=0) * float(np.linalg.norm(target))
    for _ in range(_ROUNDS_PER_COLUMN * n_columns):
        gain = np.where(used, -np.inf, columns.T @ (target - columns @ found) - small)
        if used.all() or gain.max() <= 0.0:
            break
        used[gain.argmax()] = True
        while True:
            free = np.zeros(n_columns)
            free[used] = np.linalg.lstsq(columns[:, used], target, rcond=None)[0]
            below = used & (free <= 0.0)
            if not below.any():
                found = free
                break
            # As far towards the free solution as none becomes negative; what meets zero first goes.
            reach = found[below] / (found[below] - free[below])
            found += reach.min() * (free - found)
            used[np.flatnonzero(below)[reach == reach.min()]] = False
            found[~used] = 0.0
    return found
