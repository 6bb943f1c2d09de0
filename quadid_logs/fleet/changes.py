"""When a vehicle changed, and which one stands out: decided with intervals, scatter and the number of tests.

Three things can make a number differ between two flights of a whole vehicle:
what the flight cannot tell (its interval), what the day brings (scatter of the
vehicle's own flights beyond the intervals), and slow influences that are no
damage (a floor per quantity). A change must exceed all three together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.normal import MEDIAN_DEVIATION, NORMAL_95

#: Chance of any false alarm in a whole fleet: one in a hundred fleets.
FALSE_ALARMS: Final = 0.01
#: Flights on either side of a change: fewer are a bad day, not a changed vehicle.
MIN_RUN: Final = 3
#: The scatter that is usual in the fleet counts like this many flights of the vehicle itself: its own
#: few flights tell it badly, but it need not be like the others.
_PRIOR_FLIGHTS: Final = 10.0
#: Vehicles that must be there to say what is usual, or to stand out against.
_MIN_VEHICLES: Final = 5
#: A splitting of the life is followed by tests of the parts: as many again.
_LEVELS: Final = 2
#: How much of the information the median absolute deviation uses (Hampel 1974): m vehicles tell
#: their scatter by it as well as 0.37 m by the standard deviation.
_MAD_EFFICIENCY: Final = 0.37


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """One quantity over a vehicle's flights, in order of time.

    Attributes
    ----------
    name, axis : str
        ``axis`` is "" for what belongs to all.
    value, half_width : ndarray, shape (n_flights,)
        Estimate and half of its 95 % interval, NaN where the flight does not tell.
    floor : float
        What may differ between flights of a whole vehicle, in the unit of `value`.
    """

    name: str
    axis: str
    value: FloatArray
    half_width: FloatArray
    floor: float

    @property
    def told(self) -> FloatArray:
        """Indices of the flights that tell the quantity."""
        usable = np.isfinite(self.value) & np.isfinite(self.half_width) & (self.half_width > 0.0)
        return np.flatnonzero(usable)  # type: ignore[return-value]


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """A quantity before and after, and the least difference that counts."""

    name: str
    axis: str
    before: float
    after: float
    margin: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """From this flight on (its index in the vehicle's life) the vehicle is another one."""

    flight: int
    shifts: tuple[Shift, ...]


class Usual(NamedTuple):
    """Scatter that is usual in the fleet, in squared intervals' standard errors, and what it counts for."""

    scatter: float = 1.0
    flights: float = 0.0


def count_tests(lives: Sequence[Sequence[Series]]) -> int:
    """Return how many differences `find_changes` may look at in all vehicles together."""
    return _LEVELS * sum(
        max(b - a - 2 * MIN_RUN + 1, 0)
        for life in lives
        for one in life
        for a, b in _stretches(0, len(one.told))
    )


def _stretches(first: int, after: int) -> Iterator[tuple[int, int]]:
    """Yield a part of a life, its halves, quarters and so on, overlapping by half.

    A propeller that wore and was replaced leaves the whole life's two means
    alike; some stretch holds one of the two changes alone (S. Kovács et al.,
    "Seeded binary segmentation," Biometrika, vol. 110, pp. 249-256, 2023).
    """
    length, n_flights = float(after - first), after - first
    while length >= 2 * MIN_RUN:
        n_steps = round(2.0 * (n_flights - length) / length)
        for step in range(n_steps + 1):
            begin = first + round((n_flights - length) * step / max(n_steps, 1))
            yield begin, min(begin + round(length), after)
        length /= 2.0


def usual_scatter(lives: Sequence[Sequence[Series]]) -> dict[tuple[str, str], Usual]:
    """Return, by name and axis, how much more than their intervals the flights of one vehicle scatter.

    From differences of consecutive flights, which a change moves only once;
    the median over the vehicles, which few changed ones do not move.
    """
    found: dict[tuple[str, str], list[float]] = {}
    for life in lives:
        for one in life:
            told = one.told
            if len(told) >= 2 * MIN_RUN:
                variance = (one.half_width[told] / NORMAL_95) ** 2
                squared = np.diff(one.value[told]) ** 2 / (variance[1:] + variance[:-1])
                found.setdefault((one.name, one.axis), []).append(float(np.mean(squared)))
    return {
        key: Usual(max(float(np.median(all_)), 1.0), _PRIOR_FLIGHTS)
        for key, all_ in found.items()
        if len(all_) >= _MIN_VEHICLES
    }


def find_changes(
    life: Sequence[Series], n_tests: int, usual: Mapping[tuple[str, str], Usual]
) -> tuple[Change, ...]:
    """Split a vehicle's life where it changed.

    Every series is split at every flight. Two means, weighted with the
    intervals, differ if they do so by more than Student's t allows after
    Bonferroni's correction for all tests in the fleet, with the intervals
    widened by the scatter inside the two parts (the Birge ratio [1]_, moderated
    by what is usual in the fleet [2]_), and by more than the floor. Where any
    series differs, the split is put where the sum of squares over all that
    differ falls most; the parts are split again [3]_. The same is tried in
    stretches of the life, because two changes can hide each other.

    Parameters
    ----------
    life : sequence of Series
        All over the same flights.
    n_tests : int
        From `count_tests`.
    usual : mapping
        From `usual_scatter`.

    Returns
    -------
    tuple of Change
        In order of time.

    References
    ----------
    .. [1] R. T. Birge, "The calculation of errors by the method of least
       squares," Phys. Rev., vol. 40, pp. 207-227, 1932.
    .. [2] G. K. Smyth, "Linear models and empirical Bayes methods for assessing
       differential expression," Stat. Appl. Genet. Mol. Biol., vol. 3, 2004.
    .. [3] L. Y. Vostrikova, "Detecting disorder in multidimensional random
       processes," Soviet Math. Dokl., vol. 24, pp. 55-59, 1981.
    """
    n_flights = max((one.value.shape[0] for one in life), default=0)
    open_parts, found = [(0, n_flights)], []
    while open_parts:
        first, after = open_parts.pop()
        splits = [_best_split(life, stretch, n_tests, usual) for stretch in _stretches(first, after)]
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
    life: Sequence[Series],
    part: tuple[int, int],
    n_tests: int,
    usual: Mapping[tuple[str, str], Usual],
) -> tuple[float, Change] | None:
    """Return the most likely change inside a part of the life and how much it explains, None if none does."""
    splits = [_splits(one, part, n_tests, usual.get((one.name, one.axis), Usual())) for one in life]
    changed = [np.abs(each.difference) > each.margin for each in splits]
    moving = [number for number, each in enumerate(changed) if each.any()]
    if not moving:
        return None
    total = np.sum([splits[number].gain for number in moving], axis=0)
    anywhere = np.any([changed[number] for number in moving], axis=0)
    best = int(np.argmax(np.where(anywhere, total, -np.inf)))
    return float(total[best]), Change(
        flight=part[0] + best,
        shifts=tuple(
            Shift(
                name=one.name,
                axis=one.axis,
                before=float(each.before[best]),
                after=float(each.after[best]),
                margin=float(each.margin[best]),
            )
            for one, each, here in zip(life, splits, changed, strict=True)
            if here[best]
        ),
    )


