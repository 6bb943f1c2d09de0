"""Whether the estimate would have come out the same in another way, or at another time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import ChangeCheck, FormulationCheck
from quadid_logs.identify.actuator_model import ActuatorModel
from quadid_logs.identify.design import Design
from quadid_logs.identify.fit import PooledFit, Regression, fit_pooled
from quadid_logs.identify.inference import Estimate, clusters_of
from quadid_logs.identify.structures import Structure
from quadid_logs.maths.least_squares import column_scale, solve_least_squares
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.structural_change import largest_change
from quadid_logs.vocabulary import TORQUE_SYMBOLS

#: Length of the integrals of the integral form: a quarter of a second gives
#: motion below 2 Hz most weight, the Gaussians of the weak form that up to 5 Hz.
_INTEGRAL_S = 0.25
#: The quantiles of 400 resampled estimates are known to a tenth.
_RESAMPLED = 400
#: Fewer blocks than these cannot be resampled to anything.
_FEWEST_BLOCKS = 6


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
        first, last = sorted((change.before[axis], change.after[axis]))
        half = NORMAL_95 * (last - first) / np.sqrt(change.statistic[axis])
        low[place], high[place] = min(low[place], first - half), max(high[place], last + half)
    return estimate._replace(low=low, high=high)


def check_formulations(model: ActuatorModel, structure: Structure, fit: PooledFit) -> FormulationCheck:
    """Fit the integral formulation, with boxcars as test functions, beside the weak one with its Gaussians.

    Parameters
    ----------
    model : ActuatorModel
    structure : Structure
    fit : PooledFit
        In the weak formulation.

    Returns
    -------
    FormulationCheck
    """
    n_rows = max(2, round(_INTEGRAL_S / model.design.period_s))
    integral = fit_pooled(model.design, structure, model.actuator, fit.kept, model.unknown, average=n_rows)
    both = (fit, integral)
    return FormulationCheck(
        on_axis_gain=np.array([structure.on_axis(each.theta) for each in both]),
        half_width=np.array([structure.on_axis(each.half_width) for each in both]),
    )


def bootstrapped_half_width(design: Design, structure: Structure, regression: Regression) -> FloatArray:
    """Return half widths of the 95 % intervals of B11, B22, B33 by resampling blocks; shape (3,).

    Blocks are longer than any memory of the residuals, so they may be drawn
    with replacement (H. R. Kunsch, Annals of Statistics 17, 1989). NaN where
    there are too few.

    Parameters
    ----------
    design : Design
    structure : Structure
    regression : Regression
        Its training rows.

    Returns
    -------
    ndarray, shape (3,)
        [rad/s^2 per unit of torque].
    """
    blocks = np.unique(design.block[design.train], return_inverse=True)[1]
    n_blocks = int(blocks.max()) + 1
    half_width = np.full(3, np.nan)
    if n_blocks < _FEWEST_BLOCKS:
        return half_width
    scale = column_scale(regression.explained)
    ends = np.flatnonzero(np.diff(blocks)) + 1
    left, right, target = (
        np.split(each, ends) for each in (regression.explained / scale, regression.Z / scale, regression.Y)
    )
    squares = np.array([a.T @ b for a, b in zip(left, right, strict=True)])
    products = np.array([a.T @ b for a, b in zip(left, target, strict=True)])
    even = np.full(n_blocks, 1.0 / n_blocks)
    drawn = np.random.default_rng(0).multinomial(n_blocks, even, size=_RESAMPLED).astype(np.float64)
    gram, moment = np.tensordot(drawn, squares, 1), np.tensordot(drawn, products, 1)
    for axis in range(3):
        own, others = _own_and_others(structure, regression, axis)
        columns = [own, *others]
        try:
            theta = np.linalg.solve(gram[:, columns][:, :, columns], moment[:, columns, axis, np.newaxis])
        except np.linalg.LinAlgError:
            continue
        # Quantiles: where a draw misses the few blocks with a manoeuvre, its estimate is anything.
        low, high = np.quantile(theta[:, 0, 0], [0.025, 0.975])
        half_width[axis] = 0.5 * (high - low) / scale[own]
    return half_width


def _own_and_others(structure: Structure, regression: Regression, axis: int) -> tuple[int, list[int]]:
    """Return the column of the axis' own torque and all others that its row uses."""
    own = structure.columns.index(TORQUE_SYMBOLS[axis])
    return own, [int(column) for column in np.flatnonzero(regression.used[axis]) if column != own]
