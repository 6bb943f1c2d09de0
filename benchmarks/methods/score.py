"""What the benchmark counts: errors and intervals against truths, and how flights of one vehicle repeat."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from benchmarks.methods.data_sets import Kind
from benchmarks.methods.entry import Entry, Estimate, Outcome
from quadid_logs.vocabulary import AXES

#: Numbers of an entry were made from other data if they differ by more: 1 % of a root mean square is
#: hundred times what processors differ by, and less than another seed makes of it.
_SAME_DATA = 0.01
#: The median of the absolute deviations, as the standard deviation of a normal distribution.
_MAD_TO_SIGMA = 1.4826
#: Two flights have one difference, and no spread to speak of.
_FEWEST_FLIGHTS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What is known of a data set.

    Attributes
    ----------
    kind : str
    n_samples : int
    rms : tuple of float
        Of p, q, r, L, M, N.
    truth : mapping of str to float, or None
        On-axis effectiveness by axis.
    vehicle : str
        Flights of one name are of one vehicle in one state.
    """

    kind: Kind
    n_samples: int
    rms: tuple[float, ...]
    truth: Mapping[str, float] | None = None
    vehicle: str = ""


class Error(NamedTuple):
    """An estimate over its truth, less one: NaN where there is none; its interval alike, None without one."""

    data_set: str
    axis: str
    error: float
    interval: tuple[float, float] | None

    @property
    def held(self) -> bool | None:
        """Whether the interval holds the truth; None without an interval."""
        return None if self.interval is None else self.interval[0] <= 0.0 <= self.interval[1]


class Accuracy(NamedTuple):
    """What errors are in sum.

    ``median`` and ``most`` (nine in ten are below) count axes without a number as infinitely wrong. Of the
    intervals: how many, how many hold the truth, their median half width, and their mean interval score
    (Gneiting and Raftery, J. Am. Stat. Assoc. 102, 2007, eq. 43): width plus 40 times what a miss misses by.
    """

    n: int
    answered: int
    median: float
    most: float
    n_intervals: int
    held: int
    half_width: float
    interval_score: float


class Repeated(NamedTuple):
    """How flights of one vehicle agree by one method, over roll and pitch.

    ``answered`` of ``n`` axes have a number; ``spread`` is their robust standard deviation over their
    median, NaN below three flights; of the pairs with intervals, how many agree within both.
    """

    n: int
    answered: int
    spread: float
    n_pairs: int
    agree: int


def is_same_data(outcome: Outcome, facts: Facts) -> bool:
    """Say whether a result was made from the data set as it is.

    Parameters
    ----------
    outcome : Outcome
    facts : Facts

    Returns
    -------
    bool
    """
    alike = np.allclose(outcome.rms, facts.rms, rtol=_SAME_DATA, atol=0.0)
    return outcome.n_samples == facts.n_samples and bool(alike)


def errors(entry: Entry, facts: Mapping[str, Facts], kinds: Sequence[Kind]) -> list[Error]:
    """Return every axis whose truth is known, answered or not.

    Parameters
    ----------
    entry : Entry
    facts : mapping of str to Facts
        By data set.
    kinds : sequence of Kind
        Which data sets count.

    Returns
    -------
    list of Error
    """
    found = []
    for name, known in facts.items():
        if known.truth is None or known.kind not in kinds:
            continue
        found += [_error(name, axis, _of(entry, name, known, axis), known.truth[axis]) for axis in AXES]
    return found


def accuracy(found: Sequence[Error]) -> Accuracy:
    """Return what errors are in sum.

    Parameters
    ----------
    found : sequence of Error

    Returns
    -------
    Accuracy
        Relative to the truth; NaN where nothing is there to count.
    """
    size = np.array([math.inf if math.isnan(each.error) else abs(each.error) for each in found])
    claimed = [each for each in found if each.interval is not None]
    widths = [each.interval[1] - each.interval[0] for each in claimed if each.interval]
    return Accuracy(
        n=len(found),
        answered=int(np.sum(np.isfinite(size))),
        median=float(np.quantile(size, 0.5, method="higher")) if found else math.nan,
        most=float(np.quantile(size, 0.9, method="higher")) if found else math.nan,
        n_intervals=len(claimed),
        held=sum(each.held is True for each in claimed),
        half_width=0.5 * float(np.median(widths)) if claimed else math.nan,
        interval_score=float(np.mean([_interval_score(each) for each in claimed])) if claimed else math.nan,
    )


def repeated(entry: Entry, facts: Mapping[str, Facts], vehicle: str) -> Repeated:
    """Return how the flights of a vehicle agree, over roll and pitch: yaw moves with the throttle.

    Parameters
    ----------
    entry : Entry
    facts : mapping of str to Facts
    vehicle : str

    Returns
    -------
    Repeated
    """
    names = [name for name, known in facts.items() if known.vehicle == vehicle]
    answered, spreads, pairs = 0, [], []
    for axis in ("roll", "pitch"):
        given = [_of(entry, name, facts[name], axis) for name in names]
        estimates = [each for each in given if each is not None]
        values = np.array([each.value for each in estimates])
        answered += len(estimates)
        if len(values) >= _FEWEST_FLIGHTS:
            middle = np.median(values)
            spreads.append(_MAD_TO_SIGMA * np.median(np.abs(values - middle)) / max(abs(middle), 1e-300))
        pairs += [_agree(*pair) for pair in combinations(estimates, 2) if all(each.ci95 for each in pair)]
    return Repeated(
        n=2 * len(names),
        answered=answered,
        spread=float(np.mean(spreads)) if spreads else math.nan,
        n_pairs=len(pairs),
        agree=sum(pairs),
    )


def _of(entry: Entry, name: str, known: Facts, axis: str) -> Estimate | None:
    """Return an entry's estimate, None where it has none from this data."""
    outcome = entry.results.get(name)
    return outcome.axes[axis] if outcome is not None and is_same_data(outcome, known) else None


def _error(name: str, axis: str, given: Estimate | None, truth: float) -> Error:
    if given is None:
        return Error(name, axis, math.nan, None)
    interval = given.ci95 and (given.ci95[0] / truth - 1.0, given.ci95[1] / truth - 1.0)
    return Error(name, axis, given.value / truth - 1.0, interval)


def _interval_score(each: Error) -> float:
    """Return the score of a 95 % interval, smaller is better."""
    assert each.interval is not None
    low, high = each.interval
    return high - low + 2.0 / 0.05 * (max(low, 0.0) + max(-high, 0.0))


def _agree(one: Estimate, other: Estimate) -> bool:
    """Say whether two estimates differ by less than their 95 % intervals allow a difference."""
    assert one.ci95 is not None
    assert other.ci95 is not None
    halves = [0.5 * (high - low) for low, high in (one.ci95, other.ci95)]
    return abs(one.value - other.value) <= math.hypot(*halves)
