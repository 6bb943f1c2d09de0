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
#: Of the widest.
_LEAST_WIDTH = 1e-6


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
    value, variance = _known(value, half_width)
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


class RandomEffectMean(NamedTuple):
    """The mean of what estimates are estimates of.

    Attributes
    ----------
    value, half_width : float
        The mean with half of its 95 % interval.
    sd : float
        Of what the estimates are estimates of.
    sd_ci95 : (float, float)
        Its 95 % interval; the upper end is infinite for a single estimate.
    next_half_width : float
        Half of the 95 % interval of what one more estimate would be of.
    """

    value: float
    half_width: float
    sd: float
    sd_ci95: tuple[float, float]
    next_half_width: float


def random_effect_mean(value: FloatArray, half_width: FloatArray) -> RandomEffectMean:
    """Return the mean of estimates that may differ beyond their own errors.

    Parameters
    ----------
    value, half_width : ndarray, shape (n,)
        Estimates, and half of their 95 % intervals; what is not finite or positive is left out.

    Returns
    -------
    RandomEffectMean
        NaN and infinite widths where no estimate is known.

    Notes
    -----
    Weights and interval as of `random_effect`, the latter never narrower than the estimates' own errors make
    it (C. Roever, G. Knapp and T. Friede, BMC Medical Research Methodology 15, 2015). The interval of the
    standard deviation is the Q-profile's (W. Viechtbauer, Statistics in Medicine 26, 2007), that of a further
    one of J. Higgins, S. Thompson and D. Spiegelhalter (J. Royal Statistical Society A 172, 2009).

    Examples
    --------
    >>> found = random_effect_mean(np.array([1.0, 1.3, 0.8, 1.1]), np.full(4, 0.04))
    >>> round(found.value, 2), round(found.half_width, 2), round(found.sd, 2), round(found.sd_ci95[1], 2)
    (1.05, 0.33, 0.21, 0.78)
    """
    sd = random_effect(value, half_width).sd
    value, variance = _known(value, half_width)
    n = value.size
    if not n:
        return RandomEffectMean(math.nan, math.inf, math.nan, (0.0, math.inf), math.inf)
    weight = 1.0 / (variance + sd**2)
    mean = float(np.average(value, weights=weight))
    own = NORMAL_95**2 / float(weight.sum())
    spread = float(weight @ (value - mean) ** 2) / max(n - 1, 1)
    t = student_95(n - 1)
    squared = max(own, t**2 * spread / float(weight.sum())) if n > 1 else own
    return RandomEffectMean(
        mean, math.sqrt(squared), sd, _sd_interval(value, variance), math.sqrt(squared + (t * sd) ** 2)
    )


def _sd_interval(value: FloatArray, variance: FloatArray) -> tuple[float, float]:
    """Return the standard deviations at which the generalised chi-square has its 97.5 and 2.5 % points."""
    from scipy.optimize import brentq
    from scipy.special import chdtri

    n = value.size
    if n < 2:
        return 0.0, math.inf
    # In units of their scatter, so that the search ends whatever the unit.
    scale = math.sqrt(float(np.var(value, ddof=1) + variance.mean()))
    value, variance = (value - value.mean()) / scale, variance / scale**2

    def excess(sd: float, point: float) -> float:
        weight = 1.0 / (variance + sd**2)
        return float(weight @ (value - np.average(value, weights=weight)) ** 2) - point

    def solved(point: float) -> float:
        """Return where the falling chi-square meets a point; 0 where it begins below."""
        largest = math.sqrt(n / point) * 4.0
        return 0.0 if excess(0.0, point) <= 0.0 else float(brentq(excess, 0.0, largest, args=(point,)))

    low, high = (solved(float(chdtri(n - 1, tail))) for tail in (0.025, 0.975))
    if not high:
        # They agree better than their own errors let expect: their whole scatter bounds what is between them.
        high = math.sqrt((n - 1) * float(np.var(value, ddof=1)) / float(chdtri(n - 1, 0.975)))
    return scale * low, scale * high


def _known(value: FloatArray, half_width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the estimates that are known, with their variances."""
    known = np.isfinite(value) & np.isfinite(half_width) & (half_width > 0.0)
    width = half_width[known]
    # Beyond, squares of weights are lost to rounding; one that knows a million times more is all that counts.
    width = np.maximum(width, _LEAST_WIDTH * width.max(initial=0.0))
    return value[known], (width / NORMAL_95) ** 2
