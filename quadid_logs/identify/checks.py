"""Whether the estimate would have come out the same at another time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quadid_logs.data.model import ChangeCheck
from quadid_logs.identify.design import Design
from quadid_logs.identify.fit import Regression
from quadid_logs.identify.inference import Estimate, clusters_of
from quadid_logs.identify.structures import Structure
from quadid_logs.maths.least_squares import solve_least_squares
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.structural_change import largest_change
from quadid_logs.vocabulary import TORQUE_SYMBOLS


def check_change(
    design: Design, structure: Structure, regression: Regression, axes: Sequence[int]
) -> ChangeCheck:
    """Look for the time after which an axis' on-axis effectiveness is another one.

    Parameters
    ----------
    design : Design
        As it was fitted.
    structure : Structure
    regression : Regression
        Its rows.
    axes : sequence of int
        Axes that are excited.

    Returns
    -------
    ChangeCheck
        NaN on the other axes.
    """
    clusters, time_s = clusters_of(design), design.time_s[design.train]
    found = np.full((4, 3), np.nan)
    for axis in axes:
        own, others = _own_and_others(structure, regression, axis)
        columns = [own, *others]
        theta = solve_least_squares(
            regression.explained[:, columns], regression.Y[:, axis : axis + 1]
        ).coefficients[0]
        residual = regression.Y[:, axis] - regression.Z[:, columns] @ theta
        alone = solve_least_squares(
            regression.explained[:, others], regression.explained[:, own : own + 1]
        ).residuals[:, 0]
        change = largest_change(alone, residual, clusters)
        if change is not None:
            first = np.flatnonzero(clusters >= change.first_cluster)[0]
            found[:, axis] = (
                time_s[first],
                theta[0] + change.before,
                theta[0] + change.after,
                change.statistic,
            )
    return ChangeCheck(time_s=found[0], before=found[1], after=found[2], statistic=found[3])


def with_change(structure: Structure, estimate: Estimate, change: ChangeCheck) -> Estimate:
    """Widen the intervals of the on-axis effectiveness to what it was before and after a change that is seen.

    Parameters
    ----------
    structure : Structure
    estimate : Estimate
    change : ChangeCheck

    Returns
    -------
    Estimate
    """
    low, high = estimate.low.copy(), estimate.high.copy()
    for axis in np.flatnonzero(change.seen).tolist():
        place = axis, len(structure.terms) + axis
        first, last = before_and_after(change, axis)
        low[place], high[place] = min(low[place], first), max(high[place], last)
    return estimate._replace(low=low, high=high)


def before_and_after(change: ChangeCheck, axis: int) -> tuple[float, float]:
    """Return the ends of the 95 % intervals before and after a change, both together.

    Parameters
    ----------
    change : ChangeCheck
    axis : int
        0 roll, 1 pitch, 2 yaw.

    Returns
    -------
    low, high : float
    """
    first, last = sorted((float(change.before[axis]), float(change.after[axis])))
    half = NORMAL_95 * (last - first) / float(np.sqrt(change.statistic[axis]))
    return first - half, last + half


def _own_and_others(structure: Structure, regression: Regression, axis: int) -> tuple[int, list[int]]:
    """Return the column of the axis' own torque and all others that its row uses."""
    own = structure.columns.index(TORQUE_SYMBOLS[axis])
    return own, [int(column) for column in np.flatnonzero(regression.used[axis]) if column != own]
