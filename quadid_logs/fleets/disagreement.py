"""Flights that differ by more than their intervals and one vehicle's days allow, however few they are.

`changes` estimates how a vehicle's flights scatter from the flights
themselves, which takes many of them. Here nothing is estimated: the interval of
each flight, and what may differ between flights of an undamaged vehicle, are
known, so that the squares of the deviations from the mean are a chi-square
also of two flights [1]_. Only on-axis effectiveness is tested, whose
differences between days have a known bound; all else goes with wind and
manoeuvre.

References
----------
.. [1] W. G. Cochran, "The combination of estimates from different experiments,"
   Biometrics, vol. 10, pp. 101-129, 1954: the test of homogeneity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.comparison import yaw_by_throttle
from quadid_logs.fleets.changes import (
    FALSE_ALARMS,
    MIN_RUN,
    ChangePoint,
    OpenChange,
    ScatterPrior,
    Series,
    Shift,
)
from quadid_logs.maths.normal import NORMAL_95

TESTED: Final = "gain"
#: Flights that are another vehicle for a while, and then the old one again: one alone is a bad day.
_EPISODE: Final = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """Flights that no change, bad day or episode makes one vehicle.

    ``first`` and ``last`` are the flights between which it was found, ``lowest`` and ``highest`` the
    values there; ``p_value`` is the chance of as much scatter in any vehicle of an unchanged fleet.
    """

    name: str
    axis: str
    first: int
    last: int
    lowest: float
    highest: float
    p_value: float


class Disagreements(NamedTuple):
    """What explains the flights of a vehicle that do not agree."""

    changes: tuple[ChangePoint, ...] = ()
    open_change: OpenChange | None = None
    scatter: tuple[Scatter, ...] = ()


class _Known(NamedTuple):
    """A quantity in some flights: its value, the variance of it, and what throttle makes of it."""

    flight: IntArray
    value: FloatArray
    variance: FloatArray
    throttle: FloatArray

    def some(self, chosen: BoolArray) -> _Known:
        """Return those of some flights."""
        return _Known(self.flight[chosen], self.value[chosen], self.variance[chosen], self.throttle[chosen])


def n_disagreement_tests(histories: Sequence[Sequence[Series]]) -> int:
    """Return how many quantities `find_disagreements` looks at in all vehicles together."""
    return sum(one.name == TESTED and len(one.known) > 1 for history in histories for one in history)


def find_disagreements(
    history: Sequence[Series],
    ends: Sequence[int],
    n_tests: int,
    prior: Mapping[tuple[str, str], ScatterPrior],
) -> Disagreements:
    """Test whether the flights between the changes that are known agree, and explain where they do not.

    The explanation is the simplest that leaves flights which agree: the last
    ones differ; an episode of two flights or more; a single bad day, which is
    no alarm. Where there is none, they are not one vehicle.

    Parameters
    ----------
    history : sequence of Series
        All over the same flights.
    ends : sequence of int
        Flights with which each part begins, and the number of all.
    n_tests : int
        In the fleet, for Bonferroni's correction.
    prior : mapping
        From `scatter_prior`: of a fleet whose flights all scatter more than their intervals, none is blamed.
    """
    found = _Found()
    for part in pairwise(ends):
        for one in history:
            if one.name == TESTED:
                told = one.known[(one.known >= part[0]) & (one.known < part[1])]
                # Two flights of an undamaged vehicle differ by the systematic uncertainty at most in 95 %.
                between_days = one.systematic**2 / (2.0 * NORMAL_95**2)
                scatter = prior.get((one.name, one.axis), ScatterPrior()).scatter
                variance = scatter * (one.half_width[told] / NORMAL_95) ** 2 + between_days
                throttle = np.full(len(told), math.nan) if one.throttle is None else one.throttle[told]
                known = _Known(told, one.value[told], variance, throttle)
                _explain(one, known, n_tests, is_last=part[1] == ends[-1], found=found)
    return found.merged()


class _Found:
    """Collects what was found in the quantities of a vehicle."""

    def __init__(self) -> None:
        self.changes: dict[int, list[Shift]] = {}
        self.open: dict[tuple[int, int, int], list[Shift]] = {}
        self.scatter: list[Scatter] = []

    def merged(self) -> Disagreements:
        """Put quantities that change with the same flight together."""
        changes = tuple(
            ChangePoint(flight=flight, shifts=tuple(shifts))
            for flight, shifts in sorted(self.changes.items())
        )
        if not self.open:
            return Disagreements(changes, None, tuple(self.scatter))
        leading = min(self.open, key=lambda each: min(shift.p_value for shift in self.open[each]))
        shifts = [shift for key, some in self.open.items() if key[0] == leading[0] for shift in some]
        flight, n_before, n_after = leading
        still = OpenChange(flight=flight, n_before=n_before, n_after=n_after, shifts=tuple(shifts))
        return Disagreements(changes, still, tuple(self.scatter))


def _explain(one: Series, known: _Known, n_tests: int, *, is_last: bool, found: _Found) -> None:
    """Find what makes the flights of a part agree."""
    level = FALSE_ALARMS / max(n_tests, 1)
    p_value = agreement(known)
    if p_value >= level:
        return
    # Which flights may be the ones that differ: the last, some between, or a bad day.
    explanations: list[BoolArray] = []
    n_flights = len(known.flight)
    flight = np.arange(n_flights)
    # Of two that leave the same flights alike, the first counts: a bad day before a change.
    if n_flights > MIN_RUN:
        explanations.extend(flight == day for day in range(n_flights - 1))
    explanations.extend(flight >= begins for begins in range(1, n_flights))
    # Longer ones are changes, which `find_changes` finds.
    for length in range(_EPISODE, 2 * MIN_RUN):
        if n_flights >= max(2 * length, length + MIN_RUN):
            explanations.extend(
                (flight >= begins) & (flight < begins + length) for begins in range(1, n_flights - length)
            )
    candidates = [
        (min(agreement(known.some(differs)), agreement(known.some(~differs))), differs)
        for differs in explanations
    ]
    fitting, differs = max(candidates, key=lambda each: each[0], default=(0.0, np.zeros(0, np.bool_)))
    if fitting < level:
        found.scatter.append(
            Scatter(
                name=one.name,
                axis=one.axis,
                first=int(known.flight[0]),
                last=int(known.flight[-1]),
                lowest=float(known.value.min()),
                highest=float(known.value.max()),
                p_value=min(p_value * n_tests, 1.0),
            )
        )
        return
    n_differ, begins = int(np.count_nonzero(differs)), int(np.argmax(differs))
    first, ends_with_log = int(known.flight[begins]), bool(differs[-1])
    shift = _shift(one, known, differs, n_tests)
    if ends_with_log and is_last and (n_differ < MIN_RUN or begins < MIN_RUN):
        found.open.setdefault((first, begins, n_differ), []).append(shift)
    elif n_differ >= _EPISODE:
        found.changes.setdefault(first, []).append(shift)
        if not ends_with_log:
            back = known.flight[begins + n_differ]
            repaired = replace(shift, before=shift.after, after=shift.before)
            found.changes.setdefault(int(back), []).append(repaired)


def agreement(known: _Known) -> float:
    """Return the chance that flights which agree scatter as much: 1 for one flight alone."""
    from scipy.special import chdtrc

    n_flights = len(known.value)
    if n_flights < 2:
        return 1.0
    weight = 1.0 / known.variance
    mean = float(np.sum(weight * known.value) / np.sum(weight))
    off = np.abs(known.value - mean)
    by_throttle = yaw_by_throttle(mean, known.throttle / _mean_throttle(known))
    off = np.maximum(off - np.where(np.isfinite(by_throttle), by_throttle, 0.0), 0.0)
    return float(chdtrc(n_flights - 1.0, np.sum(weight * off**2)))


def _mean_throttle(known: _Known) -> float:
    """Return the mean throttle of flights that tell it, NaN where none does."""
    told = known.throttle[known.throttle > 0.0]
    return float(told.mean()) if told.size else math.nan


def _shift(one: Series, known: _Known, differs: BoolArray, n_tests: int) -> Shift:
    """Compare the flights that differ with the others, as `compare` does two flights."""
    from scipy.special import ndtr, ndtri

    sides = known.some(~differs), known.some(differs)
    weights = [1.0 / side.variance for side in sides]
    before, after = (
        float(np.average(side.value, weights=weight)) for side, weight in zip(sides, weights, strict=True)
    )
    error = math.sqrt(sum(1.0 / float(np.sum(weight)) for weight in weights))
    by_throttle = float(yaw_by_throttle(before, _mean_throttle(sides[1]) / _mean_throttle(sides[0])))
    by_throttle = by_throttle if math.isfinite(by_throttle) else 0.0
    beyond = max(abs(after - before) - by_throttle, 0.0)
    return Shift(
        name=one.name,
        axis=one.axis,
        before=before,
        after=after,
        margin=-float(ndtri(0.5 * FALSE_ALARMS / max(n_tests, 1))) * error + by_throttle,
        half_width=NORMAL_95 * error,
        p_value=min(2.0 * float(ndtr(-beyond / error)) * n_tests, 1.0),
    )
