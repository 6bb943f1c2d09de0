"""The rigid-body structure: one symmetric inertia tensor behind all rows.

`damped` fits its rows one by one, and nothing makes their gyroscopic and
torque coefficients those of one body. Here all follow from one tensor, so
each row's data speak for the others, and there is half as much to find.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.identify.actuator import ActuatorFit
from quadid_logs.identify.design import Design
from quadid_logs.identify.fit import (
    NOTHING_UNKNOWN,
    PooledFit,
    TorqueUnknowns,
    actuator_columns,
    clusters_of,
    covariance_95,
    share_explained,
    targets_changed,
)
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.structures import DAMPED, RIGID_BODY, RIGID_BODY_THROTTLED, Structure
from quadid_logs.identify.systematic import seen_through
from quadid_logs.maths.least_squares import Equation, solve_least_squares
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.rigid_body import PRODUCTS, gyroscopic_matrix
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS

#: Where the search begins, and where it stays in a direction of which the flight
#: says nothing: log of Jxx/Jyy and of Jxx/Jzz of published multirotors, and no
#: products of inertia.
_USUAL_RATIOS = (0.0, -0.6)
_USUAL_CORRELATIONS = (0.0, 0.0, 0.0)
#: How far vehicles lie around that; many times what a good flight leaves open.
_RATIO_SPREAD = 0.5
_CORRELATION_SPREAD = 0.2
#: Relative step of the central differences: their error is its square.
_STEP = 1e-5
#: A body that is there is found in ten to thirty trials.
_MOST_TRIALS = 150
_PAIRS = ((0, 1), (0, 2), (1, 2))


class _Body(NamedTuple):
    """How the parameters lie in one vector, and what A and B they make.

    Own gains (3); log ratios of the inverse moments of inertia (2, absent
    where torque is in N m: they are those of the gains then); correlations of
    the inverse inertia (3); own damping (3); coefficients of the disturbances
    (3 each); relative slope of the yaw gain over throttle (1, absent where the
    throttle is not known); errors E of the gyro (9). The trim is left at zero:
    see `with_trim`.

    E must be among the unknowns: the ratio of two cross gains is that of the
    torques' units, if they are the vehicle's; if they are the gyro's cross
    talk, it is anything, and inertia and gyroscopic terms would follow it.
    """

    calibrated: bool
    throttled: bool
    n_disturbances: int
    gyro_spread: float

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
    def disturbances(self) -> slice:
        return self._after_ratios(6, 3 * self.n_disturbances)

    @property
    def gyro(self) -> slice:
        first = int(self.disturbances.stop) + int(self.throttled)
        return slice(first, first + 9)

    @property
    def size(self) -> int:
        return int(self.gyro.stop)

    def _after_ratios(self, first: int, count: int) -> slice:
        return slice(self.ratios.stop + first, self.ratios.stop + first + count)

    def coefficients(self, x: FloatArray) -> FloatArray:
        """Return [A B] and the coefficients of the disturbances; shape (3, n_columns + n_disturbances).

        With P the inverse inertia to any scale, B = P K and the damping P D,
        K and D diagonal such that the diagonals are the given ones.
        """
        moments = np.abs(x[:3]) if self.calibrated else np.exp([0.0, *x[self.ratios]])
        P = np.diag(moments)
        for value, (i, j) in zip(x[self.correlations], _PAIRS, strict=True):
            P[i, j] = P[j, i] = value * np.sqrt(moments[i] * moments[j])
        B = P * (x[:3] / moments)
        damping = P * (x[self.damping] / moments)
        parts = [gyroscopic_matrix(np.linalg.inv(P)), damping, np.zeros((3, 1))]
        if self.throttled:
            parts.append(x[self.disturbances.stop] * B[:, 2:])
        return np.concatenate([*parts, B, x[self.disturbances].reshape(3, -1)], axis=1)

    def seen(self, x: FloatArray) -> FloatArray:
        """Return the `coefficients` for rates as the gyro shows them."""
        theta, E = self.coefficients(x), x[self.gyro].reshape(3, 3)
        n_products = len(PRODUCTS)
        products, damping = seen_through(E, theta[:, :n_products], theta[:, n_products : n_products + 3])
        whole = np.concatenate([products, damping, theta[:, n_products + 3 :]], axis=1)
        return np.asarray((np.eye(3) + E) @ whole)

    def usual(self) -> tuple[FloatArray, FloatArray]:
        """Return what is expected and its spread, infinite where anything goes; both (n_parameters,)."""
        expected, spread = np.zeros(self.size), np.full(self.size, np.inf)
        expected[self.correlations], spread[self.correlations] = _USUAL_CORRELATIONS, _CORRELATION_SPREAD
        if not self.calibrated:
            expected[self.ratios], spread[self.ratios] = _USUAL_RATIOS, _RATIO_SPREAD
        spread[self.gyro] = self.gyro_spread
        return expected, spread


def _slopes(function: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
    """Return the derivatives of a function by all parameters, as its last dimension."""
    columns = []
    for number, step in enumerate(_STEP * np.maximum(np.abs(x), 1.0)):
        ahead, behind = x.copy(), x.copy()
        ahead[number] += step
        behind[number] -= step
        columns.append((function(ahead) - function(behind)) / (2.0 * step))
    return np.stack(columns, axis=-1)


class _Reduced(NamedTuple):
    """The problem in the few rows of its triangle: Z = Q R, ``targets`` = Q' Y, rows weigh 1/``sigma``."""

    R: FloatArray
    targets: FloatArray
    sigma: FloatArray


