"""The grid of values that whole numbers leave in a signal."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray

#: A level of a grid comes again; values that lie on none are each their own.
_COMES_AGAIN: Final = 3
#: So many of the samples lie on the grid: the others were clipped, or interpolated.
_ON_GRID: Final = 0.9
#: Single precision, in fractions of the largest value.
_SAME: Final = 1e-6
#: Distances between two neighbouring levels that are tried, the smallest first.
_MOST_STEPS: Final = 64
#: How far a level may be off a multiple of the step, in steps.
_OFF: Final = 0.05


def step_of(values: FloatArray) -> float:
    """Return the step between the values that a signal takes.

    Parameters
    ----------
    values : ndarray, shape (n,)

    Returns
    -------
    float
        0 where the values lie on no grid about zero, or on a single level.

    Examples
    --------
    >>> t = np.arange(0.0, 20.0, 0.01)
    >>> round(step_of(np.trunc(40.0 * np.sin(t)) / 8.0), 4), step_of(np.sin(t))
    (0.125, 0.0)
    """
    size = np.abs(values[np.isfinite(values)])
    if not size.size or not (largest := float(size.max())) > 0.0:
        return 0.0
    level, count = np.unique(np.rint(size / (_SAME * largest)), return_counts=True)
    again = count >= _COMES_AGAIN
    if count[again].sum() < _ON_GRID * size.size or np.count_nonzero(again) < 2:
        return 0.0
    # What stood still on the ground, or at a limit, may be on levels of its own: no more than a tenth of all.
    levels = level[again & (level > 0.0)] * _SAME * largest
    samples = count[again & (level > 0.0)]
    steps = np.unique(np.diff(np.append(0.0, levels)))
    for step in steps[steps * _OFF > _SAME * largest][:_MOST_STEPS].tolist():
        multiple = levels / step
        off = samples[np.abs(multiple - np.rint(multiple)) > _OFF].sum()
        if size.size - count[~again].sum() - off >= _ON_GRID * size.size:
            return float(step)
    return 0.0
