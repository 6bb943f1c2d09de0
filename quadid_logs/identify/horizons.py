"""Prediction of body rates some steps ahead, with intervals: one regression for each horizon.

A simulated model accumulates all errors of torque, trim and air. A hovering multirotor is unstable, so that
the prediction loses its accuracy after half a second. Here the change of the rates after n steps is regressed
on known quantities: the state at the start of the horizon, the torque since then, and the last tenth of a
second, while the rotors still follow an earlier command. Cross-validation over flights sets the penalty of
each group of columns, and the width of the intervals.

References
----------
D. S. Shook, C. Mohtadi and S. L. Shah, "Identification for long-range predictive control," IEE Proceedings
D 138, 1991, for a fit to each horizon; A. E. Hoerl and R. W. Kennard, Technometrics 12, 1970, for the
penalties; J. Lei, M. G'Sell, A. Rinaldo, R. J. Tibshirani and L. Wasserman, Journal of the American
Statistical Association 113, 2018, sec. 5.2, for intervals by residuals over their expected size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.errors import EmptyLogError, SettingsError
from quadid_logs.identify.terms import (
    GRAVITY,
    GYROSCOPIC,
    RATE_TERMS,
    VELOCITY,
    VELOCITY_LIFTED,
    VELOCITY_SQUARED,
    Term,
    column_of,
)
from quadid_logs.maths.nonnegative import nonnegative_least_squares

#: Horizons in samples: those that the nano-drone benchmark scores.
STEPS: Final = (1, 10, 50)
#: The state where a horizon begins, by groups of one penalty. Of the attitude only gravity along the body
#: axes: the heading moves nothing.
START_TERMS: Final[Mapping[str, tuple[Term, ...]]] = {
    "rates": RATE_TERMS,
    "products of rates": GYROSCOPIC,
    "tilt": GRAVITY,
    "speed": VELOCITY,
    "speed squared and lifted": (*VELOCITY_SQUARED, *VELOCITY_LIFTED),
}
_TORQUE, _TORQUE_CHANGE = "torque", "change of torque"
_TORQUE_BEFORE, _RATES_BEFORE = "torque before", "rates before"
#: Three time constants of a typical multirotor's rotor, of 30 ms [s].
MEMORY_S: Final = 0.1
#: The torque where a horizon begins is the mean of so many samples: one alone is its noise.
_START_SAMPLES = 3
#: The torque after that is told in so many parts: after half a second, parts of 80 ms, about a rotor's lag.
_PARTS = 6
#: From nothing taken off to nothing left, in steps of half a decade; columns count in their own spread.
_PENALTIES: Final = 10.0 ** np.arange(-6.0, 4.01, 0.5)
_FIRST_PENALTY = 0.1
#: The search ends where a round over all groups explains less than this more.
_GAIN = 1e-4
_MOST_ROUNDS = 6
#: Starts that follow each other tell the same; of a long flight so many, evenly spread, are fitted to.
_MOST_STARTS = 20_000
_PROBABILITY: Final = 0.95
#: Rounds in which the expected size of the residuals settles, and the least of it over their mean.
_SIZE_ROUNDS = 8
_LEAST_SIZE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HorizonModel:
    """The regression of one horizon.

    Attributes
    ----------
    n_steps : int
    weights : ndarray, shape (n_columns + 1, 3)
        Change of p, q, r [rad/s] per unit of a column; the last row is the constant.
    penalties : dict of str to float
        Ridge penalty by group of columns: 0.1 reduces the weight of a single column by a tenth.
    unexplained : float
        Unexplained fraction of the squared change of the rates in validation flights. At 1, the model is as
        good as constant rates.
    size : ndarray, shape (n_sizes, 3)
        Expected size of the residual per unit of the activity at the start (motion, torque).
    least_size, quantile : ndarray, shape (3,)
        Smallest expected size [rad/s]; half width of the 95 % interval over the expected size.
    """

    n_steps: int
    weights: FloatArray
    penalties: dict[str, float]
    unexplained: float
    size: FloatArray
    least_size: FloatArray
    quantile: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HorizonPrediction:
    """Predicted and measured rates at one horizon, from every start in a flight.

    Attributes
    ----------
    n_steps : int
        Horizon in samples.
    horizon_s : float
        Horizon [s].
    start_s : ndarray, shape (n_starts,)
        Start of each horizon [s].
    predicted, half_width, measured, kept : ndarray, shape (n_starts, 3)
        p, q, r at the end of the horizon [rad/s]: predicted, half of the 95 % interval, and measured.
        ``kept`` are the rates at the start.
    """

    n_steps: int
    horizon_s: float
    start_s: FloatArray
    predicted: FloatArray
    half_width: FloatArray
    measured: FloatArray
    kept: FloatArray

    @property
    def error_rad_s(self) -> float:
        """Mean length of the error vector, as in the nano-drone benchmark [rad/s]."""
        return _mean_length(self.measured - self.predicted)

    @property
    def kept_error_rad_s(self) -> float:
        """Mean length of the error vector for constant rates [rad/s]."""
        return _mean_length(self.measured - self.kept)

    @property
    def coverage(self) -> FloatArray:
        """Fraction of the starts whose interval contains the measured rate, by axis; shape (3,)."""
        return np.asarray(np.mean(np.abs(self.measured - self.predicted) <= self.half_width, axis=0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RatePredictor:
    """Predicts body rates some steps ahead in flights of one vehicle.

    Attributes
    ----------
    groups : tuple of str
        Groups of `START_TERMS` that all flights had.
    sample_period_s, memory_s : float
        Sample period of the flights; length of the past before a horizon that is used [s].
    torque_unit : str
        Unit of the torque in all flights, "" if not known.
    horizons : tuple of HorizonModel
        One model for each horizon.
    """

    groups: tuple[str, ...]
    sample_period_s: float
    memory_s: float
    torque_unit: str
    horizons: tuple[HorizonModel, ...]

    def predict(self, data: FlightData) -> tuple[HorizonPrediction, ...]:
        """Predict from every sample of another flight, given the torque until the end of the horizon.

        Parameters
        ----------
        data : FlightData
            A flight with the same sample period.

        Returns
        -------
        tuple of HorizonPrediction
            One prediction for each horizon, all with the same starts.

        Raises
        ------
        SettingsError
            If the flight has another sample period, or its torque is another quantity.
        EmptyLogError
            If the flight lacks a signal, or no segment is longer than the longest horizon.
        """
        _check_same(data, self.sample_period_s, self.torque_unit)
        longest = max(each.n_steps for each in self.horizons)
        found = []
        for model in self.horizons:
            n_before = _n_before(self.memory_s, self.sample_period_s)
            rows = _rows_of(data, self.groups, _Span(n_before, model.n_steps, longest))
            change = np.column_stack([rows.columns, np.ones(len(rows.columns))]) @ model.weights
            sizes = np.maximum(np.einsum("akm,ma->ka", rows.activity, model.size), model.least_size)
            found.append(
                HorizonPrediction(
                    n_steps=model.n_steps,
                    horizon_s=model.n_steps * self.sample_period_s,
                    start_s=rows.start_s,
                    predicted=rows.start_rate + change,
                    half_width=model.quantile * sizes,
                    measured=rows.start_rate + rows.change,
                    kept=rows.start_rate,
                )
            )
        return tuple(found)


def fit_predictor(
    flights: Sequence[FlightData],
    steps: Sequence[int] = STEPS,
    sets: Sequence[str] | None = None,
    *,
    memory_s: float = MEMORY_S,
) -> RatePredictor:
    """Fit a regression for each horizon to flights of one vehicle.

    Parameters
    ----------
    flights : sequence of FlightData
        Flights with one sample period.
    steps : sequence of int
        Horizons in samples.
    sets : sequence of str, optional
        Name of the set that each flight belongs to, for cross-validation by set. Put flights that repeat one
        trajectory into one set. The default is one set for each flight.
    memory_s : float
        Length of the past before the start of a horizon that is used [s]; 0 uses the state at the start only.

    Returns
    -------
    RatePredictor

    Raises
    ------
    SettingsError
        If there are fewer than two sets, or sample periods or torque quantities differ.
    EmptyLogError
        If a flight has no segment longer than the longest horizon.
    """
    names = [str(number) for number in range(len(flights))] if sets is None else [*sets]
    if len(names) != len(flights) or len(set(names)) < 2:
        raise SettingsError(
            "At least two sets of flights are needed: intervals of predictions come from flights that were "
            "left out.",
            hint="Name two flights or more, and one set for each.",
        )
    if not steps or min(steps) < 1:
        raise SettingsError("A horizon must be at least one step.")
    period_s = flights[0].sample_period_s
    for flight in flights:
        _check_same(flight, period_s, _unit(flights[0]))
    groups = tuple(
        name
        for name, terms in START_TERMS.items()
        if all(_columns(flight, terms) is not None for flight in flights)
    )
    spans = [_Span(_n_before(memory_s, period_s), n_steps, max(steps)) for n_steps in steps]
    models = tuple(
        _fit_horizon([_rows_of(flight, groups, span) for flight in flights], names, span.n_steps)
        for span in spans
    )
    return RatePredictor(
        groups=groups,
        sample_period_s=period_s,
        memory_s=memory_s,
        torque_unit=_unit(flights[0]),
        horizons=models,
    )


class _Span(NamedTuple):
    """Samples before a start, to the end of its horizon, and to that of the longest one."""

    n_before: int
    n_steps: int
    longest: int


class _Rows(NamedTuple):
    """Starts in one flight: what is known of each, and how far the rates change until its end.

    ``groups`` is the name of each column's group; ``activity``, (3, n_starts, n_sizes) by axis, is what the
    size of a residual goes with.
    """

    start_s: FloatArray
    start_rate: FloatArray
    columns: FloatArray
    groups: tuple[str, ...]
    change: FloatArray
    activity: FloatArray

    def thinned(self) -> _Rows:
        """Return starts that are evenly spread, not too many."""
        step = max(1, -(-len(self.start_s) // _MOST_STARTS))
        return self._replace(
            start_s=self.start_s[::step],
            start_rate=self.start_rate[::step],
            columns=self.columns[::step],
            change=self.change[::step],
            activity=self.activity[:, ::step],
        )


def _check_same(data: FlightData, period_s: float, unit: str) -> None:
    """Refuse a flight on another clock, or whose torque is another quantity."""
    if _unit(data) != unit:
        raise SettingsError(
            f"The torque of one flight is in {unit!a}, that of another in {_unit(data)!a}.",
            hint="Describe the vehicle with --vehicle: all flights are then in N m.",
        )
    if not np.isclose(data.sample_period_s, period_s, rtol=1e-3):
        raise SettingsError(
            f"The flights were resampled to {1.0 / period_s:.4g} and {1.0 / data.sample_period_s:.4g} Hz.",
            hint="Set one rate for all flights with --sample-rate-hz.",
        )


def _n_before(memory_s: float, period_s: float) -> int:
    """Return the memory in samples: two parts, or none."""
    return 2 * round(0.5 * memory_s / period_s)


def _unit(data: FlightData) -> str:
    return "" if data.input is None else data.input.unit


def _columns(data: FlightData, terms: Sequence[Term]) -> list[FloatArray] | None:
    """Return the columns of terms by segment, (n_samples, n_terms) each; None where the flight lacks one."""
    found = []
    for segment in data.segments:
        columns = [column_of(term, segment, data.sample_period_s) for term in terms]
        known = [column for column in columns if column is not None]
        if len(known) < len(columns):
            return None
        found.append(np.column_stack(known))
    return found


def _rows_of(data: FlightData, groups: Sequence[str], span: _Span) -> _Rows:
    """Return the starts of a flight from which the longest horizon ends in its segment."""
    started: list[tuple[str, list[FloatArray]]] = []
    for name in groups:
        columns = _columns(data, START_TERMS[name])
        if columns is None:
            raise EmptyLogError(f"The flight lacks a signal that the others have: {name}.")
        started.append((name, columns))
    parts = [
        _rows_in(segment, [(name, columns[number]) for name, columns in started], span)
        for number, segment in enumerate(data.segments)
        if segment.n_samples > span.n_before + span.longest
    ]
    if not parts:
        least = span.n_before + span.longest
        raise EmptyLogError(f"No segment of the flight is longer than {least} samples.")
    return parts[0]._replace(
        start_s=np.concatenate([each.start_s for each in parts]),
        start_rate=np.concatenate([each.start_rate for each in parts]),
        columns=np.concatenate([each.columns for each in parts]),
        change=np.concatenate([each.change for each in parts]),
        activity=np.concatenate([each.activity for each in parts], axis=1),
    )


def _rows_in(segment: Segment, started: Sequence[tuple[str, FloatArray]], span: _Span) -> _Rows:
    """Return the starts of one segment."""
    start = np.arange(span.n_before, segment.n_samples - span.longest, dtype=np.int64)
    rate, n_steps = segment.body_rate_rad_s, span.n_steps
    first = min(n_steps, _START_SAMPLES)
    at_start = _mean_over(segment.torque, start, first)
    ends = np.linspace(first, n_steps, min(n_steps - first, _PARTS) + 1).round().astype(np.int64)
    parts = [_mean_over(segment.torque, start + a, b - a) - at_start for a, b in pairwise(ends.tolist())]
    blocks = [(name, columns[start]) for name, columns in started]
    blocks.append((_TORQUE, at_start))
    if parts:
        blocks.append((_TORQUE_CHANGE, np.hstack(parts)))
    if half := span.n_before // 2:
        before = [_mean_over(segment.torque, start - ago, half) for ago in (2 * half, half)]
        blocks.append((_TORQUE_BEFORE, np.hstack([each - at_start for each in before])))
        blocks.append(
            (_RATES_BEFORE, np.hstack([rate[start] - rate[start - ago] for ago in (2 * half, half)]))
        )
    # What the size of a residual goes with: a constant, how fast the vehicle turns and flies, how much the
    # torque is and varies over the horizon.
    mean, mean_square = (_mean_over(segment.torque**power, start, n_steps) for power in (1, 2))
    varied = np.sqrt(np.maximum(mean_square - mean**2, 0.0))
    turning = np.abs(rate[start])
    together = [np.ones(len(start)), np.linalg.norm(turning, axis=1), np.linalg.norm(varied, axis=1)]
    if "speed" in dict(started) and segment.velocity_m_s is not None:
        together.append(np.linalg.norm(segment.velocity_m_s[start], axis=1))
    own = [(turning[:, axis], varied[:, axis], np.abs(at_start[:, axis])) for axis in range(3)]
    return _Rows(
        start_s=segment.time_s[start],
        start_rate=rate[start],
        columns=np.hstack([block for _, block in blocks]),
        groups=tuple(name for name, block in blocks for _ in range(block.shape[1])),
        change=rate[start + n_steps] - rate[start],
        activity=np.stack([np.column_stack([*together, *each]) for each in own]),
    )


def _mean_over(columns: FloatArray, start: IntArray, n_samples: int) -> FloatArray:
    """Return the mean over so many samples from each start on; shape (n_starts, n_columns)."""
    total = np.vstack([np.zeros(columns.shape[1]), np.cumsum(columns, axis=0)])
    return np.asarray((total[start + n_samples] - total[start]) / n_samples)


class _Moments(NamedTuple):
    """Sums of products over one flight: columns with columns, with changes, changes with themselves."""

    gram: FloatArray
    cross: FloatArray
    total: float
    n_starts: int

    def unexplained(self, weights: FloatArray) -> float:
        """Return which fraction of the squared change is left."""
        left = self.total - 2.0 * np.sum(weights * self.cross) + np.sum(weights * (self.gram @ weights))
        return float(left / self.total) if self.total > 0.0 else 1.0


def _fit_horizon(flights: Sequence[_Rows], sets: Sequence[str], n_steps: int) -> HorizonModel:
    """Fit one horizon, with penalties and intervals by sets that were left out."""
    flights = [each.thinned() for each in flights]
    spread = np.concatenate([each.columns for each in flights]).std(axis=0)
    spread[spread == 0.0] = 1.0
    scaled = [np.column_stack([each.columns / spread, np.ones(len(each.columns))]) for each in flights]
    moments = [
        _Moments(X.T @ X, X.T @ each.change, float(np.sum(each.change**2)), len(X))
        for X, each in zip(scaled, flights, strict=True)
    ]
    columns_of = flights[0].groups
    penalties, unexplained = _choose_penalties(moments, sets, columns_of)
    left_out = _without_each(moments, sets, _ridge(penalties, columns_of))
    residuals = [
        each.change - X @ left_out[name] for X, each, name in zip(scaled, flights, sets, strict=True)
    ]
    # Every flight counts alike. The size of residuals is a sum of activities, none of them negative, fitted
    # to their amount in proportion to it: a calm flight's small ones count for as much as another's large
    # ones.
    counts = np.concatenate([np.full(len(each), 1.0 / len(each)) for each in residuals])
    size_per_activity, least, quantiles = [], [], []
    for axis in range(3):
        amount = np.concatenate([np.abs(each[:, axis]) for each in residuals])
        active = np.concatenate([each.activity[axis] for each in flights])
        mean = float(np.average(amount, weights=counts)) or 1.0
        unit = active.mean(axis=0)
        unit[unit == 0.0] = 1.0
        size = np.full(amount.shape, mean)
        for _ in range(_SIZE_ROUNDS):
            weight = np.sqrt(counts) / size
            # The triangle holds all that many rows tell of few columns, and takes a hundredth of the time.
            orthogonal, triangle = np.linalg.qr(active / unit * weight[:, np.newaxis])
            share = nonnegative_least_squares(triangle, orthogonal.T @ (amount * weight)) / unit
            size = np.maximum(active @ share, _LEAST_SIZE * mean)
        ratio = amount / size
        order = np.argsort(ratio)
        below = np.cumsum(counts[order])
        size_per_activity.append(share)
        least.append(_LEAST_SIZE * mean)
        quantiles.append(float(ratio[order][np.searchsorted(below, _PROBABILITY * below[-1])]))
    weights = _solve(moments, _ridge(penalties, columns_of))
    weights[:-1] /= spread[:, np.newaxis]
    return HorizonModel(
        n_steps=n_steps,
        weights=weights,
        penalties=penalties,
        unexplained=unexplained,
        size=np.column_stack(size_per_activity),
        least_size=np.array(least),
        quantile=np.array(quantiles),
    )


def _ridge(penalties: Mapping[str, float], columns_of: Sequence[str]) -> FloatArray:
    """Return the penalty of each column, the constant's last; shape (n_columns + 1,)."""
    return np.array([*(penalties[name] for name in columns_of), 1e-9])


