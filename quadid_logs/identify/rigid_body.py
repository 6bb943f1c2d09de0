"""A single rigid body: one symmetric inertia tensor behind all equations.

Equation by equation, nothing makes the gyroscopic and torque coefficients
those of a rigid body. Here all follow from one tensor, so each equation's data
speak for the others, and there is half as much to find.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.identify.actuator_model import ActuatorModel
from quadid_logs.identify.design import Design
from quadid_logs.identify.equation_by_equation import ActuatedFit
from quadid_logs.identify.fit import PooledFit, explained_fraction, times_of, with_trim
from quadid_logs.identify.inference import clusters_of, feedback_left, infer, torque_effects
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.systematic import GYRO_SYSTEMATIC, as_measured
from quadid_logs.identify.terms import THROTTLED_YAW, TORQUE_TERMS, TRIM, YAW_REACTION, of_loops
from quadid_logs.maths.least_squares import Equation, solve_least_squares
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.rotational_dynamics import PRODUCTS, gyroscopic_matrix
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS, TORQUE_SYMBOLS

#: Where the search begins, and where it stays in a direction of which the flight
#: says nothing: log of Jxx/Jyy and of Jxx/Jzz of published multirotors, and no
#: products of inertia.
_PRIOR_RATIOS = (0.0, -0.6)
_PRIOR_CORRELATIONS = (0.0, 0.0, 0.0)
#: How far vehicles lie around that; many times what a good flight leaves open.
_RATIO_SPREAD = 0.5
_CORRELATION_SPREAD = 0.2
#: Relative step of the central differences: their error is its square.
_STEP = 1e-5
#: A body that is there is found in ten to thirty trials.
_MOST_TRIALS = 150
_PAIRS = ((0, 1), (0, 2), (1, 2))
_OF_YAW_TORQUE = (THROTTLED_YAW.symbol, YAW_REACTION.symbol)


class _Body(NamedTuple):
    """How the parameters lie in one vector, and what A and B they make.

    On-axis effectiveness (3); log ratios of the inverse moments of inertia (2, absent where torque
    is in N m: they are those of the effectiveness then); correlations of the inverse inertia (3);
    on-axis damping (3); coefficients of the ``loose`` columns, which no inertia ties together
    (3 each); relative slope of the yaw effectiveness over throttle (1, absent where the throttle is
    not known); lead of the yaw reaction (1, absent where none is seen); errors E of the gyro (9). The
    trim is left at zero: see `with_trim`.

    E must be among the unknowns: the ratio of two off-axis entries of B is that of the
    torques' units, if they are the vehicle's; if they are the gyro's cross
    talk, it is anything, and inertia and gyroscopic terms would follow it.
    """

    symbols: tuple[str, ...]
    loose: tuple[str, ...]
    calibrated: bool

    @classmethod
    def of(cls, structure: Structure, design: Design, *, calibrated: bool) -> _Body:
        """Return the body of a structure that a flight's disturbances turn as well."""
        symbols = (*structure.columns, *design.disturbances(structure))
        tied = (*PRODUCTS, *RATE_SYMBOLS, TRIM.symbol, *_OF_YAW_TORQUE, *TORQUE_SYMBOLS)
        return cls(symbols, tuple(symbol for symbol in symbols if symbol not in tied), calibrated)

    @property
    def of_yaw_torque(self) -> tuple[str, ...]:
        """Columns that follow from N: what they do to the vehicle is a multiple of what N does."""
        return tuple(symbol for symbol in _OF_YAW_TORQUE if symbol in self.symbols)

    @property
    def multiples(self) -> slice:
        """Of `of_yaw_torque`."""
        return slice(int(self.of_loose.stop), int(self.of_loose.stop) + len(self.of_yaw_torque))

    @property
    def torques(self) -> tuple[str, ...]:
        """Columns that errors of lag, delay and torque reach."""
        return tuple(symbol for symbol in (*TORQUE_SYMBOLS, YAW_REACTION.symbol) if symbol in self.symbols)

    @property
    def ratios(self) -> slice:
        return slice(3, 3 if self.calibrated else 5)

    @property
    def correlations(self) -> slice:
        return self._after_ratios(0, 3)

    @property
    def damping(self) -> slice:
        return self._after_ratios(3, 3)

    @property
    def of_loose(self) -> slice:
        return self._after_ratios(6, 3 * len(self.loose))

    @property
    def gyro(self) -> slice:
        return slice(self.multiples.stop, self.multiples.stop + 9)

    @property
    def size(self) -> int:
        return int(self.gyro.stop)

    @property
    def of_vehicle(self) -> BoolArray:
        """Mark the parameters that are the vehicle's and not the gyro's."""
        return np.asarray(np.arange(self.size) < self.gyro.start, dtype=np.bool_)

    def _after_ratios(self, first: int, count: int) -> slice:
        return slice(self.ratios.stop + first, self.ratios.stop + first + count)

    def _places(self, symbols: tuple[str, ...]) -> list[int]:
        return [self.symbols.index(symbol) for symbol in symbols]

    def coefficients(self, x: FloatArray) -> FloatArray:
        """Return the coefficients of all columns for parameters (..., n_parameters); (..., 3, n_symbols).

        With P the inverse inertia to any scale, B = P K and the damping P D,
        K and D diagonal such that the diagonals are the given ones.
        """
        first = np.zeros((*x.shape[:-1], 1))
        moments = np.abs(x[..., :3]) if self.calibrated else np.exp(np.append(first, x[..., self.ratios], -1))
        P = np.zeros((*x.shape[:-1], 3, 3))
        P[..., range(3), range(3)] = moments
        for value, (i, j) in zip(np.moveaxis(x[..., self.correlations], -1, 0), _PAIRS, strict=True):
            P[..., i, j] = P[..., j, i] = value * np.sqrt(moments[..., i] * moments[..., j])
        B = P * (x[..., :3] / moments)[..., np.newaxis, :]
        theta = np.zeros((*x.shape[:-1], 3, len(self.symbols)))
        theta[..., self._places(TORQUE_SYMBOLS)] = B
        inertia = np.asarray(np.linalg.inv(P), dtype=np.float64)
        theta[..., self._places(PRODUCTS)] = gyroscopic_matrix(inertia)
        theta[..., self._places(RATE_SYMBOLS)] = P * (x[..., self.damping] / moments)[..., np.newaxis, :]
        theta[..., self._places(self.loose)] = x[..., self.of_loose].reshape(*x.shape[:-1], 3, -1)
        multiples = x[..., np.newaxis, self.multiples]
        theta[..., self._places(self.of_yaw_torque)] = B[..., 2:] * multiples
        return theta

    def measured(self, x: FloatArray) -> FloatArray:
        """Return the `coefficients` for rates as the gyro shows them."""
        theta, E = self.coefficients(x), x[..., self.gyro].reshape(*x.shape[:-1], 3, 3)
        products, rates = self._places(PRODUCTS), self._places(RATE_SYMBOLS)
        theta[..., products], theta[..., rates] = as_measured(E, theta[..., products], theta[..., rates])
        return np.asarray((np.eye(3) + E) @ theta)

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Return prior mean and its spread, infinite where anything goes; both (n_parameters,)."""
        mean, spread = np.zeros(self.size), np.full(self.size, np.inf)
        mean[self.correlations], spread[self.correlations] = _PRIOR_CORRELATIONS, _CORRELATION_SPREAD
        if not self.calibrated:
            mean[self.ratios], spread[self.ratios] = _PRIOR_RATIOS, _RATIO_SPREAD
        spread[self.gyro] = GYRO_SYSTEMATIC / NORMAL_95
        return mean, spread


class _Rows(NamedTuple):
    """The training rows Y = Z coefficients', what the instruments make of Z, and where they are from."""

    Z: FloatArray
    explained: FloatArray
    Y: FloatArray
    design: Design
    model: ActuatorModel
    project: Projection


