"""Change points and outliers of vehicles: tests with intervals, scatter and Bonferroni's correction.

Three things can make a number differ between two flights of an undamaged
vehicle: the estimation error (its interval), the scatter of the vehicle's own
flights beyond the intervals, and slow influences that are no damage (a
systematic uncertainty per quantity). A change must exceed all three together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.comparison import yaw_by_throttle
from quadid_logs.maths.normal import MEDIAN_DEVIATION, NORMAL_95

#: Chance of any false alarm in a whole fleet: one in a hundred fleets.
FALSE_ALARMS: Final = 0.01
#: Flights on either side of a change: fewer are a bad day, not a changed vehicle.
MIN_RUN: Final = 3
#: Weight of the fleet's typical scatter, in flights of the vehicle itself: its own few flights estimate
#: it badly, but it need not be like the others.
_PRIOR_FLIGHTS: Final = 10.0
#: Vehicles that a prior, or an outlier test, needs.
_MIN_VEHICLES: Final = 5
#: A split is followed by tests of both parts: as many again.
_LEVELS: Final = 2
#: Statistical efficiency of the median absolute deviation (Hampel 1974): with m vehicles it is as good
#: as the standard deviation with 0.37 m.
_MAD_EFFICIENCY: Final = 0.37


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """One quantity over a vehicle's flights, in order of time.

    Attributes
    ----------
    name, axis : str
        ``axis`` is "" for what belongs to all.
    value, half_width : ndarray, shape (n_flights,)
        Estimate and half of its 95 % interval, NaN where it was not identifiable.
    systematic : float
        Systematic uncertainty: what may differ between flights of an undamaged
        vehicle, in the unit of `value`.
    throttle : ndarray, shape (n_flights,), or None
        Mean throttle of the flights [1], NaN where unknown; None for what does not depend on it.
    """

    name: str
    axis: str
    value: FloatArray
    half_width: FloatArray
    systematic: float
    throttle: FloatArray | None = None

    @property
    def known(self) -> IntArray:
        """Indices of the flights in which the quantity was identifiable."""
        usable = np.isfinite(self.value) & np.isfinite(self.half_width) & (self.half_width > 0.0)
        return np.flatnonzero(usable)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """A quantity before and after, and the least difference that counts.

    ``half_width`` is that of the difference's own 95 % interval, with the
    scatter of the flights, but without systematic uncertainty and correction.
    ``p_value`` is the chance of such a difference in any vehicle of an unchanged fleet, where the
    intervals alone tell it.
    """

    name: str
    axis: str
    before: float
    after: float
    margin: float
    half_width: float = float("nan")
    p_value: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangePoint:
    """From this flight on (its index in the vehicle's history) the vehicle is another one."""

    flight: int
    shifts: tuple[Shift, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenChange:
    """The vehicle's last flights differ, and one side has too few to call it a change.

    ``flight`` is the first that differs; ``n_before`` and ``n_after`` count the
    flights on either side since the last change in which the quantity that
    differs most is known.
    """

    flight: int
    n_before: int
    n_after: int
    shifts: tuple[Shift, ...]

    @property
    def n_missing(self) -> int:
        """Flights like the last that decide it; 0 if none can, because too few lie before."""
        return max(MIN_RUN - self.n_after, 0) if self.n_before >= MIN_RUN else 0


class ScatterPrior(NamedTuple):
    """Prior of a vehicle's scatter: its mean in squared standard errors, and its weight in flights."""

    scatter: float = 1.0
    flights: float = 0.0


def count_tests(histories: Sequence[Sequence[Series]]) -> int:
    """Return how many differences `find_changes` and `find_open_change` may look at in all vehicles together.

    Tests that Bonferroni's correction must count.
    """
    lengths = [len(one.known) for history in histories for one in history]
    decided = sum(
        max(b - a - 2 * MIN_RUN + 1, 0) for length in lengths for a, b in _seeded_intervals(0, length)
    )
    # Without a decision, at most every split of the last flights is tried.
    return _LEVELS * decided + sum(min(max(length - 1, 0), 2 * MIN_RUN - 2) for length in lengths)


def _seeded_intervals(first: int, after: int) -> Iterator[tuple[int, int]]:
    """Yield a part of a history, its halves, quarters and so on, overlapping by half.

    A propeller that wore and was replaced leaves the whole history's two means
    alike; some seeded interval holds one of the two changes alone (S. Kovács et
    al., "Seeded binary segmentation," Biometrika, vol. 110, pp. 249-256, 2023).
    """
    length, n_flights = float(after - first), after - first
    while length >= 2 * MIN_RUN:
        n_steps = round(2.0 * (n_flights - length) / length)
        for step in range(n_steps + 1):
            begin = first + round((n_flights - length) * step / max(n_steps, 1))
            yield begin, min(begin + round(length), after)
        length /= 2.0


def scatter_prior(histories: Sequence[Sequence[Series]]) -> dict[tuple[str, str], ScatterPrior]:
    """Return, by name and axis, how much more than their intervals the flights of one vehicle scatter.

    From differences of consecutive flights, which a change shifts only once;
    the median over the vehicles, which few changed ones do not shift.

    None for a quantity that fewer than five vehicles have.
    """
    found: dict[tuple[str, str], list[float]] = {}
    for history in histories:
        for one in history:
            known = one.known
            if len(known) >= 2 * MIN_RUN:
                variance = (one.half_width[known] / NORMAL_95) ** 2
                squared = np.diff(one.value[known]) ** 2 / (variance[1:] + variance[:-1])
                found.setdefault((one.name, one.axis), []).append(float(np.mean(squared)))
    return {
        key: ScatterPrior(max(float(np.median(all_)), 1.0), _PRIOR_FLIGHTS)
        for key, all_ in found.items()
        if len(all_) >= _MIN_VEHICLES
    }


def find_changes(
    history: Sequence[Series], n_tests: int, prior: Mapping[tuple[str, str], ScatterPrior]
) -> tuple[ChangePoint, ...]:
    """Split a vehicle's history where it changed.

    Every series is split at every flight. Two means, weighted with the
    intervals, differ if they do so by more than Student's t allows after
    Bonferroni's correction for all tests in the fleet, with the intervals
    widened by the scatter inside the two parts (the Birge ratio [1]_, moderated
    by a prior from the fleet [2]_), and by more than the systematic uncertainty.
    It must hold with the scatter as a factor and as an added variance [4]_.
    Where any series differs, the split is put where the sum of squares over all
    that differ falls most; the parts are split again [3]_. The same is tried in
    seeded intervals of the history, because two changes can hide each other.

    Parameters
    ----------
    history : sequence of Series
        All over the same flights.
    n_tests : int
        From `count_tests`.
    prior : mapping
        From `scatter_prior`.

    Returns
    -------
    tuple of ChangePoint
        In order of time.

    References
    ----------
    .. [1] R. T. Birge, "The calculation of errors by the method of least
       squares," Phys. Rev., vol. 40, pp. 207-227, 1932.
    .. [2] G. K. Smyth, "Linear models and empirical Bayes methods for assessing
       differential expression," Stat. Appl. Genet. Mol. Biol., vol. 3, 2004.
    .. [3] L. Y. Vostrikova, "Detecting disorder in multidimensional random
       processes," Soviet Math. Dokl., vol. 24, pp. 55-59, 1981.
    .. [4] R. C. Paule and J. Mandel, "Consensus values and weighting factors,"
       J. Res. Natl. Bur. Stand., vol. 87, pp. 377-385, 1982.
    """
    n_flights = max((one.value.shape[0] for one in history), default=0)
    open_parts, found = [(0, n_flights)], []
    while open_parts:
        first, after = open_parts.pop()
        splits = [_best_split(history, part, n_tests, prior) for part in _seeded_intervals(first, after)]
        gain, change = max(
            (split for split in splits if split), key=lambda split: split[0], default=(0.0, None)
        )
        if change is not None and gain > 0.0:
            found.append(change)
            open_parts += [(first, change.flight), (change.flight, after)]
    return tuple(sorted(found, key=lambda change: change.flight))


class _Splits(NamedTuple):
    """What every split of a part does to one series: arrays over the flights that could begin the rest."""

    difference: FloatArray
    margin: FloatArray
    gain: FloatArray
    before: FloatArray
    after: FloatArray


def _best_split(
    history: Sequence[Series],
    part: tuple[int, int],
    n_tests: int,
    prior: Mapping[tuple[str, str], ScatterPrior],
) -> tuple[float, ChangePoint] | None:
    """Return the most likely change inside a part of the history and how much it explains, if any does."""
    splits = [_splits(one, part, n_tests, prior.get((one.name, one.axis), ScatterPrior())) for one in history]
    changed = [np.abs(each.difference) > each.margin for each in splits]
    shifted = [number for number, each in enumerate(changed) if each.any()]
    if not shifted:
        return None
    total = np.sum([splits[number].gain for number in shifted], axis=0)
    anywhere = np.any([changed[number] for number in shifted], axis=0)
    while anywhere.any():
        best = int(np.argmax(np.where(anywhere, total, -np.inf)))
        shifts = tuple(
            Shift(
                name=one.name,
                axis=one.axis,
                before=float(each.before[best]),
                after=float(each.after[best]),
                margin=float(each.margin[best]),
            )
            for one, each, here in zip(history, splits, changed, strict=True)
            if here[best] and _is_beyond_scatter(one, part, part[0] + best, n_tests, prior)
        )
        if shifts:
            return float(total[best]), ChangePoint(flight=part[0] + best, shifts=shifts)
        anywhere[best] = False
    return None


def _is_beyond_scatter(
    one: Series,
    part: tuple[int, int],
    flight: int,
    n_tests: int,
    prior: Mapping[tuple[str, str], ScatterPrior],
) -> bool:
    """Return whether a split holds also where scatter adds to the intervals instead of widening them.

    Days scatter alike whether a flight's interval is wide or narrow; widened
    by a factor, a narrow interval would still claim too much.
    """
    known = one.known
    known = known[(known >= part[0]) & (known < part[1])]
    shift, _ = _compared(
        one, known, known >= flight, n_tests, prior.get((one.name, one.axis), ScatterPrior())
    )
    return abs(shift.after - shift.before) > shift.margin


def _splits(one: Series, part: tuple[int, int], n_tests: int, prior: ScatterPrior) -> _Splits:
    """Split one series at every flight of a part; margins are infinite where a side is too short."""
    n_flights = part[1] - part[0]
    nothing = np.zeros(n_flights)
    known = one.known
    known = known[(known >= part[0]) & (known < part[1])]
    n_known = len(known)
    if n_known < 2 * MIN_RUN:
        return _Splits(nothing, nothing + np.inf, nothing, nothing, nothing)
    centre = float(np.median(one.value[known]))  # sums of squares of what is small
    value, weight = one.value[known] - centre, (NORMAL_95 / one.half_width[known]) ** 2
    # How many informative flights lie before each flight of the part.
    count = np.searchsorted(known, np.arange(part[0], part[1]))
    sums = [np.concatenate([[0.0], np.cumsum(weight * value**power)]) for power in (0, 1, 2)]
    w1, w2 = sums[0][count], sums[0][-1] - sums[0][count]
    inside = (count >= MIN_RUN) & (n_known - count >= MIN_RUN)
    with np.errstate(divide="ignore", invalid="ignore"):
        before, after = sums[1][count] / w1, (sums[1][-1] - sums[1][count]) / w2
        residual = sums[2][-1] - w1 * before**2 - w2 * after**2
        variance = 1.0 / w1 + 1.0 / w2
        freedom = n_known - 2.0 + prior.flights
        scatter = np.maximum((residual + prior.flights * prior.scatter) / freedom, 1.0)
        margin = np.hypot(_student(n_tests, freedom) * np.sqrt(scatter * variance), one.systematic)
        margin += _by_throttle(one, known, count, before + centre)
        gain = (after - before) ** 2 / variance / scatter
    return _Splits(
        difference=np.where(inside, after - before, 0.0),
        margin=np.where(inside, margin, np.inf),
        gain=np.where(inside, gain, 0.0),
        before=before + centre,
        after=after + centre,
    )


def _by_throttle(one: Series, known: IntArray, n_before: IntArray, before: FloatArray | float) -> FloatArray:
    """Return what the mean throttle before and after alone may make of the difference between them.

    `n_before` of the known flights lie before, one number for each split; a side without a flight
    that tells its throttle explains nothing.
    """
    throttle = np.zeros(len(known)) if one.throttle is None else np.nan_to_num(one.throttle[known])
    total, number = (np.concatenate([[0.0], np.cumsum(each)]) for each in (throttle, throttle > 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        first = total[n_before] / number[n_before]
        rest = (total[-1] - total[n_before]) / (number[-1] - number[n_before])
        part = yaw_by_throttle(before, rest / first)
    # Added to the margin, not by squares: the throttle shifts the value one way, as a bias.
    return np.where(np.isfinite(part), part, 0.0)


def find_open_change(
    history: Sequence[Series],
    since: int,
    n_tests: int,
    prior: Mapping[tuple[str, str], ScatterPrior],
) -> OpenChange | None:
    """Return how the last flights differ where too few are flown to call it a change.

    One or two last flights are compared with all before them; in a history too
    short for any decision, every split is tried. The test is that of
    `find_changes`, with the scatter as an added variance [1]_.

    Parameters
    ----------
    history : sequence of Series
        All over the same flights.
    since : int
        Index of the first flight that counts: that of the last change.
    n_tests : int
        From `count_tests`.
    prior : mapping
        From `scatter_prior`.

    Returns
    -------
    OpenChange or None
        The split that explains most; None where the last flights are like the others.

    References
    ----------
    .. [1] R. C. Paule and J. Mandel, "Consensus values and weighting factors,"
       J. Res. Natl. Bur. Stand., vol. 87, pp. 377-385, 1982.
    """
    found: dict[int, list[_OpenShift]] = {}
    for one in history:
        known = one.known[one.known >= since]
        most_after = MIN_RUN - 1 if len(known) >= 2 * MIN_RUN else len(known) - 1
        for n_after in range(1, most_after + 1):
            is_after = np.arange(len(known)) >= len(known) - n_after
            shift, error = _compared(
                one, known, is_after, n_tests, prior.get((one.name, one.axis), ScatterPrior())
            )
            difference = shift.after - shift.before
            # A flight that is like those before again is no sign of a change, whatever the one beside it was.
            together = np.all((one.value[known][is_after] - shift.before) * difference > 0.5 * difference**2)
            if abs(difference) > shift.margin and together:
                each = _OpenShift(shift, (difference / error) ** 2, len(known) - n_after, n_after)
                found.setdefault(int(known[-n_after]), []).append(each)
    if not found:
        return None
    flight, differing = max(found.items(), key=lambda split: (sum(each.gain for each in split[1]), split[0]))
    leading = max(differing, key=lambda each: each.gain)
    return OpenChange(
        flight=flight,
        n_before=leading.n_before,
        n_after=leading.n_after,
        shifts=tuple(each.shift for each in differing),
    )


class _OpenShift(NamedTuple):
    """A quantity that differs in the last flights, and how much of its squared residuals that explains."""

    shift: Shift
    gain: float
    n_before: int
    n_after: int


def _compared(
    one: Series, known: IntArray, is_after: BoolArray, n_tests: int, prior: ScatterPrior
) -> tuple[Shift, float]:
    """Compare two sides of a series, scatter being an added variance; return also the standard error."""
    value, freedom = one.value[known], len(known) - 2.0 + prior.flights
    variance = (one.half_width[known] / NORMAL_95) ** 2
    # No flight counts for more than a typical one: a scatter from few flights may come out as none.
    variance = np.maximum(variance, np.median(variance))
    sides = (~is_after, is_after)
    if freedom < 1.0:
        return Shift(name=one.name, axis=one.axis, before=math.nan, after=math.nan, margin=math.inf), math.inf
    weight = 1.0 / (variance + _added_variance(value, variance, sides, prior))
    before, after = (float(np.average(value[side], weights=weight[side])) for side in sides)
    error = float(np.sqrt(sum(1.0 / np.sum(weight[side]) for side in sides)))
    chance = float(np.hypot(_student(n_tests, freedom) * error, one.systematic))
    shift = Shift(
        name=one.name,
        axis=one.axis,
        before=before,
        after=after,
        margin=chance + float(_by_throttle(one, known, np.array(np.sum(~is_after)), before)),
        half_width=_quantile(0.05, freedom) * error,
    )
    return shift, error


def _added_variance(
    value: FloatArray, variance: FloatArray, sides: tuple[BoolArray, BoolArray], prior: ScatterPrior
) -> float:
    """Return the variance between flights beyond their intervals at which the residuals are as expected.

    Where all intervals are alike, this is the Birge ratio.
    """
    freedom, typical = len(value) - 2.0 + prior.flights, float(np.median(variance))
    parts = [(value[side], variance[side]) for side in sides]

    def excess(added: float) -> float:
        residual = prior.flights * prior.scatter * typical / (typical + added)
        for values, variances in parts:
            weight = 1.0 / (variances + added)
            # As np.average does, without its checks, which would take most of the time.
            mean = (values * weight).sum() / weight.sum()
            residual += float((weight * (values - mean) ** 2).sum())
        return residual - freedom

    if excess(0.0) <= 0.0:
        return 0.0
    from scipy.optimize import brentq

    # Here no residual is left to explain: each squared one is at most the squared span.
    most = float(np.ptp(value)) ** 2 * len(value) + prior.flights * prior.scatter * typical
    return float(brentq(excess, 0.0, most, rtol=1e-6))


def _student(n_tests: int, freedom: float) -> float:
    """Return the two-sided quantile of Student's t at which all tests together give few false alarms."""
    return _quantile(FALSE_ALARMS / max(n_tests, 1), freedom)


def _quantile(chance: float, freedom: float) -> float:
    """Return what Student's t exceeds on either side with this chance."""
    from scipy.special import stdtrit

    return float(-stdtrit(freedom, 0.5 * chance))


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlierTest:
    """A vehicle's present value of a quantity against the others of its model."""

    vehicle: str
    name: str
    axis: str
    value: float
    typical: float
    margin: float

    @property
    def is_outlier(self) -> bool:
        """Whether it differs by more than chance and scatter between vehicles."""
        return abs(self.value - self.typical) > self.margin


def present_value(one: Series, since: int, prior: ScatterPrior) -> tuple[float, float]:
    """Return the mean of a series since a flight, and its standard error; NaN if nowhere identifiable.

    Parameters
    ----------
    since : int
        Index of the first flight that counts: that of the last change.

    Returns
    -------
    mean, standard_error : float
        In the unit of the series.
    """
    known = one.known
    known = known[known >= since]
    if not len(known):
        return float("nan"), float("nan")
    weight = (NORMAL_95 / one.half_width[known]) ** 2
    mean = float(np.sum(weight * one.value[known]) / np.sum(weight))
    residual = float(np.sum(weight * (one.value[known] - mean) ** 2))
    scatter = max(
        (residual + prior.flights * prior.scatter) / max(len(known) - 1.0 + prior.flights, 1.0), 1.0
    )
    return mean, float(np.sqrt(scatter / np.sum(weight)))


def present_throttle(one: Series, since: int) -> float:
    """Return the mean throttle of a series since a flight, 0 where it is not known or of no influence.

    Parameters
    ----------
    since : int
        As for `present_value`.

    Returns
    -------
    float
        As a fraction of full throttle [1].
    """
    known = one.known[one.known >= since]
    throttle = np.zeros(0) if one.throttle is None else one.throttle[known]
    throttle = throttle[throttle > 0.0]
    return float(np.mean(throttle)) if len(throttle) else 0.0


def compare_vehicles(
    present: Mapping[str, tuple[float, float]],
    *,
    name: str,
    axis: str,
    systematic: float,
    n_tests: int,
    throttle: Mapping[str, float] | None = None,
) -> tuple[OutlierTest, ...]:
    """Compare every vehicle with all others of its model.

    Parameters
    ----------
    present : mapping of str to (value, standard error)
        By vehicle, from `present_value`.
    systematic : float
        As of the `Series`.
    n_tests : int
        Vehicles times quantities in the fleet.
    throttle : mapping of str to float, optional
        Mean throttle by vehicle where the quantity depends on it.

    Returns
    -------
    tuple of OutlierTest
        Against the median and the median absolute deviation of the others:
        several outliers do not hide each other. Empty with fewer than five
        others.
    """
    known = {vehicle: both for vehicle, both in present.items() if np.isfinite(both).all()}
    if len(known) <= _MIN_VEHICLES:
        return ()
    outlier_tests, flown = [], throttle or {}
    for vehicle, (value, error) in known.items():
        others = np.array([both[0] for other, both in known.items() if other != vehicle])
        middle = float(np.median(others))
        scatter = float(np.median(np.abs(others - middle))) / MEDIAN_DEVIATION
        freedom = max(_MAD_EFFICIENCY * (len(others) - 1), 1.0)
        margin = float(np.hypot(_student(n_tests, freedom) * np.hypot(scatter, error), systematic))
        # What the vehicle's throttle against that of the others alone may make of the quantity.
        others_throttle = [each for other, each in flown.items() if other != vehicle and each > 0.0]
        own = flown.get(vehicle, 0.0)
        if others_throttle and own > 0.0:
            margin += float(yaw_by_throttle(middle, own / np.median(others_throttle)))
        outlier_tests.append(
            OutlierTest(vehicle=vehicle, name=name, axis=axis, value=value, typical=middle, margin=margin)
        )
    return tuple(outlier_tests)
