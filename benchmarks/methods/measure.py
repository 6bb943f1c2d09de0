"""A data set -> what each method that is installed gave on it."""

from __future__ import annotations

import time
import warnings
from typing import NamedTuple

import numpy as np

from benchmarks.methods.data_sets import DataSet, Source, load
from benchmarks.methods.entrants import ENTRANTS, Entrant
from benchmarks.methods.entry import Outcome
from benchmarks.methods.score import Facts
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES


class Measured(NamedTuple):
    """A data set with what each method gave; None where no flight is in it."""

    name: str
    facts: Facts | None
    outcomes: dict[str, Outcome]
    problems: list[str]


def measure(source: Source) -> Measured:
    """Let every method estimate from a data set; one that breaks down gives no number."""
    data_set = load(source)
    if data_set is None:
        return Measured(source.name, None, {}, [])
    truth = None
    if data_set.truth is not None:
        truth = dict(zip(AXES, map(float, data_set.truth.effectiveness), strict=True))
    facts = Facts(
        kind=source.kind,
        n_samples=data_set.n_samples,
        rms=data_set.rms,
        truth=truth,
        vehicle=source.vehicle,
    )
    outcomes, problems = {}, []
    for entrant in ENTRANTS:
        if entrant.is_installed:
            outcomes[entrant.name], problem = _outcome(entrant, data_set)
            problems += [problem] if problem else []
    return Measured(source.name, facts, outcomes, problems)


def _outcome(entrant: Entrant, data_set: DataSet) -> tuple[Outcome, str]:
    """Return what a method gave, and what it raised."""
    problem, estimates = "", (None, None, None)
    began = time.process_time()
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # theirs: collinear columns, deprecations
        try:
            estimates = entrant.run(data_set)
        except Exception as error:  # noqa: BLE001 - whatever a package raises, the others go on
            problem = printable(f"{entrant.name}: {type(error).__name__}: {error}")
    outcome = Outcome(
        n_samples=data_set.n_samples,
        rms=data_set.rms,
        seconds=time.process_time() - began,
        axes=dict(zip(AXES, estimates, strict=True)),
    )
    return outcome, problem
