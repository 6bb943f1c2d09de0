"""How many axes of a fleet gave a model that can be used, and what blocks the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.sentences import continued
from quadid_logs.untrusted import printable

#: Reasons that are named one by one.
_MOST_REASONS: Final = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """Axes of all analyzed flights by verdict, and the refused ones by their gravest reason (a code)."""

    usable: int
    caution: int
    refused: Counter[str]

    @property
    def n_axes(self) -> int:
        """Axes of all analyzed flights."""
        return self.usable + self.caution + self.refused.total()

    @property
    def is_empty(self) -> bool:
        """Whether flights were analyzed and no axis of any can be used."""
        return self.n_axes > 0 and self.usable + self.caution == 0


def coverage_of(axes: Iterable[tuple[str, Iterable[str], int]]) -> Coverage:
    """Count axes.

    Parameters
    ----------
    axes : iterable of (verdict, reasons, count)
        Reasons are codes, the gravest first.
    """
    counts: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    for verdict, reasons, count in axes:
        if verdict == "refused":
            refused[next(iter(reasons), "")] += count
        else:
            counts[verdict] += count
    return Coverage(usable=counts["usable"], caution=counts["caution"], refused=refused)


def coverage_words(coverage: Coverage) -> str:
    """Return in one line how many axes are usable and what blocks the others.

    Examples
    --------
    >>> coverage_words(coverage_of([("usable", (), 2), ("refused", ("QL303", "QL403"), 1)]))
    '2 of 3 axes are usable; 1 is refused: logged too slowly to identify anything (QL303) on 1.'
    """
    if not coverage.n_axes:
        return "No log could be analyzed."
    n_refused = coverage.refused.total()
    fit = (
        f"{coverage.usable} of {coverage.n_axes} axes are usable"
        if coverage.usable
        else f"No axis of {coverage.n_axes} is usable"
    )
    caution = f", {coverage.caution} can be used with caution" if coverage.caution else ""
    if not n_refused:
        return f"{fit}{caution}."
    # By code where counts are equal: store and page count in different orders, and must name the same.
    first = sorted(coverage.refused.items(), key=lambda one: (-one[1], one[0]))[:_MOST_REASONS]
    reasons = [
        f"{continued(CATALOGUE[code].title)} ({code}) on {count}"
        if code in CATALOGUE
        else f"{printable(code, 20) or 'without a reason'} on {count}"
        for code, count in first
    ]
    others = n_refused - sum(count for _, count in first)
    if others:
        reasons.append(f"other reasons on {others}")
    return f"{fit}{caution}; {n_refused} {'is' if n_refused == 1 else 'are'} refused: {', '.join(reasons)}."
