"""Many tests at once: Holm's correction."""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import FloatArray


def holm(p_values: FloatArray) -> FloatArray:
    """Return p-values that hold for all tests together.

    Parameters
    ----------
    p_values : ndarray, shape (n,)
        One of each test, in any order and however dependent.

    Returns
    -------
    ndarray, shape (n,)
        If every adjusted p-value below 0.05 is called a difference, one false call or more happens in at most
        5 % of such families (S. Holm, Scandinavian J. Statistics 6, 1979).

    Examples
    --------
    >>> holm(np.array([0.01, 0.04, 0.03])).tolist()
    [0.03, 0.06, 0.06]
    """
    order = np.argsort(p_values)
    n = order.size
    adjusted = np.empty(n)
    adjusted[order] = np.maximum.accumulate(np.minimum(p_values[order] * np.arange(n, 0, -1), 1.0))
    return adjusted


def two_sided(z: FloatArray) -> FloatArray:
    """Return the p-values of standard normal values, either sign counted.

    Parameters
    ----------
    z : ndarray

    Returns
    -------
    ndarray, shape of ``z``

    Examples
    --------
    >>> two_sided(np.array([0.0, -1.96])).round(3).tolist()
    [1.0, 0.05]
    """
    from scipy.special import ndtr

    return np.asarray(2.0 * ndtr(-np.abs(z)), dtype=np.float64)