def rigid_body_for(design: Design) -> Structure:
    """Return the structure, with the throttle's effect on yaw where the throttle is known."""
    return RIGID_BODY_THROTTLED if design.has_throttle else RIGID_BODY


def fit_rigid_body(
    design: Design,
    actuator: ActuatorFit,
    rows_apart: PooledFit,
    telling: Sequence[int],
    *,
    calibrated: bool,
    gyro_systematic: float,
    unknown: TorqueUnknowns = NOTHING_UNKNOWN,
) -> PooledFit | None:
    """Fit one tensor, damping, trim and the throttle's effect on yaw to all rows at once.

    Parameters
    ----------
    design : Design
    actuator : ActuatorFit
        Found with `DAMPED`.
    rows_apart : PooledFit
        `DAMPED` fitted with that actuator: the start.
    telling : sequence of int
        Axes that answer to their own torque. Unless all three do, nothing
        couples the rows, and no shape is claimed.
    calibrated : bool
        Torque is in N m, so B itself is symmetric.
    gyro_systematic : float
        Half width of the 95 % interval of each scale and cross-axis error of the gyro.
    unknown : TorqueUnknowns, optional
        As in `fit_pooled`.

    Returns
    -------
    PooledFit, or None where no body has such gains (a negative one), or none is found that explains them.

    Notes
    -----
    The search works on the triangle of one QR decomposition, so that its steps
    do not cost more for a longer flight.
    """
    structure = rigid_body_for(design)
    own = np.diag(rows_apart.theta[:, len(DAMPED.regressors) :])
    if not (own > 0.0).all():
        return None
    disturbances = design.disturbances(structure)
    body = _Body(calibrated, design.has_throttle, len(disturbances), gyro_systematic / NORMAL_95)
    train = design.train
    torque = design.torque(actuator.lag_s, actuator.delay_s, throttled=design.has_throttle)
    Z = design.stack((*structure.columns, *disturbances), torque)[train]
    Y = np.column_stack([design.columns[name] for name in ACCELERATION_SYMBOLS])[train]
    free = np.ones(body.size, dtype=np.bool_)
    if len(telling) < len(RATE_SYMBOLS):
        free[body.ratios] = free[body.correlations] = free[body.gyro] = False
    n_clusters = int(clusters_of(design).max()) + 1
    project = Projection(design, structure, train, also=torque[:, 3:])
    x = _solve(body, _reduced(project(Z), Y, 1.0 - rows_apart.r2, n_clusters), _start(body, rows_apart), free)
    if x is None:
        return None
    return _as_fit(body, x, free, Z, Y, design, actuator, project, len(structure.columns), unknown)


def _start(body: _Body, rows_apart: PooledFit) -> FloatArray:
    """Return the parameters of a body of usual shape with the gains that the rows have one by one."""
    x, _ = body.usual()
    A = rows_apart.theta[:, : len(DAMPED.regressors)]
    x[:3] = np.diag(rows_apart.theta[:, len(DAMPED.regressors) :])
    x[body.damping] = [A[row, DAMPED.regressors.index(name)] for row, name in enumerate(RATE_SYMBOLS)]
    # Behind the air speed, rows apart have the squares of the rates, which here belong to the structure.
    x[body.disturbances] = rows_apart.disturbance[:, : body.n_disturbances].ravel()
    return x


def _reduced(explained: FloatArray, Y: FloatArray, unexplained: FloatArray, n_clusters: int) -> _Reduced:
    """Reduce the rows to a triangle; a stretch of correlated residuals counts as one observation."""
    Q, R = np.linalg.qr(explained)
    squares = unexplained * np.sum((Y - Y.mean(axis=0)) ** 2, axis=0)
    return _Reduced(R, Q.T @ Y, np.sqrt(np.maximum(squares, 1e-24) / n_clusters))


