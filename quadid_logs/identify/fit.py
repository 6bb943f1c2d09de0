"""Pooled estimate of one structure, each equation by itself, from all training rows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.identify.actuator import ActuatorFit
from quadid_logs.identify.design import Design
from quadid_logs.identify.inference import (
    NOTHING_UNKNOWN,
    TorqueEffects,
    TorqueUnknowns,
    Uncertainty,
    clusters_of,
    feedback_left,
    infer,
    student_quantile,
    torque_effects,
)
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.terms import AIR_SPEED, LOOP_SYMBOLS, ROTOR_DAMPING, TRIM, YAW_REACTION
from quadid_logs.maths.least_squares import Equation, clustered_covariance, solve_least_squares

_YAW = 2
_AIR_SPEED = tuple(term.symbol for term in AIR_SPEED)


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
    r2_commanded : ndarray, shape (n_targets,), or None
        Of what follows from the instruments; `r2` without any.
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
    measured : ndarray, shape (n_targets, n_columns), or None
        [A B] of the rates as measured, where that is not `theta`.
    of_axes : ndarray, shape (3, 5, 5), or None
        As of `quadid_logs.identify.inference.Uncertainty.of_axes`; None for a structure without actuator.
    """

    theta: FloatArray
    half_width: FloatArray
    kept: BoolArray
    r2: FloatArray
    condition_number: float
    n_parameters: int = 0
    lag_half_width_s: float = float("nan")
    delay_half_width_s: float = float("nan")
    disturbance: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    gyro: FloatArray | None = None
    measured: FloatArray | None = None
    of_axes: FloatArray | None = None
    r2_commanded: FloatArray | None = None

    @property
    def as_measured(self) -> FloatArray:
        """[A B] of the rates that the gyro shows: what the log is to be compared with."""
        return self.theta if self.measured is None else self.measured


class Regression(NamedTuple):
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

    def solve(self) -> FloatArray:
        """Solve each equation; shape (n_targets, n_columns), zero where a column is not used."""
        theta = np.zeros(self.used.shape)
        for row, columns in enumerate(self.used):
            solved = solve_least_squares(self.explained[:, columns], self.Y[:, row : row + 1])
            theta[row, columns] = solved.coefficients[0]
        return theta

    def r2(self, theta: FloatArray) -> FloatArray:
        """Return R2 of each target as `theta` (n_targets, n_columns) explains it; shape (n_targets,)."""
        return explained_fraction(self.Y, self.Y - self.Z @ theta.T)

    def r2_commanded(self, theta: FloatArray, design: Design) -> FloatArray:
        """Return R2 of what follows from the instruments, which no gust makes less; `r2` without any."""
        if design.instruments is None:
            return self.r2(theta)
        project = Projection.onto(design.instruments[design.train])
        return commanded_fraction(project, self.Y, self.Y - self.Z @ theta.T)


def lay_out(
    design: Design,
    structure: Structure,
    actuator: ActuatorFit | None,
    kept: BoolArray | None = None,
    *,
    all_instruments: bool = False,
) -> Regression:
    """Lay out the rows that a structure is fitted to.

    Parameters
    ----------
    design, structure, actuator, kept
        As of `fit_pooled`.
    all_instruments : bool
        For more columns than those of the structure: none is left out.

    Returns
    -------
    Regression
    """
    train = design.train
    torque = (
        design.torque.as_logged()
        if actuator is None
        else design.torque.behind(actuator.lag_s, actuator.delay_s, structure.inputs)
    )
    # The paper's own structures are fitted as the paper does.
    instrumented = design if actuator is not None else design.without_instruments()
    names = (*structure.columns, *design.disturbances(structure), *structure.targets)
    rows = design.stack(names, torque, structure.inputs)[train]
    n_targets = len(structure.targets)
    Z, Y = rows[:, :-n_targets], rows[:, -n_targets:]
    project = Projection(instrumented, structure, train)
    if actuator is not None and not all_instruments:
        by_time = times_of(design, actuator)[train]
        project = project.jackknifed(np.column_stack([Z, by_time]), clusters_of(design))
    return Regression(Z, project(Z), Y, used_columns(design, structure, kept), project)


