"""Lag, delay and spin-up/spin-down asymmetry of the rotors, brought to their least error together.

The search for a lag on the torque only comes near: behind rotors each lag
needs a torque of its own, and to find the two in turn takes many rounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.flight import InputDescription
from quadid_logs.data.model import TimingCheck
from quadid_logs.identify.actuator import ActuatorFit, Scorer, lag_limit, same_loss
from quadid_logs.identify.design import Design
from quadid_logs.identify.fit import used_columns
from quadid_logs.identify.inference import NOTHING_UNKNOWN, TorqueUnknowns, clusters_of, student_quantile
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.rotors import MOST_ASYMMETRIC, Rotors, rotor_slopes, with_lag_on_rotors
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.torque_errors import battery_errors, expo_errors, grid_errors, sampling_errors
from quadid_logs.identify.torque_products import MAX_DELAY_S, MAX_LAG_S
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS

_T = TypeVar("_T")
#: Below [s], the lag of a rotor moves no torque by as much as can be seen.
_LEAST_LAG_S = 0.002
#: A lag of small rotors [s].
_SOME_LAG_S = 0.01
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
#: Symmetric rotors pass for asymmetric ones so often. What is not taken for asymmetry is in the intervals all
#: the same; what is wrongly taken for it takes a part of the effectiveness.
_BY_CHANCE = 0.01
#: Or the squared error falls to half, and the asymmetry is so many standard deviations from none: of some 70
#: simulated flights with symmetric rotors none came near both; with rotors that slow down two to four times
#: as slowly it falls to a quarter, at 10 standard deviations.
_MOST_OF_ERROR = float(np.log(2.0))
_FAR = 4.0
#: Logarithm of the asymmetry from which it is searched for, to either side: twice as slow one way.
_ASYMMETRIC = float(np.log(2.0))
#: No search where asymmetry seems to explain less of the error than this; those flights had 0.07 and more.
_WORTH_TRYING = 0.05
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


class KnownActuator(NamedTuple):
    """Lag and delay [s] that are known before a fit in time, and by how much the torque is late, if it is."""

    lag_s: float
    delay_s: float
    timing: TimingCheck | None = None


class FitProblem(NamedTuple):
    """What is fitted: the rows, the columns each of them may use, and the axes that count.

    ``every_step``: each step of the control loop was logged. ``grid``: steps of the values of L, M, N.
    """

    design: Design
    structure: Structure
    kept: BoolArray
    axes: Sequence[int]
    every_step: bool = False
    grid: tuple[float, float, float] = (0.0, 0.0, 0.0)


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
    if described is not None and start.lag_s >= _LEAST_LAG_S:
        by_chance = same_loss(torque_search.project, problem.axes)
        rotor_search = _Search(problem, described)
        on_rotors, rotor_loss = rotor_search.least(on_torque)
        on_rotors, rotor_loss = _with_asymmetry(rotor_search, on_rotors, rotor_loss, by_chance)
        if rotor_loss <= torque_loss + by_chance or rotor_search.lag_is_measured:
            model = _model(problem.design, start, rotor_search.jackknifed(on_rotors), described)
            return _with_unknowns(model, problem, described)
    model = _model(problem.design, start, torque_search.jackknifed(on_torque))
    return _with_unknowns(model, problem, described)


def _with_asymmetry(
    search: _Search, symmetric: FloatArray, loss: float, by_chance: float
) -> tuple[FloatArray, float]:
    """Return the point of least error with the asymmetry that the flight speaks for, if any, and its loss."""
    scores = search.scores(np.append(symmetric, 0.0))
    if not scores.shown and scores.explained < _WORTH_TRYING:
        return symmetric, loss
    # Begun at none, a search may end on the wrong side: there is a minimum on either.
    both = (search.least(np.append(symmetric, start)) for start in (-_ASYMMETRIC, _ASYMMETRIC))
    asymmetric, least_loss = min(both, key=lambda found: found[1])
    if abs(asymmetric[2]) >= (1.0 - _TIME_TOLERANCE) * np.log(MOST_ASYMMETRIC):
        # A search that ends where no rotor is has found something else.
        return symmetric, loss
    better = loss - least_loss
    shown = scores.shown and better > by_chance
    # The score test has the asymmetry's own error in its variance: of a large one it sees little.
    if shown or (better > _MOST_OF_ERROR and search.scores(asymmetric).deviates(asymmetric[2])):
        return asymmetric, least_loss
    return symmetric, loss


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
    found = search.jackknifed(start) if search.project.n_instruments else search.least(start, rounds=1)[0]
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
    # A lag of nothing is a bound, too, from which no step leads away while the delay is still at its own.
    starts = (start, start + np.array([_SOME_LAG_S, -_SOME_LAG_S]))
    either = (search.least(one, earliest_s=-MAX_DELAY_S) for one in starts)
    found, free_loss = min(either, key=lambda each: each[1])
    if found[1] >= 0.0 or loss - free_loss <= same_loss(search.project, problem.axes):
        return None
    found = search.jackknifed(found, earliest_s=-MAX_DELAY_S)
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
    errors += grid_errors(problem.design, problem.grid)
    if not problem.every_step:
        errors += sampling_errors(problem.design)
    return model._replace(
        actuator=actuator._replace(lag_limit_s=limit_s), unknown=TorqueUnknowns(slopes, errors)
    )


class _Axis(NamedTuple):
    """Basis of the fixed columns, what of the acceleration they leave, and which torques the row may use.

    ``rows`` are fixed columns and acceleration as they are, not as the instruments explain them.
    """

    basis: FloatArray
    target: FloatArray
    inputs: BoolArray
    rows: FloatArray


class _Solved(NamedTuple):
    """Weighted residual, torque outside what the fixed columns explain, and its gains."""

    left: FloatArray
    alone: FloatArray
    gain: FloatArray


class _Scores(NamedTuple):
    """Scores of the asymmetry: derivatives of half the squared error, by cluster (n_clusters,).

    ``information`` is what they change by with the asymmetry, ``squares`` the squared error, ``limit`` how
    many standard deviations chance makes of their sum.
    """

    by_cluster: FloatArray
    information: float
    squares: float
    limit: float

    @property
    def shown(self) -> bool:
        """Whether the flight speaks for asymmetry, at the best lag and delay without.

        A score test whose variance allows for residuals that are alike for a while, as those of gusts are:
        to them a few instruments that happen to follow one gust would pass for evidence (D. D. Boos, The
        American Statistician 46, 1992).
        """
        return bool(self.by_cluster.sum() ** 2 > self.limit**2 * np.sum(self.by_cluster**2))

    @property
    def explained(self) -> float:
        """Fraction of the squared error that asymmetry explains, if it goes on as it begins."""
        of = self.information * self.squares
        return float(self.by_cluster.sum() ** 2 / of) if of > 0.0 else 0.0

    def deviates(self, log_asymmetry: float) -> bool:
        """Say whether an asymmetry is far from none, with the variance of what it leaves itself."""
        return bool(abs(log_asymmetry) * self.information > _FAR * np.linalg.norm(self.by_cluster))


class _Latest(Generic[_T]):
    """The latest results of a method of its owner.

    Not `functools.lru_cache`: that of a bound method refers back to its owner, and so all that a search holds
    would stay in memory until the interpreter looks for cycles.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: dict[tuple[float, ...], _T] = {}

    def of(self, place: tuple[float, ...], make: Callable[..., _T]) -> _T:
        """Return what was made of a place, or make it."""
        if place not in self._kept and len(self._kept) == self._most:
            del self._kept[next(iter(self._kept))]
        found = self._kept.pop(place) if place in self._kept else make(*place)
        self._kept[place] = found
        return found


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
        columns = (*structure.columns, *disturbances)
        is_torque = np.isin(columns, self._inputs)
        # In the order of the torque's columns, which begin with L, M, N; those of a structure end with them.
        torques = [columns.index(symbol) for symbol in self._inputs]
        names = (*structure.regressors, *disturbances)
        fixed = np.column_stack([design.columns[name] for name in names if name not in self._inputs])
        self._fixed = fixed[self._train]
        used = used_columns(design, structure, problem.kept)
        targets = [design.columns[ACCELERATION_SYMBOLS[axis]][self._train] for axis in problem.axes]
        self._rows = [
            np.column_stack([self._fixed[:, used[axis, ~is_torque]], target])
            for axis, target in zip(problem.axes, targets, strict=True)
        ]
        self._used_torques = [used[axis, torques] for axis in problem.axes]
        self._weight = np.ones(len(self._rows))
        # A delay moves no rotor, nor does the choice of instruments.
        self._designs: _Latest[Design] = _Latest(3)
        # The same for all instruments: at a point, and a step away along each unknown.
        self._torques_on_rows: _Latest[FloatArray] = _Latest(1 + len(_STEPS))
        self._see_through(self.project)

    def _see_through(self, project: Projection) -> None:
        """Take from rows and torque what these instruments tell of them."""
        self.project = project
        self._axes: list[_Axis] = []
        for rows, inputs in zip(self._rows, self._used_torques, strict=True):
            explained = project.coordinates(rows)
            basis, _ = np.linalg.qr(explained[:, :-1])
            left = _outside(basis, explained[:, -1:])[:, 0]
            self._axes.append(_Axis(basis, left, inputs, rows))
        # A search asks for residuals and derivatives at the same point, and begins where another has ended.
        self._torques: _Latest[FloatArray] = _Latest(2)
        self._moves: _Latest[list[FloatArray]] = _Latest(1)

    def jackknifed(self, x: FloatArray, *, earliest_s: float = 0.0) -> FloatArray:
        """Return the point near that of least error where no instrument counts for what it follows by chance.

        The axes are weighted by all of their residuals: of so few instruments hardly any is left. As many
        instruments as unknowns hold no search back: one that ends at a bound has found nothing.
        """
        if not self.project.n_instruments or not self._is_seen(x):
            return x
        torque = self._torque_on_rows(x)
        slopes = [
            (self._torque_on_rows(x + step * np.eye(x.size)[number]) - torque) / step
            for number, step in enumerate(_STEPS[: x.size])
        ]
        self._weight = np.ones(len(self._rows))
        left = self._left_of_rows(x)
        other = copy(self)
        other._see_through(
            self.project.jackknifed(
                np.column_stack([self._fixed, torque, *slopes]), clusters_of(self._design)
            )
        )
        other._weight = 1.0 / np.maximum([np.linalg.norm(each) for each in left], 1e-12)
        if not other._is_seen(x):
            return x
        found = other._solve(x, earliest_s)
        return x if _reaches_a_bound(x, found) else found

    def least(
        self, x: FloatArray, *, rounds: int = _ROUNDS, earliest_s: float = 0.0
    ) -> tuple[FloatArray, float]:
        """Return the point of least error from a start (lag, delay[, asymmetry]), and its logarithm.

        No delay is tried that is less than `earliest_s`. A point of more error than the start is no result.
        """
        if not self._is_seen(x):
            return x, self._loss(x)
        best = np.clip(x, *self._bounds(x.size, earliest_s))
        least = self._loss(best)
        for _ in range(rounds):
            self._weight = 1.0 / np.maximum(np.sqrt(self._squares(best)), 1e-12)
            found = self._solve(best, earliest_s)
            loss = self._loss(found)
            if loss > least:
                break
            best, least = found, loss
        return best, least

    def _bounds(self, size: int, earliest_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the least and the largest lag, delay and asymmetry, so many of them."""
        limit = float(np.log(MOST_ASYMMETRIC))
        low = np.array([self._lags_s[0], earliest_s, -limit])
        high = np.array([self._lags_s[1], MAX_DELAY_S, limit])
        return low[:size], high[:size]

    def _solve(self, x: FloatArray, earliest_s: float) -> FloatArray:
        """Return the point of least weighted squares."""
        from scipy.optimize import least_squares

        low, high = self._bounds(x.size, earliest_s)
        found = least_squares(
            self._misfit,
            np.clip(x, low, high),
            self._slopes,
            bounds=(low, high),
            x_scale=np.array(_SCALE)[: x.size],
            ftol=_TOLERANCE,
            xtol=_TIME_TOLERANCE,
            gtol=None,
            max_nfev=_MOST_TRIALS,
        )
        return np.asarray(found.x, dtype=np.float64)

    def _is_seen(self, x: FloatArray) -> bool:
        """Say whether lag, delay or asymmetry move the residuals by more than their rounding.

        What does not is no start of a search.
        """
        moved = np.abs(self._slopes(x) * np.array(_SCALE)[: x.size]).max()
        return bool(moved > np.finfo(np.float64).eps * np.abs(self._misfit(x)).max())

    def scores(self, x: FloatArray) -> _Scores:
        """Return the scores of the asymmetry at a point, lag and delay solved for."""
        slopes, clusters = self._slopes(x), clusters_of(self._design)
        others, _ = np.linalg.qr(slopes[:, :2])
        score = np.split(_outside(others, slopes[:, 2:])[:, 0], len(self._axes))
        left = zip(score, self._left_of_rows(x), strict=True)
        by_row = np.sum([self.project.on_rows(one) * residuals for one, residuals in left], axis=0)
        by_cluster = np.bincount(clusters, weights=by_row).astype(np.float64)
        return _Scores(
            by_cluster=by_cluster,
            information=float(sum(one @ one for one in score)),
            squares=float(np.sum(self._misfit(x) ** 2)),
            limit=float(student_quantile(clusters, _BY_CHANCE / 2.0)),
        )

    def _left_of_rows(self, x: FloatArray) -> list[FloatArray]:
        """Return the weighted residuals of each axis on the training rows themselves."""
        behind = self._torque_on_rows(x)
        found = []
        for axis, weight, solved in zip(self._axes, self._weight, self._solved(x), strict=True):
            left = axis.rows[:, -1] - behind[:, axis.inputs] @ solved.gain
            fixed = self.project.coordinates(np.column_stack([axis.rows[:, :-1], left]))
            theta = np.linalg.lstsq(fixed[:, :-1], fixed[:, -1], rcond=None)[0]
            found.append(np.asarray(weight * (left - axis.rows[:, :-1] @ theta)))
        return found

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

    def _torque_at(self, *place: float) -> FloatArray:
        """Return the same, kept for a place that comes again."""
        return self._torques.of(place, self._torque)

    def _torque(self, *place: float) -> FloatArray:
        """Return the torque on the training rows, as far as it follows from the instruments."""
        return self.project.coordinates(self._torques_on_rows.of(place, self._behind))

    def _behind(self, lag_s: float, delay_s: float, log_asymmetry: float) -> FloatArray:
        """Return the torque on the training rows."""
        design = self._designs.of((lag_s, log_asymmetry), self._design_at)
        return design.torque.behind(lag_s, delay_s, self._inputs)[self._train]

    def _torque_on_rows(self, x: FloatArray) -> FloatArray:
        return self._torques_on_rows.of(self._place(x), self._behind)

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

    def _moved(self, *x: float) -> list[FloatArray]:
        """Return the derivatives of the torque by lag, delay and asymmetry, so many as are searched for."""
        here = np.array(x)
        torque = self._torque_at(*self._place(here))
        return [
            (self._torque(*self._place(here + step * np.eye(here.size)[number])) - torque) / step
            for number, step in enumerate(_STEPS[: here.size])
        ]

    def _slopes(self, x: FloatArray) -> FloatArray:
        """Return the derivatives of the weighted residuals; shape (n_rows of all axes, x.size)."""
        solved_axes, derivatives = self._solved(x), self._moves.of(tuple(x.tolist()), self._moved)
        parts = []
        for axis, weight, solved in zip(self._axes, self._weight, solved_axes, strict=True):
            moved = np.column_stack([derivative[:, axis.inputs] @ solved.gain for derivative in derivatives])
            span, _ = np.linalg.qr(solved.alone)
            parts.append(-weight * _outside(span, _outside(axis.basis, moved)))
        return np.concatenate(parts)


def _reaches_a_bound(start: FloatArray, found: FloatArray) -> bool:
    """Say whether lag or delay went from inside to the largest that any vehicle has."""
    largest_s = np.array([MAX_LAG_S, MAX_DELAY_S])
    inside, ended = (x[:2] < (1.0 - _TIME_TOLERANCE) * largest_s for x in (start, found))
    return bool((inside & ~ended).any())


def _outside(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the part of columns that an orthonormal basis does not explain."""
    return np.asarray(columns - basis @ (basis.T @ columns))