def _splits(one: Series, part: tuple[int, int], n_tests: int, usual: Usual) -> _Splits:
    """Split one series at every flight of a part; margins are infinite where a side is too short."""
    n_flights = part[1] - part[0]
    nothing = np.zeros(n_flights)
    told = one.told
    told = told[(told >= part[0]) & (told < part[1])]
    n_told = len(told)
    if n_told < 2 * MIN_RUN:
        return _Splits(nothing, nothing + np.inf, nothing, nothing, nothing)
    centre = float(np.median(one.value[told]))  # sums of squares of what is small
    value, weight = one.value[told] - centre, (NORMAL_95 / one.half_width[told]) ** 2
    # How many of the flights that tell lie before each flight of the part.
    count = np.searchsorted(told, np.arange(part[0], part[1]))
    sums = [np.concatenate([[0.0], np.cumsum(weight * value**power)]) for power in (0, 1, 2)]
    w1, w2 = sums[0][count], sums[0][-1] - sums[0][count]
    inside = (count >= MIN_RUN) & (n_told - count >= MIN_RUN)
    with np.errstate(divide="ignore", invalid="ignore"):
        before, after = sums[1][count] / w1, (sums[1][-1] - sums[1][count]) / w2
        residual = sums[2][-1] - w1 * before**2 - w2 * after**2
        variance = 1.0 / w1 + 1.0 / w2
        freedom = n_told - 2.0 + usual.flights
        scatter = np.maximum((residual + usual.flights * usual.scatter) / freedom, 1.0)
        margin = np.hypot(_student(n_tests, freedom) * np.sqrt(scatter * variance), one.floor)
        gain = (after - before) ** 2 / variance / scatter
    return _Splits(
        difference=np.where(inside, after - before, 0.0),
        margin=np.where(inside, margin, np.inf),
        gain=np.where(inside, gain, 0.0),
        before=before + centre,
        after=after + centre,
    )