class _Reduced(NamedTuple):
    """The problem in the few rows of its triangle: Z = Q R, ``targets`` = Q' Y, rows weigh 1/``sigma``."""

    R: FloatArray
    targets: FloatArray
    sigma: FloatArray


def fit_single_rigid_body(structure: Structure, data: FlightData, first: ActuatedFit) -> ActuatedFit | None:
    """Fit one tensor, damping, trim and the throttle's effect on yaw to all equations at once.

    Parameters
    ----------
    structure : Structure
        With products of rates, rates and torques among its columns.
    data : FlightData
        Torque in N m makes B itself symmetric.
    first : ActuatedFit
        Equation by equation: the start, and the actuator. Unless all three axes are informative,
        nothing couples the equations, and no shape is claimed.

    Returns
    -------
    ActuatedFit, or None where no body has such gains (a negative one), or none is found that explains them.

    Notes
    -----
    The search works on the triangle of one QR decomposition, so that its steps
    do not cost more for a longer flight.
    """
    if not (first.structure.on_axis(first.fit.theta) > 0.0).all():
        return None
    design = first.model.design
    body = _Body.of(structure, design, calibrated=data.input is not None and data.input.unit == "N m")
    rows = _rows(body, structure, first.model)
    free = np.ones(body.size, dtype=np.bool_)
    if len(first.informative) < len(RATE_SYMBOLS):
        free[body.ratios] = free[body.correlations] = free[body.gyro] = False
    n_clusters = int(clusters_of(design).max()) + 1
    # The rows are reduced to a triangle; a cluster of correlated residuals counts as one observation.
    Y = rows.Y
    Q, R = np.linalg.qr(rows.explained)
    squares = (1.0 - first.fit.r2) * np.sum((Y - Y.mean(axis=0)) ** 2, axis=0)
    problem = _Reduced(R, Q.T @ Y, np.sqrt(np.maximum(squares, 1e-24) / n_clusters))
    x = _solve(body, problem, _start(body, first), free)
    if x is None:
        return None
    fit = with_trim(
        _as_fit(body, x, free, rows, len(structure.columns)), structure, first.whole, first.model.actuator
    )
    # How a gain changes with the band is a matter of the data, not of what the equations have in common.
    change = first.band.on_axis_gain / first.band.on_axis_gain[0]
    band = replace(first.band, on_axis_gain=structure.on_axis(fit.theta) * change)
    return first._replace(structure=structure, fit=fit, band=band)