def times_of(design: Design, actuator: ActuatorFit) -> FloatArray:
    """Return the derivatives of the torque by lag and delay; shape (n_rows, 6).

    Parameters
    ----------
    design : Design
    actuator : ActuatorFit

    Returns
    -------
    ndarray, shape (n_rows, 6)
    """
    lag_s, delay_s = actuator.lag_s, actuator.delay_s
    by_lag, by_delay = design.torque.by_lag(lag_s, delay_s), design.torque.by_delay(lag_s, delay_s)
    return np.column_stack([by_lag, by_delay])


def used_columns(design: Design, structure: Structure, kept: BoolArray | None) -> BoolArray:
    """Return which columns of structure and disturbances each target may use; shape (n_targets, n_columns).

    Of high-passed rows there is no trim to be seen, and rotors damp each axis by its own column.

    Parameters
    ----------
    design : Design
    structure : Structure
    kept : ndarray of bool, shape (n_targets, n_structure_columns), or None
        All by default.

    Returns
    -------
    ndarray of bool, shape (n_targets, n_columns)
    """
    n_disturbances = len(design.disturbances(structure))
    used = np.ones((len(structure.targets), len(structure.columns) + n_disturbances), dtype=np.bool_)
    if kept is not None:
        used[:, : len(structure.columns)] = kept
    if design.high_pass_hz and TRIM in structure.terms:
        used[:, structure.terms.index(TRIM)] = False
    names = (*structure.columns, *design.disturbances(structure))
    for term in ROTOR_DAMPING:
        if term.symbol in names:
            used[np.arange(len(used)) != term.axis, names.index(term.symbol)] = False
    if YAW_REACTION in structure.terms:
        # Air tilts a vehicle and does not turn it about its yaw axis, but slow as it is it passes for N.
        used[_YAW, [number for number, name in enumerate(names) if name in _AIR_SPEED]] = False
    return used