def _solve(body: _Body, problem: _Reduced, x: FloatArray, free: BoolArray) -> FloatArray | None:
    """Return the parameters of least weighted squares (Levenberg-Marquardt); the others stay as they are.

    None where the search does not end.
    """
    from scipy.optimize import least_squares

    expected, spread = body.usual()
    pull = np.diag(1.0 / spread)[np.ix_(free, free)]

    def with_free(values: FloatArray) -> FloatArray:
        whole = x.copy()
        whole[free] = values
        return whole

    def misfit(values: FloatArray) -> FloatArray:
        now = with_free(values)
        of_rows = (problem.R @ body.seen(now).T - problem.targets) / problem.sigma
        return np.concatenate([of_rows.T.ravel(), ((now - expected) / spread)[free]])

    def jacobian(values: FloatArray) -> FloatArray:
        slopes = _slopes(body.seen, with_free(values))[..., free]
        return np.concatenate([*(problem.R @ slopes[row] / problem.sigma[row] for row in range(3)), pull])

    found = least_squares(misfit, x[free], jac=jacobian, x_scale="jac", method="lm", max_nfev=_MOST_TRIALS)
    return with_free(found.x) if found.success else None


def _as_fit(
    body: _Body,
    x: FloatArray,
    free: BoolArray,
    Z: FloatArray,
    Y: FloatArray,
    design: Design,
    actuator: ActuatorFit,
    project: Projection,
    n_columns: int,
    unknown: TorqueUnknowns,
) -> PooledFit:
    """Carry the covariance of the parameters over to A and B, to first order."""
    theta, seen = body.coefficients(x), body.seen(x)
    slopes, slopes_seen = (_slopes(function, x)[..., free] for function in (body.coefficients, body.seen))
    coupled = bool(free[body.correlations].any())
    if not coupled:
        # Of a body whose shape is not known, only what its axes do by themselves is.
        own = np.abs(slopes).max(axis=2) > 0.0
        theta, slopes = np.where(own, theta, 0.0), slopes * own[..., np.newaxis]
        seen, slopes_seen = theta, slopes
    residual = Y - Z @ seen.T
    clusters = clusters_of(design)
    # As in the search: a stretch of correlated residuals counts as one observation.
    per_stretch = np.sqrt(len(residual) / (int(clusters.max()) + 1))
    weight = 1.0 / np.maximum(per_stretch * np.sqrt(np.mean(residual**2, axis=0)), 1e-12)
    explained = project(Z)
    B = seen[:, n_columns - 3 : n_columns]
    of_actuator = actuator_columns(design, actuator, B, unknown.slopes)
    shared = {name: project(column) for name, column in of_actuator.items()}
    n_own = int(np.count_nonzero(free))
    everything = np.arange(n_own + len(shared), dtype=np.int64)
    _, spread = body.usual()
    prior = np.concatenate([np.where(_of_gyro(body), 1.0 / spread**2, 0.0)[free], np.zeros(len(shared))])
    equations = [
        Equation(
            jacobian=np.column_stack(
                [explained @ slopes_seen[row], *(column[:, row] for column in shared.values())]
            )
            * weight[row],
            residuals=residual[:, row] * weight[row],
            parameters=everything,
        )
        for row in range(3)
    ]
    errors = targets_changed(design, actuator, B, unknown) * weight[:, np.newaxis]
    covariance = covariance_95(equations, clusters, errors, everything.size, prior)
    variance = np.einsum("rcp,pq,rcq->rc", slopes, covariance[:n_own, :n_own], slopes)
    kept = np.abs(slopes).max(axis=2) > 0.0
    whole = solve_least_squares(Z[:, kept.any(axis=0)], Y)
    actuator_half_width = np.sqrt(np.maximum(np.diag(covariance)[n_own:], 0.0))
    by_name = dict(zip(shared, actuator_half_width.tolist(), strict=True))
    return PooledFit(
        theta=theta[:, :n_columns],
        half_width=np.where(kept, np.sqrt(np.maximum(variance, 0.0)), np.inf)[:, :n_columns],
        kept=np.asarray(kept, dtype=np.bool_)[:, :n_columns],
        r2=share_explained(Y, residual),
        condition_number=whole.condition_number,
        rank=whole.rank,
        n_parameters=int(np.count_nonzero(free & ~_of_gyro(body))) + len(shared),
        lag_half_width_s=by_name.get("lag", float("nan")),
        delay_half_width_s=by_name.get("delay", float("nan")),
        disturbance=seen[:, n_columns:],
        gyro=x[body.gyro].reshape(3, 3) if coupled else None,
        seen=seen[:, :n_columns],
    )


def _of_gyro(body: _Body) -> BoolArray:
    """Mark the parameters that are the gyro's; what is usual of vehicles is no observation of this one."""
    marks = np.zeros(body.size, dtype=np.bool_)
    marks[body.gyro] = True
    return marks