def _rows(body: _Body, structure: Structure, model: ActuatorModel) -> _Rows:
    """Lay out the training rows; what else passes the actuator is an instrument besides."""
    design, train = model.design, model.design.train
    torque = design.torque.behind(model.actuator.lag_s, model.actuator.delay_s, structure.inputs)
    Z = design.stack(body.symbols, torque, structure.inputs)[train]
    Y = np.column_stack([design.columns[name] for name in ACCELERATION_SYMBOLS])[train]
    answering = {term.symbol for term in TORQUE_TERMS if term.answers_disturbances}
    others = [number for number, symbol in enumerate(structure.inputs) if symbol not in answering]
    project = Projection(design, structure, train, also=torque[:, others])
    by_time = times_of(design, model.actuator)[train]
    project = project.jackknifed(np.column_stack([Z, by_time]), clusters_of(design))
    return _Rows(Z, project(Z), Y, design, model, project)


def _start(body: _Body, first: ActuatedFit) -> FloatArray:
    """Return the parameters of a body of typical shape with the gains found equation by equation."""
    x, _ = body.prior()
    symbols = (*first.structure.columns, *first.model.design.disturbances(first.structure))
    known = dict(zip(symbols, np.column_stack([first.fit.theta, first.fit.disturbance]).T, strict=True))
    x[:3] = first.structure.on_axis(first.fit.theta)
    x[body.damping] = [known[name][row] for row, name in enumerate(RATE_SYMBOLS)]
    x[body.multiples] = [
        known.get(name, np.zeros(3))[2] / known[TORQUE_SYMBOLS[2]][2] for name in body.of_yaw_torque
    ]
    loose = [known.get(name, np.zeros(3)) for name in body.loose]
    x[body.of_loose] = np.array(loose).T.ravel()
    return x