def _student(n_tests: int, freedom: float) -> float:
    """Return the two-sided quantile of Student's t at which all tests together give few false alarms."""
    from scipy.special import stdtrit

    return float(-stdtrit(freedom, 0.5 * FALSE_ALARMS / max(n_tests, 1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """A vehicle's present value of a quantity against the others of its model."""

    vehicle: str
    name: str
    axis: str
    value: float
    usual: float
    margin: float

    @property
    def stands_out(self) -> bool:
        """Whether it differs by more than chance and scatter between vehicles."""
        return abs(self.value - self.usual) > self.margin


def present_value(one: Series, since: int, usual: Usual) -> tuple[float, float]:
    """Return the mean of a series since a flight, and its standard error; NaN where no flight tells it."""
    told = one.told
    told = told[told >= since]
    if not len(told):
        return float("nan"), float("nan")
    weight = (NORMAL_95 / one.half_width[told]) ** 2
    mean = float(np.sum(weight * one.value[told]) / np.sum(weight))
    residual = float(np.sum(weight * (one.value[told] - mean) ** 2))
    scatter = max((residual + usual.flights * usual.scatter) / max(len(told) - 1.0 + usual.flights, 1.0), 1.0)
    return mean, float(np.sqrt(scatter / np.sum(weight)))


def compare_vehicles(
    present: Mapping[str, tuple[float, float]], *, name: str, axis: str, floor: float, n_tests: int
) -> tuple[Standing, ...]:
    """Compare every vehicle with all others of its model.

    Parameters
    ----------
    present : mapping of str to (value, standard error)
        By vehicle, from `present_value`.
    name, axis : str
        Of the quantity.
    floor : float
        As of the `Series`.
    n_tests : int
        Vehicles times quantities in the fleet.

    Returns
    -------
    tuple of Standing
        Median and median absolute deviation of the others say what is usual:
        several that stand out do not hide each other. Empty with fewer than
        five others.
    """
    known = {vehicle: both for vehicle, both in present.items() if np.isfinite(both).all()}
    if len(known) <= _MIN_VEHICLES:
        return ()
    standings = []
    for vehicle, (value, error) in known.items():
        others = np.array([both[0] for other, both in known.items() if other != vehicle])
        middle = float(np.median(others))
        scatter = float(np.median(np.abs(others - middle))) / MEDIAN_DEVIATION
        freedom = max(_MAD_EFFICIENCY * (len(others) - 1), 1.0)
        margin = float(np.hypot(_student(n_tests, freedom) * np.hypot(scatter, error), floor))
        standings.append(
            Standing(vehicle=vehicle, name=name, axis=axis, value=value, usual=middle, margin=margin)
        )
    return tuple(standings)
