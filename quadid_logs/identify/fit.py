"""Pooled estimate of one structure with intervals that survive coloured residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.identify.actuator import ActuatorFit
from quadid_logs.identify.design import Design
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.rotors import RotorSlopes
from quadid_logs.identify.structures import THROTTLED_YAW, TRIM, Structure
from quadid_logs.maths.least_squares import (
    Equation,
    clustered_covariance,
    first_order_change,
    solve_least_squares,
)

#: Residuals of flight data are correlated over some tenths of a second (rate
#: loop, gusts); a second holds that memory, and thirty of them a variance.
_CLUSTER_S = 1.0
_MIN_CLUSTERS = 12
#: A lag with less phase than this [rad] at the smoothing cut-off acts as a
#: delay does; their derivatives are then parallel and only the sum is known.
_LAG_SEEN = 0.1


class TorqueUnknowns(NamedTuple):
    """What is not known of the torque beside lag and delay.

    ``slopes`` for how unevenly rotors lag; ``errors`` are designs with what
    the torque may have been off by (see `torque_errors`).
    """

    slopes: RotorSlopes | None = None
    errors: tuple[Design, ...] = ()


NOTHING_UNKNOWN: Final = TorqueUnknowns()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PooledFit:
    """One structure fitted to all training rows.

    Attributes
    ----------
    theta : ndarray, shape (n_targets, n_columns)
        [A B]; zero where a column was left out.
    half_width : ndarray, shape (n_targets, n_columns)
        Of the 95 % interval, infinite where it cannot be told.
    kept : ndarray of bool, shape (n_targets, n_columns)
    r2 : ndarray, shape (n_targets,)
        On the training rows.
    condition_number : float
        Of the column-scaled regressor matrix.
    n_parameters : int
        Numbers that were fitted, lag and delay among them.
    lag_half_width_s, delay_half_width_s : float
        NaN for a structure without actuator.
    disturbance : ndarray, shape (n_targets, n_disturbances)
        Coefficients of `Design.disturbances`.
    gyro : ndarray, shape (3, 3), or None
        Scale and cross-axis errors E of the gyro, where they were among the unknowns: it shows (I + E) w.
    seen : ndarray, shape (n_targets, n_columns), or None
        [A B] of the rates as shown, where that is not `theta`.
    """

    theta: FloatArray
    half_width: FloatArray
    kept: BoolArray
    r2: FloatArray
    condition_number: float
    rank: int
    n_parameters: int = 0
    lag_half_width_s: float = float("nan")
    delay_half_width_s: float = float("nan")
    disturbance: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    gyro: FloatArray | None = None
    seen: FloatArray | None = None

    @property
    def as_seen(self) -> FloatArray:
        """[A B] of the rates that the gyro shows: what the log is to be compared with."""
        return self.theta if self.seen is None else self.seen


class Problem(NamedTuple):
    """Z theta' = Y on the training rows.

    ``explained`` is what the instruments make of Z; ``used`` (n_targets,
    n_columns) which columns each target may use. The columns are those of the
    structure, then the disturbances.
    """

    Z: FloatArray
    explained: FloatArray
    Y: FloatArray
    used: BoolArray
    project: Projection


def problem_of(
    design: Design,
    structure: Structure,
    actuator: ActuatorFit | None,
    kept: BoolArray | None = None,
    *,
    average: int = 1,
) -> Problem:
    """Lay out the rows that a structure is fitted to; parameters as of `fit_pooled`."""
    train = design.train
    torque = (
        design.torque_as_logged() if actuator is None else design.torque(actuator.lag_s, actuator.delay_s)
    )
    # The paper's own structures are fitted as the paper does.
    instrumented = design if actuator is not None else design.without_instruments()
    whole = np.column_stack(
        [
            design.stack((*structure.columns, *design.disturbances(structure)), torque),
            *(design.columns[name] for name in structure.targets),
        ]
    )
    rows = design.averaged(whole, average)[train]
    n_targets = len(structure.targets)
    Z, Y = rows[:, :-n_targets], rows[:, -n_targets:]
    used = used_columns(design, structure, kept)
    project = Projection(instrumented, structure, train)
    return Problem(Z, project(Z), Y, used, project)


def used_columns(design: Design, structure: Structure, kept: BoolArray | None) -> BoolArray:
    """Return which columns of structure and disturbances each target may use; shape (n_targets, n_columns).

    Without what is slow there is no trim to be seen.
    """
    n_disturbances = len(design.disturbances(structure))
    used = np.ones((len(structure.targets), len(structure.columns) + n_disturbances), dtype=np.bool_)
    if kept is not None:
        used[:, : len(structure.columns)] = kept
    if design.high_pass_hz and TRIM in structure.columns:
        used[:, structure.columns.index(TRIM)] = False
    return used


def coefficients_of(problem: Problem) -> FloatArray:
    """Solve each row; shape (n_targets, n_columns), zero where a column is not used."""
    theta = np.zeros(problem.used.shape)
    for row, columns in enumerate(problem.used):
        solved = solve_least_squares(problem.explained[:, columns], problem.Y[:, row : row + 1])
        theta[row, columns] = solved.coefficients[0]
    return theta


def r2_of(problem: Problem) -> FloatArray:
    """Return R2 of each target as the problem's solution leaves it; shape (n_targets,)."""
    return share_explained(problem.Y, problem.Y - problem.Z @ coefficients_of(problem).T)