def _slopes(function: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
    """Return the derivatives of a function by all parameters, as its last dimension.

    The function takes many points at once: one by one they would be most of the time of a short flight.
    """
    step = _STEP * np.maximum(np.abs(x), 1.0)
    ahead, behind = function(x + np.diag(step)), function(x - np.diag(step))
    return np.ascontiguousarray(np.moveaxis(ahead - behind, 0, -1) / (2.0 * step))


def _solve(body: _Body, problem: _Reduced, x: FloatArray, free: BoolArray) -> FloatArray | None:
    """Return the parameters of least weighted squares (Levenberg-Marquardt); the others stay as they are.

    None where the search does not end.
    """
    from scipy.optimize import least_squares

    mean, spread = body.prior()
    prior_weight = np.diag(1.0 / spread)[np.ix_(free, free)]

    def with_free(values: FloatArray) -> FloatArray:
        whole = x.copy()
        whole[free] = values
        return whole

    def misfit(values: FloatArray) -> FloatArray:
        now = with_free(values)
        of_rows = (problem.R @ body.measured(now).T - problem.targets) / problem.sigma
        return np.concatenate([of_rows.T.ravel(), ((now - mean) / spread)[free]])

    def jacobian(values: FloatArray) -> FloatArray:
        slopes = _slopes(body.measured, with_free(values))[..., free]
        of_rows = (problem.R @ slopes[row] / problem.sigma[row] for row in range(3))
        return np.concatenate([*of_rows, prior_weight])

    found = least_squares(misfit, x[free], jac=jacobian, x_scale="jac", method="lm", max_nfev=_MOST_TRIALS)
    return with_free(found.x) if found.success else None


def _as_fit(body: _Body, x: FloatArray, free: BoolArray, rows: _Rows, n_columns: int) -> PooledFit:
    """Carry the covariance of the parameters over to A and B (the first `n_columns`), to first order."""
    theta, measured = body.coefficients(x), body.measured(x)
    slopes, slopes_measured = (
        _slopes(function, x)[..., free] for function in (body.coefficients, body.measured)
    )
    coupled = bool(free[body.correlations].any())
    if not coupled:
        # Of a body whose shape is not known, only what its axes do by themselves is: no product of rates.
        own = np.abs(slopes).max(axis=2) > 0.0
        own[:, body._places(PRODUCTS)] = False
        theta, slopes = np.where(own, theta, 0.0), slopes * own[..., np.newaxis]
        measured, slopes_measured = theta, slopes
    residual = rows.Y - rows.Z @ measured.T
    clusters = clusters_of(rows.design)
    # As in the search: a cluster of correlated residuals counts as one observation.
    per_cluster = np.sqrt(len(residual) / (int(clusters.max()) + 1))
    weight = 1.0 / np.maximum(per_cluster * np.sqrt(np.mean(residual**2, axis=0)), 1e-12)
    model, B = rows.model, measured[:, body._places(body.torques)]
    effects = torque_effects(
        rows.design, model.actuator, B, model.unknown, rows.project, symbols=body.torques
    )
    n_free = int(np.count_nonzero(free))
    equations = [
        Equation(rows.explained @ slopes_measured[row], residual[:, row], np.arange(n_free, dtype=np.int64))
        for row in range(3)
    ]
    # What is typical of vehicles is no observation of this one; what is known of its gyro is.
    prior = np.where(body.of_vehicle, 0.0, 1.0 / body.prior()[1] ** 2)[free]
    jacobians = ((rows.Z @ slopes_measured[row], equations[row].jacobian) for row in range(3))
    feedback = feedback_left(rows.design, jacobians, rows.project.n_instruments)
    found = infer(equations, weight, clusters, effects, n_free, prior, feedback)
    variance = np.einsum("rcp,pq,rcq->rc", slopes, found.covariance, slopes)
    kept = np.asarray(np.abs(slopes).max(axis=2) > 0.0, dtype=np.bool_)
    return PooledFit(
        theta=theta[:, :n_columns],
        half_width=np.where(kept, np.sqrt(np.maximum(variance, 0.0)), np.inf)[:, :n_columns],
        kept=kept[:, :n_columns],
        r2=explained_fraction(rows.Y, residual),
        condition_number=solve_least_squares(rows.Z[:, kept.any(axis=0)], rows.Y).condition_number,
        n_parameters=int(np.count_nonzero(free & body.of_vehicle)) + len(effects.shared),
        lag_half_width_s=found.lag_s,
        delay_half_width_s=found.delay_s,
        disturbance=measured[:, n_columns:],
        gyro=x[body.gyro].reshape(3, 3) if coupled else None,
        measured=measured[:, :n_columns],
        of_axes=found.of_axes(of_loops(body.symbols, slopes_measured)),
    )
