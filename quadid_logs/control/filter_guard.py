"""Whether filters are worth changing: where flights with them end, and what the next one bears."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

from quadid_logs.control.filter_design import MOST_LOST, WORTH, Together
from quadid_logs.data.tuning import AxisTuning
from quadid_logs.diagnose.findings import finding


class Refiltered(NamedTuple):
    """The next flight of an axis with filters and gains, and what these bring in the end.

    ``in_the_end`` is what gust error and noise are at the target of gains and filters, against gains alone
    (`filter_design.together`).
    """

    tuning: AxisTuning
    in_the_end: Together


def is_no_worse(filtered: Refiltered, alone: AxisTuning) -> bool:
    """Tell whether an axis loses nothing in the end, and the next flight is no step back.

    Filters that change take some of what a controller may change in one flight, so the next flight is held
    against the flown one, and not against gains alone. What nobody can tell counts as more gust error.

    Parameters
    ----------
    filtered : Refiltered
        With filters and gains.
    alone : AxisTuning
        The next flight with gains alone, under the same limits, which may have more gust error than flew.
    """
    # An axis that is refused stays as it flew.
    most = 1.0 if alone.verdict == "refused" else max(1.0, alone.attitude_error)
    return filtered.in_the_end.lost <= MOST_LOST and filtered.tuning.attitude_error <= most


def are_worth_it(together: Iterable[Refiltered]) -> bool:
    """Tell whether filters that change together bring as much in the end as a change of gains is to bring."""
    return sum(one.in_the_end.won for one in together) <= -WORTH


def with_flown_filters(axis: str, alone: AxisTuning) -> AxisTuning:
    """Return gains alone, and say that the filters stay.

    Returns
    -------
    AxisTuning
        A refused axis as it is: it says why.
    """
    if alone.verdict == "refused":
        return alone
    return replace(alone, reasons=(*alone.reasons, finding("QL674", "info", {}, axes=(axis,))))
