"""One lag and one delay between the logged torque and the angular acceleration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.identify.design import Design
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.torque_products import MAX_DELAY_S, MAX_LAG_S, torque_products
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS

#: Coarse grid as fractions of the largest lag and delay, denser where real ones lie.
_LAG_FRACTIONS = (0.0, 0.02, 0.04, 0.06, 0.08, 0.12, 0.16, 0.2, 0.24, 0.32, 0.4, 0.52, 0.64, 0.8, 1.0)
_DELAY_FRACTIONS = (0.0, 0.04, 0.08, 0.13, 0.17, 0.21, 0.25, 0.33, 0.42, 0.5, 0.67, 0.83, 1.0)
#: Each refinement shrinks the step by four; three leave below 0.1 ms of delay.
_REFINEMENTS = 3
#: Ten minutes of flight at fifty rows a second fix lag and delay to microseconds.
_ENOUGH_ROWS = 30_000
#: Relative difference of squared errors that no cross-validation can tell apart.
_SAME_LOSS = 1e-3
#: 95 % quantile of chi-square with one degree of freedom: by so much the summed
#: logarithms of the errors of instruments differ by chance.
_CHANCE = 3.84


class ActuatorFit(NamedTuple):
    """Best lag and delay [s], and ``loss`` (n_lags, n_delays): 1 - cross-validated R2.

    ``lag_limit_s`` is the largest lag that, with a shorter delay, does as
    well (a lag far shorter than the motion looks like a delay), NaN where
    `lag_limit` has not been asked.
    """

    lag_s: float
    delay_s: float
    lag_grid_s: FloatArray
    delay_grid_s: FloatArray
    loss: FloatArray
    lag_limit_s: float = float("nan")


class _Fold(NamedTuple):
    """One way to split the training rows: fit to one part, score on the other.

    ``to_fit`` and ``to_score`` are the instruments of either part, ``slope``
    solves for the fixed regressors on the rows of ``fit``.
    """

    fit: IntArray
    score: IntArray
    to_fit: Projection
    to_score: Projection
    fixed_fit: FloatArray
    fixed_score: FloatArray
    slope: FloatArray


def fit_actuator(design: Design, structure: Structure, axes: Sequence[int]) -> ActuatorFit:
    """Find the lag and delay that explain the training blocks best, as if the lag acted on the torque.

    Parameters
    ----------
    design : Design
    structure : Structure
    axes : sequence of int
        Axes (0 roll, 1 pitch, 2 yaw) that are excited and informative.

    Returns
    -------
    ActuatorFit

    Notes
    -----
    Without instruments half of the training blocks predicts the other half
    and vice versa; with them, the part of the residual that follows from the
    instruments is made least (generalised method of moments). The axes enter
    by the logarithm of their error, so that none outweighs the others by its
    units. The held-out blocks stay unseen.
    """
    score = Scorer(design, structure, axes)
    lags = MAX_LAG_S * np.array(_LAG_FRACTIONS)
    delays = MAX_DELAY_S * np.array(_DELAY_FRACTIONS)
    loss = np.exp([[score(lag, delay) for delay in delays] for lag in lags])
    row, column = divmod(int(np.argmin(loss)), delays.size)
    lag_s, delay_s = float(lags[row]), float(delays[column])
    lag_step, delay_step = _step_at(lags, row), _step_at(delays, column)
    for _ in range(_REFINEMENTS):
        trial = [
            (score(lag, delay), lag, delay)
            for lag in _around(lag_s, lag_step, MAX_LAG_S)
            for delay in _around(delay_s, delay_step, MAX_DELAY_S)
        ]
        _, lag_s, delay_s = min(trial)
        lag_step, delay_step = lag_step / 4.0, delay_step / 4.0
    return ActuatorFit(lag_s, delay_s, lags, delays, loss)


def lag_limit(score: Scorer, lag_s: float, delay_s: float) -> float:
    """Return how much of the delay might as well be lag.

    For slow motion lag and delay act by their sum alone. Along a constant
    sum, lags are as good as the best while the error is larger by chance only.

    Parameters
    ----------
    score : Scorer
    lag_s, delay_s : float
        The best ones [s].

    Returns
    -------
    float
        The largest lag [s] that does as well.
    """
    trials = np.linspace(lag_s, lag_s + delay_s, 21)
    best = score(lag_s, delay_s)
    good = [lag for lag in trials if score(lag, lag_s + delay_s - lag) < best + score.same_loss]
    return float(max(good, default=lag_s))


class Scorer:
    """Error for one lag and delay; everything that does not depend on them is kept.

    The design is thinned where the flight is longer than the question needs.
    """

    def __init__(self, design: Design, structure: Structure, axes: Sequence[int]) -> None:
        design = design.thinned(_ENOUGH_ROWS)
        self._design = design
        self._axes = list(axes)
        self._inputs = structure.inputs
        names = (*structure.regressors, *design.disturbances(structure))
        self._fixed = np.column_stack([design.columns[name] for name in names if name not in self._inputs])
        targets = np.column_stack([design.columns[name] for name in ACCELERATION_SYMBOLS])
        self._targets = targets[:, self._axes]
        even = design.block % 4 < 2
        train = design.train
        # Instruments hold no noise that two more unknowns could be fitted to: all rows may do both.
        # So they must where a flight is so short, or so much cut about, that one half is empty.
        one_part = design.instruments is not None or not (train & even).any() or not (train & ~even).any()
        parts = (train,) if one_part else (train & even, train & ~even)
        halves = [(np.flatnonzero(rows), Projection(design, structure, rows)) for rows in parts]
        self._folds = [self._fold(*halves[0], *halves[-1])]
        if len(halves) > 1:
            self._folds.append(self._fold(*halves[1], *halves[0]))
        self._spread = sum(
            np.sum(project.coordinates(self._targets[rows] - self._targets[rows].mean(axis=0)) ** 2, axis=0)
            for rows, project in halves
        )
        rows, project = halves[0]
        directions = project.directions(design.time_s.size, rows)
        self._products = None if directions is None else torque_products(design, directions, self._inputs)
        self._explained = project.coordinates(self._targets[rows])
        self.same_loss = same_loss(halves[0][1], self._axes)

    def _fold(self, fit: IntArray, to_fit: Projection, score: IntArray, to_score: Projection) -> _Fold:
        fixed = to_fit.coordinates(self._fixed[fit])
        return _Fold(
            fit,
            score,
            to_fit,
            to_score,
            fixed,
            to_score.coordinates(self._fixed[score]),
            np.asarray(np.linalg.pinv(fixed), dtype=np.float64),
        )

    def __call__(self, lag_s: float, delay_s: float) -> float:
        """Return the logarithm of the error, mean over the axes, of a lag and a delay [s]."""
        if self._products is None:
            # Without instruments, which make few products of the many rows.
            both = np.column_stack([self._design.torque.behind(lag_s, delay_s, self._inputs), self._targets])
            error = np.zeros(len(self._axes))
            for fold in self._folds:
                fit = fold.to_fit.coordinates(both[fold.fit])
                slope = fold.slope @ fit
                inside = fit - fold.fixed_fit @ slope
                outside = fold.to_score.coordinates(both[fold.score]) - fold.fixed_score @ slope
                error += _left_by_torque(inside, outside, len(self._inputs))
            return self._log_error(error)
        both = np.column_stack([self._products(lag_s, delay_s), self._explained])
        (fold,) = self._folds
        left = both - fold.fixed_fit @ (fold.slope @ both)
        return self._log_error(_left_by_torque(left, left, len(self._inputs)))

    def _log_error(self, error: FloatArray) -> float:
        return float(np.mean(np.log(np.maximum(error, 1e-300) / np.maximum(self._spread, 1e-300))))


def same_loss(project: Projection, axes: Sequence[int]) -> float:
    """Return the relative difference of squared errors, mean over the axes, that chance makes.

    Parameters
    ----------
    project : Projection
    axes : sequence of int
        That are scored.

    Returns
    -------
    float
        A thousandth without instruments.
    """
    return _CHANCE / (project.n_instruments * len(axes)) if project.n_instruments else _SAME_LOSS


def _left_by_torque(fit: FloatArray, score: FloatArray, n: int) -> FloatArray:
    """Return the squared error on rows to score of gains fitted to other rows; [n torques, targets] each."""
    theta, *_ = np.linalg.lstsq(fit[:, :n], fit[:, n:], rcond=None)
    return np.asarray(np.sum((score[:, n:] - score[:, :n] @ theta) ** 2, axis=0))


def _step_at(grid: FloatArray, index: int) -> float:
    """Return the larger distance from a grid point to its neighbours."""
    return float(np.max(np.abs(grid - grid[index])[max(index - 1, 0) : index + 2])) / 2.0


def _around(centre: float, step: float, largest: float) -> list[float]:
    """Return five points around the best one, inside the physical range."""
    return sorted({float(np.clip(centre + k * step / 2.0, 0.0, largest)) for k in (-2, -1, 0, 1, 2)})
