"""Many tests of one thing: which of them say something."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quadid_logs.arrays import FloatArray


def adjusted(p_values: FloatArray) -> FloatArray:
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
    >>> adjusted(np.array([0.01, 0.04, 0.03])).tolist()
    [0.03, 0.06, 0.06]
    """
    order = np.argsort(p_values)
    n = order.size
    found = np.empty(n)
    found[order] = np.maximum.accumulate(np.minimum(p_values[order] * np.arange(n, 0, -1), 1.0))
    return found


def holm(p_values: Sequence[float], level: float) -> tuple[bool, ...]:
    """Return which hypotheses are rejected so that none is by chance, but with this probability.

    Parameters
    ----------
    p_values : sequence of float
        Of tests that may depend on each other in any way.
    level : float
        Probability of at least one false rejection.

    Returns
    -------
    tuple of bool

    References
    ----------
    .. [1] S. Holm, "A simple sequentially rejective multiple test procedure," Scand. J. Statist., vol. 6,
       pp. 65-70, 1979.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.02], 0.05)
    (True, True, True)
    >>> holm([0.01, 0.04, 0.03], 0.05)
    (True, False, False)
    """
    return tuple(bool(each <= level) for each in adjusted(np.asarray(p_values, dtype=np.float64)))


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
