"""Whether one coefficient stays the same over time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray

#: Fraction of the information that either side of a change must hold (Andrews' trimming).
_TRIMMED = 0.15


class StructuralChange(NamedTuple):
    """The likeliest change of one coefficient.

    ``first_cluster`` is the first cluster after it; ``before`` and ``after``
    are the coefficient's deviations from the fit to all samples on both
    sides; ``statistic`` is their squared difference over its variance.
    """

    first_cluster: int
    before: float
    after: float
    statistic: float


def largest_change(
    regressor: FloatArray, residual: FloatArray, clusters: IntArray
) -> StructuralChange | None:
    r"""Find where a coefficient changes most, against what its residuals allow.

    For each time, the coefficient's deviation before and after it, and the
    squared difference over its variance (Wald), which is that of scores summed
    over clusters, so that coloured residuals count in full. The largest over
    all times passes 8.7 in 5 % and 12.2 in 1 % of series without change.

    Parameters
    ----------
    regressor : ndarray, shape (n_samples,)
        Orthogonal to the other regressors.
    residual : ndarray, shape (n_samples,)
        Of the fit to all samples.
    clusters : ndarray of int, shape (n_samples,)
        Number of the cluster (consecutive samples) of each sample, from 0 in order of time.

    Returns
    -------
    StructuralChange or None
        None where no time has enough information on both sides.

    References
    ----------
    D. W. K. Andrews, "Tests for parameter instability and structural change
    with unknown change point," Econometrica 61, 1993; critical values of the
    corrigendum, Econometrica 71, 2003, one parameter, 15 % trimming.
    """
    information = np.bincount(clusters, regressor**2)
    score = np.bincount(clusters, regressor * residual)
    sums = np.cumsum(np.stack([information, score, score**2, score * information, information**2]), axis=1)
    G, S, SS, SG, GG = sums[:, :-1]
    total = sums[:, -1:]
    if not total[0, 0] > 0.0:
        return None
    inside = (_TRIMMED * total[0] < G) & ((1.0 - _TRIMMED) * total[0] > G)
    if not inside.any():
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        before, after = S / G, (total[1] - S) / (total[0] - G)
        variance = (SS - 2.0 * before * SG + before**2 * GG) / G**2
        rest = total[2:] - sums[2:, :-1]
        variance += (rest[0] - 2.0 * after * rest[1] + after**2 * rest[2]) / (total[0] - G) ** 2
        statistic = np.where(inside & (variance > 0.0), (after - before) ** 2 / variance, 0.0)
    best = int(np.argmax(statistic))
    return StructuralChange(best + 1, float(before[best]), float(after[best]), float(statistic[best]))