def fit_pooled(
    design: Design,
    structure: Structure,
    actuator: ActuatorFit | None,
    kept: BoolArray | None = None,
    unknown: TorqueUnknowns = NOTHING_UNKNOWN,
    *,
    average: int = 1,
) -> PooledFit:
    """Fit all targets of a structure to the training rows.

    Parameters
    ----------
    design : Design
    structure : Structure
    actuator : ActuatorFit or None
        Lag and delay that the torque passes; their uncertainty widens the
        intervals. None for the torque as logged.
    kept : ndarray of bool, shape (n_targets, n_columns), optional
        Columns that each target may use; all by default.
    unknown : TorqueUnknowns, optional
        What else of the torque is not known; it widens the intervals too.
    average : int
        Rows that both sides are averaged over first (the integral form).

    Returns
    -------
    PooledFit
    """
    problem = problem_of(design, structure, actuator, kept, average=average)
    Z, explained, Y, used, project = problem
    n_columns = len(structure.columns)
    theta = coefficients_of(problem)
    residual = Y - Z @ theta.T
    whole = solve_least_squares(Z[:, used.any(axis=0)], Y)
    B = theta[:, n_columns - 3 : n_columns]
    of_actuator = actuator_columns(design, actuator, B, unknown.slopes, average=average)
    shared = {name: project(column) for name, column in of_actuator.items()}
    errors = targets_changed(design, actuator, B, unknown, average=average)
    half_width, actuator_half_width = _half_widths(
        explained, residual, used, clusters_of(design), shared, errors
    )
    return PooledFit(
        theta=theta[:, :n_columns],
        half_width=half_width[:, :n_columns],
        kept=used[:, :n_columns],
        r2=share_explained(Y, residual),
        condition_number=whole.condition_number,
        rank=whole.rank,
        n_parameters=int(np.count_nonzero(used)) + len(shared),
        lag_half_width_s=actuator_half_width["lag"],
        delay_half_width_s=actuator_half_width["delay"],
        disturbance=theta[:, n_columns:],
    )


def with_trim(fit: PooledFit, structure: Structure, whole: Design, actuator: ActuatorFit) -> PooledFit:
    """Add the trim, which is slow, to a fit that was made without what is slow.

    Parameters
    ----------
    whole : Design
        The same rows with what is slow.

    Returns
    -------
    PooledFit
        With the mean of what the rest of the model leaves, and its interval.
    """
    train = whole.train
    torque = whole.torque(actuator.lag_s, actuator.delay_s, throttled=THROTTLED_YAW in structure.columns)
    Y = np.column_stack([whole.columns[name] for name in structure.targets])[train]
    rest = Y - whole.stack(structure.columns, torque)[train] @ fit.as_seen.T
    disturbances = whole.disturbances(structure)
    rest -= whole.stack(disturbances, torque)[train] @ fit.disturbance.T if disturbances else 0.0
    trim = rest.mean(axis=0)
    # Gusts last for seconds: a block is the least that counts as one observation of them.
    clusters = np.unique(whole.block[train], return_inverse=True)[1].astype(np.int64)
    ones = np.ones((len(rest), 1))
    half_width = [
        quantile_95(clusters)
        * np.sqrt(
            clustered_covariance([Equation(ones, left - left.mean(), np.array([0]))], clusters, 1)[0, 0]
        )
        for left in rest.T
    ]
    column = structure.columns.index(TRIM)
    theta, half_widths, kept = fit.theta.copy(), fit.half_width.copy(), fit.kept.copy()
    theta[:, column], half_widths[:, column], kept[:, column] = trim, half_width, True
    seen = None if fit.seen is None else fit.seen.copy()
    if seen is not None:
        seen[:, column] = trim
    return replace(
        fit,
        theta=theta,
        seen=seen,
        half_width=half_widths,
        kept=kept,
        n_parameters=fit.n_parameters + len(trim),
    )


def share_explained(Y: FloatArray, residual: FloatArray) -> FloatArray:
    """Return R2 of each column; shape (n_targets,)."""
    spread = np.sum((Y - Y.mean(axis=0)) ** 2, axis=0)
    return np.asarray(1.0 - np.sum(residual**2, axis=0) / np.where(spread > 0.0, spread, np.inf))


def quantile_95(clusters: IntArray) -> float:
    """Return the two-sided 95 % quantile of Student's t that a variance from so many stretches needs."""
    from scipy.special import stdtrit

    return float(stdtrit(max(int(clusters.max()), 1), 0.975))


