"""Lag, delay and spin-up/spin-down asymmetry of the rotors, brought to their least error together.

The search for a lag on the torque only comes near: behind rotors each lag
needs a torque of its own, and to find the two in turn takes many rounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.flight import InputDescription
from quadid_logs.identify.actuator import ActuatorFit, Scorer, lag_limit, same_loss
from quadid_logs.identify.design import Design
from quadid_logs.identify.fit import used_columns
from quadid_logs.identify.inference import NOTHING_UNKNOWN, TorqueUnknowns
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.rotors import MOST_ASYMMETRIC, Rotors, rotor_slopes, with_lag_on_rotors
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.torque_errors import battery_errors, expo_errors, sampling_errors
from quadid_logs.identify.torque_products import MAX_DELAY_S, MAX_LAG_S
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS

#: Below [s], the lag of a rotor moves no torque by as much as can be seen.
_LEAST_LAG_S = 0.002
#: Steps of lag [s], delay [s] and logarithm of the asymmetry that change the fit about as much.
_SCALE = (1e-3, 1e-3, 0.1)
#: Relative change of the squared error, a hundredth of what chance makes of it in an hour of flight.
_TOLERANCE = 1e-6
#: Relative change of lag and delay: microseconds, which no log resolves.
_TIME_TOLERANCE = 1e-4
#: Steps of the derivatives: so small that they are straight, and far from rounding.
_STEPS = (2e-5, 2e-5, 2e-3)
#: Gauss-Newton needs three to six; a search that needs more has no minimum.
_MOST_TRIALS = 15
#: The axes are weighted by errors that change with the fit; the second time they hardly do.
_ROUNDS = 2


class ActuatorModel(NamedTuple):
    """How the torque reaches the vehicle.

    ``design`` holds the torque that, behind the linear lag of ``actuator``,
    acts as the rotors do; without rotors it is as logged. ``unknown`` is what
    else of that torque is not known.
    """

    actuator: ActuatorFit
    design: Design
    rotors: Rotors | None = None
    unknown: TorqueUnknowns = NOTHING_UNKNOWN


class FitProblem(NamedTuple):
    """What is fitted: the rows, the columns each of them may use, and the axes that count.

    ``every_step``: each step of the control loop was logged.
    """

    design: Design
    structure: Structure
    kept: BoolArray
    axes: Sequence[int]
    every_step: bool = False


def find_actuator_model(
    problem: FitProblem, start: ActuatorFit, described: InputDescription | None
) -> ActuatorModel:
    """Find lag and delay, and whether the lag acts on torque or rotors.

    Parameters
    ----------
    problem : FitProblem
        Its design with the torque as logged.
    start : ActuatorFit
        Found as if the lag acted on the torque.
    described : InputDescription or None
        With the ``torque_per_thrust`` of the rotors, where they are known.

    Returns
    -------
    ActuatorModel
        On the torque where that explains the flight better, as in some
        simulators; with symmetric rotors unless asymmetric ones explain it better.
    """
    torque_search = _Search(problem, None)
    on_torque, torque_loss = torque_search.least(np.array([start.lag_s, start.delay_s]))
    model = _model(problem.design, start, on_torque)
    if described is not None and start.lag_s >= _LEAST_LAG_S:
        by_chance = same_loss(torque_search.project, problem.axes)
        rotor_search = _Search(problem, described)
        on_rotors, rotor_loss = rotor_search.least(on_torque)
        asymmetric, loss = rotor_search.least(np.append(on_rotors, 0.0))
        if loss < rotor_loss - by_chance:
            on_rotors, rotor_loss = asymmetric, loss
        if rotor_loss <= torque_loss + by_chance or rotor_search.lag_is_measured:
            model = _model(problem.design, start, on_rotors, described)
    return _with_unknowns(model, problem, described)


def same_actuator_model(
    problem: FitProblem, model: ActuatorModel, described: InputDescription | None
) -> ActuatorModel:
    """Return a model of the same kind, with the asymmetry it has, fitted to other rows; nothing is unknown.

    Parameters
    ----------
    problem : FitProblem
        With the other rows.
    model : ActuatorModel
    described : InputDescription or None
        As of `find_actuator_model`.

    Returns
    -------
    ActuatorModel
    """
    rotors = model.rotors
    known = described if rotors is not None else None
    search = _Search(problem, known, 0.0 if rotors is None else rotors.log_asymmetry)
    start = np.array([model.actuator.lag_s, model.actuator.delay_s])
    found, _ = search.least(start, rounds=1)
    return _model(problem.design, model.actuator, found, known, search.log_asymmetry)


def free_actuator_model(
    problem: FitProblem, model: ActuatorModel, described: InputDescription | None
) -> ActuatorModel | None:
    """Return a model of the same kind whose delay may be negative, as where torque is stamped late.

    Parameters
    ----------
    problem : FitProblem
    model : ActuatorModel
    described : InputDescription or None
        As of `find_actuator_model`.

    Returns
    -------
    ActuatorModel or None
        None where it explains the flight better by chance only.
    """
    rotors = model.rotors
    known = described if rotors is not None else None
    search = _Search(problem, known, 0.0 if rotors is None else rotors.log_asymmetry)
    start = np.array([model.actuator.lag_s, model.actuator.delay_s])
    _, loss = search.least(start, rounds=1)
    found, free_loss = search.least(start, earliest_s=-MAX_DELAY_S)
    if found[1] >= 0.0 or loss - free_loss <= same_loss(search.project, problem.axes):
        return None
    return _model(problem.design, model.actuator, found, known, search.log_asymmetry)


def _model(
    as_logged: Design,
    start: ActuatorFit,
    found: FloatArray,
    described: InputDescription | None = None,
    log_asymmetry: float = 0.0,
) -> ActuatorModel:
    """Put a model together from its lag, delay and asymmetry."""
    lag_s, delay_s = (float(value) for value in found[:2])
    actuator = start._replace(lag_s=lag_s, delay_s=delay_s)
    if described is None:
        return ActuatorModel(actuator, as_logged)
    rotors = Rotors.of(lag_s, float(found[2]) if found.size > 2 else log_asymmetry)
    return ActuatorModel(actuator, with_lag_on_rotors(as_logged, described, rotors), rotors)


def _with_unknowns(
    model: ActuatorModel, problem: FitProblem, described: InputDescription | None
) -> ActuatorModel:
    """Add how far the lag might be delay, and what else is not known of the torque."""
    actuator = model.actuator
    score = Scorer(model.design, problem.structure, problem.axes)
    limit_s = lag_limit(score, actuator.lag_s, actuator.delay_s)
    slopes = None
    if model.rotors is not None and described is not None:
        slopes = rotor_slopes(problem.design, described, model.rotors)
    errors = battery_errors(problem.design) + expo_errors(problem.design, described)
    if not problem.every_step:
        errors += sampling_errors(problem.design)
    return model._replace(
        actuator=actuator._replace(lag_limit_s=limit_s), unknown=TorqueUnknowns(slopes, errors)
    )


class _Axis(NamedTuple):
    """Basis of the fixed columns, what of the acceleration they leave, and which torques the row may use."""

    basis: FloatArray
    target: FloatArray
    inputs: BoolArray


class _Solved(NamedTuple):
    """Weighted residual, torque outside what the fixed columns explain, and its gains."""

    left: FloatArray
    alone: FloatArray
    gain: FloatArray


class _Search:
    """Squared errors of each axis over lag, delay and asymmetry, all else solved for (variable projection).

    G. H. Golub and V. Pereyra, Inverse Problems 19, 2003; derivatives as L.
    Kaufman's, BIT 15, 1975. ``described`` is None for a lag on the torque.
    """

    def __init__(
        self, problem: FitProblem, described: InputDescription | None, log_asymmetry: float = 0.0
    ) -> None:
        design, structure = problem.design, problem.structure
        self._design, self._described, self.log_asymmetry = design, described, log_asymmetry
        expo = None if described is None else described.expo
        self.lag_is_measured = expo is not None and expo.lag_is_measured
        self._lags_s = (0.0, MAX_LAG_S) if expo is None else np.clip(expo.rotor_lag_s, 0.0, MAX_LAG_S)
        self._train = design.train
        self.project = Projection(design, structure, self._train)
        disturbances = design.disturbances(structure)
        self._inputs = structure.inputs
        is_torque = np.isin((*structure.columns, *disturbances), self._inputs)
        names = (*structure.regressors, *disturbances)
        fixed = np.column_stack([design.columns[name] for name in names if name not in self._inputs])
        fixed = self.project.coordinates(fixed[self._train])
        used = used_columns(design, structure, problem.kept)
        self._axes: list[_Axis] = []
        for axis in problem.axes:
            basis, _ = np.linalg.qr(fixed[:, used[axis, ~is_torque]])
            target = design.columns[ACCELERATION_SYMBOLS[axis]][self._train, np.newaxis]
            target = _outside(basis, self.project.coordinates(target))[:, 0]
            self._axes.append(_Axis(basis, target, used[axis, is_torque]))
        self._weight = np.ones(len(self._axes))
        # A search asks for residuals and derivatives at the same point, and a delay moves no rotor.
        self._torque_at = lru_cache(maxsize=2)(self._torque)
        self._design_with = lru_cache(maxsize=3)(self._design_at)

    def least(
        self, x: FloatArray, *, rounds: int = _ROUNDS, earliest_s: float = 0.0
    ) -> tuple[FloatArray, float]:
        """Return the point of least error from a start (lag, delay[, asymmetry]), and its logarithm.

        No delay is tried that is less than `earliest_s`.
        """
        from scipy.optimize import least_squares

        limit = float(np.log(MOST_ASYMMETRIC))
        low = np.array([self._lags_s[0], earliest_s, -limit])[: x.size]
        high = np.array([self._lags_s[1], MAX_DELAY_S, limit])[: x.size]
        if not self._slopes(x).any():
            return x, self._loss(x)
        for _ in range(rounds):
            self._weight = 1.0 / np.maximum(np.sqrt(self._squares(x)), 1e-12)
            x = least_squares(
                self._misfit,
                np.clip(x, low, high),
                self._slopes,
                bounds=(low, high),
                x_scale=np.array(_SCALE)[: x.size],
                ftol=_TOLERANCE,
                xtol=_TIME_TOLERANCE,
                gtol=None,
                max_nfev=_MOST_TRIALS,
            ).x
        return x, self._loss(x)

    def _loss(self, x: FloatArray) -> float:
        """Return the mean over the axes of the logarithm of the squared error."""
        return float(np.mean(np.log(np.maximum(self._squares(x), 1e-300))))

    def _misfit(self, x: FloatArray) -> FloatArray:
        """Return the weighted residuals of all axes, one after the other."""
        return np.concatenate([solved.left for solved in self._solved(x)])

    def _squares(self, x: FloatArray) -> FloatArray:
        """Return the squared error of each axis."""
        left = np.array([solved.left @ solved.left for solved in self._solved(x)])
        return np.asarray(left / self._weight**2)

    def _design_at(self, lag_s: float, log_asymmetry: float) -> Design:
        """Return the design with the torque that belongs to such rotors."""
        if self._described is None:
            return self._design
        rotors = Rotors.of(max(lag_s, _LEAST_LAG_S), log_asymmetry)
        return with_lag_on_rotors(self._design, self._described, rotors)

    def _torque(self, lag_s: float, delay_s: float, log_asymmetry: float) -> FloatArray:
        """Return the torque on the training rows, as far as it follows from the instruments."""
        design = self._design_with(lag_s, log_asymmetry)
        return self.project.coordinates(design.torque.behind(lag_s, delay_s, self._inputs)[self._train])

    def _place(self, x: FloatArray) -> tuple[float, float, float]:
        """Return lag, delay and asymmetry, which may not be searched for."""
        return float(x[0]), float(x[1]), float(x[2]) if x.size > 2 else self.log_asymmetry

    def _solved(self, x: FloatArray) -> list[_Solved]:
        """Solve each axis for its gains."""
        torque = self._torque_at(*self._place(x))
        found = []
        for axis, weight in zip(self._axes, self._weight, strict=True):
            alone = _outside(axis.basis, torque[:, axis.inputs])
            gain = np.asarray(np.linalg.lstsq(alone, axis.target, rcond=None)[0], dtype=np.float64)
            found.append(_Solved(weight * (axis.target - alone @ gain), alone, gain))
        return found

    def _slopes(self, x: FloatArray) -> FloatArray:
        """Return the derivatives of the weighted residuals; shape (n_rows of all axes, x.size)."""
        solved_axes, torque = self._solved(x), self._torque_at(*self._place(x))
        derivatives = [
            (self._torque(*self._place(x + step * np.eye(x.size)[number])) - torque) / step
            for number, step in enumerate(_STEPS[: x.size])
        ]
        parts = []
        for axis, weight, solved in zip(self._axes, self._weight, solved_axes, strict=True):
            moved = np.column_stack([derivative[:, axis.inputs] @ solved.gain for derivative in derivatives])
            span, _ = np.linalg.qr(solved.alone)
            parts.append(-weight * _outside(span, _outside(axis.basis, moved)))
        return np.concatenate(parts)


def _outside(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the part of columns that an orthonormal basis does not explain."""
    return np.asarray(columns - basis @ (basis.T @ columns))