def _solve(moments: Sequence[_Moments], ridge: FloatArray) -> FloatArray:
    """Return the weights of all columns, scaled; shape (n_columns + 1, 3)."""
    n_starts = sum(each.n_starts for each in moments)
    gram = np.sum([each.gram for each in moments], axis=0) + n_starts * np.diag(ridge)
    return np.asarray(np.linalg.solve(gram, np.sum([each.cross for each in moments], axis=0)))


def _without_each(
    moments: Sequence[_Moments], sets: Sequence[str], ridge: FloatArray
) -> dict[str, FloatArray]:
    """Return the weights without each set."""
    return {
        name: _solve([each for each, of in zip(moments, sets, strict=True) if of != name], ridge)
        for name in dict.fromkeys(sets)
    }


def _choose_penalties(
    moments: Sequence[_Moments], sets: Sequence[str], columns_of: Sequence[str]
) -> tuple[dict[str, float], float]:
    """Search one group after the other for the penalty that leaves least of the sets left out.

    Every set counts alike, and so does every flight in it.
    """

    def unexplained(penalties: Mapping[str, float]) -> float:
        without = _without_each(moments, sets, _ridge(penalties, columns_of))
        left = [each.unexplained(without[name]) for each, name in zip(moments, sets, strict=True)]
        return float(
            np.mean(
                [
                    np.mean([value for value, of in zip(left, sets, strict=True) if of == name])
                    for name in without
                ]
            )
        )

    chosen = dict.fromkeys(columns_of, _FIRST_PENALTY)
    best = unexplained(chosen)
    for _ in range(_MOST_ROUNDS):
        before = best
        for group in chosen:
            tried = {float(each): unexplained({**chosen, group: float(each)}) for each in _PENALTIES}
            penalty = min(tried, key=lambda each: tried[each])
            if tried[penalty] < best:
                best, chosen = tried[penalty], {**chosen, group: penalty}
        if before - best < _GAIN:
            break
    return chosen, best


def _mean_length(error: FloatArray) -> float:
    return float(np.mean(np.linalg.norm(error, axis=1)))