def clusters_of(design: Design) -> IntArray:
    """Return the number of the stretch that each row is in; residuals are correlated inside one only."""
    train = design.train
    length_s = min(_CLUSTER_S, np.count_nonzero(train) * design.period_s / _MIN_CLUSTERS)
    # Stretches end where a segment or a block ends: only neighbours in time are correlated.
    elapsed = np.floor((design.time_s - design.time_s[0]) / length_s)
    key = np.stack([design.block, elapsed.astype(np.int64)])[:, train]
    return np.asarray(np.unique(key, axis=1, return_inverse=True)[1].ravel(), dtype=np.int64)


def actuator_columns(
    design: Design,
    actuator: ActuatorFit | None,
    B: FloatArray,
    slopes: RotorSlopes | None,
    *,
    average: int = 1,
) -> Mapping[str, FloatArray]:
    """Return the derivatives of all targets by lag, delay and unevenness, each (n_train, n_targets)."""
    if actuator is None:
        return {}
    lag_s, delay_s = actuator.lag_s, actuator.delay_s

    def of_targets(torque: FloatArray) -> FloatArray:
        return np.asarray(design.averaged(torque, average)[design.train] @ B.T)

    delay = of_targets(design.torque_by_delay(lag_s, delay_s))
    if actuator.lag_s * 2.0 * np.pi * design.smoothing_hz < _LAG_SEEN:
        return {"delay": delay}
    by_lag = design.torque_by_lag(lag_s, delay_s)
    if slopes is None:
        return {"lag": of_targets(by_lag), "delay": delay}
    of_rotors, uneven = (slope.torque(lag_s, delay_s) for slope in slopes)
    return {"lag": of_targets(by_lag + of_rotors), "delay": delay, "unevenness": of_targets(uneven)}


def targets_changed(
    design: Design,
    actuator: ActuatorFit | None,
    B: FloatArray,
    unknown: TorqueUnknowns,
    *,
    average: int = 1,
) -> FloatArray:
    """Return what errors of the torque make of the targets; shape (n_train, n_targets, n_errors)."""
    train = design.train
    if actuator is None or not unknown.errors:
        return np.zeros((np.count_nonzero(train), len(B), 0))
    torques = (error.torque(actuator.lag_s, actuator.delay_s) for error in unknown.errors)
    return np.stack([design.averaged(torque, average)[train] @ B.T for torque in torques], axis=2)


def covariance_95(
    equations: Sequence[Equation],
    clusters: IntArray,
    errors: FloatArray,
    n_parameters: int,
    prior_precision: FloatArray | None = None,
) -> FloatArray:
    """Return the covariance whose roots are half widths of 95 % intervals.

    Parameters
    ----------
    equations, clusters, n_parameters, prior_precision
        As of `clustered_covariance`.
    errors : ndarray, shape (n_samples, n_equations, n_errors)
        What possible errors of the torque, each at its 95 %, make of the
        targets, weighted as their residuals are.

    Returns
    -------
    ndarray, shape (n_parameters, n_parameters)
    """
    of_residuals = clustered_covariance(equations, clusters, n_parameters, prior_precision)
    by_row = [errors[:, row] for row in range(len(equations))]
    change = first_order_change(equations, by_row, n_parameters, prior_precision)
    return np.asarray(quantile_95(clusters) ** 2 * of_residuals + change @ change.T)


def _half_widths(
    Z: FloatArray,
    residual: FloatArray,
    kept: BoolArray,
    clusters: IntArray,
    shared: Mapping[str, FloatArray],
    errors: FloatArray,
) -> tuple[FloatArray, dict[str, float]]:
    """Return half widths of the 95 % intervals of theta, and of lag and delay.

    All targets are stacked into one problem, because lag and delay are common
    to them; each target is weighted by its residual.
    """
    weight = 1.0 / np.maximum(np.sqrt(np.mean(residual**2, axis=0)), 1e-12)
    offsets = np.concatenate([[0], np.cumsum(np.count_nonzero(kept, axis=1))]).astype(np.int64)
    n_own = int(offsets[-1])
    of_actuator = np.arange(n_own, n_own + len(shared), dtype=np.int64)
    equations = []
    for row, columns in enumerate(kept):
        derivatives = [derivative[:, row : row + 1] for derivative in shared.values()]
        equations.append(
            Equation(
                jacobian=np.concatenate([Z[:, columns], *derivatives], axis=1) * weight[row],
                residuals=residual[:, row] * weight[row],
                parameters=np.concatenate([np.arange(offsets[row], offsets[row + 1]), of_actuator]),
            )
        )
    covariance = covariance_95(equations, clusters, errors * weight[:, np.newaxis], n_own + len(shared))
    half = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    half_width = np.full(kept.shape, np.inf)
    for row, columns in enumerate(kept):
        half_width[row, columns] = half[offsets[row] : offsets[row + 1]]
    names = list(shared)
    return half_width, {
        name: float(half[n_own + names.index(name)]) if name in shared else float("nan")
        for name in ("lag", "delay")
    }
