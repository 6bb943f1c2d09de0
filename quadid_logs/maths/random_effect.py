"""Whether several estimates are of one value, and what is known of their mean where they are not."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.student import chi_square_tail, student_95

#: Of two, the spread between others could be anything.
_FEWEST: int = 3


class RandomEffect(NamedTuple):
    """How far estimates differ beyond their own errors.

    Attributes
    ----------
    n : int
        Of estimates that are known.
    chi_square, p_value : float
        Of their being of one value.
    sd : float
        Of what they are estimates of.
    half_width : float
        What this adds, squared, to the squared half width of a mean that is weighted, and known, by their own
        errors alone; 0 for fewer than three.
    """

    n: int
    chi_square: float
    p_value: float
    sd: float
    half_width: float


def random_effect(value: FloatArray, half_width: FloatArray) -> RandomEffect:
    """Ask whether estimates are of one value.

    Parameters
    ----------
    value, half_width : ndarray, shape (n,)
        Estimates, and half of their 95 % intervals; what is not finite or positive is left out.

    Returns
    -------
    RandomEffect

    Notes
    -----
    Cochran's test; the variance between by R. DerSimonian and N. Laird (Controlled Clinical Trials 7, 1986);
    the factor on the variance of the mean, and Student's t, by J. Hartung and G. Knapp (Statistics in
    Medicine 20, 2001), whose intervals hold for few estimates too.

    Examples
    --------
    >>> found = random_effect(np.array([1.0, 1.02, 0.98, 1.01]), np.full(4, 0.04))
    >>> round(found.p_value, 2), found.sd
    (0.55, 0.0)
    >>> found = random_effect(np.array([1.0, 1.3, 0.8, 1.1]), np.full(4, 0.04))
    >>> found.p_value < 1e-6, round(found.sd, 2), round(found.half_width, 2)
    (True, 0.21, 0.33)
    """
    known = np.isfinite(value) & np.isfinite(half_width) & (half_width > 0.0)
    value, variance = value[known], (half_width[known] / NORMAL_95) ** 2
    n = value.size
    if n < 2:
        return RandomEffect(n, 0.0, 1.0, 0.0, 0.0)
    weight = 1.0 / variance
    chi_square = float(weight @ (value - weight @ value / weight.sum()) ** 2)
    between = chi_square - (n - 1)
    between = max(between / float(weight.sum() - weight @ weight / weight.sum()), 0.0)
    total = variance + between
    spread = float(np.sum((value - np.average(value, weights=1.0 / total)) ** 2 / total)) / (n - 1)
    share = weight / weight.sum()
    whole = student_95(n - 1) ** 2 * spread * float(share**2 @ total)
    own = NORMAL_95**2 * float(share**2 @ variance)
    added = math.sqrt(max(whole - own, 0.0)) if n >= _FEWEST else 0.0
    return RandomEffect(n, chi_square, chi_square_tail(chi_square, n - 1), math.sqrt(between), added)