def fit_pooled(
    design: Design,
    structure: Structure,
    actuator: ActuatorFit | None,
    kept: BoolArray | None = None,
    unknown: TorqueUnknowns = NOTHING_UNKNOWN,
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

    Returns
    -------
    PooledFit
    """
    regression = lay_out(design, structure, actuator, kept)
    return fit_laid_out(regression, design, structure, actuator, unknown)


def fit_laid_out(
    regression: Regression,
    design: Design,
    structure: Structure,
    actuator: ActuatorFit | None,
    unknown: TorqueUnknowns = NOTHING_UNKNOWN,
) -> PooledFit:
    """Fit as `fit_pooled` does, to rows that are laid out.

    Parameters
    ----------
    regression : Regression
        As of `lay_out` for the others.
    design, structure, actuator, unknown
        As of `fit_pooled`.

    Returns
    -------
    PooledFit
    """
    Z, _, Y, used, project = regression
    n_columns = len(structure.columns)
    theta = regression.solve()
    symbols = structure.torques
    B = theta[:, [structure.columns.index(symbol) for symbol in symbols]]
    effects = torque_effects(design, actuator, B, unknown, project, symbols=symbols)
    found = _uncertainty(design, regression, theta, effects)
    half_width = np.full(used.shape, np.inf)
    half_width[used] = found.half_width
    return PooledFit(
        theta=theta[:, :n_columns],
        half_width=half_width[:, :n_columns],
        kept=used[:, :n_columns],
        r2=regression.r2(theta),
        r2_commanded=regression.r2_commanded(theta, design),
        condition_number=solve_least_squares(Z[:, used.any(axis=0)], Y).condition_number,
        n_parameters=int(np.count_nonzero(used)) + len(effects.shared),
        lag_half_width_s=found.lag_s,
        delay_half_width_s=found.delay_s,
        disturbance=theta[:, n_columns:],
        of_axes=None if actuator is None else found.of_axes(_one_each(structure, used)),
    )


def _one_each(structure: Structure, used: BoolArray) -> FloatArray:
    """Return the slopes of what a loop is made of where every coefficient is a parameter.

    Shape (3, 3, n_parameters), as `Uncertainty.of_axes` takes them; zero where an axis has none.
    """
    number = np.cumsum(used.ravel()).reshape(used.shape) - 1
    slopes = np.zeros((3, 3, int(np.count_nonzero(used))))
    for axis, symbols in enumerate(LOOP_SYMBOLS):
        for row, symbol in enumerate(symbols):
            column = structure.columns.index(symbol) if symbol in structure.columns else -1
            if column >= 0 and used[axis, column]:
                slopes[axis, row, number[axis, column]] = 1.0
    return slopes


def _uncertainty(
    design: Design, regression: Regression, theta: FloatArray, effects: TorqueEffects
) -> Uncertainty:
    """Return how well theta, lag and delay are known.

    All targets are stacked into one problem, because lag and delay are common
    to them; each target is weighted by its residual.
    """
    residual = regression.Y - regression.Z @ theta.T
    weight = 1.0 / np.maximum(np.sqrt(np.mean(residual**2, axis=0)), 1e-12)
    used = regression.used
    number = np.cumsum(used.ravel()).reshape(used.shape) - 1
    equations = [
        Equation(regression.explained[:, columns], residual[:, row], number[row, columns].astype(np.int64))
        for row, columns in enumerate(used)
    ]
    jacobians = ((regression.Z[:, columns], regression.explained[:, columns]) for columns in used)
    feedback = feedback_left(design, jacobians, regression.project.n_instruments)
    n_used = int(np.count_nonzero(used))
    return infer(equations, weight, clusters_of(design), effects, n_used, feedback=feedback)


def with_trim(fit: PooledFit, structure: Structure, whole: Design, actuator: ActuatorFit) -> PooledFit:
    """Add the trim, which is slow, to a fit that was made to high-passed rows.

    Parameters
    ----------
    fit : PooledFit
    structure : Structure
        A structure without trim leaves the fit as it is.
    whole : Design
        The same rows, not high-passed.
    actuator : ActuatorFit

    Returns
    -------
    PooledFit
        With the mean of what the rest of the model leaves, and its interval.
    """
    if TRIM not in structure.terms:
        return fit
    train = whole.train
    torque = whole.torque.behind(actuator.lag_s, actuator.delay_s, structure.inputs)
    Y = np.column_stack([whole.columns[name] for name in structure.targets])[train]
    rest = Y - whole.stack(structure.columns, torque, structure.inputs)[train] @ fit.as_measured.T
    for name, coefficients in zip(whole.disturbances(structure), fit.disturbance.T, strict=True):
        rest -= whole.columns[name][train, np.newaxis] * coefficients
    trim = rest.mean(axis=0)
    column = structure.terms.index(TRIM)
    theta, half_width, kept = fit.theta.copy(), fit.half_width.copy(), fit.kept.copy()
    theta[:, column], half_width[:, column], kept[:, column] = trim, _mean_half_width(rest, whole), True
    measured = None if fit.measured is None else fit.measured.copy()
    if measured is not None:
        measured[:, column] = trim
    return replace(
        fit,
        theta=theta,
        measured=measured,
        half_width=half_width,
        kept=kept,
        n_parameters=fit.n_parameters + len(trim),
    )


def _mean_half_width(columns: FloatArray, design: Design) -> list[float]:
    """Return the half width of the 95 % interval of the mean of each column of the training rows."""
    # Gusts last for seconds: a block is the least that counts as one observation of them.
    blocks = np.unique(design.block[design.train], return_inverse=True)[1].astype(np.int64)
    ones = np.ones((len(columns), 1))
    equations = [Equation(ones, column - column.mean(), np.array([0])) for column in columns.T]
    return [
        student_quantile(blocks) * float(np.sqrt(clustered_covariance([each], blocks, 1)[0, 0]))
        for each in equations
    ]


def commanded_fraction(project: Projection, Y: FloatArray, residual: FloatArray) -> FloatArray:
    """Return R2 of each column as far as it follows from instruments; shape (n_targets,).

    Parameters
    ----------
    project : Projection
        On the instruments.
    Y, residual : ndarray, shape (n_rows, n_targets)

    Returns
    -------
    ndarray, shape (n_targets,)
        1 where nothing follows.
    """
    left, whole = (np.sum(project.coordinates(each) ** 2, axis=0) for each in (residual, Y))
    return np.asarray(1.0 - left / np.where(whole > 0.0, whole, np.inf))


def explained_fraction(Y: FloatArray, residual: FloatArray) -> FloatArray:
    """Return R2 of each column; shape (n_targets,).

    Parameters
    ----------
    Y, residual : ndarray, shape (n_rows, n_targets)

    Returns
    -------
    ndarray, shape (n_targets,)
        1 where a column does not vary.
    """
    spread = np.sum((Y - Y.mean(axis=0)) ** 2, axis=0)
    return np.asarray(1.0 - np.sum(residual**2, axis=0) / np.where(spread > 0.0, spread, np.inf))
